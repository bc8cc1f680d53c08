//! Rays per second of each backend on one thread: `cargo bench --bench rays`.
//!
//! There are no calls of the library behind `embree` to compare with: they need `unsafe`, which only the backend has. Its
//! single rays differ from raw calls by the checks of the segment's ends.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use embrace::accel::{Accel, BuildOptions, Ray};
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

fn backend<A: Accel>(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group(A::NAME);
    group.sample_size(20);
    for name in ["cornell", "spheres"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
        let desc = load(&path, LoadOptions::default()).expect("the scene is in the repository");
        let scene = Scene::build(desc, SceneOptions::default()).expect("the scene can be built");
        let accel = A::build(&scene.geometry, BuildOptions::default()).expect("the backend builds");
        for (kind, rays) in ["camera", "bounce"].iter().zip(camera_and_bounce(&scene, &accel)) {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_function(format!("{name}, {kind}, closest"), |b| {
                b.iter(|| rays.iter().filter(|ray| accel.intersect(ray).is_some()).count());
            });
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
        }
    }
    group.finish();
}

fn backends(criterion: &mut Criterion) {
    #[cfg(feature = "embree")]
    backend::<embrace::accel::embree::Embree>(criterion);
    #[cfg(feature = "obvhs")]
    backend::<embrace::accel::obvhs::Obvhs>(criterion);
}

criterion_group!(rays, backends);
criterion_main!(rays);
