//! The principled BSDF: Mitsuba's `principled`, which is Burley's ("Physically Based Shading at Disney", 2012, and
//! "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering", 2015).
//!
//! A diffuse part with retro-reflection and sheen, GGX facets that reflect as metal and as a dielectric and transmit as
//! tinted glass, and a coat. What facets reflect and transmit is at most what they get.
//!
//! Burley's sum does not take what facets reflect from the diffuse part: a white one of index 1.5 and roughness 0.5 sends on
//! 1.043 times what it gets along the normal, 1.060 at 53 degrees, 1.154 at 78, and 1.067 of light from all sides. Scenes that were
//! made for it are to look as they did, so it stays for them. Where `conserves` is set, the diffuse part is multiplied by
//! (1 − F(θo)) (1 − F(θi)), which is reciprocal and leaves out light that goes back and forth below the facets. The coat is a layer of
//! GGX facets of index 1.5 then, and all that is below is multiplied by the same for its reflectance; Burley's is a quarter as
//! strong, of facets with wider tails, and added, which gains at most 3.5 %. The sheen is added in both.
//!
//! What is transmitted enters a solid, or crosses a wall too thin to refract (`thin`): light is then scattered as if it were
//! reflected, to the other side.
//!
//! Dielectric reflection can be weakened and coloured, as glTF's `KHR_materials_specular` does: the reflectance F0 along the
//! normal is multiplied by `specular_color`, up to 1; that at other angles lies between as the true one does between F0 and 1; and
//! all of it is multiplied by `specular`.
//!
//! Directions are sampled by densities of our own.

use super::coated::smooth_internal_reflectance;
use super::dielectric::{Facet, fresnel_dielectric, radiance_scale};
use super::smith::{Smith, into_frame, out_of_frame};
use super::{BsdfEval, BsdfSample, Distribution, eta2_minus_sin2};
use crate::math::{Rgb, Vec3, sin_cos_turns};
use crate::sampling::warp;
use std::f32::consts::{FRAC_1_PI, PI};

/// The principled BSDF at a point. Parameters as in [`crate::material::Principled`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipledBsdf {
    /// Albedo of the diffuse part, reflectance of metal, tint of glass.
    pub base_color: Rgb,
    /// Square root of the GGX width.
    pub roughness: f32,
    /// Stretch of highlights.
    pub anisotropic: f32,
    /// Share of metal.
    pub metallic: f32,
    /// Share of glass in what is not metal.
    pub spec_trans: f32,
    /// Index on the other side over that on the side of `wo`.
    pub eta: f32,
    /// Hue of reflections of what is not metal.
    pub spec_tint: f32,
    /// Factor on those.
    pub specular: f32,
    /// Factor on their reflectance along the normal, at least 0.
    pub specular_color: Rgb,
    /// Retro-reflection of cloth.
    pub sheen: f32,
    /// Hue of that.
    pub sheen_tint: f32,
    /// Between diffuse and subsurface scattering.
    pub flatness: f32,
    /// A second, colourless coat.
    pub clearcoat: f32,
    /// Width of its facets, below 1 where energy is not conserved.
    pub coat_alpha: f32,
    /// Whether what facets reflect is taken from the diffuse part, and what the coat does from all below.
    pub conserves: bool,
    /// Whether what is transmitted crosses a thin wall.
    pub thin: bool,
    /// Whether `wo` is outside. Both sides of a thin wall are.
    pub front: bool,
    /// Cosine and sine of the angle around the normal of the direction that highlights are stretched along.
    pub tangent: [f32; 2],
}

/// The coat's reflectance along the normal.
const COAT_REFLECTANCE: f32 = 0.04;
/// The index that belongs to it.
const COAT_INDEX: f32 = 1.5;
/// What the layer takes of diffuse light that leaves a surface of index 1.1 to 2.5 below it, within 0.004.
const COAT_DIFFUSE_REFLECTANCE: f32 = 0.081;
/// Width of the GGX facets whose masking Burley's coat has, whatever its own.
const COAT_SHADOWING: f32 = 0.25;
/// Widths of Burley's coat without gloss and with all of it.
const BURLEY_COAT_ALPHA: [f32; 2] = [0.1, 0.001];
/// The smallest width.
const MIN_ALPHA: f32 = 1e-3;

