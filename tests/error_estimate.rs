//! What a render says of its own error, against what its error is.

mod support;

use embrace::accel::Accel;
use embrace::error::{ErrorEstimate, Interval, estimate};
use embrace::film::Rect;
use embrace::integrator::Settings;
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{LoadOptions, SceneOptions, load};
use rayon::prelude::*;
use std::path::Path;
use support::{Prepared, for_each_backend};

for_each_backend! { but not brute:
    the_true_error_lies_in_the_interval_as_often_as_stated
}

const SEEDS: u64 = 100;

/// A scene of the repository, at this size.
fn prepare<A: Accel>(name: &str, resolution: [u32; 2]) -> Prepared<A> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
    let mut desc = load(&path, LoadOptions::default()).unwrap();
    desc.camera.resolution = resolution;
    Prepared::new(
        desc,
        SceneOptions {
            mis: true,
            ..SceneOptions::default()
        },
    )
}

/// The mean of every pixel, and the estimate of the error.
fn run<A: Accel>(prepared: &Prepared<A>, seed: u64, spp: u32, error: ErrorControl) -> (Vec<[f64; 3]>, ErrorEstimate) {
    let [x1, y1] = prepared.scene.camera.resolution();
    let job = Job {
        crop: Rect { x0: 0, y0: 0, x1, y1 },
        spp,
        error,
        settings: Settings {
            seed,
            ..Settings::default()
        },
    };
    let (film, _) = render(&prepared.scene, &prepared.accel, prepared.kernel, &job);
    let estimate = estimate(&film).expect("two samples a pixel");
    (film.means(), estimate)
}

fn the_true_error_lies_in_the_interval_as_often_as_stated<A: Accel>() {
    let spps: Vec<u32> = std::env::var("SPPS")
        .unwrap_or("16".into())
        .split(',')
        .map(|s| s.parse().unwrap())
        .collect();
    let names = std::env::var("NAMES").unwrap_or("cornell,glass,many-lights,spheres,veach-mis,furnace".into());
    for name in names.split(',') {
        for &spp in &spps {
            let prepared = prepare::<A>(name, [80, 60]);
            let runs: Vec<_> = (0..SEEDS)
                .into_par_iter()
                .map(|seed| run(&prepared, seed, spp, ErrorControl::Ignored))
                .collect();
            let n = runs.len() as f64;
            let pixels = runs[0].0.len();
            let mean: Vec<[f64; 3]> = (0..pixels)
                .map(|i| [0, 1, 2].map(|c| runs.iter().map(|r| r.0[i][c]).sum::<f64>() / n))
                .collect();
            // The reference is the mean of all runs: the error against it is smaller by (n - 1) / n on average.
            for (what, weight, of) in [
                (
                    "relmse",
                    (|m: f64| 1.0 / (m * m + 0.01)) as fn(f64) -> f64,
                    (|e: &ErrorEstimate| e.relmse) as fn(&ErrorEstimate) -> Interval,
                ),
                ("mse", |_| 1.0, |e| e.mse),
            ] {
                let errors: Vec<f64> = runs
                    .iter()
                    .map(|(image, _)| {
                        let sum: f64 = image
                            .iter()
                            .zip(&mean)
                            .map(|(a, m)| (0..3).map(|c| weight(m[c]) * (a[c] - m[c]).powi(2)).sum::<f64>())
                            .sum();
                        sum / (3 * pixels) as f64 * n / (n - 1.0)
                    })
                    .collect();
                let inside = errors
                    .iter()
                    .zip(&runs)
                    .filter(|(e, r)| (of(&r.1).low..=of(&r.1).high).contains(e))
                    .count();
                let below = errors.iter().zip(&runs).filter(|(e, r)| **e < of(&r.1).low).count();
                let mean_error = errors.iter().sum::<f64>() / n;
                let sd = (errors.iter().map(|e| (e - mean_error).powi(2)).sum::<f64>() / n).sqrt() / mean_error;
                let mean_estimate = runs.iter().map(|r| of(&r.1).value).sum::<f64>() / n;
                let sd_e = (runs
                    .iter()
                    .map(|r| (of(&r.1).value - mean_estimate).powi(2))
                    .sum::<f64>()
                    / n)
                    .sqrt()
                    / mean_estimate;
                let mut widths: Vec<f64> = runs.iter().map(|r| of(&r.1).high / of(&r.1).value).collect();
                widths.sort_by(f64::total_cmp);
                println!(
                    "{} {name} {spp} {what}: inside {inside} (true below {below}), mean error {mean_error:.3e} sd {sd:.3}, estimate/error {:.3} sd {sd_e:.3}, width {:.3}",
                    A::NAME,
                    mean_estimate / mean_error,
                    widths[widths.len() / 2]
                );
            }
        }
    }
}
