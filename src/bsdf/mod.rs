//! Scattering at a surface, in the local frame whose +z is the shading normal on the side of `wo`.
//!
//! `wo` points to the previous vertex and always has `wo.z > 0`; `wi` is the sampled direction, away from the surface as
//! well (pbrt's convention). Radiance is what is transported.

use crate::math::{Rgb, Vec3};
use crate::sampling::warp;

mod coated;
mod conductor;
mod dielectric;
mod diffuse;
mod microfacet;
mod plastic;
mod principled;
mod rough;
mod smith;

pub use coated::{CoatTable, CoatedDiffuse};
pub use conductor::Conductor;
pub use dielectric::Dielectric;
pub use diffuse::Diffuse;
pub use microfacet::SMOOTH_ALPHA;
pub use plastic::{MIN_ALPHA as PLASTIC_MIN_ALPHA, Plastic};
pub use principled::PrincipledBsdf;
pub use rough::{Distribution, RoughGlass, RoughMetal, ThinGlass};

/// A scattering function with its parameters at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bsdf {
    /// Lambert's law.
    Diffuse(Diffuse),
    /// Metal: GGX with exact Fresnel reflectance, or a smooth mirror of it.
    Conductor(Conductor),
    /// Glass: smooth or rough, reflecting and transmitting.
    Dielectric(Dielectric),
    /// A perfect mirror of constant reflectance.
    Mirror(Rgb),
    /// A diffuse base under a rough dielectric coat.
    Plastic(Plastic),
    /// Metal with all parameters.
    RoughMetal(RoughMetal),
    /// Glass with all parameters.
    RoughGlass(RoughGlass),
    /// A sheet of glass.
    ThinGlass(ThinGlass),
    /// A diffuse base under glass, with light between them.
    CoatedDiffuse(CoatedDiffuse),
    /// Metal, plastic, glass and cloth in one.
    Principled(PrincipledBsdf),
}

/// Value and density of a pair of directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfEval {
    /// f(wo, wi) · |cos θi| [1/sr].
    pub value: Rgb,
    /// Density with which [`Bsdf::sample`] draws `wi` [1/sr].
    pub pdf_w: f32,
}

impl BsdfEval {
    /// Nothing is scattered and nothing sampled.
    pub const ZERO: BsdfEval = BsdfEval {
        value: Rgb::BLACK,
        pdf_w: 0.0,
    };

    /// The same if it is finite: products of two denormal cosines vanish and leave 0 / 0, and such a pair carries no light.
    #[inline]
    fn or_zero(self) -> BsdfEval {
        if self.value.is_finite() && self.pdf_w.is_finite() {
            self
        } else {
            BsdfEval::ZERO
        }
    }

    /// The sample of a direction with this value and density, if it carries anything.
    #[inline]
    fn at(self, wi: Vec3, eta_squared: f32) -> Option<BsdfSample> {
        let weight = self.value / self.pdf_w;
        (self.pdf_w > 0.0 && !weight.is_black() && weight.is_finite()).then_some(BsdfSample {
            wi,
            weight,
            pdf_w: self.pdf_w,
            eta_squared,
        })
    }
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BsdfSample {
    /// Unit direction, local.
    pub wi: Vec3,
    /// f · |cos θi| / density, in each channel.
    pub weight: Rgb,
    /// Density [1/sr]; infinite for a delta lobe.
    pub pdf_w: f32,
    /// Square of the index ratio that radiance was scaled by on transmission, else 1. Roulette multiplies it back in, so
    /// that paths inside glass do not die of a factor that they regain on leaving.
    pub eta_squared: f32,
}

impl BsdfSample {
    /// Whether the direction comes from a delta lobe.
    pub fn is_delta(&self) -> bool {
        self.pdf_w == f32::INFINITY
    }

    fn delta(wi: Vec3, weight: Rgb, eta_squared: f32) -> BsdfSample {
        BsdfSample {
            wi,
            weight,
            pdf_w: f32::INFINITY,
            eta_squared,
        }
    }
}

impl Bsdf {
    /// Value and sampling density of a direction. Delta lobes give zero for both.
    // Always inlined: diffuse, which is most of the hits, is then not called for.
    #[inline(always)]
    pub fn eval(&self, wo: Vec3, wi: Vec3) -> BsdfEval {
        match self {
            Bsdf::Diffuse(bsdf) => bsdf.eval(wi),
            Bsdf::Conductor(bsdf) => bsdf.eval(wo, wi),
            Bsdf::Dielectric(bsdf) => bsdf.eval(wo, wi),
            Bsdf::Plastic(bsdf) => bsdf.eval(wo, wi),
            Bsdf::RoughMetal(bsdf) => bsdf.eval(wo, wi),
            Bsdf::RoughGlass(bsdf) => bsdf.eval(wo, wi),
            Bsdf::CoatedDiffuse(bsdf) => bsdf.eval(wo, wi),
            Bsdf::Principled(bsdf) => bsdf.eval(wo, wi),
            Bsdf::Mirror(_) | Bsdf::ThinGlass(_) => BsdfEval::ZERO,
        }
    }

