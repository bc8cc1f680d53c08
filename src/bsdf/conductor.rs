//! Metals: GGX microfacets with the exact Fresnel reflectance of a complex index.

use super::microfacet::{Ggx, SMOOTH_ALPHA};
use super::{BsdfEval, BsdfSample, eta2_minus_sin2, reflect_z};
use crate::math::{Rgb, Vec3};

/// A metal of complex index `eta + i k` per channel, relative to the outside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// Real part of the index, above 0.
    pub eta: Rgb,
    /// Absorption, 0 or more.
    pub k: Rgb,
    /// GGX width; below [`SMOOTH_ALPHA`] a perfect mirror.
    pub alpha: f32,
}

impl Conductor {
    pub(super) fn is_smooth(&self) -> bool {
        self.alpha < SMOOTH_ALPHA
    }

    #[inline]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wi.z <= 0.0 || self.is_smooth() {
            return BsdfEval::ZERO;
        }
        match (wo + wi).try_normalize() {
            Some(h) => self.reflect(wo, wi, h),
            None => BsdfEval::ZERO,
        }
    }

    /// Value and density of a reflection by the microfacets of normal `h`.
    #[inline]
    fn reflect(&self, wo: Vec3, wi: Vec3, h: Vec3) -> BsdfEval {
        let ggx = Ggx { alpha: self.alpha };
        let d = ggx.d(h);
        // f cos θi = F D G2 / (4 cos θo), and the Jacobian of reflection is 1 / (4 wo·h).
        let value = self.fresnel(wo.dot(h)) * (0.25 * d * ggx.g2_over_cos(wo, wi));
        let pdf_w = 0.25 * d * ggx.g1_over_cos(wo);
        // Products of two denormal cosines vanish and leave 0 / 0; such a pair carries no light.
        if value.is_finite() && pdf_w.is_finite() {
            BsdfEval { value, pdf_w }
        } else {
            BsdfEval::ZERO
        }
    }

    #[inline]
    pub(super) fn sample(&self, wo: Vec3, u: [f32; 2]) -> Option<BsdfSample> {
        if self.is_smooth() {
            return Some(BsdfSample::delta(reflect_z(wo), self.fresnel(wo.z), 1.0));
        }
        let ggx = Ggx { alpha: self.alpha };
        let h = ggx.sample_visible(wo, u);
        let wi = (h * (2.0 * wo.dot(h)) - wo).normalize();
        if wi.z <= 0.0 {
            return None;
        }
        // By this very h: that of wo and wi is another one where the lobe is narrower than directions are rounded.
        let BsdfEval { value, pdf_w } = self.reflect(wo, wi, h);
        (pdf_w > 0.0).then(|| BsdfSample {
            wi,
            weight: value / pdf_w,
            pdf_w,
            eta_squared: 1.0,
        })
    }

    /// Unpolarised reflectance at an interface seen under the cosine `cos` from outside.
    #[inline]
    pub(super) fn fresnel(&self, cos: f32) -> Rgb {
        let cos = cos.clamp(0.0, 1.0);
        let channel = |eta: f32, k: f32| fresnel_conductor(cos, eta, k);
        Rgb::new(
            channel(self.eta.r, self.k.r),
            channel(self.eta.g, self.k.g),
            channel(self.eta.b, self.k.b),
        )
    }
}

/// The exact unpolarised Fresnel reflectance of a complex index (Born and Wolf, section 14.2), in real arithmetic.
#[inline]
fn fresnel_conductor(cos: f32, eta: f32, k: f32) -> f32 {
    let cos2 = cos * cos;
    let sin2 = (1.0 - cos) * (1.0 + cos);
    let eta_k2 = (eta * k) * (eta * k);
    let t0 = eta2_minus_sin2(eta, cos) - k * k;
    let a2_plus_b2 = (t0 * t0 + 4.0 * eta_k2).sqrt();
    let t1 = a2_plus_b2 + cos2;
    // a² and b² are (√(t0² + 4 eta² k²) ± t0) / 2, and their product is eta² k²: the smaller one comes from the larger one,
    // because the difference would be rounding error for large k.
    let larger = 0.5 * (a2_plus_b2 + t0.abs());
    let a = if t0 >= 0.0 { larger } else { eta_k2 / larger }.sqrt();
    let t2 = 2.0 * cos * a;
    let r_s = (t1 - t2) / (t1 + t2);
    let t3 = cos2 * a2_plus_b2 + sin2 * sin2;
    let t4 = t2 * sin2;
    let r_p = r_s * (t3 - t4) / (t3 + t4);
    // 0 / 0 at exactly grazing incidence, where everything is reflected.
    let r = 0.5 * (r_s + r_p);
    if r.is_nan() { 1.0 } else { r.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same reflectance in complex f64 arithmetic.
    fn reference(cos: f64, eta: f64, k: f64) -> f64 {
        type C = (f64, f64);
        let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
        let sqrt = |a: C| {
            let r = a.0.hypot(a.1);
            (
                ((r + a.0) / 2.0).max(0.0).sqrt(),
                ((r - a.0) / 2.0).max(0.0).sqrt().copysign(a.1),
            )
        };
        let n = (eta, k);
        let n2 = mul(n, n);
        let cos_t_n = sqrt((n2.0 - (1.0 - cos * cos), n2.1)); // n cos θt
        let ratio2 =
            |a: C, b: C| ((a.0 - b.0).powi(2) + (a.1 - b.1).powi(2)) / ((a.0 + b.0).powi(2) + (a.1 + b.1).powi(2));
        let r_s = ratio2((cos, 0.0), cos_t_n);
        let r_p = ratio2((n2.0 * cos, n2.1 * cos), cos_t_n);
        0.5 * (r_s + r_p)
    }

    #[test]
    fn reflectance_is_that_of_complex_arithmetic_for_metals_and_glasses() {
        for (eta, k) in [(0.183, 3.424), (1.657, 9.224), (1.5, 0.0), (0.2, 1000.0), (4.0, 1.0)] {
            for i in 0..=100 {
                let cos = f64::from(i) / 100.0;
                let (got, expected) = (
                    fresnel_conductor(cos as f32, eta as f32, k as f32),
                    reference(cos, eta, k),
                );
                assert!(
                    (f64::from(got) - expected).abs() < 2e-5,
                    "cos {cos} eta {eta} k {k}: {got} for {expected}"
                );
            }
        }
    }
}