/// Shares of light by one facet.
struct Shares {
    reflected: Rgb,
    transmitted: Rgb,
}

impl Shares {
    /// Probability of reflection where a facet has been chosen. Of white glass it is the reflectance.
    fn reflection_probability(&self) -> f32 {
        let [reflected, transmitted] = [self.reflected, self.transmitted].map(Rgb::luminance);
        if transmitted > 0.0 {
            reflected / (reflected + transmitted)
        } else {
            1.0
        }
    }
}

/// Probabilities of the lobes; their sum is 1.
struct Lobes {
    diffuse: f32,
    coat: f32,
    main: f32,
}

impl PrincipledBsdf {
    /// Width of the coat of a gloss in [0, 1] where energy is not conserved.
    pub fn burley_coat_alpha(gloss: f32) -> f32 {
        let [dull, glossy] = BURLEY_COAT_ALPHA;
        dull + (glossy - dull) * gloss
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        if wi.z == 0.0 {
            return BsdfEval::ZERO;
        }
        let [wo, wi] = [wo, wi].map(|w| into_frame(w, self.tangent));
        let reflected = if self.thin { wi.with_z(wi.z.abs()) } else { wi };
        Facet::of(wo, reflected, self.index()).map_or(BsdfEval::ZERO, |mut facet| {
            if reflected.z > 0.0 {
                // The same, but the product has few digits where both are grazing, and the coat's density is over it.
                facet.wo_h = 0.5 * (wo + reflected).length();
            }
            self.scatter(wo, wi, &facet)
        })
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let lobes = self.lobes(wo);
        if lobe < lobes.diffuse {
            let wi = warp::cosine_hemisphere(u);
            return self.eval(wo, wi).at(wi, 1.0);
        }
        let lobe = lobe - lobes.diffuse;
        let wo = into_frame(wo, self.tangent);
        let mut eta_squared = 1.0;
        let (wi, facet) = if lobe < lobes.coat {
            let h = if self.conserves {
                self.coat_facets().sample_visible(wo, u)
            } else {
                self.burley_coat().sample(u)
            };
            if wo.dot(h) <= 0.0 {
                return None;
            }
            Facet::reflect(wo, h)?
        } else {
            let h = self.facets().sample_visible(wo, u);
            if (lobe - lobes.coat) / lobes.main < self.shares(wo.dot(h)).reflection_probability() {
                Facet::reflect(wo, h)?
            } else if self.thin {
                let (wi, facet) = Facet::reflect(wo, h)?;
                (wi.with_z(-wi.z), facet)
            } else {
                let eta = self.index();
                eta_squared = eta * eta;
                Facet::refract(wo, h, eta)?
            }
        };
        self.scatter(wo, wi, &facet)
            .at(out_of_frame(wi, self.tangent), eta_squared)
    }

    /// Value and density of a pair of directions in the frame of the highlights.
    fn scatter(&self, wo: Vec3, wi: Vec3, facet: &Facet) -> BsdfEval {
        let lobes = self.lobes(wo);
        let shares = self.shares(facet.wo_h);
        let reflection = shares.reflection_probability();
        if wi.z < 0.0 {
            let scale = if self.thin { 1.0 } else { radiance_scale(self.index()) };
            let share = (
                shares.transmitted * (scale * self.passes_coat(wo, wi)),
                lobes.main * (1.0 - reflection),
            );
            return self.facets().scatter(wo, wi, facet, share).or_zero();
        }
        let share = (shares.reflected, lobes.main * reflection);
        let mut eval = self.facets().scatter(wo, wi, facet, share);
        if lobes.diffuse > 0.0 {
            eval.value += self.diffuse(wo, wi, facet.wo_h);
            eval.pdf_w += lobes.diffuse * warp::cosine_hemisphere_pdf_w(wi.z);
        }
        if lobes.coat > 0.0 {
            let coat = self.coat(wo, wi, facet, lobes.coat);
            eval.value = eval.value * self.passes_coat(wo, wi) + coat.value;
            eval.pdf_w += coat.pdf_w;
        }
        eval.or_zero()
    }

