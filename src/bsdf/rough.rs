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

#[cfg(test)]
mod tests {
    use super::super::tests::{REFLECTED, TRANSMITTED, assert_values};
    use super::super::{Bsdf, Dielectric};
    use super::*;
    use std::f32::consts::FRAC_PI_6;

    const TINTS: [Rgb; 2] = [Rgb::new(0.9, 0.8, 0.7), Rgb::new(0.5, 0.6, 0.7)];

    fn metal(alpha: [f32; 2], distribution: Distribution) -> RoughMetal {
        RoughMetal {
            eta: Rgb::new(0.2, 0.9, 1.1),
            k: Rgb::new(3.9, 2.4, 2.2),
            reflectance: TINTS[0],
            alpha,
            distribution,
            tangent: [1.0, 0.0],
        }
    }

    fn glass(eta: f32, alpha: [f32; 2], distribution: Distribution) -> RoughGlass {
        RoughGlass {
            eta,
            reflectance: TINTS[0],
            transmittance: TINTS[1],
            alpha,
            distribution,
            tangent: [1.0, 0.0],
        }
    }

    /// `roughconductor` and `roughdielectric` (int_ior 1.5) of Mitsuba 3.9.1, alpha_u 0.3, alpha_v 0.15; the latter from
    /// outside, then from inside.
    #[test]
    fn values_are_those_of_mitsuba() {
        for (distribution, metals, outside, inside) in [
            (
                Distribution::Ggx,
                [[1.10011, 0.632619, 0.471632], [0.0528443, 0.0307571, 0.0232786]],
                [
                    [0.0473355, 0.042076, 0.0368165],
                    [2.08662, 2.50395, 2.92127],
                    [0.00779649, 0.00935579, 0.0109151],
                ],
                [[0.0554877, 0.0493224, 0.0431571], [0.212676, 0.255211, 0.297746]],
            ),
            (
                Distribution::Beckmann,
                [[1.34129, 0.77131, 0.575029], [3.27197e-05, 1.9044e-05, 1.44135e-05]],
                [
                    [0.0577129, 0.0513004, 0.0448878],
                    [2.85535, 3.42642, 3.99749],
                    [5.3754e-05, 6.45048e-05, 7.52556e-05],
                ],
                [
                    [0.0676523, 0.0601354, 0.0526185],
                    [5.25328e-06, 6.30394e-06, 7.35459e-06],
                ],
            ),
        ] {
            let alpha = [0.3, 0.15];
            assert_values(&Bsdf::RoughMetal(metal(alpha, distribution)), &REFLECTED, &metals, 1e-4);
            let glass = |eta| Bsdf::RoughGlass(glass(eta, alpha, distribution));
            let [reflected, transmitted] = [REFLECTED[0], TRANSMITTED[0]];
            let pairs = [reflected, transmitted, TRANSMITTED[1]];
            assert_values(&glass(1.5), &pairs, &outside, 1e-4);
            assert_values(&glass(1.0 / 1.5), &pairs[..2], &inside, 1e-4);
        }
    }

    #[test]
    fn without_width_or_tint_they_are_the_smooth_ones() {
        let wo = Vec3::new(0.48, 0.36, 0.8);
        let (eta, k) = (Rgb::new(0.2, 0.9, 1.1), Rgb::new(3.9, 2.4, 2.2));
        let mirror = RoughMetal {
            reflectance: Rgb::WHITE,
            ..metal([0.0; 2], Distribution::Beckmann)
        };
        let smooth = Bsdf::Conductor(Conductor { eta, k, alpha: 0.0 });
        let u = [0.2, 0.7];
        assert_eq!(mirror.sample(wo, u), smooth.sample(wo, 0.5, u));
        for eta in [1.5, 1.0 / 1.5, 1.0] {
            let clear = RoughGlass {
                reflectance: Rgb::WHITE,
                transmittance: Rgb::WHITE,
                ..glass(eta, [0.0; 2], Distribution::Ggx)
            };
            let smooth = Bsdf::Dielectric(Dielectric { eta, alpha: 0.0 });
            assert!(Bsdf::RoughGlass(clear).is_delta());
            for lobe in [0.0, 0.05, 0.5, 0.99] {
                assert_eq!(clear.sample(wo, lobe, u), smooth.sample(wo, lobe, u), "eta {eta}");
            }
        }
    }

    #[test]
    fn clear_thin_glass_sends_on_all_light_and_reflects_twice_what_one_side_does_or_less() {
        let sheet = |reflectance, transmittance| ThinGlass {
            ior: 1.5,
            reflectance,
            transmittance,
        };
        let wo = Vec3::new(0.48, 0.36, 0.8);
        let once = fresnel_dielectric(0.8, 1.5);
        // 2 F − 2 F² + …
        let reflected = sheet(Rgb::WHITE, Rgb::WHITE).reflected(0.8);
        assert!((reflected - 2.0 * once + 2.0 * once * once).abs() < 3.0 * once * once * once);
        let colored = sheet(TINTS[0], TINTS[1]);
        let back = colored.sample(wo, reflected - 1e-4).unwrap();
        let through = colored.sample(wo, reflected + 1e-4).unwrap();
        assert_eq!((back.wi, back.weight), (Vec3::new(-0.48, -0.36, 0.8), TINTS[0]));
        assert_eq!((through.wi, through.weight), (-wo, TINTS[1]));
    }

    #[test]
    fn highlights_are_wide_along_the_tangent_where_that_width_is_larger() {
        let (sin, cos) = FRAC_PI_6.sin_cos();
        for distribution in [Distribution::Ggx, Distribution::Beckmann] {
            let straight = metal([0.4, 0.05], distribution);
            let turned = RoughMetal {
                tangent: [cos, sin],
                ..straight
            };
            // Tilted from the normal along the tangent and across it.
            let along = turned.eval(Vec3::Z, Vec3::new(0.5 * cos, 0.5 * sin, 0.75f32.sqrt()));
            let across = turned.eval(Vec3::Z, Vec3::new(-0.5 * sin, 0.5 * cos, 0.75f32.sqrt()));
            assert!(along.value.r > 100.0 * across.value.r, "{along:?} {across:?}");
            assert!(along.pdf_w > 100.0 * across.pdf_w);
            // All turns with the tangent.
            let [wo, wi] = [Vec3::new(0.6, 0.0, 0.8), Vec3::new(-0.48, 0.36, 0.8)];
            let [a, b] = [wo, wi].map(|w| out_of_frame(w, turned.tangent));
            let (there, here) = (turned.eval(a, b), straight.eval(wo, wi));
            assert!((there.value.r / here.value.r - 1.0).abs() < 1e-4, "{there:?} {here:?}");
            let (there, here) = (turned.sample(a, [0.3, 0.6]), straight.sample(wo, [0.3, 0.6]));
            let (there, here) = (there.unwrap(), here.unwrap());
            assert!((there.wi - out_of_frame(here.wi, turned.tangent)).length() < 1e-5);
        }
    }
}
