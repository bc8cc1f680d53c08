//! Glass: reflection and refraction at a smooth or rough interface (Walter et al. 2007).

use super::microfacet::{Ggx, SMOOTH_ALPHA};
use super::{BsdfEval, BsdfSample, reflect_z};
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
        let reflects = wi.z > 0.0;
        let h = if reflects { wo + wi } else { wo + wi * self.eta };
        let Some(h) = h.try_normalize() else {
            return BsdfEval::ZERO;
        };
        let h = if h.z < 0.0 { -h } else { h };
        let (wo_h, wi_h) = (wo.dot(h), wi.dot(h));
        // Both directions must see the same microfacet from the sides that they are on.
        if wo_h <= 0.0 || (wi_h > 0.0) != reflects {
            return BsdfEval::ZERO;
        }
        let ggx = Ggx { alpha: self.alpha };
        let fresnel = fresnel_dielectric(wo_h, self.eta);
        let (share, jacobian) = if reflects {
            (fresnel, 1.0 / (4.0 * wo_h))
        } else {
            let denominator = wi_h + wo_h / self.eta;
            (1.0 - fresnel, -wi_h / (denominator * denominator))
        };
        let d = ggx.d(h);
        // f cos θi = share D G2 (wo·h) |dh/dwi| / cos θo; transmitted radiance is scaled by the change of solid angle.
        let common = share * d * wo_h * jacobian / wo.z;
        let scale = if reflects { 1.0 } else { 1.0 / (self.eta * self.eta) };
        let value = common * ggx.g2(wo, wi) * scale;
        let pdf_w = common * ggx.g1(wo);
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
                    Rgb::splat(1.0 / eta_squared),
                    eta_squared,
                )
            });
        }
        let ggx = Ggx { alpha: self.alpha };
        let h = ggx.sample_visible(wo, u);
        let wo_h = wo.dot(h);
        let (wi, eta_squared) = if lobe < fresnel_dielectric(wo_h, self.eta) {
            let wi = (h * (2.0 * wo_h) - wo).normalize();
            (wi.z > 0.0).then_some((wi, 1.0))?
        } else {
            let wi = refract(wo, h, self.eta)?;
            (wi.z < 0.0).then_some((wi, eta_squared))?
        };
        let BsdfEval { value, pdf_w } = self.eval(wo, wi);
        (pdf_w > 0.0).then(|| BsdfSample {
            wi,
            weight: value / pdf_w,
            pdf_w,
            eta_squared,
        })
    }
}

/// The unpolarised Fresnel reflectance between dielectrics, seen under the cosine `cos` >= 0, with the index ratio `eta`
/// (far side over near side). 1 under total internal reflection.
#[inline]
pub(super) fn fresnel_dielectric(cos: f32, eta: f32) -> f32 {
    let cos = cos.clamp(0.0, 1.0);
    let sin2_t = (1.0 - cos * cos) / (eta * eta);
    if sin2_t >= 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let r_parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let r_perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (r_parallel * r_parallel + r_perpendicular * r_perpendicular)
}

/// Snell's law: the direction of the refracted ray, away from the surface, or `None` under total internal reflection.
#[inline]
fn refract(wo: Vec3, h: Vec3, eta: f32) -> Option<Vec3> {
    let cos = wo.dot(h);
    let sin2_t = (1.0 - cos * cos).max(0.0) / (eta * eta);
    if sin2_t >= 1.0 {
        return None;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    (h * (cos / eta - cos_t) - wo / eta).try_normalize()
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
