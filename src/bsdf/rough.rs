//! Metals and glass of any width and either kind of microfacets, tinted: Mitsuba's `roughconductor`, `roughdielectric` and
//! `thindielectric`, and the smooth ones. Shadowing is Smith's separable form, as there.

use super::conductor::Conductor;
use super::dielectric::{Facet, fresnel_dielectric, radiance_scale, refract};
use super::microfacet::SMOOTH_ALPHA;
use super::smith::{Smith, into_frame, out_of_frame};
use super::{BsdfEval, BsdfSample, reflect_z};
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
    pub(super) fn is_smooth(&self) -> bool {
        self.alpha.iter().all(|alpha| *alpha < SMOOTH_ALPHA)
    }

    // Out of line, as all of these: the kernels of scenes without them stay small.
    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wi.z <= 0.0 || self.is_smooth() {
            return BsdfEval::ZERO;
        }
        let [wo, wi] = [wo, wi].map(|w| into_frame(w, self.tangent));
        Facet::of(wo, wi, 1.0).map_or(BsdfEval::ZERO, |facet| self.scatter(wo, wi, &facet))
    }

    fn scatter(&self, wo: Vec3, wi: Vec3, facet: &Facet) -> BsdfEval {
        let share = self.reflectance * self.fresnel(facet.wo_h);
        self.facets().scatter(wo, wi, facet, (share, 1.0)).or_zero()
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        if self.is_smooth() {
            let weight = self.reflectance * self.fresnel(wo.z);
            return Some(BsdfSample::delta(reflect_z(wo), weight, 1.0));
        }
        let wo = into_frame(wo, self.tangent);
        let (wi, facet) = Facet::reflect(wo, self.facets().sample_visible(wo, u))?;
        self.scatter(wo, wi, &facet).at(out_of_frame(wi, self.tangent), 1.0)
    }

    fn facets(&self) -> Smith {
        Smith::new(self.alpha, self.distribution)
    }

    fn fresnel(&self, cos: f32) -> Rgb {
        let (eta, k, alpha) = (self.eta, self.k, 0.0);
        Conductor { eta, k, alpha }.fresnel(cos)
    }

    /// See [`super::Bsdf::albedo`].
    pub(super) fn albedo(&self) -> Rgb {
        self.reflectance * self.fresnel(1.0)
    }
}

impl RoughGlass {
    pub(super) fn is_smooth(&self) -> bool {
        self.alpha.iter().all(|alpha| *alpha < SMOOTH_ALPHA) || (self.eta - 1.0).abs() < SMOOTH_ALPHA
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if self.is_smooth() || wi.z == 0.0 {
            return BsdfEval::ZERO;
        }
        let [wo, wi] = [wo, wi].map(|w| into_frame(w, self.tangent));
        Facet::of(wo, wi, self.eta).map_or(BsdfEval::ZERO, |facet| {
            let fresnel = fresnel_dielectric(facet.wo_h, self.eta);
            self.scatter(wo, wi, &facet, fresnel)
        })
    }

    fn scatter(&self, wo: Vec3, wi: Vec3, facet: &Facet, fresnel: f32) -> BsdfEval {
        let share = if wi.z > 0.0 {
            (self.reflectance * fresnel, fresnel)
        } else {
            let transmitted = 1.0 - fresnel;
            (
                self.transmittance * (transmitted * radiance_scale(self.eta)),
                transmitted,
            )
        };
        self.facets().scatter(wo, wi, facet, share).or_zero()
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let eta_squared = self.eta * self.eta;
        if self.is_smooth() {
            // The probability of the choice cancels the share of the light.
            return Some(if lobe < fresnel_dielectric(wo.z, self.eta) {
                BsdfSample::delta(reflect_z(wo), self.reflectance, 1.0)
            } else {
                let wi = refract(wo, Vec3::Z, self.eta)?;
                BsdfSample::delta(wi, self.transmittance * radiance_scale(self.eta), eta_squared)
            });
        }
        let wo = into_frame(wo, self.tangent);
        let h = self.facets().sample_visible(wo, u);
        let fresnel = fresnel_dielectric(wo.dot(h), self.eta);
        let ((wi, facet), eta_squared) = if lobe < fresnel {
            (Facet::reflect(wo, h)?, 1.0)
        } else {
            (Facet::refract(wo, h, self.eta)?, eta_squared)
        };
        self.scatter(wo, wi, &facet, fresnel)
            .at(out_of_frame(wi, self.tangent), eta_squared)
    }

    fn facets(&self) -> Smith {
        Smith::new(self.alpha, self.distribution)
    }

    /// See [`super::Bsdf::albedo`].
    pub(super) fn albedo(&self) -> Rgb {
        let fresnel = fresnel_dielectric(1.0, self.eta);
        self.reflectance * fresnel + self.transmittance * (1.0 - fresnel)
    }
}

impl ThinGlass {
    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32) -> Option<BsdfSample> {
        let (wi, weight) = if lobe < self.reflected(wo.z) {
            (reflect_z(wo), self.reflectance)
        } else {
            (-wo, self.transmittance)
        };
        Some(BsdfSample::delta(wi, weight, 1.0))
    }

    /// Share of all orders of reflection: F + (1 − F)² F (1 + F² + …) = 2 F / (1 + F).
    fn reflected(&self, cos: f32) -> f32 {
        let fresnel = fresnel_dielectric(cos, self.ior);
        2.0 * fresnel / (1.0 + fresnel)
    }

    /// See [`super::Bsdf::albedo`].
    pub(super) fn albedo(&self) -> Rgb {
        let reflected = self.reflected(1.0);
        self.reflectance * reflected + self.transmittance * (1.0 - reflected)
    }
}
