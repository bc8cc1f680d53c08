//! Glass: reflection and refraction at a smooth or rough interface (Walter et al. 2007).

use super::microfacet::{Ggx, SMOOTH_ALPHA};
use super::{BsdfEval, BsdfSample, eta2_minus_sin2, reflect_z};
use crate::math::{Rgb, Vec3};

/// A dielectric interface, colourless and without absorption.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dielectric {
    /// Index on the far side over the index on the side of `wo`.
    pub eta: f32,
    /// GGX width; below [`SMOOTH_ALPHA`] perfectly smooth.
    pub alpha: f32,
}

impl Dielectric {
    pub(super) fn is_smooth(&self) -> bool {
        // Between equal indices nothing bends and nothing reflects, however rough; the half vector of a transmitted
        // pair, a difference of nearly opposite directions, is then rounding error.
        self.alpha < SMOOTH_ALPHA || (self.eta - 1.0).abs() < SMOOTH_ALPHA
    }

    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if self.is_smooth() || wi.z == 0.0 {
            return BsdfEval::ZERO;
        }
        let Some(facet) = Facet::of(wo, wi, self.eta) else {
            return BsdfEval::ZERO;
        };
        let fresnel = fresnel_dielectric(facet.wo_h, self.eta);
        let share = if wi.z > 0.0 { fresnel } else { 1.0 - fresnel };
        self.scatter(wo, wi, &facet, share)
    }

    /// Value and density of a pair of directions that the microfacets make with this `share` of the light.
    #[inline]
    fn scatter(&self, wo: Vec3, wi: Vec3, facet: &Facet, share: f32) -> BsdfEval {
        let ggx = Ggx { alpha: self.alpha };
        // f cos θi = share D G2 (wo·h) |dh/dwi| / cos θo; transmitted radiance is scaled by the change of solid angle.
        let common = share * ggx.d(facet.h) * facet.jacobian;
        let scale = if wi.z > 0.0 { 1.0 } else { radiance_scale(self.eta) };
        let value = common * ggx.g2_over_cos(wo, wi) * scale;
        let pdf_w = common * ggx.g1_over_cos(wo);
        if value.is_finite() && pdf_w.is_finite() {
            BsdfEval {
                value: Rgb::splat(value),
                pdf_w,
            }
        } else {
            BsdfEval::ZERO
        }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let eta_squared = self.eta * self.eta;
        if self.is_smooth() {
            return Some(if lobe < fresnel_dielectric(wo.z, self.eta) {
                BsdfSample::delta(reflect_z(wo), Rgb::WHITE, 1.0)
            } else {
                // The probability of the choice cancels the transmittance; what stays is the solid-angle factor.
                BsdfSample::delta(
                    refract(wo, Vec3::Z, self.eta)?,
                    Rgb::splat(radiance_scale(self.eta)),
                    eta_squared,
                )
            });
        }
        let ggx = Ggx { alpha: self.alpha };
        let h = ggx.sample_visible(wo, u);
        let fresnel = fresnel_dielectric(wo.dot(h), self.eta);
        // Value and density by this very h: that of wo and wi is another one where the lobe is narrower than directions are
        // rounded.
        let (wi, eval, eta_squared) = if lobe < fresnel {
            let (wi, facet) = Facet::reflect(wo, h)?;
            (wi, self.scatter(wo, wi, &facet, fresnel), 1.0)
        } else {
            let (wi, facet) = Facet::refract(wo, h, self.eta)?;
            (wi, self.scatter(wo, wi, &facet, 1.0 - fresnel), eta_squared)
        };
        (eval.pdf_w > 0.0).then(|| BsdfSample {
            wi,
            weight: eval.value / eval.pdf_w,
            pdf_w: eval.pdf_w,
            eta_squared,
        })
    }
}

/// The microfacet that a pair of directions meets.
pub(super) struct Facet {
    /// Its normal.
    pub(super) h: Vec3,
    /// Cosine of `wo` to it, above 0.
    pub(super) wo_h: f32,
    /// |dh/dwi| wo·h.
    pub(super) jacobian: f32,
}

impl Facet {
    /// That of `wo` and `wi`, on the same side or on opposite ones. `None` where they do not see the same facet from the
    /// sides that they are on.
    #[inline]
    pub(super) fn of(wo: Vec3, wi: Vec3, eta: f32) -> Option<Facet> {
        let reflects = wi.z > 0.0;
        let h = if reflects { wo + wi } else { wo + wi * eta };
        let (h, length) = h.normalize_and_length();
        let h = if h.z < 0.0 { -h } else { h };
        let (wo_h, wi_h) = (wo.dot(h), wi.dot(h));
        if length == 0.0 || wo_h <= 0.0 || (wi_h > 0.0) != reflects {
            return None;
        }
        let jacobian = if reflects {
            0.25
        } else {
            refraction_jacobian(eta, wo_h, wi_h, length)
        };
        Some(Facet { h, wo_h, jacobian })
    }

