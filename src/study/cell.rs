//! A cell of a study: one setting with one number of samples, for all seeds.

use super::bias::{self, Bias};
use super::measure::{Errors, Pixels, Replications, errors};
use super::reference::Reference;
use super::renderer::{Renderer, Stop};
use crate::image::Image;
use crate::image::flip::hdr_flip;
use crate::integrator::Settings;
use crate::math::Rgb;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Fewest images of a cell: error bars need them.
pub const FEWEST_SEEDS: u32 = 8;

/// What must be the same for a stored cell to be used again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CellKey {
    /// Version of the program.
    pub version: String,
    /// The scene and all its files.
    pub scene_hash: String,
    /// What it is compared with.
    pub reference_hash: String,
    /// Columns and rows.
    pub resolution: [u32; 2],
    /// Name of the setting.
    pub setting: String,
    /// The setting as `embrace render` takes it.
    pub arguments: String,
    /// Depth limit of scene or command line.
    pub max_depth: Option<u32>,
    /// Name and version of what traces the rays.
    pub backend: String,
    /// Samples per pixel.
    pub spp: u32,
    /// Seed of the first image.
    pub first_seed: u64,
    /// How many images.
    pub seeds: u32,
    /// How many threads rendered: times depend on it.
    pub threads: usize,
    /// Stops of exposure of the pictures.
    pub exposure: String,
}

/// One image of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Of the random numbers.
    pub seed: u64,
    /// From the first to the last sample.
    pub seconds: f64,
    /// Against the reference, whose own noise is in it.
    #[serde(flatten)]
    pub errors: Errors,
    /// Samples that were NaN or infinite.
    pub dropped: u64,
}

/// A finished cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Samples per pixel.
    pub spp: u32,
    /// Scene tables and tree.
    pub build_seconds: f64,
    /// One per seed.
    pub runs: Vec<Run>,
    /// What the mean of all images says.
    pub bias: Bias,
    /// Mean HDR-FLIP of the first image against the reference.
    pub flip: f64,
}

/// Pictures of a cell.
pub struct Pictures {
    /// The image of the first seed.
    pub image: Image<Rgb>,
    /// Its FLIP errors.
    pub flip: Image<f32>,
}

/// Renders a cell; `None` when stopped.
pub fn run(
    renderer: &dyn Renderer,
    settings: &Settings,
    key: &CellKey,
    reference: &Reference,
    build_seconds: f64,
    stop: Stop<'_>,
) -> Option<(Cell, Pictures)> {
    let mut replications = Replications::new(reference.pixels.values.len());
    let mut runs = Vec::new();
    let mut first = None;
    for i in 0..key.seeds {
        let settings = Settings {
            seed: key.first_seed.wrapping_add(u64::from(i)),
            ..*settings
        };
        let start = Instant::now();
        let (film, report) = renderer.render(key.spp, &settings, stop);
        let seconds = start.elapsed().as_secs_f64();
        if film.sample_range().0 < key.spp {
            return None;
        }
        let pixels = Pixels::of_film(&film, key.resolution);
        runs.push(Run {
            seed: settings.seed,
            seconds,
            errors: errors(&pixels, &reference.pixels, &reference.brightest),
            dropped: report.dropped.count,
        });
        replications.add(&pixels);
        first.get_or_insert_with(|| pixels.to_image());
    }
    let image = first.expect("a cell has images");
    let flip = hdr_flip(&reference.pixels.to_image(), &image);
    let cell = Cell {
        spp: key.spp,
        build_seconds,
        runs,
        bias: bias::of(&replications, reference),
        flip: flip.pixels.iter().map(|&e| f64::from(e)).sum::<f64>() / flip.pixels.len() as f64,
    };
    Some((cell, Pictures { image, flip }))
}
