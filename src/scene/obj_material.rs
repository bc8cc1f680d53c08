//! What the materials of MTL files become.
//!
//! MTL is older than physically based shading; the reading here is:
//! - `illum` 4, 6, 7 or 9 is glass of index `Ni`.
//! - a map of `Pr` or `Pm`, a `Pm` between 0 and 1, or metal whose colour varies is the principled BSDF.
//! - `Pm` of 1, or `illum` 3 or 5 with a specular colour and a black `Kd`, is metal. Its index follows from the
//!   colour as reflectance at normal incidence.
//! - a specular colour `Ks`, or a roughness `Pr`, is a coat over the diffuse base.
//! - anything else is diffuse.
//!
//! Width of a highlight: `Pr` squared where it is given, else `Ns` by α = sqrt(2 / (Ns + 2)), which matches the Blinn-Phong
//! lobe at its peak (Walter et al. 2007). `d`, `Tr` and `map_d` are coverage, except for glass.

use super::bitmap::Role;
use super::file::MAX_RADIANCE;
use super::obj::{MapKind, MapRef, MtlMaterial};
use crate::bsdf::PLASTIC_MIN_ALPHA;
use crate::light::Emission;
use crate::material::{Channel, General, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use crate::math::{Affine2, Rgb};
use crate::texture::{Encoding, Texture, TextureMap, Wrap};

/// The colour of a surface whose bitmap is missing: one that nobody takes for intended.
pub(super) const MISSING: Rgb = Rgb::new(0.8, 0.0, 0.8);

/// A material, and the light of surfaces that have it.
pub(super) struct Converted {
    pub(super) material: Material,
    pub(super) emission: Option<Emission>,
    /// What the emission is multiplied by.
    pub(super) emission_map: Option<Spectrum>,
    /// What could not be kept.
    pub(super) notes: Vec<String>,
}

/// How a bitmap is read.
pub(super) fn role(kind: MapKind, map: &MapRef) -> Role {
    match kind {
        MapKind::Kd | MapKind::Ke => Role::Colour(None),
        MapKind::D if map.channel.is_none() => Role::Coverage,
        MapKind::D | MapKind::Pr | MapKind::Pm | MapKind::Bump | MapKind::Norm => Role::Colour(Some(Encoding::Linear)),
    }
}

/// What is seen in the place of a bitmap that is missing.
pub(super) fn without(kind: MapKind) -> &'static str {
    match kind {
        MapKind::Kd => "the surface is shown in magenta",
        MapKind::D => "the surface is whole",
        _ => "the material is shown without it",
    }
}

/// A material to be converted.
struct Source<'a> {
    mtl: &'a MtlMaterial,
    /// The texture of each map, if it could be read.
    bitmaps: [Option<u32>; MapKind::ALL.len()],
    textures: &'a [Texture],
    notes: Vec<String>,
}

/// Converts a material. `bitmaps`: the texture of each of its maps, if it could be read. `is_colored`: whether meshes that have
/// it have vertex colours, which are a factor on its colour.
pub(super) fn convert(
    mtl: &MtlMaterial,
    bitmaps: [Option<u32>; MapKind::ALL.len()],
    textures: &[Texture],
    is_colored: bool,
) -> Converted {
    let mut source = Source {
        mtl,
        bitmaps,
        textures,
        notes: Vec::new(),
    };
    let unit = |rgb: Rgb| rgb.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 });
    let kd = unit(mtl.kd.unwrap_or(Rgb::splat(0.8)));
    let base = match (source.texture(MapKind::Kd), mtl.map(MapKind::Kd), is_colored) {
        (Some(map), _, false) => Spectrum::Bitmap(map, Rgb::WHITE),
        (Some(map), _, true) => Spectrum::VertexColor(Some(map), Rgb::WHITE),
        (None, Some(_), _) => Spectrum::Constant(MISSING),
        (None, None, false) => Spectrum::Constant(kd),
        (None, None, true) => Spectrum::VertexColor(None, kd),
    };
    let is_glass = matches!(mtl.illum, Some(4 | 6 | 7 | 9));
    let scattering = source.scattering(base, kd, unit(mtl.ks.unwrap_or(Rgb::BLACK)), is_glass);
    let material = Material {
        opacity: source.opacity().filter(|_| !is_glass),
        relief: source.relief(),
        ..Material::new(scattering)
    };
    let emission_map = source.texture(MapKind::Ke);
    let radiance = mtl.ke.filter(|ke| ke.is_finite() && !ke.is_black());
    // A map alone is as bright as it looks, although many exporters write a black `Ke` beside it.
    let radiance = radiance.or(emission_map.map(|_| Rgb::WHITE));
    Converted {
        material,
        emission: radiance.map(|radiance| Emission {
            radiance: radiance.map(|c| c.clamp(0.0, MAX_RADIANCE as f32)),
            both_sides: true,
        }),
        emission_map: emission_map.map(|map| Spectrum::Bitmap(map, Rgb::WHITE)),
        notes: source.notes,
    }
}

