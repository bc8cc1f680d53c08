//! Rendering allocates at the start of a pass over the image, and nothing for a path or a ray.

mod support;

use embrace::accel::{Accel, BuildOptions};
use embrace::film::Rect;
use embrace::integrator::{KernelChoice, Settings, kernel_for};
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{LoadOptions, Scene, SceneOptions, load};
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::path::Path;
use std::sync::Mutex;
use support::for_each_backend;

for_each_backend! { but not brute:
    samples_allocate_nothing
}

/// Counts what Rust allocates. A library in C is not seen.
#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// The count is of all threads: one test at a time.
static ALONE: Mutex<()> = Mutex::new(());

const THREADS: usize = 2;

/// Allocations of a thread in a pass: the arrays of its batch, each of which grows a few times.
const PER_THREAD_AND_PASS: usize = 200;

/// Allocations of a render.
fn allocations<A: Accel>(scene: &Scene, accel: &A, spp: u32) -> usize {
    let [x1, y1] = scene.camera.resolution();
    let crop = Rect { x0: 0, y0: 0, x1, y1 };
    let settings = Settings::default();
    let job = Job {
        crop,
        spp,
        error: ErrorControl::Ignored,
        split_direct: false,
        settings,
    };
    let kernel = kernel_for(scene, KernelChoice::Auto);
    let region = Region::new(ALLOCATOR);
    let (_, report) = render(scene, accel, kernel, &job);
    let change = region.change();
    assert_eq!(report.paths, crop.pixels() * u64::from(spp));
    change.allocations + change.reallocations
}

fn samples_allocate_nothing<A: Accel>() {
    let _alone = ALONE.lock();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(THREADS).build().unwrap();
    pool.install(|| {
        for name in ["cornell", "spheres", "many-lights", "glass"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
            let mut desc = load(&path, LoadOptions::default()).unwrap();
            desc.camera.resolution = [64, 48];
            let scene = Scene::build(desc, SceneOptions::default()).unwrap();
            let accel = A::build(&scene.geometry, BuildOptions::default()).unwrap();
            // Tables that are made on first use.
            allocations(&scene, &accel, 1);
            let [few, many] = [16, 64].map(|spp| allocations(&scene, &accel, spp));
            // Passes of 1, 1, 2, 4 and 8 samples, then of 16.
            let passes = 3;
            let bound = few + passes * THREADS * PER_THREAD_AND_PASS;
            println!("{} {name}: {few} allocations, then {many}; at most {bound}", A::NAME);
            assert!(many <= bound, "{} {name}: {few}, then {many}", A::NAME);
        }
    });
}
