//! What the materials of MTL files become.
//!
//! MTL is older than physically based shading; the reading here is:
//! - `illum` 4, 6, 7 or 9 is glass of index `Ni`.
//! - `Pm` of 1/2 or more, or `illum` 3 or 5 with a specular colour and a black `Kd`, is metal. Its index follows from the
//!   colour as reflectance at normal incidence.
//! - a specular colour `Ks`, or a roughness `Pr`, is a coat over the diffuse base.
//! - anything else is diffuse.
//!
//! Width of a highlight: `Pr` squared where it is given, else `Ns` by α = sqrt(2 / (Ns + 2)), which matches the Blinn-Phong
//! lobe at its peak (Walter et al. 2007). `d`, `Tr` and `map_d` are coverage, except for glass.

use super::obj::MtlMaterial;
use crate::bsdf::PLASTIC_MIN_ALPHA;
use crate::material::{Material, Scattering, Spectrum};
use crate::math::Rgb;

/// Converts a material whose bitmaps are resolved already. Says what it could not keep.
pub(super) fn convert(mtl: &MtlMaterial, map_kd: Option<Spectrum>, map_d: Option<Spectrum>) -> (Material, Vec<String>) {
    let mut notes = Vec::new();
    let unit = |rgb: Rgb| rgb.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 });
    let kd = unit(mtl.kd.unwrap_or(Rgb::splat(0.8)));
    let ks = unit(mtl.ks.unwrap_or(Rgb::BLACK));
    let alpha = match (mtl.pr, mtl.ns) {
        (Some(roughness), _) => roughness.clamp(0.0, 1.0).powi(2),
        (None, Some(ns)) => (2.0 / (ns.max(0.0) + 2.0)).sqrt(),
        (None, None) => 0.3,
    };
    let base = map_kd.unwrap_or(Spectrum::Constant(kd));
    let metallic = mtl.pm.unwrap_or(0.0);
    if metallic > 0.0 && metallic < 1.0 {
        notes.push(format!(
            "Pm {metallic} is between dielectric and metal; taken as {}",
            if metallic >= 0.5 { "metal" } else { "dielectric" }
        ));
    }
    let mirror_like = matches!(mtl.illum, Some(3 | 5)) && !ks.is_black() && kd.is_black();
    let glass = matches!(mtl.illum, Some(4 | 6 | 7 | 9));
    let scattering = if glass {
        let smooth = mtl.pr.is_none();
        let ior = mtl.ni.filter(|ni| (0.01..=100.0).contains(ni)).unwrap_or(1.5);
        Scattering::Dielectric {
            ior,
            alpha: if smooth { 0.0 } else { alpha },
        }
    } else if metallic >= 0.5 || mirror_like {
        if matches!(base, Spectrum::Bitmap(..)) {
            notes.push("a metal's colour cannot come from a bitmap; Kd is used".into());
        }
        let (eta, k) = index_of_metal(if metallic >= 0.5 { kd } else { ks });
        let smooth = mirror_like && mtl.pr.is_none() && mtl.ns.is_none_or(|ns| ns >= 1000.0);
        Scattering::Conductor {
            eta,
            k,
            alpha: if smooth { 0.0 } else { alpha },
        }
    } else if !ks.is_black() || mtl.pr.is_some() {
        let specular = if ks.is_black() { Rgb::splat(0.04) } else { ks };
        Scattering::Plastic {
            reflectance: base,
            specular,
            alpha: alpha.max(PLASTIC_MIN_ALPHA),
        }
    } else {
        Scattering::Diffuse { reflectance: base }
    };
    let opacity = match (glass, map_d, mtl.d) {
        (true, ..) => None,
        (false, Some(map), _) => Some(map),
        (false, None, Some(d)) if d < 1.0 => Some(Spectrum::Constant(Rgb::splat(d.max(0.0)))),
        _ => None,
    };
    (
        Material {
            opacity,
            ..Material::new(scattering)
        },
        notes,
    )
}

/// A complex index whose reflectance at normal incidence is `r` (Gulbrandsen 2014, "Artist Friendly Metallic Fresnel"):
/// of the many, the one with the smallest real part, which real metals are close to.
fn index_of_metal(r: Rgb) -> (Rgb, Rgb) {
    // At exactly 1 the absorption would be infinite.
    let r = r.map(|c| c.clamp(0.0, 0.999));
    let eta = |r: f32| (1.0 - r) / (1.0 + r);
    let k = |r: f32| {
        (((eta(r) + 1.0).powi(2) * r - (eta(r) - 1.0).powi(2)) / (1.0 - r))
            .max(0.0)
            .sqrt()
    };
    (r.map(eta), r.map(k))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bsdf::{Bsdf, Conductor};
    use crate::math::Vec3;

    fn scattering(mtl: MtlMaterial) -> Scattering {
        convert(&mtl, None, None).0.scattering
    }

    #[test]
    fn a_metal_reflects_its_colour_at_normal_incidence() {
        for r in [0.1, 0.5, 0.95] {
            let (eta, k) = index_of_metal(Rgb::splat(r));
            let metal = Bsdf::Conductor(Conductor { eta, k, alpha: 0.0 });
            let weight = metal.sample(Vec3::Z, 0.5, [0.5; 2]).unwrap().weight;
            assert!((weight.r - r).abs() < 1e-3, "{weight:?} for {r}");
        }
    }

    #[test]
    fn the_illumination_model_and_the_physical_keys_choose_the_scattering() {
        let mtl = MtlMaterial::default;
        assert!(matches!(scattering(mtl()), Scattering::Diffuse { .. }));
        assert!(matches!(
            scattering(MtlMaterial {
                illum: Some(7),
                ..mtl()
            }),
            Scattering::Dielectric { alpha: 0.0, .. }
        ));
        assert!(matches!(
            scattering(MtlMaterial { pm: Some(1.0), ..mtl() }),
            Scattering::Conductor { .. }
        ));
        assert!(matches!(
            scattering(MtlMaterial { pr: Some(0.5), ..mtl() }),
            Scattering::Plastic { alpha: 0.25, .. }
        ));
        let mirror = MtlMaterial {
            kd: Some(Rgb::BLACK),
            ks: Some(Rgb::WHITE),
            illum: Some(3),
            ns: Some(1e5),
            ..mtl()
        };
        assert!(matches!(scattering(mirror), Scattering::Conductor { alpha: 0.0, .. }));
    }

    #[test]
    fn dissolve_is_coverage_except_for_glass() {
        let half = MtlMaterial {
            d: Some(0.5),
            ..MtlMaterial::default()
        };
        assert_eq!(
            convert(&half, None, None).0.opacity,
            Some(Spectrum::Constant(Rgb::splat(0.5)))
        );
        let glass = MtlMaterial { illum: Some(4), ..half };
        assert_eq!(convert(&glass, None, None).0.opacity, None);
    }
}