impl Source<'_> {
    /// A bitmap with the options of its map.
    fn texture(&self, kind: MapKind) -> Option<TextureMap> {
        let map = self.mtl.map(kind)?;
        Some(TextureMap {
            to_uv: Affine2::from_scale_angle_translation(map.scale.into(), 0.0, map.offset.into()),
            wrap: [if map.clamp { Wrap::Clamp } else { Wrap::Repeat }; 2],
            ..TextureMap::new(self.bitmaps[kind as usize]?)
        })
    }

    /// A number from a bitmap.
    fn number(&self, kind: MapKind) -> Option<Scalar> {
        let channel = self.mtl.map(kind)?.channel.unwrap_or(Channel::Mean);
        Some(Scalar::Varying(
            Spectrum::Bitmap(self.texture(kind)?, Rgb::WHITE),
            channel,
        ))
    }

    fn scattering(&mut self, base: Spectrum, kd: Rgb, ks: Rgb, is_glass: bool) -> Scattering {
        let mtl = self.mtl;
        let alpha = match (mtl.pr, mtl.ns) {
            (Some(roughness), _) => roughness.clamp(0.0, 1.0).powi(2),
            (None, Some(ns)) => (2.0 / (ns.max(0.0) + 2.0)).sqrt(),
            (None, None) => 0.3,
        };
        let metallic = mtl.pm.unwrap_or(0.0);
        let mirror_like = matches!(mtl.illum, Some(3 | 5)) && !ks.is_black() && kd.is_black();
        let [roughness_map, metallic_map] = [MapKind::Pr, MapKind::Pm].map(|kind| self.number(kind));
        if is_glass {
            if roughness_map.is_some() || metallic_map.is_some() {
                self.notes
                    .push("glass has no maps of Pr and Pm; they are ignored".into());
            }
            let smooth = mtl.pr.is_none();
            let ior = mtl.ni.filter(|ni| (0.01..=100.0).contains(ni)).unwrap_or(1.5);
            return Scattering::Dielectric {
                ior,
                alpha: if smooth { 0.0 } else { alpha },
            };
        }
        let is_part_metal = metallic > 0.0 && metallic < 1.0;
        let is_varying_metal = metallic >= 1.0 && base.varies();
        if is_part_metal || is_varying_metal || roughness_map.is_some() || metallic_map.is_some() {
            if !ks.is_black() {
                self.notes.push("Ks is not used beside Pm or maps of Pr and Pm".into());
            }
            return Scattering::General(General::Principled(Box::new(Principled {
                roughness: roughness_map.unwrap_or(Scalar::Constant(alpha.sqrt())),
                metallic: metallic_map.unwrap_or(Scalar::Constant(metallic.min(1.0))),
                ..Principled::new(base)
            })));
        }
        if metallic >= 1.0 || mirror_like {
            let (eta, k) = index_of_metal(if metallic >= 1.0 { kd } else { ks });
            let smooth = mirror_like && mtl.pr.is_none() && mtl.ns.is_none_or(|ns| ns >= 1000.0);
            return Scattering::Conductor {
                eta,
                k,
                alpha: if smooth { 0.0 } else { alpha },
            };
        }
        if !ks.is_black() || mtl.pr.is_some() {
            let specular = if ks.is_black() { Rgb::splat(0.04) } else { ks };
            return Scattering::Plastic {
                reflectance: base,
                specular,
                alpha: alpha.max(PLASTIC_MIN_ALPHA),
            };
        }
        Scattering::Diffuse { reflectance: base }
    }

    fn opacity(&self) -> Option<Spectrum> {
        // The mean of the channels is what counts.
        let tint = match self.mtl.map(MapKind::D).and_then(|map| map.channel) {
            Some(Channel::R) => Rgb::new(3.0, 0.0, 0.0),
            Some(Channel::G) => Rgb::new(0.0, 3.0, 0.0),
            Some(Channel::B) => Rgb::new(0.0, 0.0, 3.0),
            Some(Channel::Mean | Channel::Luminance) | None => Rgb::WHITE,
        };
        match (self.texture(MapKind::D), self.mtl.map(MapKind::D), self.mtl.d) {
            (Some(map), ..) => Some(Spectrum::Bitmap(map, tint)),
            (None, Some(_), _) => None,
            (None, None, d) => d
                .filter(|d| *d < 1.0)
                .map(|d| Spectrum::Constant(Rgb::splat(d.max(0.0)))),
        }
    }

    fn relief(&mut self) -> Option<Relief> {
        let strength = |kind| self.mtl.map(kind).map_or(1.0, |map| map.strength);
        if let Some(map) = self.texture(MapKind::Norm) {
            let scale = strength(MapKind::Norm);
            return Some(Relief::NormalMap { map, scale });
        }
        let (map, scale) = (self.texture(MapKind::Bump)?, strength(MapKind::Bump));
        if holds_normals(&self.textures[map.texture as usize]) {
            self.notes
                .push("the bump map holds normals, not heights, and is used so".into());
            return Some(Relief::NormalMap { map, scale });
        }
        let channel = self.mtl.map(MapKind::Bump).and_then(|map| map.channel);
        if matches!(channel, Some(Channel::R | Channel::G | Channel::B)) {
            self.notes
                .push("a bump map's height is the mean of its channels; -imfchan is ignored".into());
        }
        Some(Relief::BumpMap { map, scale })
    }
}

