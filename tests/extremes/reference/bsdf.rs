//! Scattering in the local frame: `wo.z > 0`, both directions away from the surface.

use embrace::bsdf::SMOOTH_ALPHA;
use embrace::material::{Material, Scattering, Spectrum};
use embrace::math::DVec3;
use std::f64::consts::{FRAC_PI_4, PI, TAU};

use super::rgb;

/// A scattering function with its parameters at one point.
pub(super) enum Bsdf {
    Diffuse {
        reflectance: DVec3,
    },
    Conductor {
        eta: DVec3,
        k: DVec3,
        alpha: f64,
    },
    /// `eta`: index on the far side over that on the side of `wo`.
    Dielectric {
        eta: f64,
        alpha: f64,
    },
    Mirror {
        reflectance: DVec3,
    },
    Plastic {
        reflectance: DVec3,
        specular: DVec3,
        alpha: f64,
    },
}

/// A direction and what it is worth.
pub(super) struct Sample {
    pub(super) wi: DVec3,
    /// f |cos θi| over the density.
    pub(super) weight: DVec3,
    /// [1/sr]; infinite for a delta lobe.
    pub(super) pdf_w: f64,
    /// The factor on radiance that transmission divides by.
    pub(super) eta_squared: f64,
}

impl Bsdf {
    pub(super) fn new(material: &Material, front: bool) -> Bsdf {
        let constant = |spectrum| match spectrum {
            Spectrum::Constant(value) => rgb(value),
            _ => panic!("the reference has no textures"),
        };
        match material.scattering {
            Scattering::General(_) => panic!("the reference has none of the general materials"),
            Scattering::Diffuse { reflectance } => Bsdf::Diffuse {
                reflectance: constant(reflectance),
            },
            Scattering::Conductor { eta, k, alpha } => Bsdf::Conductor {
                eta: rgb(eta),
                k: rgb(k),
                alpha: alpha.into(),
            },
            Scattering::Dielectric { ior, alpha } => Bsdf::Dielectric {
                eta: f64::from(ior).powi(if front { 1 } else { -1 }),
                alpha: alpha.into(),
            },
            Scattering::Mirror { reflectance } => Bsdf::Mirror {
                reflectance: rgb(reflectance),
            },
            Scattering::Plastic {
                reflectance,
                specular,
                alpha,
            } => Bsdf::Plastic {
                reflectance: constant(reflectance),
                specular: rgb(specular),
                alpha: alpha.into(),
            },
        }
    }

    pub(super) fn is_black(&self) -> bool {
        match self {
            Bsdf::Diffuse { reflectance } | Bsdf::Mirror { reflectance } => *reflectance == DVec3::ZERO,
            _ => false,
        }
    }

    fn is_delta(&self) -> bool {
        let smooth = f64::from(SMOOTH_ALPHA);
        match *self {
            Bsdf::Conductor { alpha, .. } => alpha < smooth,
            Bsdf::Dielectric { eta, alpha } => alpha < smooth || (eta - 1.0).abs() < smooth,
            Bsdf::Mirror { .. } => true,
            Bsdf::Diffuse { .. } | Bsdf::Plastic { .. } => false,
        }
    }

