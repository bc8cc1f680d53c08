//! Rendering a film: tiles × samples on the threads of the current rayon pool.

use crate::accel::Accel;
use crate::adaptive::{NoiseTarget, Planner};
use crate::film::{Film, Rect, Tile};
use crate::integrator::{Batch, Kernel, RayCounts, SampleId, Settings};
use crate::light::Environment;
use crate::math::Rgb;
use crate::scene::Scene;
use serde::Serialize;
use std::iter;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Most samples of a pixel between two looks at the rest of the image: bounds what an interruption waits for, and how
/// uneven the image is that it leaves.
const MAX_PASS: u32 = 16;

/// Edge length in pixels of the cells that samples go to by their error: that of the blocks by which camera rays are traced.
const CELL_SIZE: u32 = 4;

/// What to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Job {
    /// Part of the image.
    pub crop: Rect,
    /// Samples of every pixel; with [`ErrorControl::Bounded`] the most that any pixel gets.
    pub spp: u32,
    /// What is done about the error.
    pub error: ErrorControl,
    /// Whether the film tells direct light apart ([`Film::map_parts`]).
    pub split_direct: bool,
    /// The estimator.
    pub settings: Settings,
}

/// What is done about the error of the image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ErrorControl {
    /// Nothing: every pixel gets the same number of samples.
    #[default]
    Ignored,
    /// Samples go where the error is until the image is as good as this.
    Bounded(NoiseTarget),
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

/// How to follow a render and to end it.
pub struct Watch<'a> {
    /// Asked between batches of paths, from any thread; once it says yes, what is done is returned.
    pub stop: &'a (dyn Fn() -> bool + Sync),
    /// Told, from any thread, how many paths have been traced and how many there will be, as far as is known.
    pub progress: &'a (dyn Fn(u64, u64) + Sync),
    /// Shown the film after each pass over the image but the last.
    pub after_pass: &'a mut dyn FnMut(&Film),
}

/// Renders `job` to its end into a film. See [`render_watched`].
pub fn render<A: Accel>(scene: &Scene, accel: &A, kernel: Kernel, job: &Job) -> (Film, RenderReport) {
    let watch = Watch {
        stop: &|| false,
        progress: &|_, _| (),
        after_pass: &mut |_| (),
    };
    render_watched(scene, accel, kernel, job, watch)
}

/// Renders `job` into a film. Samples are taken in passes over the whole image, each pixel's in ascending order, so that
/// the film is the same for any number of threads.
///
/// # Panics
/// If the scene was built for multiple importance sampling ([`crate::scene::SceneOptions::mis`]) and the settings are without:
/// light would be missing. If the error is bounded and the sampler does not tell it
/// ([`crate::sampling::SamplerKind::has_independent_halves`]).
pub fn render_watched<A: Accel>(
    scene: &Scene,
    accel: &A,
    kernel: Kernel,
    job: &Job,
    watch: Watch<'_>,
) -> (Film, RenderReport) {
    let needs_mis = scene.lights.environment().is_some_and(Environment::is_compensated);
    assert!(
        job.settings.mis || !needs_mis,
        "the scene was built for multiple importance sampling"
    );
    assert!(
        job.error == ErrorControl::Ignored || job.settings.sampler.has_independent_halves(),
        "the sampler does not tell the error that is to be bounded"
    );
    let (mut film, mut planner) = match job.error {
        ErrorControl::Ignored => (Film::new(job.crop), None),
        ErrorControl::Bounded(target) => {
            let film = Film::with_cells(job.crop, CELL_SIZE);
            let planner = Planner::new(target, job.spp);
            (film, Some(planner))
        }
    };
    if job.split_direct {
        film = film.split_direct();
    }
    let mut report = RenderReport::default();
    let done = AtomicU64::new(0);
    loop {
        let expected = match &mut planner {
            None => plan_evenly(&mut film, job.spp),
            Some(planner) => planner.plan(&mut film),
        };
        let Some(expected) = expected else { break };
        if (watch.stop)() {
            break;
        }
        if report.paths > 0 {
            (watch.after_pass)(&film);
        }
        let tracer = Tracer {
            scene,
            accel,
            kernel,
            settings: &job.settings,
            stop: watch.stop,
        };
        // Tile by tile, as threads become free: halves of the image would differ too much in cost.
        let tiles = Mutex::new(film.tiles_mut().iter_mut());
        let next = || tiles.lock().unwrap_or_else(PoisonError::into_inner).next();
        let reports = rayon::broadcast(|_| {
            let mut batch = if job.split_direct {
                Batch::with_direct()
            } else {
                Batch::default()
            };
            iter::from_fn(next)
                .map(|tile| {
                    let report = tracer.render(&mut batch, tile);
                    let done = done.fetch_add(report.paths, Ordering::Relaxed) + report.paths;
                    (watch.progress)(done, expected);
                    report
                })
                .fold(RenderReport::default(), RenderReport::plus)
        });
        report = reports.into_iter().fold(report, RenderReport::plus);
    }
    (film, report)
}

