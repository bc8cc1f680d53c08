//! Samples by error: the mean of the image stays right, and the error becomes what was asked for.

mod support;

use embrace::accel::Accel;
use embrace::adaptive::NoiseTarget;
use embrace::error::estimate;
use embrace::film::{Film, Rect};
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::math::Rgb;
use embrace::render::{ErrorControl, Job, render};
use rayon::prelude::*;
use support::{Prepared, Significance, Summary, assert_same_images, for_each_backend, scene_of_repository};

for_each_backend! { but not brute:
    samples_by_error_leave_every_pixel_unbiased
    samples_by_error_reach_the_target_with_fewer_paths
}

fn film<A: Accel>(prepared: &Prepared<A>, seed: u64, spp: u32, error: ErrorControl) -> (Film, u64) {
    let [x1, y1] = prepared.scene.camera.resolution();
    let job = Job {
        crop: Rect { x0: 0, y0: 0, x1, y1 },
        spp,
        error,
        split_direct: false,
        settings: Settings {
            seed,
            ..Settings::default()
        },
    };
    let (film, report) = render(&prepared.scene, &prepared.accel, prepared.kernel, &job);
    (film, report.paths)
}

fn bounded(relative_rmse: f64, min_spp: u32) -> ErrorControl {
    ErrorControl::Bounded(NoiseTarget { relative_rmse, min_spp })
}

/// From very few samples on, where a decision that looked at the samples it is about would show most.
fn samples_by_error_leave_every_pixel_unbiased<A: Accel>() {
    for (name, target) in [("glass", 0.3), ("spheres", 0.25)] {
        let prepared = scene_of_repository::<A>(name, [40, 30]);
        let runs: Vec<Film> = (0..64)
            .into_par_iter()
            .map(|seed| film(&prepared, seed, 4096, bounded(target, 4)).0)
            .collect();
        let (fewest, most) = runs
            .iter()
            .map(Film::sample_range)
            .fold((u32::MAX, 0), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        println!("{} {name}: {fewest} to {most} samples", A::NAME);
        assert!(most > 4 * fewest, "samples are spread evenly: {fewest} to {most}");
        let images: Vec<Image<Rgb>> = runs.iter().map(Film::develop).collect();
        let evenly: Vec<Image<Rgb>> = (1000..1064)
            .into_par_iter()
            .map(|seed| film(&prepared, seed, 128, ErrorControl::Ignored).0.develop())
            .collect();
        let name = format!("adaptive-{}-{name}", A::NAME);
        assert_same_images(&name, &Summary::of(&images), &Summary::of(&evenly), Significance(1e-4));
    }
}

fn samples_by_error_reach_the_target_with_fewer_paths<A: Accel>() {
    let prepared = scene_of_repository::<A>("cornell", [64, 48]);
    let target = 0.04;
    let (adaptive, paths) = film(&prepared, 3, 4096, bounded(target, 16));
    let reached = estimate(&adaptive).unwrap().relative_rmse().value;
    assert!(reached <= target && reached > 0.95 * target, "{reached}");
    // As many paths, spread evenly.
    let (evenly, _) = film(&prepared, 4, (paths / (64 * 48)) as u32, ErrorControl::Ignored);
    let of_even = estimate(&evenly).unwrap().relative_rmse().value;
    println!("{}: {reached:.4} by error, {of_even:.4} evenly, {paths} paths", A::NAME);
    assert!(reached < of_even, "{reached} by error, {of_even} evenly");
}
