//! What images are compared with: given, or rendered as several independent images, so that its own noise is known.

use super::measure::{Pixels, Replications, brightest_around};
use super::renderer::{Renderer, Stop};
use crate::image::compare::RELATIVE_OFFSET;
use crate::integrator::{Lighting, Settings};
use serde::{Deserialize, Serialize};

/// How many independent images a reference is the mean of.
pub const REPLICATIONS: u32 = 8;

/// Added to the study's first seed: no image of the study shares random numbers with the reference.
pub const SEED_OFFSET: u64 = 1 << 32;

/// Which light an image is meant to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// All of it.
    Global,
    /// Emission and one scattering event.
    Direct,
}

impl Target {
    /// The target of a setting.
    pub fn of(settings: &Settings) -> Target {
        match settings.lighting {
            Lighting::Global => Target::Global,
            Lighting::Direct => Target::Direct,
        }
    }

    /// For files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Target::Global => "global",
            Target::Direct => "direct",
        }
    }
}

/// An image without noise, or nearly.
#[derive(Clone, Debug)]
pub struct Reference {
    /// The image.
    pub pixels: Pixels,
    /// What is known of its own noise; nothing for a file of others.
    pub noise: Option<(Noise, LuminanceVariance)>,
    /// The largest luminance around each pixel.
    pub brightest: Vec<f64>,
    /// Tells references apart: a hash of the pixels.
    pub hash: String,
}

/// Estimated variance of each pixel's luminance.
pub type LuminanceVariance = Vec<f64>;

/// The part of an image's error that the reference has itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// In the MSE.
    pub mse: f64,
    /// In the relMSE.
    pub relmse: f64,
}

impl Reference {
    /// From pixels and, if known, their noise.
    pub fn new(pixels: Pixels, noise: Option<(Noise, LuminanceVariance)>) -> Reference {
        let mut hasher = blake3::Hasher::new();
        for value in pixels.values.iter().flatten() {
            hasher.update(&value.to_le_bytes());
        }
        Reference {
            brightest: brightest_around(&pixels),
            hash: hasher.finalize().to_hex()[..16].into(),
            pixels,
            noise,
        }
    }

    /// Its own part of errors; zero where it is not known.
    pub fn noise(&self) -> Noise {
        self.noise.as_ref().map_or(Noise::default(), |(noise, _)| *noise)
    }
}

/// The mean over all pixels and channels.
fn noise(values: &[[f64; 3]], variances: &[[f64; 4]]) -> Noise {
    let mut noise = Noise::default();
    for (value, variance) in values.iter().zip(variances) {
        for c in 0..3 {
            noise.mse += variance[c];
            noise.relmse += variance[c] / (value[c] * value[c] + RELATIVE_OFFSET);
        }
    }
    let count = 3.0 * values.len() as f64;
    Noise {
        mse: noise.mse / count,
        relmse: noise.relmse / count,
    }
}

/// Samples of each of the images that have `spp` together.
pub fn samples_each(spp: u32) -> u32 {
    spp.div_ceil(REPLICATIONS).max(1)
}

/// Renders a reference with `spp` samples in all; `None` when stopped. `done` is told after each of [`REPLICATIONS`] images.
pub fn render(
    renderer: &dyn Renderer,
    settings: &Settings,
    spp: u32,
    stop: Stop<'_>,
    done: &mut dyn FnMut(u32),
) -> Option<Reference> {
    let resolution @ [width, height] = renderer.scene().camera.resolution();
    let each = samples_each(spp);
    let mut replications = Replications::new(width as usize * height as usize);
    for i in 0..REPLICATIONS {
        let settings = Settings {
            seed: settings.seed.wrapping_add(SEED_OFFSET).wrapping_add(u64::from(i)),
            ..*settings
        };
        let (film, _) = renderer.render(each, &settings, stop);
        if film.sample_range().0 < each {
            return None;
        }
        replications.add(&Pixels::of_film(&film, resolution));
        done(i + 1);
    }
    // As files hold it, so that a study that goes on has the same reference.
    let mean = Pixels {
        width,
        height,
        values: replications.mean().into_iter().map(|v| v.map(to_f32)).collect(),
    };
    let variances = replications.variance_of_mean();
    let noise = noise(&mean.values, &variances);
    let luminance = variances.iter().map(|v| to_f32(v[3])).collect();
    Some(Reference::new(mean, Some((noise, luminance))))
}

fn to_f32(value: f64) -> f64 {
    f64::from(value as f32)
}