/// Whether an image that should hold heights looks like one of normals, as some exporters write under the same keyword:
/// nearly all texels are unit vectors that point outwards. Grey heights are that only where they are near 0.79.
fn holds_normals(texture: &Texture) -> bool {
    let is_normal = |c: [f32; 3]| {
        let [x, y, z] = c.map(|c| 2.0 * c - 1.0);
        z > 0.0 && (x * x + y * y + z * z - 1.0).abs() < 0.15
    };
    let is_grey = |c: [f32; 3]| c == [c[0]; 3];
    let count = |texels: &mut dyn Iterator<Item = [f32; 3]>| {
        let (mut all, mut normals, mut grey) = (0u64, 0u64, true);
        for texel in texels {
            all += 1;
            normals += u64::from(is_normal(texel));
            grey &= is_grey(texel);
        }
        !grey && normals * 10 > all * 9
    };
    match texture {
        Texture::Rgb8(image, _) => count(&mut image.pixels.iter().map(|p| p.map(|c| f32::from(c) / 255.0))),
        Texture::Rgb32(image) => count(&mut image.pixels.iter().map(|p| p.to_array())),
    }
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

    fn converted(mtl: &MtlMaterial) -> Material {
        convert(mtl, [None; MapKind::ALL.len()], &[], false).material
    }

    fn scattering(mtl: MtlMaterial) -> Scattering {
        converted(&mtl).scattering
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
        assert_eq!(converted(&half).opacity, Some(Spectrum::Constant(Rgb::splat(0.5))));
        let glass = MtlMaterial { illum: Some(4), ..half };
        assert_eq!(converted(&glass).opacity, None);
    }
}