    /// Draws a direction: `lobe` in [0, 1) chooses between lobes, `u` in [0, 1)² the direction. `None` ends the path: the
    /// sample carries nothing.
    #[inline]
    pub fn sample(&self, wo: Vec3, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        match self {
            Bsdf::Diffuse(bsdf) => bsdf.sample(u),
            Bsdf::Conductor(bsdf) => bsdf.sample(wo, u),
            Bsdf::Dielectric(bsdf) => bsdf.sample(wo, lobe, u),
            Bsdf::Plastic(bsdf) => bsdf.sample(wo, lobe, u),
            Bsdf::RoughMetal(bsdf) => bsdf.sample(wo, u),
            Bsdf::RoughGlass(bsdf) => bsdf.sample(wo, lobe, u),
            Bsdf::ThinGlass(bsdf) => bsdf.sample(wo, lobe),
            Bsdf::CoatedDiffuse(bsdf) => bsdf.sample(wo, lobe, u),
            Bsdf::Principled(bsdf) => bsdf.sample(wo, lobe, u),
            Bsdf::Mirror(reflectance) => {
                (!reflectance.is_black()).then(|| BsdfSample::delta(reflect_z(wo), *reflectance, 1.0))
            }
        }
    }

    /// Draws a direction whatever the lobes, by the cosine of its angle or uniformly; over both hemispheres if light can
    /// pass through. The article's bounce, kept beside [`Bsdf::sample`] to compare with. Not for delta lobes.
    pub fn sample_hemisphere(&self, wo: Vec3, cosine: bool, lobe: f32, u: [f32; 2]) -> Option<BsdfSample> {
        let mut wi = if cosine {
            warp::cosine_hemisphere(u)
        } else {
            warp::uniform_hemisphere(u)
        };
        if self.transmits() && lobe < 0.5 {
            wi.z = -wi.z;
        }
        let pdf_w = self.hemisphere_pdf_w(cosine, wi);
        let BsdfEval { value, .. } = self.eval(wo, wi);
        let eta_squared = match self {
            Bsdf::Dielectric(bsdf) if wi.z < 0.0 => bsdf.eta * bsdf.eta,
            Bsdf::RoughGlass(bsdf) if wi.z < 0.0 => bsdf.eta * bsdf.eta,
            Bsdf::Principled(bsdf) if wi.z < 0.0 && !bsdf.thin => bsdf.eta * bsdf.eta,
            _ => 1.0,
        };
        (!value.is_black()).then(|| BsdfSample {
            wi,
            weight: value / pdf_w,
            pdf_w,
            eta_squared,
        })
    }

    /// Density of [`Bsdf::sample_hemisphere`] [1/sr].
    pub fn hemisphere_pdf_w(&self, cosine: bool, wi: Vec3) -> f32 {
        let side = if self.transmits() {
            0.5
        } else if wi.z > 0.0 {
            1.0
        } else {
            0.0
        };
        side * if cosine {
            warp::cosine_hemisphere_pdf_w(wi.z.abs())
        } else {
            warp::UNIFORM_HEMISPHERE_PDF_W
        }
    }

    /// The share of light along the normal that is scattered, reflected and transmitted together, each microfacet taken to
    /// lie in the surface: what denoisers take for the colour of a surface.
    pub fn albedo(&self) -> Rgb {
        match self {
            Bsdf::Diffuse(bsdf) => bsdf.reflectance,
            Bsdf::Conductor(bsdf) => bsdf.fresnel(1.0),
            Bsdf::Dielectric(_) => Rgb::WHITE,
            Bsdf::Plastic(bsdf) => bsdf.albedo(),
            Bsdf::RoughMetal(bsdf) => bsdf.albedo(),
            Bsdf::RoughGlass(bsdf) => bsdf.albedo(),
            Bsdf::ThinGlass(bsdf) => bsdf.albedo(),
            Bsdf::CoatedDiffuse(bsdf) => bsdf.albedo(),
            Bsdf::Principled(bsdf) => bsdf.albedo(),
            Bsdf::Mirror(reflectance) => *reflectance,
        }
    }