    /// What the coat reflects, and its density where it has been chosen with this probability.
    fn coat(&self, wo: Vec3, wi: Vec3, facet: &Facet, probability: f32) -> BsdfEval {
        if self.conserves {
            let share = Rgb::splat(self.coat_reflectance(facet.wo_h));
            return self.coat_facets().scatter(wo, wi, facet, (share, probability));
        }
        let d = self.burley_coat().d(facet.h);
        let shadowing = Smith::new([COAT_SHADOWING; 2], Distribution::Ggx);
        let masking = shadowing.g1(wo) * shadowing.g1(wi);
        let fresnel = self.schlick(Rgb::splat(COAT_REFLECTANCE), facet.wo_h);
        BsdfEval {
            value: fresnel * (0.25 * self.clearcoat * d * masking * wi.z),
            pdf_w: probability * d * facet.h.z / (4.0 * facet.wo_h),
        }
    }

    /// What a coat that is a layer reflects under the cosine `cos`.
    fn coat_reflectance(&self, cos: f32) -> f32 {
        self.clearcoat * fresnel_dielectric(cos, COAT_INDEX)
    }

    /// What a coat that is a layer leaves of light between two directions.
    fn passes_coat(&self, wo: Vec3, wi: Vec3) -> f32 {
        if !self.conserves || self.clearcoat == 0.0 {
            return 1.0;
        }
        let is_outside = [self.front, self.thin || self.front == (wi.z > 0.0)];
        let passes = |w: Vec3, is_outside| {
            if is_outside {
                1.0 - self.coat_reflectance(w.z.abs())
            } else {
                1.0
            }
        };
        passes(wo, is_outside[0]) * passes(wi, is_outside[1])
    }

    /// The diffuse part and the sheen, times |cos θi|.
    fn diffuse(&self, wo: Vec3, wi: Vec3, cos_d: f32) -> Rgb {
        let [at_wo, at_wi] = [wo, wi].map(|w| schlick_weight(w.z));
        let plain = (1.0 - 0.5 * at_wo) * (1.0 - 0.5 * at_wi);
        let r = 2.0 * self.roughness * cos_d * cos_d;
        let retro = r * (at_wo + at_wi + at_wo * at_wi * (r - 1.0));
        let flat = [at_wo, at_wi].map(|weight| 1.0 + (0.5 * r - 1.0) * weight);
        let subsurface = 1.25 * (flat[0] * flat[1] * (1.0 / (wo.z + wi.z) - 0.5) + 0.5);
        let shape = (plain + retro) * (1.0 - self.flatness) + subsurface * self.flatness;
        let diffuse = self.base_color * (self.opaque() * shape * FRAC_1_PI);
        let sheen = self.hue(self.sheen_tint) * (self.sheen * (1.0 - self.metallic) * schlick_weight(cos_d));
        let left = if self.conserves {
            (1.0 - self.dielectric(wo.z).max_component()) * (1.0 - self.dielectric(wi.z).max_component())
        } else {
            1.0
        };
        (diffuse * left + sheen) * wi.z
    }

    /// What microfacets reflect and transmit under the cosine `cos`.
    fn shares(&self, cos: f32) -> Shares {
        let dielectric = self.dielectric(cos);
        let reflected = if self.front {
            let mut reflected = dielectric * ((1.0 - self.metallic) * (1.0 - self.spec_tint));
            if self.metallic > 0.0 {
                reflected += self.schlick(self.base_color, cos) * self.metallic;
            }
            let tinted = (1.0 - self.metallic) * self.spec_tint * self.specular;
            if tinted > 0.0 {
                reflected += self.schlick(self.hue(1.0) * self.at_normal(), cos) * tinted;
            }
            reflected
        } else {
            // From inside only glass is seen.
            dielectric * self.glass()
        };
        // Light crosses the surface of a solid twice.
        let tint = if self.thin {
            self.base_color
        } else {
            self.base_color.map(f32::sqrt)
        };
        Shares {
            reflected,
            transmitted: tint * (self.glass() * (1.0 - dielectric.max_component())),
        }
    }

    /// What a facet that is not metal reflects under the cosine `cos`.
    fn dielectric(&self, cos: f32) -> Rgb {
        let fresnel = fresnel_dielectric(cos, self.index());
        // Total reflection stays total.
        if fresnel == 1.0 {
            return Rgb::WHITE;
        }
        self.specular(fresnel)
    }

