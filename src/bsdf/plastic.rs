//! A diffuse base under a rough, clear coat: painted wood, plastic, glazed clay.
//!
//! f = F D G / (4 cos θo cos θi) + (1 − F(θo)) (1 − F(θi)) reflectance / π, with Schlick's F. Light that bounces between
//! base and coat is left out, so that energy is lost rather than gained; the form is reciprocal.

use super::microfacet::Ggx;
use super::{BsdfEval, BsdfSample};
use crate::math::{Rgb, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// The smallest coat width: below it the lobe would have to become a delta beside a diffuse base.
pub const MIN_ALPHA: f32 = 1e-3;

/// A coated diffuse surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plastic {
    /// Albedo of the base, in [0, 1].
    pub reflectance: Rgb,
    /// Reflectance of the coat at normal incidence, in [0, 1].
    pub specular: Rgb,
    /// GGX width of the coat, at least [`MIN_ALPHA`].
    pub alpha: f32,
}

impl Plastic {
    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        match (wo + wi).try_normalize() {
            Some(h) => self.scatter(wo, wi, h),
            None => BsdfEval::ZERO,
        }
    }

    /// Value and density of a pair of directions with the half vector `h`.
    #[inline]
    fn scatter(&self, wo: Vec3, wi: Vec3, h: Vec3) -> BsdfEval {
        let through = (Rgb::WHITE - self.fresnel(wo.z)) * (Rgb::WHITE - self.fresnel(wi.z));
        let base = self.reflectance * through * (wi.z * FRAC_1_PI);
        let coat_share = self.coat_share(wo);
        let base_pdf_w = warp::cosine_hemisphere_pdf_w(wi.z) * (1.0 - coat_share);
        let coat = Ggx { alpha: self.alpha };
        let d = 0.25 * coat.d(h);
        let value = base + self.fresnel(wo.dot(h)) * (d * coat.g2_over_cos(wo, wi));
        let pdf_w = base_pdf_w + d * coat.g1_over_cos(wo) * coat_share;
        if value.is_finite() && pdf_w.is_finite() {
            BsdfEval { value, pdf_w }
        } else {
            BsdfEval::ZERO
        }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let (wi, BsdfEval { value, pdf_w }) = if lobe < self.coat_share(wo) {
            let h = Ggx { alpha: self.alpha }.sample_visible(wo, u);
            let wi = (h * (2.0 * wo.dot(h)) - wo).normalize();
            if wi.z <= 0.0 {
                return None;
            }
            // By this very h: that of wo and wi is another one where both are grazing.
            (wi, self.scatter(wo, wi, h))
        } else {
            let wi = warp::cosine_hemisphere(u);
            (wi, self.eval(wo, wi))
        };
        (pdf_w > 0.0).then(|| BsdfSample {
            wi,
            weight: value / pdf_w,
            pdf_w,
            eta_squared: 1.0,
        })
    }

    /// Probability of sampling the coat: its share of the light reflected towards `wo`, kept away from 0 and 1 so that
    /// neither lobe is left to the other's density.
    #[inline]
    fn coat_share(&self, wo: Vec3) -> f32 {
        let coat = self.fresnel(wo.z).luminance();
        let base = self.reflectance.luminance() * (1.0 - coat);
        if coat + base > 0.0 {
            (coat / (coat + base)).clamp(0.1, 0.9)
        } else {
            0.5
        }
    }

    /// See [`super::Bsdf::albedo`].
    pub(super) fn albedo(&self) -> Rgb {
        // The mean over the hemisphere of Schlick's (1 - cos θ)⁵, weighted by cos θ / π, is 1/21.
        let through = Rgb::WHITE - self.specular;
        self.specular + self.reflectance * through * through * (20.0 / 21.0)
    }

    #[inline]
    fn fresnel(&self, cos: f32) -> Rgb {
        let m = (1.0 - cos).clamp(0.0, 1.0);
        let m5 = m * m * m * m * m;
        self.specular + (Rgb::WHITE - self.specular) * m5
    }
}
