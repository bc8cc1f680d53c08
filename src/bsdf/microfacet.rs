//! The GGX (Trowbridge and Reitz) distribution with Smith's height-correlated shadowing.
//!
//! Walter et al. 2007 for the distribution, Heitz 2014 (JCGT 3(2)) for the shadowing, Dupuy and Benyoub 2023 ("Sampling
//! Visible GGX Normals with Spherical Caps") for the sampling.

use crate::math::Vec3;
use std::f32::consts::{PI, TAU};

/// Widths below this are treated as perfectly smooth: the lobe is then narrower than 0.006 degrees, and f32 half vectors
/// can no longer resolve it.
pub const SMOOTH_ALPHA: f32 = 1e-4;

/// An isotropic GGX distribution of normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ggx {
    /// Width, at least [`SMOOTH_ALPHA`].
    pub(super) alpha: f32,
}

impl Ggx {
    /// D(h): density of normals per solid angle and projected area [1/sr].
    #[inline]
    pub(super) fn d(self, h: Vec3) -> f32 {
        let a2 = self.alpha * self.alpha;
        // sin² from x and y, not as 1 − cos²: that difference has no digits left at small angles.
        let e = (h.x * h.x + h.y * h.y) / a2 + h.z * h.z;
        1.0 / (PI * a2 * e * e)
    }

    /// |cos θ| (1 + 2 Λ), with Smith's Λ. Nothing is divided by the cosine, so that it serves to the last grazing ulp.
    #[inline]
    fn slant(self, w: Vec3) -> f32 {
        (w.z * w.z + self.alpha * self.alpha * (w.x * w.x + w.y * w.y)).sqrt()
    }

    /// G1 / cos θo: visible fraction of the normals, per projected area. At most 2 / (α sin θo).
    #[inline]
    pub(super) fn g1_over_cos(self, wo: Vec3) -> f32 {
        2.0 / (wo.z + self.slant(wo))
    }

    /// G2 / cos θo, height-correlated. The same form serves two directions on opposite sides (as in pbrt): Heitz's own
    /// expression for those is a beta function, and differs visibly only for both directions at grazing angles of a rough
    /// surface.
    #[inline]
    pub(super) fn g2_over_cos(self, wo: Vec3, wi: Vec3) -> f32 {
        let cos_i = wi.z.abs();
        2.0 * cos_i / (self.slant(wo) * cos_i + self.slant(wi) * wo.z)
    }

    /// A normal visible from `wo` (`wo.z > 0`).
    #[inline]
    pub(super) fn sample_visible(self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        // The height of the sum is above zero and needs no sum: as one it would lose the digits of the widest normals.
        let height = (1.0 - u) * (1.0 + stretched.z);
        let z = height - stretched.z;
        let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
        let (sin, cos) = (TAU * v).sin_cos();
        let (x, y) = (r * cos + stretched.x, r * sin + stretched.y);
        Vec3::new(x * self.alpha, y * self.alpha, height)
            .try_normalize()
            .unwrap_or(Vec3::Z)
    }
}
