//! Emitters and the choice between them.

use crate::math::{Rgb, Vec3};

mod area;
mod builder;
mod distant;
mod environment;
mod punctual;
mod sampler;
mod tree;

pub use area::{AreaLight, AreaLightColumns, Emission};
pub use builder::LightSamplerBuilder;
pub use distant::DistantLight;
pub use environment::{
    EnvSampling, Environment, EnvironmentColumns, EnvironmentError, EnvironmentMap, EnvironmentPoint,
};
pub use punctual::{Falloff, PunctualLight};
pub use sampler::{Chosen, Emitter, LightSampler, LightSampling};

/// A direction towards an emitter, as seen from a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit direction from the point.
    pub wi: Vec3,
    /// What the emitter sends back along `-wi` [W·m⁻²·sr⁻¹].
    pub radiance: Rgb,
    /// Density of the direction, the choice of the emitter included [1/sr].
    pub pdf_w: f32,
    /// Where a shadow ray ends: just off the emitter. `None`: at infinity.
    pub target: Option<Vec3>,
}

/// Stands for the infinite density of the one direction towards a point or parallel light [1/sr]: 2⁴⁸, so far above that of
/// any bounce that the weight of multiple importance sampling is exactly 1. What comes from there is multiplied by it, so
/// that the quotient is what it is.
const DELTA_PDF_W: f32 = 281_474_976_710_656.0;

/// Largest product of light and [`DELTA_PDF_W`]: 2¹⁰⁰, which leaves room for what scattering multiplies it by.
const LARGEST: f32 = 1.267_650_6e30;

/// The sample of light from a single direction, which would bring so much to a surface that faces it [W·m⁻²], its emitter being
/// drawn with probability `pmf`. `None` if it is black.
fn delta_sample(wi: Vec3, irradiance: Rgb, pmf: f32, target: Option<Vec3>) -> Option<LightSample> {
    (!irradiance.is_black() && pmf > 0.0).then(|| LightSample {
        wi,
        radiance: irradiance.map(|c| (c * DELTA_PDF_W / pmf).min(LARGEST)),
        pdf_w: DELTA_PDF_W,
        target,
    })
}