    /// The reflectance in place of the one by the index alone.
    fn specular(&self, fresnel: f32) -> Rgb {
        if self.specular == 1.0 && self.specular_color == Rgb::WHITE {
            return Rgb::splat(fresnel);
        }
        let plain = self.plain_at_normal();
        let rise = ((fresnel - plain) / (1.0 - plain)).clamp(0.0, 1.0);
        self.at_normal().lerp(Rgb::WHITE, rise) * self.specular
    }

    /// Reflectance along the normal by the index alone.
    fn plain_at_normal(&self) -> f32 {
        let amplitude = (self.eta - 1.0) / (self.eta + 1.0);
        amplitude * amplitude
    }

    /// The same with its colour.
    fn at_normal(&self) -> Rgb {
        (self.specular_color * self.plain_at_normal()).map(|c| c.min(1.0))
    }

    /// Probabilities of sampling the lobes: about what each sends towards `wo`.
    fn lobes(&self, wo: Vec3) -> Lobes {
        let shares = self.shares(wo.z);
        let main = (shares.reflected + shares.transmitted).luminance();
        let (diffuse, coat) = if self.front {
            let diffuse = if self.opaque() > 0.0 {
                self.opaque() * self.base_color.luminance() + 0.1 * (1.0 - self.metallic) * self.sheen
            } else {
                0.0
            };
            let coat = if self.conserves {
                self.coat_reflectance(wo.z)
            } else {
                COAT_REFLECTANCE * self.clearcoat
            };
            (diffuse, coat)
        } else {
            (0.0, 0.0)
        };
        // Facets that are tilted reflect more than is seen here.
        let main = main.max(0.1 * (diffuse + coat)).max(1e-6);
        let scale = 1.0 / (diffuse + coat + main);
        Lobes {
            diffuse: diffuse * scale,
            coat: coat * scale,
            main: main * scale,
        }
    }

    /// Schlick's reflectance; by the cosine on the thinner side, where it is not the same.
    fn schlick(&self, at_normal: Rgb, cos: f32) -> Rgb {
        let weight = schlick_weight(if self.eta > 1.0 {
            cos
        } else {
            eta2_minus_sin2(self.eta, cos).max(0.0).sqrt() / self.eta
        });
        at_normal.lerp(Rgb::WHITE, weight)
    }

    /// White, or the base colour at luminance 1, or between.
    fn hue(&self, tint: f32) -> Rgb {
        let luminance = self.base_color.luminance();
        if luminance > 0.0 {
            Rgb::WHITE.lerp(self.base_color / luminance, tint)
        } else {
            Rgb::WHITE
        }
    }

    fn facets(&self) -> Smith {
        let width = self.roughness * self.roughness;
        let aspect = (1.0 - 0.9 * self.anisotropic).sqrt();
        Smith::new(
            [width / aspect, width * aspect].map(|alpha| alpha.max(MIN_ALPHA)),
            Distribution::Ggx,
        )
    }

    fn burley_coat(&self) -> Gtr1 {
        Gtr1 {
            alpha2: self.coat_alpha * self.coat_alpha,
        }
    }

    fn coat_facets(&self) -> Smith {
        Smith::new([self.coat_alpha.max(MIN_ALPHA); 2], Distribution::Ggx)
    }

    /// The index, kept away from 1 where light is transmitted: nothing bends there, which leaves no half vector.
    pub(super) fn index(&self) -> f32 {
        if self.transmits() && (self.eta - 1.0).abs() < 1e-3 {
            if self.front { 1.001 } else { 1.0 / 1.001 }
        } else {
            self.eta
        }
    }

    /// Share that is neither metal nor glass.
    fn opaque(&self) -> f32 {
        (1.0 - self.metallic) * (1.0 - self.spec_trans)
    }

    /// Share of glass.
    fn glass(&self) -> f32 {
        (1.0 - self.metallic) * self.spec_trans
    }

    /// See [`super::Bsdf::transmits`].
    pub(super) fn transmits(&self) -> bool {
        self.glass() > 0.0
    }