    /// f(wo, wi) |cos θi| and the density of sampling `wi`.
    pub(super) fn eval(&self, wo: DVec3, wi: DVec3) -> (DVec3, f64) {
        const NOTHING: (DVec3, f64) = (DVec3::ZERO, 0.0);
        if self.is_delta() || wi.z <= 0.0 && !matches!(self, Bsdf::Dielectric { .. }) {
            return NOTHING;
        }
        match *self {
            Bsdf::Diffuse { reflectance } => (reflectance * (wi.z / PI), wi.z / PI),
            Bsdf::Conductor { eta, k, alpha } => {
                let (value, pdf_w) = reflection(wo, wi, alpha);
                let h = (wo + wi).normalize();
                (fresnel_conductor(wo.dot(h), eta, k) * value, pdf_w)
            }
            Bsdf::Dielectric { eta, alpha } => {
                let reflects = wi.z > 0.0;
                let h = half_vector(wo, wi, eta);
                let (wo_h, wi_h) = (wo.dot(h), wi.dot(h));
                // Both must see the microfacet from the side that they are on.
                if wo_h <= 0.0 || (wi_h > 0.0) != reflects {
                    return NOTHING;
                }
                let fresnel = fresnel_dielectric(wo_h, eta);
                if reflects {
                    let (value, pdf_w) = reflection(wo, wi, alpha);
                    return (DVec3::splat(fresnel * value), fresnel * pdf_w);
                }
                // dh/dwi of refraction; radiance is scaled by the change of solid angle.
                let jacobian = eta * eta * wi_h.abs() / (eta * wi_h + wo_h).powi(2);
                let density = (1.0 - fresnel) * distribution(h, alpha) * wo_h * jacobian / wo.z;
                let shadowing = 1.0 / (1.0 + lambda(wo, alpha) + lambda(wi, alpha));
                let value = density * shadowing / (eta * eta);
                (DVec3::splat(value), density / (1.0 + lambda(wo, alpha)))
            }
            Bsdf::Plastic {
                reflectance,
                specular,
                alpha,
            } => {
                let (coat, coat_pdf_w) = reflection(wo, wi, alpha);
                let h = (wo + wi).normalize();
                let through = (1.0 - schlick(wo.z, specular)) * (1.0 - schlick(wi.z, specular));
                let share = coat_share(wo.z, reflectance, specular);
                (
                    reflectance * through * (wi.z / PI) + schlick(wo.dot(h), specular) * coat,
                    (1.0 - share) * wi.z / PI + share * coat_pdf_w,
                )
            }
            Bsdf::Mirror { .. } => NOTHING,
        }
    }

    /// How far a pair of directions is from the border of those that scatter: by its cosine to the surface, or with rough
    /// glass to the microfacet, or by the microfacet's own.
    pub(super) fn margin(&self, wo: DVec3, wi: DVec3) -> f64 {
        match *self {
            Bsdf::Dielectric { eta, .. } => {
                let h = half_vector(wo, wi, eta);
                wi.z.abs().min(h.z).min(wo.dot(h).abs()).min(wi.dot(h).abs())
            }
            _ => wi.z.abs(),
        }
    }

    /// The cosine that the choice between two lobes depends on; `None` if there is but one.
    fn lobe_cos(&self, wo: DVec3, u: [f64; 2]) -> Option<f64> {
        match *self {
            Bsdf::Dielectric { alpha, .. } => Some(wo.dot(self.normal(wo, alpha, u))),
            Bsdf::Plastic { .. } => Some(wo.z),
            _ => None,
        }
    }

    /// Whether the first lobe is taken: reflection by glass, or by the coat of plastic.
    fn takes_first_lobe(&self, cos: f64, lobe: f64) -> bool {
        match *self {
            Bsdf::Dielectric { eta, .. } => lobe < fresnel_dielectric(cos, eta),
            Bsdf::Plastic {
                reflectance, specular, ..
            } => lobe < coat_share(cos, reflectance, specular),
            _ => true,
        }
    }

    /// By how much, to a factor of two, that cosine would have to change for the other lobe. (Not how close the random number
    /// is to the probability, which has an infinite slope at the critical angle.)
    pub(super) fn lobe_margin(&self, wo: DVec3, lobe: f64, u: [f64; 2]) -> f64 {
        let Some(cos) = self.lobe_cos(wo, u) else {
            return f64::INFINITY;
        };
        let chosen = self.takes_first_lobe(cos, lobe);
        let changes = |change: f64| self.takes_first_lobe((cos + change).clamp(0.0, 1.0), lobe) != chosen;
        let mut steps = (0..40).map(|k| 0.5f64.powi(40 - k));
        steps.find(|step| changes(*step) || changes(-step)).unwrap_or(1.0)
    }

