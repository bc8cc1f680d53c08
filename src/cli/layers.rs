//! The layers of `--aov`.

use super::budget::Budget;
use super::output::Target;
use super::{Failure, RenderArgs, tell};
use crate::accel::Accel;
use crate::aov::{self, Aov, FirstHits};
use crate::film::Film;
use crate::image::exr::Layer;
use crate::integrator::Kernel;
use crate::render::Job;
use crate::scene::Scene;

/// Samples of each pixel that describe its first surface where the number of samples of the image is not known beforehand.
const OPEN_SPP: u32 = 16;

/// Share of the time that first surfaces may take: they are no use without an image.
pub(super) const FIRST_HITS_SHARE: f64 = 0.5;

/// The layers asked for, and what is known of them before there is an image.
#[derive(Debug)]
pub(super) struct Layers<'a> {
    wanted: &'a [Aov],
    first_spp: u32,
    first_hits: Option<FirstHits>,
}

impl<'a> Layers<'a> {
    /// Of the command line, if such layers can be made and written.
    pub(super) fn new(args: &'a RenderArgs, targets: &[Target], budget: &Budget) -> Result<Layers<'a>, Failure> {
        let wanted = args.aov.as_deref().unwrap_or_default();
        if !wanted.is_empty() && !targets.iter().any(Target::has_layers) {
            return Err(Failure::usage(
                "--aov makes layers, which need an .exr among the outputs",
            ));
        }
        if wanted.contains(&Aov::Variance) && !args.estimator.tells_error() {
            return Err(Failure::usage(
                "--aov variance cannot be told from samples of --sampler sobol-whole; take sobol",
            ));
        }
        let most = if budget.is_open() { OPEN_SPP } else { u32::MAX };
        Ok(Layers {
            wanted,
            first_spp: budget.spp.min(most),
            first_hits: None,
        })
    }

    /// Whether the film has to keep direct light apart.
    pub(super) fn split_direct(&self) -> bool {
        self.wanted.iter().any(|aov| aov.is_part_of_light())
    }

    /// Channels of the image and the layers, in all files together.
    pub(super) fn channels_written(&self, targets: &[Target]) -> usize {
        let further: usize = self.wanted.iter().map(|aov| aov.channels().len()).sum();
        let of = |target: &Target| if target.has_layers() { 3 + further } else { 3 };
        targets.iter().map(of).sum()
    }

    /// Traces first surfaces, if they are asked for, until `stop` says yes.
    pub(super) fn trace<A: Accel>(
        &mut self,
        scene: &Scene,
        accel: &A,
        kernel: Kernel,
        job: &Job,
        stop: &(dyn Fn() -> bool + Sync),
    ) {
        if self.wanted.iter().any(|aov| aov.is_of_first_hit()) {
            self.first_hits = FirstHits::trace(scene, accel, kernel, &job.settings, job.crop, self.first_spp, stop);
        }
    }

    /// The layers beside the image of a film. What could not be made whole is left out, with a warning.
    pub(super) fn of(&self, film: &Film, quiet: bool) -> Vec<Layer> {
        let of_first_hit = |aov| self.first_hits.as_ref().and_then(|hits| hits.layer(aov));
        let layer = |aov| aov::layer_of(film, aov).or_else(|| of_first_hit(aov));
        let layers: Vec<Layer> = self.wanted.iter().filter_map(|&aov| layer(aov)).collect();
        if layers.len() < self.wanted.len() && !quiet {
            let missing = self.wanted.iter().map(|aov| aov.name());
            let missing: Vec<&str> = missing
                .filter(|name| layers.iter().all(|layer| layer.name != *name))
                .collect();
            tell(format_args!(
                "warning: there was no time for all of the layers {}; they are left out",
                missing.join(", ")
            ));
        }
        layers
    }
}