    /// Whether all lobes are delta lobes, so that light sampling is pointless.
    #[inline]
    pub fn is_delta(&self) -> bool {
        match self {
            Bsdf::Diffuse(_) | Bsdf::Plastic(_) | Bsdf::CoatedDiffuse(_) | Bsdf::Principled(_) => false,
            Bsdf::Conductor(bsdf) => bsdf.is_smooth(),
            Bsdf::Dielectric(bsdf) => bsdf.is_smooth(),
            Bsdf::RoughMetal(bsdf) => bsdf.is_smooth(),
            Bsdf::RoughGlass(bsdf) => bsdf.is_smooth(),
            Bsdf::Mirror(_) | Bsdf::ThinGlass(_) => true,
        }
    }

    /// Whether any lobe is a delta lobe, which only [`Bsdf::sample`] draws.
    #[inline]
    pub fn has_delta(&self) -> bool {
        match self {
            Bsdf::CoatedDiffuse(bsdf) => bsdf.coat.is_smooth(),
            _ => self.is_delta(),
        }
    }

    /// Whether sampling chooses between lobes.
    #[inline]
    pub fn has_lobes(&self) -> bool {
        !matches!(
            self,
            Bsdf::Diffuse(_) | Bsdf::Conductor(_) | Bsdf::Mirror(_) | Bsdf::RoughMetal(_)
        )
    }

    /// Whether light can pass to the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        match self {
            Bsdf::Dielectric(_) | Bsdf::RoughGlass(_) | Bsdf::ThinGlass(_) => true,
            Bsdf::Principled(bsdf) => bsdf.transmits(),
            _ => false,
        }
    }

    /// Whether nothing is ever scattered.
    #[inline]
    pub fn is_black(&self) -> bool {
        match self {
            Bsdf::Diffuse(bsdf) => bsdf.reflectance.is_black(),
            Bsdf::Mirror(reflectance) => reflectance.is_black(),
            Bsdf::Principled(bsdf) => !bsdf.front && !bsdf.transmits(),
            _ => false,
        }
    }
}

/// eta² − sin² θ by cos θ in [0, 1]: what Fresnel's and Snell's laws turn on. Each form is taken where it does not cancel:
/// 1 − cos² has no digits left of a grazing cosine, which is all there is at eta = 1; nor has (eta − 1) (eta + 1) of a
/// small eta, which is all there is at normal incidence.
#[inline]
fn eta2_minus_sin2(eta: f32, cos: f32) -> f32 {
    if cos > std::f32::consts::FRAC_1_SQRT_2 {
        eta * eta - (1.0 - cos) * (1.0 + cos)
    } else {
        (eta - 1.0) * (eta + 1.0) + cos * cos
    }
}