    /// Draws a direction, and says whether it is meant to pass through the surface.
    pub(super) fn sample_direction(&self, wo: DVec3, lobe: f64, u: [f64; 2]) -> Option<(DVec3, bool)> {
        let first = self.lobe_cos(wo, u).is_none_or(|cos| self.takes_first_lobe(cos, lobe));
        match *self {
            Bsdf::Diffuse { .. } => Some((cosine_hemisphere(u), false)),
            Bsdf::Plastic { .. } if !first => Some((cosine_hemisphere(u), false)),
            Bsdf::Dielectric { eta, alpha } if !first => Some((refract(wo, self.normal(wo, alpha, u), eta)?, true)),
            Bsdf::Conductor { alpha, .. } | Bsdf::Dielectric { alpha, .. } | Bsdf::Plastic { alpha, .. } => {
                Some((reflect(wo, self.normal(wo, alpha, u)), false))
            }
            Bsdf::Mirror { .. } => Some((reflect(wo, DVec3::Z), false)),
        }
    }

    /// The normal that a lobe reflects or refracts about.
    fn normal(&self, wo: DVec3, alpha: f64, u: [f64; 2]) -> DVec3 {
        if self.is_delta() {
            DVec3::Z
        } else {
            visible_normal(wo, alpha, u)
        }
    }

    /// What a drawn direction is worth; `None` if nothing, as on the side of the surface that it is not meant for.
    pub(super) fn weigh(&self, wo: DVec3, (wi, transmits): (DVec3, bool)) -> Option<Sample> {
        if (wi.z < 0.0) != transmits {
            return None;
        }
        let eta_squared = match self {
            Bsdf::Dielectric { eta, .. } if transmits => eta * eta,
            _ => 1.0,
        };
        let (weight, pdf_w) = if self.is_delta() {
            let weight = match *self {
                Bsdf::Conductor { eta, k, .. } => fresnel_conductor(wo.z, eta, k),
                Bsdf::Mirror { reflectance } => reflectance,
                // The probability of the lobe cancels its share.
                _ => DVec3::splat(1.0 / eta_squared),
            };
            (weight, f64::INFINITY)
        } else {
            let (value, pdf_w) = self.eval(wo, wi);
            (value / pdf_w, pdf_w)
        };
        (pdf_w > 0.0).then_some(Sample {
            wi,
            weight,
            pdf_w,
            eta_squared,
        })
    }
}

/// The microfacet that sends one direction into the other, by reflection or refraction.
fn half_vector(wo: DVec3, wi: DVec3, eta: f64) -> DVec3 {
    let h = if wi.z > 0.0 { wo + wi } else { wo + wi * eta };
    h.normalize() * h.z.signum()
}

fn reflect(wo: DVec3, h: DVec3) -> DVec3 {
    h * (2.0 * wo.dot(h)) - wo
}

/// Snell's law; `None` under total internal reflection.
fn refract(wo: DVec3, h: DVec3, eta: f64) -> Option<DVec3> {
    let cos = wo.dot(h);
    let cos2_t = 1.0 - (1.0 - cos * cos) / (eta * eta);
    (cos2_t > 0.0).then(|| (h * (cos / eta - cos2_t.sqrt()) - wo / eta).normalize())
}

/// Unpolarised reflectance between dielectrics.
fn fresnel_dielectric(cos: f64, eta: f64) -> f64 {
    let cos2_t = 1.0 - (1.0 - cos * cos) / (eta * eta);
    if cos2_t <= 0.0 {
        return 1.0;
    }
    let cos_t = cos2_t.sqrt();
    let parallel = (eta * cos - cos_t) / (eta * cos + cos_t);
    let perpendicular = (cos - eta * cos_t) / (cos + eta * cos_t);
    0.5 * (parallel * parallel + perpendicular * perpendicular)
}

