//! Lambertian reflection.

use super::{BsdfEval, BsdfSample};
use crate::math::{Rgb, Vec3};
use crate::sampling::warp;
use std::f32::consts::FRAC_1_PI;

/// Reflects equally into all directions of the hemisphere: f = reflectance / π.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diffuse {
    /// Albedo, in [0, 1].
    pub reflectance: Rgb,
}

impl Diffuse {
    /// Value and density of a direction; see [`super::Bsdf::eval`].
    #[inline(always)]
    pub fn eval(&self, wi: Vec3) -> BsdfEval {
        if wi.z <= 0.0 {
            return BsdfEval::ZERO;
        }
        BsdfEval {
            value: self.reflectance * (wi.z * FRAC_1_PI),
            pdf_w: warp::cosine_hemisphere_pdf_w(wi.z),
        }
    }

    /// Draws a direction; see [`super::Bsdf::sample`].
    #[inline(always)]
    pub fn sample(&self, u: [f32; 2]) -> Option<BsdfSample> {
        let wi = warp::cosine_hemisphere(u);
        let pdf_w = warp::cosine_hemisphere_pdf_w(wi.z);
        (!self.reflectance.is_black()).then_some(BsdfSample {
            wi,
            weight: self.reflectance,
            pdf_w,
            eta_squared: 1.0,
        })
    }
}
