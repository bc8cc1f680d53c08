//! The parts of the renderer one by one, so that a regression shows where it is: `cargo bench --bench parts`.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use embrace::accel::triangle::{Corners, TriangleRay};
use embrace::accel::{Geometry, Hit, Placement, Ray};
use embrace::bsdf::{Bsdf, Conductor, Dielectric, Diffuse, Plastic};
use embrace::image::Image;
use embrace::interaction::{SurfaceInteraction, offset_point};
use embrace::light::{EnvSampling, Environment};
use embrace::math::{Rgb, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::sampling::AliasTable;
use embrace::scene::{LoadOptions, Scene, SceneOptions, load, obj};
use std::fmt::Write;
use std::hint::black_box;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// A step of SplitMix64.
fn random(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// In [0, 1).
fn unit(state: &mut u64) -> f32 {
    (random(state) >> 40) as f32 / 16_777_216.0
}

fn direction(state: &mut u64) -> Vec3 {
    let mut signed = || 2.0 * unit(state) - 1.0;
    Vec3::new(signed(), signed(), signed())
        .try_normalize()
        .unwrap_or(Vec3::Y)
}

fn alias(criterion: &mut Criterion) {
    let mut state = 1;
    for slots in [1 << 10, 1 << 21] {
        let weights: Vec<f64> = (0..slots).map(|_| f64::from(unit(&mut state)).powi(4)).collect();
        let table = AliasTable::new(weights.iter().copied()).expect("there are weights");
        criterion.bench_function(&format!("alias sample, {slots} slots"), |b| {
            b.iter(|| table.sample(random(&mut state)));
        });
    }
}

fn environment(criterion: &mut Criterion) {
    let mut state = 2;
    let (width, height) = (1024, 512);
    let pixels = (0..width * height)
        .map(|_| Rgb::splat(unit(&mut state).powi(8)))
        .collect();
    let image = Image { width, height, pixels };
    let map = Environment::from_map(&image, 1.0, 30.0, EnvSampling::Importance).expect("the image has pixels");
    criterion.bench_function("environment lookup", |b| b.iter(|| map.eval(direction(&mut state))));
    criterion.bench_function("environment sample", |b| {
        b.iter(|| {
            let texel = map.choose_texel(random(&mut state));
            map.lookup(&map.sample(texel, [unit(&mut state), unit(&mut state)]))
        });
    });
}

fn bsdfs(criterion: &mut Criterion) {
    let (eta, k) = (Rgb::new(0.2, 0.9, 1.1), Rgb::new(3.9, 2.5, 2.4));
    let reflectance = Rgb::splat(0.5);
    let mut state = 3;
    for (name, bsdf) in [
        ("diffuse", Bsdf::Diffuse(Diffuse { reflectance })),
        ("mirror", Bsdf::Mirror(reflectance)),
        ("conductor", Bsdf::Conductor(Conductor { eta, k, alpha: 0.2 })),
        (
            "smooth dielectric",
            Bsdf::Dielectric(Dielectric { eta: 1.5, alpha: 0.0 }),
        ),
        (
            "rough dielectric",
            Bsdf::Dielectric(Dielectric { eta: 1.5, alpha: 0.2 }),
        ),
        (
            "plastic",
            Bsdf::Plastic(Plastic {
                reflectance,
                specular: Rgb::splat(0.04),
                alpha: 0.2,
            }),
        ),
    ] {
        criterion.bench_function(&format!("bsdf sample, {name}"), |b| {
            b.iter(|| {
                let mut wo = direction(&mut state);
                wo.z = wo.z.abs();
                black_box(&bsdf).sample(wo, unit(&mut state), [unit(&mut state), unit(&mut state)])
            });
        });
        criterion.bench_function(&format!("bsdf eval, {name}"), |b| {
            b.iter(|| black_box(&bsdf).eval(direction(&mut state), direction(&mut state)));
        });
    }
}

fn rays(criterion: &mut Criterion) {
    let mut state = 4;
    let corners = [
        Vec3::new(-1.0, -1.0, 2.0),
        Vec3::new(1.0, -1.0, 2.0),
        Vec3::new(0.0, 1.0, 2.0),
    ];
    criterion.bench_function("ray offset", |b| {
        b.iter(|| offset_point(black_box(corners[0]), black_box(1e-6), black_box(Vec3::Z)));
    });
    let mesh = TriangleMesh {
        positions: corners.to_vec(),
        indices: vec![[0, 1, 2]],
        ..TriangleMesh::default()
    };
    let geometry = Geometry {
        meshes: vec![Arc::new(mesh)],
        placements: vec![Placement {
            mesh: 0,
            to_world: None,
        }],
    };
    let ray = Ray::new(Vec3::ZERO, Vec3::Z);
    let hit = Hit {
        t: 2.0,
        placement: 0,
        triangle: 0,
        u: 0.25,
        v: 0.5,
    };
    criterion.bench_function("shading data and a ray from there", |b| {
        b.iter(|| {
            SurfaceInteraction::new::<false>(&geometry, &ray, black_box(&hit), true)
                .map(|si| si.spawn_ray(black_box(Vec3::NEG_Z), false))
        });
    });
    let triangle = Corners::from(corners);
    criterion.bench_function("triangle test, one in four hits", |b| {
        b.iter(|| {
            let target = Vec3::new(2.0 * unit(&mut state) - 1.0, 2.0 * unit(&mut state) - 1.0, 1.0);
            TriangleRay::new(&Ray::new(Vec3::ZERO, target))?.intersect(black_box(&triangle), f32::INFINITY)
        });
    });
}

/// A square grid of two triangles a cell.
fn grid_obj(cells: usize) -> String {
    let mut text = String::new();
    let n = cells + 1;
    for i in 0..n * n {
        let (x, y) = (i % n, i / n);
        let _ = writeln!(
            text,
            "v {:.5} {:.5} {:.5}",
            x as f32 * 0.01,
            (x * y % 7) as f32 * 0.001,
            y as f32 * 0.01
        );
    }
    for i in (0..n * cells).filter(|i| i % n < cells) {
        let (a, b, c, d) = (i + 1, i + 2, i + n + 1, i + n + 2);
        let _ = writeln!(text, "f {a} {c} {b}\nf {b} {c} {d}");
    }
    text
}

fn scenes(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("scenes");
    group.sample_size(10);
    let text = grid_obj(200);
    group.throughput(Throughput::Bytes(text.len() as u64));
    group.bench_function("obj, 80,000 triangles", |b| {
        b.iter(|| {
            let missing = |_: &str| Err(io::Error::from(io::ErrorKind::NotFound));
            obj::read(Path::new("grid.obj"), text.as_bytes(), missing).expect("the text is a mesh")
        });
    });
    drop(text);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/spheres/spheres.toml");
    let desc = load(&path, LoadOptions::default()).expect("the scene is in the repository");
    group.throughput(Throughput::Elements(1));
    group.bench_function("scene build, spheres", |b| {
        b.iter_batched(
            || desc.clone(),
            |desc| Scene::build(desc, SceneOptions::default()).expect("the scene can be built"),
            BatchSize::PerIteration,
        );
    });
}

criterion_group!(parts, alias, environment, bsdfs, rays, scenes);
criterion_main!(parts);
