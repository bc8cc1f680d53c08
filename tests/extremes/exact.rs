//! The scattering functions again, in f64 and by the textbook, to compare with.

use crate::support;
use embrace::bsdf::{Bsdf, Conductor, Dielectric};
use embrace::math::DVec3;
use std::f64::consts::{PI, TAU};

/// Smith's Λ of GGX, by the cosine.
fn lambda(alpha: f64, w: DVec3) -> f64 {
    0.5 * ((alpha * w.x.hypot(w.y) / w.z).hypot(1.0) - 1.0)
}

/// D(h) of GGX.
fn d(alpha: f64, h: DVec3) -> f64 {
    let e = (h.x * h.x + h.y * h.y) / (alpha * alpha) + h.z * h.z;
    1.0 / (PI * alpha * alpha * e * e)
}

fn g1(alpha: f64, wo: DVec3) -> f64 {
    1.0 / (1.0 + lambda(alpha, wo))
}

fn g2(alpha: f64, wo: DVec3, wi: DVec3) -> f64 {
    1.0 / (1.0 + lambda(alpha, wo) + lambda(alpha, wi))
}

/// Square of the cosine of the refracted ray, negative under total reflection. As a sum, not as 1 − sin²/η².
fn cos2_t(cos: f64, eta: f64) -> f64 {
    ((eta - 1.0) * (eta + 1.0) + cos * cos) / (eta * eta)
}

pub(crate) fn fresnel_dielectric(cos: f64, eta: f64) -> f64 {
    let cos_t = cos2_t(cos, eta);
    if cos_t <= 0.0 {
        return 1.0;
    }
    let cos_t = cos_t.sqrt();
    let r = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
    0.5 * (r(eta * cos, cos_t) + r(cos, eta * cos_t))
}

/// In complex arithmetic.
pub(crate) fn fresnel_conductor(cos: f64, eta: f64, k: f64) -> f64 {
    type C = (f64, f64);
    let mul = |a: C, b: C| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let n2 = mul((eta, k), (eta, k));
    // n cos θt = sqrt(n² − sin²), by the half-angle formula that does not cancel.
    let z = ((eta - 1.0) * (eta + 1.0) - k * k + cos * cos, n2.1);
    let r = z.0.hypot(z.1);
    let (re, im) = if z.0 >= 0.0 {
        let re = ((r + z.0) / 2.0).sqrt();
        (re, if re > 0.0 { z.1 / (2.0 * re) } else { 0.0 })
    } else {
        let im = ((r - z.0) / 2.0).sqrt();
        (z.1 / (2.0 * im), im)
    };
    let ratio = |a: C, b: C| ((a.0 - b.0).powi(2) + (a.1 - b.1).powi(2)) / ((a.0 + b.0).powi(2) + (a.1 + b.1).powi(2));
    if cos == 0.0 {
        return 1.0;
    }
    0.5 * (ratio((cos, 0.0), (re, im)) + ratio((n2.0 * cos, n2.1 * cos), (re, im)))
}

/// A number, and how much it changes for a change of 1 that the reflectance in it may be off by.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shared {
    pub(crate) value: f64,
    pub(crate) per_reflectance: f64,
}

