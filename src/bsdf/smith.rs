//! Microfacets of two widths, GGX or Beckmann, with Smith's separable shadowing G1(wo) G1(wi), which is what Mitsuba takes:
//! scenes made for it look the same. The renderer's own [`super::Conductor`] and [`super::Dielectric`] have the
//! height-correlated form, which is nearer to the truth and brighter at grazing angles.
//!
//! Walter et al. 2007 for the distributions and the rational fit of Beckmann's G1 (within 0.35 %), Heitz 2014 (JCGT 3(2))
//! for the exact one and for visible normals, Dupuy and Benyoub 2023 for the sampling of GGX.

use super::dielectric::Facet;
use super::microfacet::SMOOTH_ALPHA;
use super::{BsdfEval, Distribution};
use crate::math::{Rgb, Vec3, sin_cos_turns};
use std::f32::consts::PI;

/// A distribution of normals, in the frame of its widths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Smith {
    /// Widths along x and y.
    alpha: [f32; 2],
    distribution: Distribution,
}

impl Smith {
    /// Widths below [`SMOOTH_ALPHA`] are taken for that.
    #[inline]
    pub(super) fn new(alpha: [f32; 2], distribution: Distribution) -> Smith {
        Smith {
            alpha: alpha.map(|alpha| alpha.max(SMOOTH_ALPHA)),
            distribution,
        }
    }

    /// D(h): density of normals per solid angle and projected area [1/sr].
    #[inline]
    pub(super) fn d(self, h: Vec3) -> f32 {
        let [ax, ay] = self.alpha;
        let (x, y, z2) = (h.x / ax, h.y / ay, h.z * h.z);
        let slope2 = x * x + y * y;
        match self.distribution {
            Distribution::Ggx => {
                let e = slope2 + z2;
                1.0 / (PI * ax * ay * e * e)
            }
            Distribution::Beckmann => (-slope2 / z2).exp() / (PI * ax * ay * z2 * z2),
        }
    }

    /// α(φ) sin θ.
    #[inline]
    fn stretch(self, w: Vec3) -> f32 {
        let [ax, ay] = self.alpha;
        let (x, y) = (ax * w.x, ay * w.y);
        (x * x + y * y).sqrt()
    }

    /// G1 / |cos θ|. Nothing is divided by the cosine where it is small.
    #[inline]
    pub(super) fn g1_over_cos(self, w: Vec3) -> f32 {
        let (cos, stretch) = (w.z.abs(), self.stretch(w));
        match self.distribution {
            Distribution::Ggx => 2.0 / (cos + (cos * cos + stretch * stretch).sqrt()),
            Distribution::Beckmann => {
                let a = cos / stretch;
                if a < 1.6 {
                    (3.535 + 2.181 * a) / (stretch * (1.0 + a * (2.276 + a * 2.577)))
                } else {
                    1.0 / cos
                }
            }
        }
    }

    /// Share of the normals that is visible.
    #[inline]
    pub(super) fn g1(self, w: Vec3) -> f32 {
        (w.z.abs() * self.g1_over_cos(w)).min(1.0)
    }

    /// What D(h) (wo·h) is to be multiplied by to be the density of [`Smith::sample_visible`]: the exact G1 / cos θo.
    #[inline]
    pub(super) fn visible_over_cos(self, wo: Vec3) -> f32 {
        match self.distribution {
            Distribution::Ggx => self.g1_over_cos(wo),
            Distribution::Beckmann => {
                let (cos, stretch) = (wo.z, self.stretch(wo));
                1.0 / visible_area(cos, stretch, cos / stretch)
            }
        }
    }

    /// A normal visible from `wo` (`wo.z > 0`).
    #[inline]
    pub(super) fn sample_visible(self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let [ax, ay] = self.alpha;
        let stretched = Vec3::new(wo.x * ax, wo.y * ay, wo.z).normalize();
        let (x, y, z) = match self.distribution {
            Distribution::Ggx => {
                // The height of the sum is above zero and needs no sum: as one it would lose the digits of the widest
                // normals.
                let height = (1.0 - u) * (1.0 + stretched.z);
                let z = height - stretched.z;
                let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
                let (sin, cos) = sin_cos_turns(v);
                (r * cos + stretched.x, r * sin + stretched.y, height)
            }
            Distribution::Beckmann => {
                let sin = (stretched.x * stretched.x + stretched.y * stretched.y).sqrt();
                let (cos_phi, sin_phi) = if sin > 0.0 {
                    (stretched.x / sin, stretched.y / sin)
                } else {
                    (1.0, 0.0)
                };
                let (along, across) = (visible_slope(stretched.z, sin, u), gaussian(v));
                (
                    cos_phi * along - sin_phi * across,
                    sin_phi * along + cos_phi * across,
                    1.0,
                )
            }
        };
        Vec3::new(x * ax, y * ay, z).try_normalize().unwrap_or(Vec3::Z)
    }

