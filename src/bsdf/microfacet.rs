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

    /// Smith's Λ.
    #[inline]
    fn lambda(self, w: Vec3) -> f32 {
        let sin2 = w.x * w.x + w.y * w.y;
        let tan2 = sin2 / (w.z * w.z);
        if tan2.is_finite() {
            0.5 * ((1.0 + self.alpha * self.alpha * tan2).sqrt() - 1.0)
        } else {
            f32::INFINITY
        }
    }

    /// G1: visible fraction of the normals.
    #[inline]
    pub(super) fn g1(self, w: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(w))
    }

    /// G2, height-correlated. The same form serves two directions on opposite sides (as in pbrt): Heitz's own expression
    /// for those is a beta function, and differs visibly only for both directions at grazing angles of a rough surface.
    #[inline]
    pub(super) fn g2(self, wo: Vec3, wi: Vec3) -> f32 {
        1.0 / (1.0 + self.lambda(wo) + self.lambda(wi))
    }

    /// A normal visible from `wo` (`wo.z > 0`).
    #[inline]
    pub(super) fn sample_visible(self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let stretched = Vec3::new(wo.x * self.alpha, wo.y * self.alpha, wo.z).normalize();
        let z = (1.0 - u) * (1.0 + stretched.z) - stretched.z;
        let r = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = (TAU * v).sin_cos();
        let cap = Vec3::new(r * cos, r * sin, z) + stretched;
        Vec3::new(cap.x * self.alpha, cap.y * self.alpha, cap.z.max(0.0))
            .try_normalize()
            .unwrap_or(Vec3::Z)
    }
}