    /// The facet of normal `h` and the direction that it reflects `wo` from, unless that is below the surface.
    #[inline]
    pub(super) fn reflect(wo: Vec3, h: Vec3) -> Option<(Vec3, Facet)> {
        let wo_h = wo.dot(h);
        let wi = (h * (2.0 * wo_h) - wo).normalize();
        let jacobian = 0.25;
        (wi.z > 0.0).then_some((wi, Facet { h, wo_h, jacobian }))
    }

    /// The facet of normal `h` and the direction that it refracts `wo` from, unless that is above the surface or all is
    /// reflected.
    #[inline]
    pub(super) fn refract(wo: Vec3, h: Vec3, eta: f32) -> Option<(Vec3, Facet)> {
        let wo_h = wo.dot(h);
        let cos_t = cos_transmitted(wo_h, eta)?;
        let wi = refract(wo, h, eta)?;
        let jacobian = refraction_jacobian(eta, wo_h, -cos_t, half_length(wo_h, cos_t, eta));
        (wi.z < 0.0).then_some((wi, Facet { h, wo_h, jacobian }))
    }
}

/// |dh/dwi| wo·h under refraction, where `sum` is wo·h + eta wi·h: the length of the vector that h is the direction of.
#[inline]
fn refraction_jacobian(eta: f32, wo_h: f32, wi_h: f32, sum: f32) -> f32 {
    -wi_h * wo_h * (eta * eta) / (sum * sum)
}

/// Factor on transmitted radiance, 1 / eta². That of the way back is taken from the same number, so that the two cancel to
/// an ulp: a reciprocal taken three times is the reciprocal. Of eta² on one side and (1 / eta)² on the other the product is
/// off by up to three ulps, always to the same side, and adds up over the life of a path.
#[inline]
pub(super) fn radiance_scale(eta: f32) -> f32 {
    let inverse = 1.0 / eta;
    if eta < 1.0 {
        inverse * inverse
    } else {
        let eta = 1.0 / inverse;
        1.0 / (eta * eta)
    }
}

/// The unpolarised Fresnel reflectance between dielectrics, seen under the cosine `cos` >= 0, with the index ratio `eta`
/// (far side over near side). 1 under total internal reflection.
#[inline]
pub(super) fn fresnel_dielectric(cos: f32, eta: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    let Some(cos_t) = cos_transmitted(cos, eta) else {
        return 1.0;
    };
    let r_parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let r_perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (r_parallel * r_parallel + r_perpendicular * r_perpendicular)
}

/// Cosine of the refracted ray, or `None` under total internal reflection.
#[inline]
fn cos_transmitted(cos: f32, eta: f32) -> Option<f32> {
    let scaled = eta2_minus_sin2(eta, cos);
    (scaled > 0.0).then(|| scaled.sqrt() / eta)
}

/// wo·h + eta wi·h of a refracted pair: the length of wo + eta wi, with the sign that makes it a multiple of `h`. By
/// (wo·h)² − (eta wi·h)² = 1 − eta², because the sum itself is rounding error for eta near 1.
#[inline]
fn half_length(cos: f32, cos_t: f32, eta: f32) -> f32 {
    (1.0 - eta) * (1.0 + eta) / (cos + eta * cos_t)
}

/// Snell's law: the direction of the refracted ray, away from the surface, or `None` under total internal reflection.
#[inline]
pub(super) fn refract(wo: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cos = wo.dot(h);
    let cos_t = cos_transmitted(cos, eta)?;
    ((h * half_length(cos, cos_t, eta) - wo) / eta).try_normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reflectance_at_normal_incidence_and_beyond_the_critical_angle() {
        assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
        let critical = (1.0f32 - 1.0 / (1.5 * 1.5)).sqrt();
        assert_eq!(fresnel_dielectric(critical * 0.99, 1.0 / 1.5), 1.0);
        assert!(fresnel_dielectric(critical * 1.01, 1.0 / 1.5) < 1.0);
        assert!(fresnel_dielectric(0.3, 1.0) < 1e-12);
    }

    #[test]
    fn refraction_follows_snells_law_and_reverses() {
        for cos in [0.05f32, 0.3, 0.7, 1.0] {
            let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
            let wi = refract(wo, Vec3::Z, 1.5).unwrap();
            assert!((wi.x.abs() * 1.5 - wo.x).abs() < 1e-6);
            let back = refract(Vec3::new(wi.x, 0.0, -wi.z), Vec3::Z, 1.0 / 1.5).unwrap();
            assert!((Vec3::new(back.x, 0.0, -back.z) - wo).length() < 1e-5, "{wo} {back}");
        }
    }

    #[test]
    fn a_smooth_interface_loses_no_energy_on_the_way_in_and_out() {
        let glass = |eta| Dielectric { eta, alpha: 0.0 };
        let into = glass(1.5).sample(Vec3::Z, 0.99, [0.5; 2]).unwrap();
        let out = glass(1.0 / 1.5).sample(Vec3::Z, 0.99, [0.5; 2]).unwrap();
        assert!((into.weight.r * out.weight.r - 1.0).abs() < 1e-6);
        assert!((into.eta_squared * out.eta_squared - 1.0).abs() < 1e-6);
    }
}