/// f · |cos θi| and the density of sampling, in the green channel. The directions are taken as they are.
pub(crate) fn eval(bsdf: &Bsdf, wo: DVec3, wi: DVec3) -> [Shared; 2] {
    let shared = |whole: f64, share: f64, per_share: f64| Shared {
        value: whole * share,
        per_reflectance: whole * per_share,
    };
    match *bsdf {
        Bsdf::Conductor(Conductor { eta, k, alpha }) => {
            let alpha = f64::from(alpha);
            let h = (wo + wi).normalize();
            let common = d(alpha, h) / (4.0 * wo.z);
            let fresnel = fresnel_conductor(wo.dot(h).min(1.0), eta.g.into(), k.g.into());
            [
                shared(common * g2(alpha, wo, wi), fresnel, 1.0),
                shared(common * g1(alpha, wo), 1.0, 0.0),
            ]
        }
        Bsdf::Dielectric(Dielectric { eta, alpha }) => {
            let (eta, alpha) = (f64::from(eta), f64::from(alpha));
            let reflects = wi.z > 0.0;
            let h = if reflects { wo + wi } else { wo + wi * eta }.normalize();
            let h = if h.z < 0.0 { -h } else { h };
            let (wo_h, wi_h) = (wo.dot(h), wi.dot(h));
            if wo_h <= 0.0 || (wi_h > 0.0) != reflects {
                return [shared(0.0, 0.0, 0.0); 2];
            }
            let fresnel = fresnel_dielectric(wo_h.min(1.0), eta);
            let (share, jacobian, scale) = if reflects {
                (fresnel, 1.0 / (4.0 * wo_h), 1.0)
            } else {
                (1.0 - fresnel, -wi_h / (wi_h + wo_h / eta).powi(2), 1.0 / (eta * eta))
            };
            let common = d(alpha, h) * wo_h * jacobian / wo.z;
            // Squares of amplitudes: the smaller, the less they are off.
            let per_share = fresnel.sqrt();
            [
                shared(common * g2(alpha, wo, wi) * scale, share, per_share),
                shared(common * g1(alpha, wo), share, per_share),
            ]
        }
        _ => unreachable!("not compared"),
    }
}

/// The normal of a microfacet, from the unit square, with density D cos θh.
fn normal(alpha: f64, a: f64, b: f64) -> DVec3 {
    let tan = alpha * (a / (1.0 - a)).sqrt();
    DVec3::new(tan * (TAU * b).cos(), tan * (TAU * b).sin(), 1.0).normalize()
}

/// Of the light from `wo`, the share that is scattered once by the microfacets of normal `h`, per D cos θh. Transmitted
/// light is counted as energy: without the factor of radiance 1 / η².
fn scattered(bsdf: &Bsdf, wo: DVec3, h: DVec3) -> f64 {
    let wo_h = wo.dot(h);
    if wo_h <= 0.0 {
        return 0.0;
    }
    let projected = |alpha: f32, wi: DVec3| g2(alpha.into(), wo, wi) * wo_h / (wo.z * h.z);
    let reflected = h * (2.0 * wo_h) - wo;
    match *bsdf {
        Bsdf::Conductor(Conductor { eta, k, alpha }) if reflected.z > 0.0 => {
            fresnel_conductor(wo_h, eta.g.into(), k.g.into()) * projected(alpha, reflected)
        }
        Bsdf::Dielectric(Dielectric { eta, alpha }) => {
            let eta = f64::from(eta);
            let fresnel = fresnel_dielectric(wo_h, eta);
            let mut sum = 0.0;
            if reflected.z > 0.0 {
                sum += fresnel * projected(alpha, reflected);
            }
            if fresnel < 1.0 {
                let refracted = h * (wo_h / eta - cos2_t(wo_h, eta).sqrt()) - wo / eta;
                if refracted.z < 0.0 {
                    sum += (1.0 - fresnel) * projected(alpha, refracted);
                }
            }
            sum
        }
        _ => 0.0,
    }
}

/// The share of light from `wo` that is scattered once, up or down, by quadrature over normals.
pub(crate) fn albedo(bsdf: &Bsdf, alpha: f64, wo: DVec3) -> f64 {
    // tan θh = α √(1 − t²) / t: linear in the tail, which projection stretches at grazing angles. Cells that shrink towards
    // t = 0 leave no tail unseen; the azimuth begins at that of `wo`.
    let integrand = |t: f64, b: f64| 2.0 * t * scattered(bsdf, wo, normal(alpha, 1.0 - t * t, b));
    let start = wo.y.atan2(wo.x) / TAU;
    let cells = [0.0, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0];
    let quarters = [0.0, 0.25, 0.5, 0.75].map(|quarter| [start + quarter, start + quarter + 0.25]);
    let over = |t: &[f64]| quarters.map(|b| support::integrate(&integrand, [t[0], t[1]], b, 2e-6));
    cells.windows(2).flat_map(over).sum()
}