/// Unpolarised reflectance of a metal, by the same formulas with a complex index.
fn fresnel_conductor(cos: f64, eta: DVec3, k: DVec3) -> DVec3 {
    type Complex = [f64; 2];
    let channel = |eta: f64, k: f64| {
        let norm = |[a, b]: Complex| a * a + b * b;
        let n2: Complex = [eta * eta - k * k, 2.0 * eta * k];
        // n cos θt, the root of n² − sin² θ.
        let [re, im] = [n2[0] - (1.0 - cos * cos), n2[1]];
        let root: Complex = [
            (0.5 * (re.hypot(im) + re)).max(0.0).sqrt(),
            (0.5 * (re.hypot(im) - re)).max(0.0).sqrt(),
        ];
        let perpendicular = norm([cos - root[0], -root[1]]) / norm([cos + root[0], root[1]]);
        let parallel =
            norm([n2[0] * cos - root[0], n2[1] * cos - root[1]]) / norm([n2[0] * cos + root[0], n2[1] * cos + root[1]]);
        0.5 * (parallel + perpendicular)
    };
    DVec3::new(channel(eta.x, k.x), channel(eta.y, k.y), channel(eta.z, k.z))
}

fn schlick(cos: f64, specular: DVec3) -> DVec3 {
    specular + (1.0 - specular) * (1.0 - cos).powi(5)
}

/// The probability of sampling the coat of plastic.
fn coat_share(cos: f64, reflectance: DVec3, specular: DVec3) -> f64 {
    let luminance = |rgb: DVec3| DVec3::new(0.2126, 0.7152, 0.0722).dot(rgb);
    let coat = luminance(schlick(cos, specular));
    let base = luminance(reflectance) * (1.0 - coat);
    (coat / (coat + base)).clamp(0.1, 0.9)
}

/// D G2 / (4 cos θo), which is f cos θi but for Fresnel's factor, and the density of sampling it.
fn reflection(wo: DVec3, wi: DVec3, alpha: f64) -> (f64, f64) {
    let d = distribution((wo + wi).normalize(), alpha) / (4.0 * wo.z);
    (
        d / (1.0 + lambda(wo, alpha) + lambda(wi, alpha)),
        d / (1.0 + lambda(wo, alpha)),
    )
}

/// GGX.
fn distribution(h: DVec3, alpha: f64) -> f64 {
    let e = (h.x * h.x + h.y * h.y) / (alpha * alpha) + h.z * h.z;
    1.0 / (PI * alpha * alpha * e * e)
}

/// Smith's Λ.
fn lambda(w: DVec3, alpha: f64) -> f64 {
    let tan2 = (w.x * w.x + w.y * w.y) / (w.z * w.z);
    0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0)
}

/// A microfacet normal visible from `wo` (Dupuy and Benyoub 2023).
fn visible_normal(wo: DVec3, alpha: f64, [u, v]: [f64; 2]) -> DVec3 {
    let stretch = DVec3::new(alpha, alpha, 1.0);
    let stretched = (wo * stretch).normalize();
    let z = (1.0 - u) * (1.0 + stretched.z) - stretched.z;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    ((DVec3::new(r * cos, r * sin, z) + stretched) * stretch).normalize()
}

fn cosine_hemisphere(u: [f64; 2]) -> DVec3 {
    let [x, y] = disk(u);
    DVec3::new(x, y, (1.0 - x * x - y * y).max(1e-12).sqrt())
}

/// Shirley and Chiu's concentric map to the unit disk.
pub(super) fn disk([u, v]: [f64; 2]) -> [f64; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    let (r, angle) = if b.abs() >= a.abs() {
        (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * (a / b))
    } else {
        (a, FRAC_PI_4 * (b / a))
    };
    [r * angle.cos(), r * angle.sin()]
}