/// Mirror reflection about +z.
#[inline]
fn reflect_z(w: Vec3) -> Vec3 {
    Vec3::new(-w.x, -w.y, w.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Panics unless a pair of directions of any length has these values, to a share of them.
    #[track_caller]
    pub(super) fn assert_values(bsdf: &Bsdf, pairs: &[[[f32; 3]; 2]], values: &[[f32; 3]], tolerance: f32) {
        assert_eq!(pairs.len(), values.len());
        for (pair, value) in pairs.iter().zip(values) {
            let [wo, wi] = pair.map(|w| Vec3::from(w).normalize());
            let got = bsdf.eval(wo, wi).value.to_array();
            for (got, value) in got.into_iter().zip(value) {
                assert!(
                    (got - value).abs() <= tolerance * value,
                    "{bsdf:?} {wo} {wi}: {got} for {value}"
                );
            }
        }
    }

    /// The midpoint rule over the random numbers of a sample; light is transmitted before it is scaled by the change of
    /// solid angle.
    pub(super) fn mean_weight(bsdf: &Bsdf, wo: Vec3) -> [f64; 3] {
        const LOBES: u32 = 4;
        const SIDE: u32 = 256;
        let middle = |i: u32| (i as f32 + 0.5) / SIDE as f32;
        let mut sum = [0.0; 3];
        for i in 0..LOBES * SIDE * SIDE {
            // Not on a grid: the probability of a lobe would be rounded to its cells.
            let shift = (i % (SIDE * SIDE)) as f32 * 0.618_034;
            let lobe = ((i / (SIDE * SIDE)) as f32 + shift.fract()) / LOBES as f32;
            let u = [i / SIDE % SIDE, i % SIDE].map(middle);
            if let Some(sample) = bsdf.sample(wo, lobe, u) {
                let weight = sample.weight * sample.eta_squared;
                sum = [0, 1, 2].map(|c| sum[c] + f64::from(weight[c]));
            }
        }
        sum.map(|sum| sum / f64::from(LOBES * SIDE * SIDE))
    }

    /// Two pairs of directions on the same side.
    pub(super) const REFLECTED: [[[f32; 3]; 2]; 2] = [
        [[0.3, -0.2, 0.8], [-0.4, 0.1, 0.7]],
        [[0.9, 0.1, 0.2], [-0.5, 0.3, 0.6]],
    ];
    /// Two on opposite sides.
    pub(super) const TRANSMITTED: [[[f32; 3]; 2]; 2] = [
        [[0.3, -0.2, 0.8], [-0.3, 0.1, -0.9]],
        [[0.9, 0.1, 0.2], [-0.6, 0.2, -0.7]],
    ];

    #[test]
    fn the_albedo_is_the_mean_weight_of_samples_at_normal_incidence() {
        let rgb = Rgb::new(0.2, 0.5, 0.9);
        let metal = |alpha| {
            let (eta, k) = (Rgb::new(0.183, 0.421, 1.373), Rgb::new(3.424, 2.346, 1.770));
            Bsdf::Conductor(Conductor { eta, k, alpha })
        };
        let glass = |eta, alpha| Bsdf::Dielectric(Dielectric { eta, alpha });
        let coated = |alpha, nonlinear| {
            Bsdf::CoatedDiffuse(CoatedDiffuse {
                reflectance: rgb,
                specular: Rgb::new(0.9, 0.2, 0.3),
                coat: CoatTable::of(1.5, alpha, Distribution::Ggx),
                nonlinear,
            })
        };
        let principled = |metallic, spec_trans, clearcoat, flatness| PrincipledBsdf {
            base_color: rgb,
            roughness: 0.1,
            anisotropic: 0.3,
            metallic,
            spec_trans,
            eta: 1.5,
            spec_tint: 0.4,
            specular: 1.0,
            specular_color: Rgb::WHITE,
            sheen: 0.2,
            sheen_tint: 0.5,
            flatness,
            clearcoat,
            coat_alpha: PrincipledBsdf::burley_coat_alpha(0.8),
            conserves: false,
            thin: false,
            front: true,
            tangent: [0.6, 0.8],
        };
        let layered = PrincipledBsdf {
            conserves: true,
            specular: 0.7,
            specular_color: Rgb::new(2.0, 1.0, 0.5),
            ..principled(0.3, 0.3, 1.0, 0.0)
        };
        for bsdf in [
            Bsdf::Diffuse(Diffuse { reflectance: rgb }),
            metal(0.0),
            metal(0.01),
            glass(1.5, 0.0),
            glass(1.0 / 1.5, 0.01),
            Bsdf::Mirror(rgb),
            Bsdf::Plastic(Plastic {
                reflectance: rgb,
                specular: Rgb::new(0.04, 0.3, 0.5),
                alpha: PLASTIC_MIN_ALPHA,
            }),
            Bsdf::RoughMetal(RoughMetal {
                eta: Rgb::new(0.183, 0.421, 1.373),
                k: Rgb::new(3.424, 2.346, 1.770),
                reflectance: rgb,
                alpha: [0.01, 0.02],
                distribution: Distribution::Beckmann,
                tangent: [0.6, 0.8],
            }),
            Bsdf::RoughGlass(RoughGlass {
                eta: 1.0 / 1.5,
                reflectance: rgb,
                transmittance: Rgb::new(0.9, 0.2, 0.3),
                alpha: [0.01, 0.02],
                distribution: Distribution::Ggx,
                tangent: [0.6, 0.8],
            }),
            Bsdf::ThinGlass(ThinGlass {
                ior: 1.5,
                reflectance: rgb,
                transmittance: Rgb::new(0.9, 0.2, 0.3),
            }),
            coated(0.0, false),
            coated(0.0, true),
            coated(0.01, true),
            Bsdf::Principled(principled(0.0, 0.5, 0.0, 0.0)),
            Bsdf::Principled(principled(0.0, 0.0, 1.0, 0.0)),
            Bsdf::Principled(principled(0.6, 0.5, 0.0, 1.0)),
            Bsdf::Principled(layered),
            Bsdf::Principled(PrincipledBsdf { thin: true, ..layered }),
        ] {
            let mean = mean_weight(&bsdf, Vec3::Z);
            // What the coat and the diffuse part let through is approximated where energy is conserved.
            let bound = match bsdf {
                Bsdf::Principled(p) if p.conserves => 1e-2,
                _ => 2e-3,
            };
            for (c, mean) in mean.into_iter().enumerate() {
                let albedo = f64::from(bsdf.albedo()[c]);
                assert!(
                    (mean - albedo).abs() < bound,
                    "{bsdf:?}, channel {c}: {albedo} for {mean}"
                );
            }
        }
    }
}
