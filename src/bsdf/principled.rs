//! The principled BSDF.

use super::{BsdfEval, BsdfSample};
use crate::math::{Rgb, Vec3};

/// The principled BSDF at a point. Parameters as in [`crate::material::Principled`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledBsdf {
    /// Albedo of the diffuse part, reflectance of metal, tint of glass.
    pub base_color: Rgb,
    /// Square root of the GGX width.
    pub roughness: f32,
    /// Stretch of highlights.
    pub anisotropic: f32,
    /// Share of metal.
    pub metallic: f32,
    /// Share of glass in what is not metal.
    pub spec_trans: f32,
    /// Index on the other side over that on the side of `wo`.
    pub eta: f32,
    /// Hue of reflections of what is not metal.
    pub spec_tint: f32,
    /// Retro-reflection of cloth.
    pub sheen: f32,
    /// Hue of that.
    pub sheen_tint: f32,
    /// Between diffuse and subsurface scattering.
    pub flatness: f32,
    /// A second, colourless coat.
    pub clearcoat: f32,
    /// Its gloss.
    pub clearcoat_gloss: f32,
    /// Whether `wo` is outside.
    pub front: bool,
    /// Cosine and sine of the angle around the normal of the direction that highlights are stretched along.
    pub tangent: [f32; 2],
}

impl PrincipledBsdf {
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
