//! What a film of 32 bits would lose, and save: the same samples summed in f32 and in the film's f64.

use super::renderer::Renderer;
use crate::film::{Film, Rect};
use crate::image::compare::RELATIVE_OFFSET;
use crate::integrator::{SampleId, Settings};
use crate::math::Rgb;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Edge length of the part of the image, in its middle, that is looked at.
const SIDE: u32 = 16;

/// Samples of each pixel that are computed; for higher counts the same come again.
const RECORDED: u32 = 1024;

/// Sums in f32 and f64 of the same samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accumulation {
    /// Columns and rows that are looked at.
    pub side: u32,
    /// Samples of each pixel that were computed; beyond, they are repeated.
    pub recorded_spp: u32,
    /// By samples per pixel.
    pub points: Vec<AccumulationPoint>,
    /// Time to add a sample in f32 (ns).
    pub f32_ns: f64,
    /// The same in f64 with the error carried along, as the film does (ns).
    pub f64_ns: f64,
    /// Time to compute a sample on one thread (ns).
    pub sample_ns: f64,
}

/// How far f32 sums are off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AccumulationPoint {
    /// Samples per pixel.
    pub spp: u32,
    /// Mean of the squared difference over the squared f64 value plus 0.01: comparable with a relMSE.
    pub relmse: f64,
    /// Sum of all f32 pixels over that of all f64 pixels, less 1.
    pub drift: f64,
}

/// Compares sums of up to `max_spp` samples.
pub fn measure(renderer: &dyn Renderer, settings: &Settings, max_spp: u32) -> Accumulation {
    let [width, height] = renderer.scene().camera.resolution();
    let (columns, rows) = (width.min(SIDE), height.min(SIDE));
    let crop = Rect {
        x0: (width - columns) / 2,
        y0: (height - rows) / 2,
        x1: (width - columns) / 2 + columns,
        y1: (height - rows) / 2 + rows,
    };
    let recorded_spp = RECORDED.min(max_spp);
    let mut samples = Vec::new();
    let mut ids = (0..recorded_spp).flat_map(|sample| crop.coordinates().map(move |(x, y)| SampleId { sample, y, x }));
    let start = Instant::now();
    renderer.samples(settings, &mut ids, &mut |radiance| {
        samples.push(if radiance.is_finite() { radiance } else { Rgb::BLACK });
    });
    let sample_ns = start.elapsed().as_secs_f64() * 1e9 / samples.len() as f64;

    let pixels = crop.pixels() as usize;
    let mut single = vec![[0f32; 3]; pixels];
    let mut film = Film::new(crop);
    let (mut f32_seconds, mut f64_seconds) = (0.0, 0.0);
    let (mut done, mut next) = (0u32, 1u32);
    let mut points = Vec::new();
    while next <= max_spp {
        let images = || (done..next).map(|s| (s % recorded_spp) as usize * pixels);
        let start = Instant::now();
        for image in images() {
            for (sum, sample) in single.iter_mut().zip(&samples[image..image + pixels]) {
                for (sum, x) in sum.iter_mut().zip(sample.to_array()) {
                    *sum += x;
                }
            }
        }
        f32_seconds += start.elapsed().as_secs_f64();
        let start = Instant::now();
        for tile in film.tiles_mut() {
            for image in images() {
                for (x, y) in tile.rect.coordinates() {
                    let pixel = (y - crop.y0) as usize * columns as usize + (x - crop.x0) as usize;
                    tile.add(x, y, samples[image + pixel]);
                }
            }
        }
        f64_seconds += start.elapsed().as_secs_f64();
        done = next;
        points.push(compare(&single, &film.means(), done));
        next = next.saturating_mul(4);
    }
    let added = f64::from(done) * pixels as f64;
    Accumulation {
        side: SIDE,
        recorded_spp,
        points,
        f32_ns: f32_seconds * 1e9 / added,
        f64_ns: f64_seconds * 1e9 / added,
        sample_ns,
    }
}

fn compare(single: &[[f32; 3]], means: &[[f64; 3]], spp: u32) -> AccumulationPoint {
    let (mut squares, mut sum, mut expected) = (0.0, 0.0, 0.0);
    for (single, mean) in single.iter().flatten().zip(means.iter().flatten()) {
        let value = f64::from(*single) / f64::from(spp);
        squares += (value - mean) * (value - mean) / (mean * mean + RELATIVE_OFFSET);
        sum += value;
        expected += mean;
    }
    AccumulationPoint {
        spp,
        relmse: squares / (3.0 * means.len() as f64),
        drift: if expected > 0.0 { sum / expected - 1.0 } else { 0.0 },
    }
}
