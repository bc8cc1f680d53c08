//! A diffuse base under a coat of glass.

use super::{BsdfEval, BsdfSample, Distribution};
use crate::math::{Rgb, Vec3};

/// What passes a coat of glass, by angle.
#[derive(Debug, PartialEq)]
pub struct CoatTable {
    /// Index of the coat over that of the outside, above 1.
    pub ior: f32,
    /// Width of its microfacets; 0 is smooth.
    pub alpha: f32,
    /// Which microfacets.
    pub distribution: Distribution,
}

impl CoatTable {
    /// The table of a coat. It is kept as long as the process, once for each coat.
    pub fn of(ior: f32, alpha: f32, distribution: Distribution) -> &'static CoatTable {
        todo!("{ior} {alpha} {distribution:?}")
    }
}

/// A diffuse base under a coat of glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoatedDiffuse {
    /// Albedo of the base, in [0, 1].
    pub reflectance: Rgb,
    /// Factor on what the coat reflects, in [0, 1].
    pub specular: Rgb,
    /// The coat.
    pub coat: &'static CoatTable,
    /// Whether light that goes back and forth takes the colour of the base each time.
    pub nonlinear: bool,
}

impl CoatedDiffuse {
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        todo!("{wo} {wi}")
    }

    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        todo!("{wo} {lobe} {u:?}")
    }

    /// See [`super::Bsdf::albedo`].
    pub(super) fn albedo(&self) -> Rgb {
        todo!()
    }
}