    /// Value and density of a pair of directions by a facet that sends this share of the light on its way, and is chosen to
    /// with this probability.
    #[inline]
    pub(super) fn scatter(self, wo: Vec3, wi: Vec3, facet: &Facet, (share, probability): (Rgb, f32)) -> BsdfEval {
        // f cos θi = share D G2 (wo·h) |dh/dwi| / cos θo.
        let d = self.d(facet.h) * facet.jacobian;
        BsdfEval {
            value: share * (d * self.g1_over_cos(wo) * self.g1(wi)),
            pdf_w: probability * d * self.visible_over_cos(wo),
        }
    }
}

/// A direction in the frame whose x axis is at this angle (cosine, sine) around the normal.
#[inline]
pub(super) fn into_frame(w: Vec3, [cos, sin]: [f32; 2]) -> Vec3 {
    Vec3::new(cos * w.x + sin * w.y, cos * w.y - sin * w.x, w.z)
}

/// The inverse of [`into_frame`].
#[inline]
pub(super) fn out_of_frame(w: Vec3, [cos, sin]: [f32; 2]) -> Vec3 {
    into_frame(w, [cos, -sin])
}

const SQRT_PI: f32 = 1.772_453_9;

/// cos θ (1 + Λ) of Beckmann's distribution, with `a` = cos / (α sin).
#[inline]
fn visible_area(cos: f32, stretch: f32, a: f32) -> f32 {
    // erfc(−a) = 1 + erf a.
    0.5 * (cos * erfc(-a) + stretch / SQRT_PI * (-a * a).exp())
}

/// A slope towards the viewer, drawn with density ∝ (cos + t sin)⁺ exp(−t²): what a Gaussian surface of width 1 shows under
/// that angle.
fn visible_slope(cos: f32, sin: f32, u: f32) -> f32 {
    // What lies above t, up to a factor, and exp(−t²).
    let above = |t: f32| {
        let gauss = (-t * t).exp();
        (cos * erfc_given(t, gauss) + sin / SQRT_PI * gauss, gauss)
    };
    let u = u.max(1e-12);
    let (mut low, mut high) = ((-cos / sin).max(-8.0), 8.0f32);
    let target = u * above(low).0;
    // Between the solutions at grazing and at normal incidence.
    let mut t = ((-u.ln()).max(0.0).sqrt() * (1.0 - cos) - gaussian(u) * cos).clamp(low, high);
    // Halley's method; where it leaves the bracket, the bracket is halved. Three rounds are common.
    for _ in 0..24 {
        let (value, gauss) = above(t);
        let excess = value - target;
        if excess > 0.0 {
            low = t;
        } else {
            high = t;
        }
        let seen = cos + t * sin;
        let newton = excess / (2.0 / SQRT_PI * seen * gauss);
        let bend = 1.0 + 0.5 * newton * (sin / seen - 2.0 * t);
        let next = t + if bend > 0.2 { newton / bend } else { newton };
        // The error is then about the third power of that. (Not of Halley's step: near the horizon it is always small.)
        if newton.abs() < 1e-3 {
            return next.clamp(low, high);
        }
        t = if next > low && next < high {
            next
        } else {
            0.5 * (low + high)
        };
    }
    t
}

