//! Rendering a film: tiles × samples on the threads of the current rayon pool.

use crate::accel::Accel;
use crate::film::{Film, Rect, Tile};
use crate::integrator::{Batch, Kernel, RayCounts, SampleId, Settings};
use crate::light::Environment;
use crate::scene::Scene;
use serde::Serialize;
use std::iter;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Most samples of a pixel between two looks at the rest of the image: bounds what an interruption waits for, and how
/// uneven the image is that it leaves.
const MAX_PASS: u32 = 16;

/// What to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Job {
    /// Part of the image.
    pub crop: Rect,
    /// Samples of every pixel.
    pub spp: u32,
    /// The estimator.
    pub settings: Settings,
}

/// Samples left out of the film because they were NaN or infinite: each counts as black.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DroppedSamples {
    /// How many.
    pub count: u64,
    /// The first of them, by sample, row and column: enough to compute it again.
    pub first: Option<SampleId>,
}

/// What a render did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RenderReport {
    /// Rays by purpose.
    pub rays: RayCounts,
    /// Samples that were not finite.
    pub dropped: DroppedSamples,
    /// Camera paths traced.
    pub paths: u64,
}

impl RenderReport {
    fn plus(self, other: RenderReport) -> RenderReport {
        RenderReport {
            rays: self.rays.plus(other.rays),
            dropped: DroppedSamples {
                count: self.dropped.count + other.dropped.count,
                first: self.dropped.first.into_iter().chain(other.dropped.first).min(),
            },
            paths: self.paths + other.paths,
        }
    }
}

/// Renders `job` into a film. Samples are taken in passes over the whole image, each pixel's in ascending order, so that
/// the film is the same for any number of threads.
///
/// `stop` is asked before every tile; once it says yes, what is done is returned. `progress` is told the number of paths
/// traced so far, from any thread.
pub fn render<A: Accel>(
    scene: &Scene,
    accel: &A,
    kernel: Kernel,
    job: &Job,
    stop: &(dyn Fn() -> bool + Sync),
    progress: &(dyn Fn(u64) + Sync),
) -> (Film, RenderReport) {
    render_passes(scene, accel, kernel, job, stop, progress, &mut |_| ())
}

/// The same, and shows the film to `after_pass` whenever all pixels have equally many samples: after the first, the second,
/// the fourth and so on, but the last.
///
/// # Panics
/// If the scene was built for multiple importance sampling ([`crate::scene::SceneOptions::mis`]) and the settings are without:
/// light would be missing.
pub fn render_passes<A: Accel>(
    scene: &Scene,
    accel: &A,
    kernel: Kernel,
    job: &Job,
    stop: &(dyn Fn() -> bool + Sync),
    progress: &(dyn Fn(u64) + Sync),
    after_pass: &mut dyn FnMut(&Film),
) -> (Film, RenderReport) {
    let needs_mis = scene.lights.environment().is_some_and(Environment::is_compensated);
    assert!(
        job.settings.mis || !needs_mis,
        "the scene was built for multiple importance sampling"
    );
    let mut film = Film::new(job.crop);
    let mut report = RenderReport::default();
    let done = AtomicU64::new(0);
    let mut start = 0;
    while start < job.spp && !stop() {
        // 1, 1, 2, 4, ...: a first look at once, then longer passes.
        let pass = start.clamp(1, MAX_PASS).min(job.spp - start);
        let render_tile = |batch: &mut Batch, tile: &mut Tile| {
            let mut report = RenderReport::default();
            if stop() {
                return report;
            }
            let mut samples = tile.rect.blocks().flat_map(|block| {
                (start..start + pass)
                    .flat_map(move |sample| block.coordinates().map(move |(x, y)| SampleId { sample, y, x }))
            });
            while batch.fill(&mut samples) {
                kernel.trace(scene, accel, &job.settings, batch, &mut report.rays);
                for (id, radiance) in batch.results() {
                    if radiance.is_finite() {
                        tile.add(id.x, id.y, radiance);
                    } else {
                        report.dropped.count += 1;
                        report.dropped.first = Some(report.dropped.first.map_or(id, |first| first.min(id)));
                    }
                }
            }
            tile.samples += pass;
            report.paths = tile.rect.pixels() * u64::from(pass);
            progress(done.fetch_add(report.paths, Ordering::Relaxed) + report.paths);
            report
        };
        // Tile by tile, as threads become free: halves of the image would differ too much in cost.
        let tiles = Mutex::new(film.tiles_mut().iter_mut());
        let next = || tiles.lock().unwrap_or_else(PoisonError::into_inner).next();
        let reports = rayon::broadcast(|_| {
            let mut batch = Batch::default();
            iter::from_fn(next)
                .map(|tile| render_tile(&mut batch, tile))
                .fold(RenderReport::default(), RenderReport::plus)
        });
        report = reports.into_iter().fold(report, RenderReport::plus);
        start += pass;
        if start < job.spp && !stop() {
            after_pass(&film);
        }
    }
    (film, report)
}
