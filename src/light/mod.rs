//! Emitters and the choice between them.

use crate::math::{Rgb, Vec3};

mod area;
mod environment;
mod sampler;
mod tree;

pub use area::{AreaLight, AreaLightColumns, Emission};
pub use environment::{
    EnvSampling, Environment, EnvironmentColumns, EnvironmentError, EnvironmentMap, EnvironmentPoint,
};
pub use sampler::{Chosen, Emitter, LightSampler, LightSamplerBuilder, LightSampling};

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