/// A number with the density exp(−t²) / √π: the inverse error function of 2 v − 1, by the fit of Giles 2010 ("Approximating
/// the erfinv function").
#[inline]
fn gaussian(v: f32) -> f32 {
    let v = v.clamp(1e-12, 1.0 - 0.5 * f32::EPSILON);
    let w = -(4.0 * v * (1.0 - v)).ln();
    let horner = |w: f32, coefficients: [f32; 9]| coefficients.into_iter().fold(0.0, |sum, c| sum * w + c);
    let ratio = if w < 5.0 {
        horner(
            w - 2.5,
            [
                2.810_226_4e-8,
                3.432_739_4e-7,
                -3.523_387_7e-6,
                -4.391_506_5e-6,
                2.185_808_7e-4,
                -1.253_725e-3,
                -4.177_681_6e-3,
                0.246_640_73,
                1.501_409_4,
            ],
        )
    } else {
        horner(
            w.sqrt() - 3.0,
            [
                -2.002_142_6e-4,
                1.009_505_6e-4,
                1.349_343_2e-3,
                -3.673_428_4e-3,
                5.739_507_7e-3,
                -7.622_461_3e-3,
                9.438_870_5e-3,
                1.001_674,
                2.832_976_8,
            ],
        )
    };
    ratio * (2.0 * v - 1.0)
}

/// The complementary error function, within 2e-7 of itself for x > 0 (Press et al. 1992, section 6.2) and within 4e-7 else.
#[inline]
fn erfc(x: f32) -> f32 {
    erfc_given(x, (-x * x).exp())
}

/// [`erfc`], given exp(−x²).
#[inline]
fn erfc_given(x: f32, gauss: f32) -> f32 {
    let t = 1.0 / (1.0 + 0.5 * x.abs());
    let p = [
        0.170_872_77,
        -0.822_152_23,
        1.488_515_9,
        -1.135_204,
        0.278_868_07,
        -0.186_288_06,
        0.096_784_18,
        0.374_091_96,
        1.000_023_7,
        -1.265_512_2,
    ]
    .into_iter()
    .fold(0.0, |sum, c| sum * t + c);
    let tail = t * p.exp() * gauss;
    if x < 0.0 { 2.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use super::*;
    use statrs::function::erf as exact;

    #[test]
    fn the_error_functions_are_those_of_f64() {
        for i in -600..=900 {
            let x = i as f32 * 0.01;
            let expected = exact::erfc(f64::from(x));
            let got = f64::from(erfc(x));
            // The exponent of −x² has the digits of x².
            let bound = (1e-6 + 1.2e-7 * f64::from(x * x)) * expected + f64::from(f32::MIN_POSITIVE);
            assert!((got - expected).abs() < bound, "erfc {x}: {got} for {expected}");
        }
        for i in 1..100_000 {
            let v = i as f32 * 1e-5;
            let expected = exact::erf_inv(2.0 * f64::from(v) - 1.0);
            let got = f64::from(gaussian(v));
            // Near 1/2 both are nearly 0, and near the ends 1 − v has few digits.
            assert!((got - expected).abs() < 1e-5, "{v}: {got} for {expected}");
        }
    }

    #[test]
    fn visible_slopes_are_the_inverse_of_their_cumulative_function() {
        for cos in [1e-6f32, 0.01, 0.2, 0.5, 0.8, 0.99, 1.0] {
            let sin = (1.0 - cos * cos).sqrt();
            let above = |t: f64| {
                let (cos, sin) = (f64::from(cos), f64::from(sin));
                cos * exact::erfc(t) + sin / std::f64::consts::PI.sqrt() * (-t * t).exp()
            };
            let whole = above((-f64::from(cos) / f64::from(sin)).max(-8.0));
            for i in 0..=2000 {
                let u = (i as f32 / 2000.0).min(1f32.next_down()).max(1e-9);
                let got = above(f64::from(visible_slope(cos, sin, u))) / whole;
                assert!(
                    (got - f64::from(u)).abs() < 1e-6,
                    "cos {cos}: {got} of the slopes for {u}"
                );
            }
        }
    }

    /// The fit that values are made of, and the exact share that densities are.
    #[test]
    fn beckmanns_masking_is_the_exact_one_within_its_stated_error() {
        let facets = Smith::new([0.5, 0.2], Distribution::Beckmann);
        for i in 1..=1000 {
            let cos = i as f32 * 1e-3;
            let w = Vec3::new(0.6 * (1.0 - cos * cos).sqrt(), 0.8 * (1.0 - cos * cos).sqrt(), cos);
            let ratio = facets.g1(w) / (cos * facets.visible_over_cos(w));
            assert!((ratio - 1.0).abs() < 3.6e-3, "cos {cos}: {ratio}");
        }
    }
}