/// Sets the goals of the next pass over a film whose pixels are to have `spp` samples each, and tells how many paths that
/// makes; `None` if they have.
pub(crate) fn plan_evenly(film: &mut Film, spp: u32) -> Option<u64> {
    let samples = film.cells().next()?.samples;
    // 1, 1, 2, 4, ...: a first look at once, then longer passes.
    let goal = samples + samples.clamp(1, MAX_PASS).min(spp - samples);
    film.cells_mut().for_each(|cell| cell.goal = goal);
    (samples < spp).then(|| film.crop().pixels().saturating_mul(spp.into()))
}

/// What it takes to render tiles.
struct Tracer<'a, A> {
    scene: &'a Scene,
    accel: &'a A,
    kernel: Kernel,
    settings: &'a Settings,
    stop: &'a (dyn Fn() -> bool + Sync),
}

impl<A: Accel> Tracer<'_, A> {
    /// Brings the cells of a tile to their goals, or until it is stopped.
    fn render(&self, batch: &mut Batch, tile: &mut Tile) -> RenderReport {
        let mut report = RenderReport::default();
        let Tile { cells, pixels, .. } = tile;
        let samples = cells.iter().flat_map(|cell| {
            let indices = cell.samples..cell.goal;
            cell.rect.blocks().flat_map(move |block| {
                let of_block = move |sample| block.coordinates().map(move |(x, y)| SampleId { sample, y, x });
                indices.clone().flat_map(of_block)
            })
        });
        let add = |(id, radiance, sees_light): (SampleId, Rgb, bool), direct: Option<Rgb>| {
            report.paths += 1;
            if !radiance.is_finite() {
                report.dropped.count += 1;
                report.dropped.first = Some(report.dropped.first.map_or(id, |first| first.min(id)));
                pixels.at_mut(id.x, id.y).add(Rgb::BLACK);
                return;
            }
            let pixel = pixels.at_mut(id.x, id.y);
            pixel.add(radiance);
            pixel.sees_light |= sees_light;
            if let Some(direct) = direct {
                pixels.add_direct(id.x, id.y, direct);
            }
        };
        let is_complete = self.trace(batch, samples, &mut report.rays, add);
        if is_complete {
            cells.iter_mut().for_each(|cell| cell.samples = cell.goal);
        }
        report
    }

    /// Computes samples and hands each to `add`, in their order, with its direct part, if the batch keeps that; whether it was
    /// all of them.
    fn trace(
        &self,
        batch: &mut Batch,
        mut samples: impl Iterator<Item = SampleId>,
        rays: &mut RayCounts,
        mut add: impl FnMut((SampleId, Rgb, bool), Option<Rgb>),
    ) -> bool {
        while batch.fill(&mut samples) {
            if (self.stop)() {
                return false;
            }
            self.kernel.trace(self.scene, self.accel, self.settings, batch, rays);
            let mut direct = batch.direct();
            batch.results().for_each(|result| add(result, direct.next()));
        }
        true
    }
}