    /// See [`super::Bsdf::albedo`]. The part of Burley's coat is a fit, within 0.002; where energy is conserved, the diffuse part is as
    /// if it did not change with the angle, and the coat as if it were smooth, within 0.01.
    pub(super) fn albedo(&self) -> Rgb {
        let shares = self.shares(1.0);
        let specular = shares.reflected + shares.transmitted;
        if !self.front {
            return specular;
        }
        // Integrals over the hemisphere of what `diffuse` has along the normal, but for the sheen's, which are below 3e-4.
        let (r, flatness) = (self.roughness, self.flatness);
        let shape = (41.0 / 42.0 + r * (5.0 / 84.0)) * (1.0 - flatness) + (0.748_668 + r * (1.25 / 112.0)) * flatness;
        let diffuse = self.base_color * (self.opaque() * shape);
        if !self.conserves {
            // What the coat's wide tails reflect below the horizon depends on their width.
            let gloss = (BURLEY_COAT_ALPHA[0] - self.coat_alpha) / (BURLEY_COAT_ALPHA[0] - BURLEY_COAT_ALPHA[1]);
            let coat = self.clearcoat * (0.0257 + 0.0093 * gloss * gloss.sqrt());
            return specular + diffuse + Rgb::splat(coat);
        }
        // Of light from all sides, as much passes inwards as outwards.
        let passes = self.eta * self.eta * (1.0 - smooth_internal_reflectance(self.eta));
        let left = 1.0 - self.specular(1.0 - passes).max_component();
        let diffuse = diffuse * ((1.0 - self.dielectric(1.0).max_component()) * left);
        let coat = self.clearcoat * COAT_REFLECTANCE;
        let left = [1.0 - coat, 1.0 - self.clearcoat * COAT_DIFFUSE_REFLECTANCE];
        (specular * left[0] + diffuse * left[1]) * left[0] + Rgb::splat(coat)
    }
}

