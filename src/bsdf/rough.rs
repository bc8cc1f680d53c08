//! Metals and glass of any width and either kind of microfacets, tinted.

use super::{BsdfEval, BsdfSample};
use crate::math::{Rgb, Vec3};

/// Which microfacets a rough surface has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Distribution {
    /// Trowbridge and Reitz.
    #[default]
    Ggx,
    /// Beckmann and Spizzichino.
    Beckmann,
}

/// A metal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughMetal {
    /// Real part of the index.
    pub eta: Rgb,
    /// Absorption.
    pub k: Rgb,
    /// Factor on what is reflected, in [0, 1].
    pub reflectance: Rgb,
    /// Widths along `tangent` and across, in [0, 1].
    pub alpha: [f32; 2],
    /// Which microfacets.
    pub distribution: Distribution,
    /// Cosine and sine of the angle of the first width around the normal.
    pub tangent: [f32; 2],
}

/// Glass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughGlass {
    /// Index on the other side over that on the side of `wo`.
    pub eta: f32,
    /// Factor on what is reflected, in [0, 1].
    pub reflectance: Rgb,
    /// Factor on what is transmitted, in [0, 1].
    pub transmittance: Rgb,
    /// Widths along `tangent` and across, in [0, 1].
    pub alpha: [f32; 2],
    /// Which microfacets.
    pub distribution: Distribution,
    /// Cosine and sine of the angle of the first width around the normal.
    pub tangent: [f32; 2],
}

/// A smooth sheet of glass without thickness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinGlass {
    /// Index of the sheet over that of its surroundings.
    pub ior: f32,
    /// Factor on what is reflected, in [0, 1].
    pub reflectance: Rgb,
    /// Factor on what is transmitted, in [0, 1].
    pub transmittance: Rgb,
}

impl RoughMetal {
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

impl RoughGlass {
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

impl ThinGlass {
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
