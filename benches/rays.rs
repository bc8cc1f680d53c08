//! Rays per second of each backend on one thread, beside single calls of Embree and the list of scenes with few triangles:
//! `cargo bench --bench rays`.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use embrace::accel::{Accel, BuildOptions, BuildQuality, Intersector, Ray};
use embrace::math::Vec3;
use embrace::scene::{LoadOptions, Scene, SceneOptions, load};
use std::path::Path;

const RAYS: usize = 1 << 14;

/// Camera rays in blocks of 4 x 4 pixels, and rays from what they hit, in directions that have nothing in common.
fn camera_and_bounce(scene: &Scene, accel: &impl Accel) -> [Vec<Ray>; 2] {
    let [width, height] = scene.camera.resolution();
    let blocks = (width / 4).min(32);
    let camera: Vec<Ray> = (0..RAYS as u32)
        .map(|i| {
            let (block, pixel) = (i / 16, i % 16);
            let x = (block % blocks * 4 + pixel % 4) % width;
            let y = (block / blocks * 4 + pixel / 4) % height;
            scene.camera.ray(x, y, [0.5, 0.5], [0.5, 0.5])
        })
        .collect();
    let bounce = camera.iter().enumerate().filter_map(|(i, ray)| {
        let hit = accel.intersect(ray)?;
        // A golden-angle spiral over the sphere.
        let (z, phi) = (1.0 - 2.0 * ((i as f32 * 0.618_034).fract()), i as f32 * 2.399_963);
        let r = (1.0 - z * z).max(0.0).sqrt();
        let direction = Vec3::new(r * phi.cos(), r * phi.sin(), z);
        Some(Ray::new(
            ray.origin + ray.direction * (hit.t * 0.999),
            direction.normalize(),
        ))
    });
    let bounce = bounce.collect();
    [camera, bounce]
}

/// `raw` is what the library behind the backend finds without it.
fn backend<A: Accel>(criterion: &mut Criterion, raw: Option<fn(&A, &Ray) -> f32>) {
    let mut group = criterion.benchmark_group(A::NAME);
    group.sample_size(20);
    for name in ["cornell", "spheres"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
        let desc = load(&path, LoadOptions::default()).expect("the scene is in the repository");
        let scene = Scene::build(desc, SceneOptions::default()).expect("the scene can be built");
        let build = |quality| {
            let options = BuildOptions {
                quality,
                ..BuildOptions::default()
            };
            A::build(&scene.geometry, options).expect("the backend builds")
        };
        let accel = build(BuildQuality::Medium);
        let chosen = BuildQuality::for_paths(u64::MAX, scene.triangles(), Intersector::Robust);
        let listed = (chosen == BuildQuality::List).then(|| build(chosen));
        for (kind, rays) in ["camera", "bounce"].iter().zip(camera_and_bounce(&scene, &accel)) {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_function(format!("{name}, {kind}, closest"), |b| {
                b.iter(|| rays.iter().filter(|ray| accel.intersect(ray).is_some()).count());
            });
            if let Some(raw) = raw {
                group.bench_function(format!("{name}, {kind}, closest, library alone"), |b| {
                    b.iter(|| rays.iter().filter(|ray| raw(&accel, ray).is_finite()).count());
                });
            }
            let mut hits = Vec::with_capacity(RAYS);
            group.bench_function(format!("{name}, {kind}, closest, together"), |b| {
                b.iter(|| {
                    hits.clear();
                    rays.chunks(16)
                        .for_each(|rays| accel.intersect_coherent(rays, &mut hits));
                    hits.len()
                });
            });
            let mut occluded = Vec::with_capacity(RAYS);
            group.bench_function(format!("{name}, {kind}, any, together"), |b| {
                b.iter(|| {
                    occluded.clear();
                    accel.occluded_many(&rays, &mut occluded);
                    occluded.len()
                });
            });
            if let Some(list) = listed.as_ref().and_then(A::list) {
                group.bench_function(format!("{name}, {kind}, closest, list"), |b| {
                    b.iter(|| {
                        hits.clear();
                        list.intersect(&rays, &mut hits);
                        hits.len()
                    });
                });
                group.bench_function(format!("{name}, {kind}, any, list"), |b| {
                    b.iter(|| {
                        occluded.clear();
                        list.occluded(&rays, &mut occluded);
                        occluded.len()
                    });
                });
            }
        }
    }
    group.finish();
}

fn backends(criterion: &mut Criterion) {
    #[cfg(feature = "embree")]
    backend(criterion, Some(embrace::accel::embree::Embree::distance_unchecked));
    #[cfg(feature = "obvhs")]
    backend::<embrace::accel::obvhs::Obvhs>(criterion, None);
}

criterion_group!(rays, backends);
criterion_main!(rays);