/// Schlick's (1 − cos θ)⁵.
fn schlick_weight(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// Burley's distribution of wide tails ("generalised Trowbridge-Reitz" of exponent 1).
struct Gtr1 {
    /// Square of the width, below 1.
    alpha2: f32,
}

impl Gtr1 {
    /// D(h) [1/sr].
    fn d(&self, h: Vec3) -> f32 {
        let e = h.x * h.x + h.y * h.y + self.alpha2 * h.z * h.z;
        (self.alpha2 - 1.0) / (PI * self.alpha2.ln() * e)
    }

    /// A normal of density D(h) cos θh.
    fn sample(&self, [u, v]: [f32; 2]) -> Vec3 {
        let sin2 = (self.alpha2.powf(u) - self.alpha2) / (1.0 - self.alpha2);
        let sin2 = sin2.clamp(0.0, 1.0);
        let (sin_phi, cos_phi) = sin_cos_turns(v);
        let sin = sin2.sqrt();
        Vec3::new(sin * cos_phi, sin * sin_phi, (1.0 - sin2).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::super::Bsdf;
    use super::super::tests::{REFLECTED, TRANSMITTED, assert_values, mean_weight};
    use super::*;

    const PLAIN: PrincipledBsdf = PrincipledBsdf {
        base_color: Rgb::new(0.7, 0.4, 0.1),
        roughness: 0.5,
        anisotropic: 0.0,
        metallic: 0.0,
        spec_trans: 0.0,
        // Of Mitsuba's `specular` 0.5.
        eta: 1.5,
        spec_tint: 0.0,
        specular: 1.0,
        specular_color: Rgb::WHITE,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
        clearcoat: 0.0,
        coat_alpha: 0.1,
        conserves: false,
        thin: false,
        front: true,
        tangent: [1.0, 0.0],
    };

    const ALL: PrincipledBsdf = PrincipledBsdf {
        roughness: 0.4,
        anisotropic: 0.6,
        metallic: 0.3,
        spec_trans: 0.4,
        eta: 1.4,
        spec_tint: 0.5,
        sheen: 0.8,
        sheen_tint: 0.3,
        flatness: 0.25,
        clearcoat: 0.7,
        // Of gloss 0.2.
        coat_alpha: 0.0802,
        ..PLAIN
    };

    /// `principled` of Mitsuba 3.9.1 with these parameters, and with none but the colour.
    #[test]
    fn values_are_those_of_mitsuba() {
        let plain = [[0.234224, 0.151942, 0.0696597], [0.162538, 0.098009, 0.0334799]];
        assert_values(&Bsdf::Principled(PLAIN), &REFLECTED, &plain, 1e-3);
        let reflected = [[0.49723, 0.300912, 0.104593], [0.0846602, 0.0515189, 0.0183775]];
        let transmitted = [[0.604383, 0.456871, 0.228435], [0.000554148, 0.000418897, 0.000209448]];
        // The weights of luminance have one digit less here.
        assert_values(&Bsdf::Principled(ALL), &REFLECTED, &reflected, 1e-3);
        assert_values(&Bsdf::Principled(ALL), &TRANSMITTED, &transmitted, 1e-3);
        let inside = PrincipledBsdf {
            eta: 1.0 / 1.4,
            front: false,
            ..ALL
        };
        let pairs = [REFLECTED[0], TRANSMITTED[0]];
        let values = [[0.0153825; 3], [0.0476024, 0.035984, 0.017992]];
        assert_values(&Bsdf::Principled(inside), &pairs, &values, 1e-3);
    }

    fn furnace(bsdf: &PrincipledBsdf, cos: f32) -> f64 {
        let wo = Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
        mean_weight(&Bsdf::Principled(*bsdf), wo)[1]
    }

    #[test]
    fn white_metal_and_white_glass_send_on_no_more_than_they_get_and_all_of_it_where_smooth() {
        let metal = PrincipledBsdf {
            base_color: Rgb::WHITE,
            metallic: 1.0,
            ..PLAIN
        };
        let glass = PrincipledBsdf {
            base_color: Rgb::WHITE,
            spec_trans: 1.0,
            ..PLAIN
        };
        let inside = PrincipledBsdf {
            eta: 1.0 / 1.5,
            front: false,
            ..glass
        };
        for (name, bsdf) in [("metal", metal), ("glass", glass), ("inside", inside)] {
            for cos in [1.0, 0.7, 0.3, 0.1] {
                for (roughness, least) in [(0.0, 0.998), (0.2, 0.9), (0.5, 0.7), (1.0, 0.2)] {
                    let sent = furnace(&PrincipledBsdf { roughness, ..bsdf }, cos);
                    assert!(
                        sent > least && sent < 1.0 + 1e-3,
                        "{name} of roughness {roughness} at cos {cos}: {sent}"
                    );
                }
            }
        }
    }

    /// By the published formulas, in f64 and by another program.
    #[test]
    fn white_plastic_gains_what_the_module_says() {
        let white = PrincipledBsdf {
            base_color: Rgb::WHITE,
            ..PLAIN
        };
        for (cos, expected) in [(1.0, 1.043), (0.6, 1.060), (0.2, 1.154)] {
            let sent = furnace(&white, cos);
            assert!((sent - expected).abs() < 5e-3, "cos {cos}: {sent} for {expected}");
        }
    }

    #[test]
    fn white_plastic_that_conserves_gains_nothing() {
        for (eta, roughness) in [(1.5, 0.1), (1.5, 0.5), (1.5, 1.0), (2.0, 0.3)] {
            let white = PrincipledBsdf {
                base_color: Rgb::WHITE,
                conserves: true,
                roughness,
                eta,
                ..PLAIN
            };
            for cos in [1.0, 0.6, 0.2, 0.05] {
                let sent = furnace(&white, cos);
                // What goes back and forth between and below the facets is left out.
                assert!(
                    sent > 0.35 && sent < 1.0 + 1e-3,
                    "index {eta}, roughness {roughness}, cos {cos}: {sent}"
                );
            }
        }
    }

    #[test]
    fn a_coat_that_conserves_adds_nothing_to_what_is_white() {
        let white = PrincipledBsdf {
            base_color: Rgb::WHITE,
            conserves: true,
            clearcoat: 1.0,
            ..PLAIN
        };
        let metal = PrincipledBsdf { metallic: 1.0, ..white };
        let thin = PrincipledBsdf {
            spec_trans: 1.0,
            thin: true,
            ..white
        };
        for (name, bsdf) in [("plastic", white), ("metal", metal), ("thin wall", thin)] {
            for coat_alpha in [0.0, 0.1, 0.5, 1.0] {
                for roughness in [0.1, 0.5] {
                    for cos in [1.0, 0.6, 0.2, 0.05] {
                        let sent = furnace(
                            &PrincipledBsdf {
                                coat_alpha,
                                roughness,
                                ..bsdf
                            },
                            cos,
                        );
                        // Tilted facets of the coat reflect less at grazing angles than is taken from what is below.
                        assert!(
                            sent > 0.1 && sent < 1.0 + 1e-3,
                            "{name} of roughness {roughness}, coat of {coat_alpha}, cos {cos}: {sent}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_smooth_coat_on_black_reflects_as_glass_does() {
        let coat = PrincipledBsdf {
            base_color: Rgb::BLACK,
            specular: 0.0,
            conserves: true,
            clearcoat: 0.5,
            coat_alpha: 0.0,
            ..PLAIN
        };
        for cos in [1.0, 0.6, 0.2] {
            let (sent, expected) = (furnace(&coat, cos), 0.5 * f64::from(fresnel_dielectric(cos, 1.5)));
            assert!((sent - expected).abs() < 1e-3, "cos {cos}: {sent} for {expected}");
        }
    }

    #[test]
    fn the_specular_factors_scale_the_reflectance_along_the_normal_and_at_the_horizon() {
        let tinted = PrincipledBsdf {
            specular: 0.5,
            specular_color: Rgb::new(1.0, 0.5, 30.0),
            ..PLAIN
        };
        let close = |a: Rgb, b: [f32; 3]| (a - Rgb::from(b)).map(f32::abs).max_component() < 1e-5;
        let [along, grazing] = [1.0, 0.0].map(|cos| tinted.dielectric(cos));
        assert!(close(along, [0.02, 0.01, 0.5]), "{along:?}");
        // The horizon of a dielectric reflects all of it.
        assert!(
            close(tinted.dielectric(1e-7), [0.5; 3]) && close(grazing, [1.0; 3]),
            "{grazing:?}"
        );
        let glass = PrincipledBsdf {
            eta: 1.0 / 1.5,
            spec_trans: 1.0,
            front: false,
            ..tinted
        };
        assert_eq!(glass.dielectric(0.3), Rgb::WHITE, "total reflection");
    }

    #[test]
    fn a_thin_wall_does_not_bend_light() {
        let thin = PrincipledBsdf {
            base_color: Rgb::new(0.5, 0.25, 1.0),
            spec_trans: 1.0,
            roughness: 0.01,
            thin: true,
            ..PLAIN
        };
        let wo = Vec3::new(0.6, 0.0, 0.8);
        let sample = thin.sample(wo, 0.9999, [0.3, 0.6]).expect("light passes");
        assert!(sample.wi.distance(-wo) < 1e-2, "{:?}", sample.wi);
        let passes = 1.0 - fresnel_dielectric(0.8, 1.5);
        let expected = [0.5, 0.25, 1.0].map(|c| f64::from(c * passes));
        let [r, g, b] = mean_weight(&Bsdf::Principled(thin), wo);
        let reflected = f64::from(1.0 - passes);
        for (mean, expected) in [r, g, b].into_iter().zip(expected) {
            assert!((mean - reflected - expected).abs() < 2e-3, "{mean} for {expected}");
        }
    }

    #[test]
    fn what_is_opaque_is_black_from_behind() {
        let behind = PrincipledBsdf {
            front: false,
            eta: 1.0 / 1.5,
            ..PLAIN
        };
        assert!(Bsdf::Principled(behind).is_black() && !Bsdf::Principled(PLAIN).is_black());
        for lobe in [0.0, 0.5, 0.99] {
            assert_eq!(behind.sample(Vec3::new(0.6, 0.0, 0.8), lobe, [0.3, 0.6]), None);
        }
    }

    #[test]
    fn highlights_are_wide_along_the_tangent() {
        let metal = PrincipledBsdf {
            metallic: 1.0,
            roughness: 0.3,
            anisotropic: 1.0,
            tangent: [0.6, 0.8],
            ..PLAIN
        };
        let along = metal.eval(Vec3::Z, Vec3::new(0.3, 0.4, 0.75f32.sqrt()));
        let across = metal.eval(Vec3::Z, Vec3::new(-0.4, 0.3, 0.75f32.sqrt()));
        assert!(along.value.r > 20.0 * across.value.r, "{along:?} {across:?}");
    }
}
