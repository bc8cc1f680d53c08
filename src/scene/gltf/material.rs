//! Materials: metallic-roughness as the principled model, and what extensions add to it.

use super::super::bitmap::{Role, Threshold};
use super::layer::{Clearcoat, Volume};
use super::mesh::VertexAlpha;
use super::resource::Buffers;
use super::texture::{Reference, Textures};
use super::{Asset, LoadError, Notes, label};
use crate::light::Emission;
use crate::material::{Channel, General, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use crate::math::Rgb;
use crate::texture::{Encoding, Texture};
use gltf::json::extensions::material::Specular;
use gltf::json::material::{AlphaMode, Material as Json};
use gltf::json::texture::Info;
use gltf::json::validation::Checked;
use std::collections::HashMap;

/// Materials and their names.
type NamedMaterials = Vec<(String, Material)>;

/// Least index of refraction: the principled model has none that is 1.
const LEAST_IOR: f32 = 1.0001;

/// Most radiance of a surface.
const MOST_RADIANCE: f32 = 1e30;

/// What the format says where nothing else does; names differ by the language, values do not.
const DEFAULT_CUTOFF: f32 = 0.5;

/// A material and what shines with it.
struct Surface {
    name: String,
    material: Material,
    emission: Option<Emission>,
    emission_map: Option<Spectrum>,
    is_lamp: bool,
}

/// The materials in use. One of the file may become several, for meshes that differ in what they multiply it by.
pub(super) struct Materials<'a> {
    asset: &'a Asset<'a>,
    textures: Textures,
    index: HashMap<(Option<usize>, bool, u32), usize>,
    surfaces: Vec<Surface>,
}

impl<'a> Materials<'a> {
    pub(super) fn new(asset: &'a Asset<'a>) -> Materials<'a> {
        Materials {
            asset,
            textures: Textures::default(),
            index: HashMap::new(),
            surfaces: Vec::new(),
        }
    }

    /// The number of a material of the file, or of the default one, for a mesh with vertex colours or without.
    pub(super) fn get(
        &mut self,
        material: Option<usize>,
        has_colors: bool,
        alpha: VertexAlpha,
        notes: &mut Notes,
    ) -> Result<usize, LoadError> {
        let default = Json::default();
        let json = material.map_or(&default, |index| &self.asset.root.materials[index]);
        let is_opaque = matches!(json.alpha_mode, Checked::Valid(AlphaMode::Opaque));
        let factor = if is_opaque { 1.0 } else { alpha.mean };
        let key = (material, has_colors, factor.to_bits());
        if let Some(&known) = self.index.get(&key) {
            return Ok(known);
        }
        let name = material.map_or_else(
            || "default".to_owned(),
            |index| label("materials", index, json.name.as_deref()),
        );
        if alpha.varies && !is_opaque {
            notes.add("the opacity of the vertex colours varies; its mean is used", &name);
        }
        let mut reading = Reading {
            asset: self.asset,
            textures: &mut self.textures,
            notes,
            name: &name,
            json,
            has_colors,
        };
        let surface = reading.surface(factor)?;
        let index = self.surfaces.len();
        self.index.insert(key, index);
        self.surfaces.push(surface);
        Ok(index)
    }

    /// How a material shines.
    pub(super) fn emission(&self, material: usize) -> (Option<Emission>, Option<Spectrum>) {
        let surface = &self.surfaces[material];
        (surface.emission, surface.emission_map)
    }

    /// Whether it is meant to light other things, and not to look bright alone.
    pub(super) fn is_lamp(&self, material: usize) -> bool {
        self.surfaces[material].is_lamp
    }

    /// Reads the bitmaps, and gives all materials and textures.
    pub(super) fn finish(
        self,
        buffers: &Buffers<'_>,
        hasher: &mut blake3::Hasher,
    ) -> Result<(NamedMaterials, Vec<Texture>), LoadError> {
        let mut textures = self.textures.decode(self.asset, buffers, hasher)?;
        let mut materials: NamedMaterials = self.surfaces.into_iter().map(|s| (s.name, s.material)).collect();
        for (_, material) in &mut materials {
            // Bitmaps of opacity have no other use, and rays need not stop at what is opaque everywhere.
            if let Some(Spectrum::Bitmap(map, Rgb::WHITE)) = material.opacity
                && is_white(&textures[map.texture as usize])
            {
                let texel = crate::image::Image::filled(1, 1, [u8::MAX; 3]);
                textures[map.texture as usize] = Texture::Rgb8(texel, Encoding::Linear);
                material.opacity = None;
            }
        }
        Ok((materials, textures))
    }
}

fn is_white(texture: &Texture) -> bool {
    match texture {
        Texture::Rgb8(image, _) => image.pixels.iter().all(|texel| *texel == [u8::MAX; 3]),
        Texture::Rgb32(image) => image.pixels.iter().all(|texel| *texel == Rgb::WHITE),
    }
}

/// The set of texture coordinates that the textures of a material look up; `None` without textures. A mesh has one set
/// here: where they differ, that of the base colour, or else of the first, serves all.
pub(super) fn set_of(asset: &Asset<'_>, material: Option<usize>, notes: &mut Notes) -> Result<Option<u32>, LoadError> {
    let Some(index) = material else {
        return Ok(None);
    };
    let json = &asset.root.materials[index];
    let name = label("materials", index, json.name.as_deref());
    let pbr = &json.pbr_metallic_roughness;
    let transmission = json.extensions.as_ref().and_then(|e| e.transmission.as_ref());
    let specular = json.extensions.as_ref().and_then(|e| e.specular.as_ref());
    let coat = Clearcoat::of(asset, json, &name)?;
    let infos = [
        pbr.base_color_texture.as_ref(),
        pbr.metallic_roughness_texture.as_ref(),
        json.emissive_texture.as_ref(),
        transmission.and_then(|t| t.transmission_texture.as_ref()),
        specular.and_then(|s| s.specular_texture.as_ref()),
        specular.and_then(|s| s.specular_color_texture.as_ref()),
    ];
    let mut sets: Vec<u32> = infos
        .into_iter()
        .flatten()
        .chain(coat.iter().flat_map(Clearcoat::textures))
        .map(|info| Reference::of(info).set)
        .collect();
    if let Some(normals) = &json.normal_texture {
        sets.push(Reference::of_normals(asset, normals, &name)?.set);
    }
    let first = sets.first().copied();
    if sets.iter().any(|set| Some(*set) != first) {
        notes.add(
            format!(
                "textures use several sets of texture coordinates; TEXCOORD_{} is used for all",
                first.unwrap_or(0)
            ),
            &name,
        );
    }
    Ok(first)
}

/// A number that should be in [0, 1].
fn unit(value: f32) -> f32 {
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

/// A material that is being read.
struct Reading<'a> {
    asset: &'a Asset<'a>,
    textures: &'a mut Textures,
    notes: &'a mut Notes,
    name: &'a str,
    json: &'a Json,
    has_colors: bool,
}

impl Reading<'_> {
    fn note(&mut self, sentence: &str) {
        self.notes.add(sentence, self.name);
    }

    /// A bitmap times a tint.
    fn bitmap(&mut self, reference: &Reference, role: Role, tint: Rgb) -> Result<Spectrum, LoadError> {
        let map = self.textures.map(self.asset, reference, role, self.name)?;
        Ok(Spectrum::Bitmap(map, tint))
    }

    /// A number, times a channel of a bitmap if there is one.
    fn scalar(&mut self, factor: f32, texture: Option<&Info>, channel: Channel) -> Result<Scalar, LoadError> {
        let factor = unit(factor);
        match texture {
            Some(info) if factor > 0.0 => {
                let role = Role::Colour(Some(Encoding::Linear));
                let bitmap = self.bitmap(&Reference::of(info), role, Rgb::splat(factor))?;
                Ok(Scalar::Varying(bitmap, channel))
            }
            _ => Ok(Scalar::Constant(factor)),
        }
    }

    fn base_color(&mut self) -> Result<Spectrum, LoadError> {
        let pbr = &self.json.pbr_metallic_roughness;
        let [r, g, b, _] = pbr.base_color_factor.0.map(unit);
        let tint = Rgb::new(r, g, b);
        let map = match &pbr.base_color_texture {
            Some(info) => {
                let role = Role::Colour(Some(Encoding::Srgb));
                Some(self.textures.map(self.asset, &Reference::of(info), role, self.name)?)
            }
            None => None,
        };
        Ok(match (map, self.has_colors) {
            (map, true) => Spectrum::VertexColor(map, tint),
            (Some(map), false) => Spectrum::Bitmap(map, tint),
            (None, false) => Spectrum::Constant(tint),
        })
    }

    fn surface(&mut self, vertex_alpha: f32) -> Result<Surface, LoadError> {
        let opacity = self.opacity(vertex_alpha)?;
        let is_unlit = self.json.extensions.as_ref().is_some_and(|e| e.unlit.is_some());
        let (scattering, relief, emission, emission_map) = if is_unlit {
            self.note("is unlit: it is shown as a surface that emits its colour, and so lights others");
            let base = self.base_color()?;
            let (radiance, map) = match base {
                Spectrum::Constant(rgb) => (rgb, None),
                Spectrum::Bitmap(map, rgb) => (rgb, Some(Spectrum::Bitmap(map, Rgb::WHITE))),
                Spectrum::VertexColor(map, rgb) => (rgb, Some(Spectrum::VertexColor(map, Rgb::WHITE))),
                Spectrum::Checkerboard(_) => (Rgb::WHITE, Some(base)),
            };
            let emission = Emission {
                radiance,
                both_sides: true,
            };
            let black = Scattering::Diffuse {
                reflectance: Spectrum::Constant(Rgb::BLACK),
            };
            (black, None, Some(emission), map)
        } else {
            if self.json.occlusion_texture.is_some() {
                self.note("the occlusion texture is ignored: shadows come from the geometry");
            }
            let scattering = Scattering::General(General::Principled(Box::new(self.principled()?)));
            let (emission, map) = self.emission()?;
            (scattering, self.relief()?, emission, map)
        };
        let emission = emission.filter(|emission| !emission.radiance.is_black());
        let is_strong = self
            .json
            .extensions
            .as_ref()
            .is_some_and(|e| e.emissive_strength.is_some());
        Ok(Surface {
            name: self.name.to_owned(),
            material: Material {
                opacity,
                relief,
                ..Material::new(scattering)
            },
            emission,
            is_lamp: emission.is_some() && !is_unlit && (is_strong || self.json.emissive_texture.is_none()),
            emission_map: emission_map.filter(|_| emission.is_some()),
        })
    }

    /// `None` where the surface is there everywhere.
    fn opacity(&mut self, vertex_alpha: f32) -> Result<Option<Spectrum>, LoadError> {
        let pbr = &self.json.pbr_metallic_roughness;
        let factor = unit(pbr.base_color_factor.0[3] * vertex_alpha);
        let texture = pbr
            .base_color_texture
            .as_ref()
            .filter(|_| factor > 0.0)
            .map(Reference::of);
        let whole = |alpha: f32| (alpha < 1.0).then_some(Spectrum::Constant(Rgb::splat(alpha)));
        match (self.json.alpha_mode, texture) {
            (Checked::Valid(AlphaMode::Mask), texture) => {
                let cutoff = self.json.alpha_cutoff.map_or(DEFAULT_CUTOFF, |cutoff| cutoff.0);
                match texture {
                    Some(texture) => {
                        let role = Role::Alpha(Some(Threshold::new(cutoff / factor)));
                        self.bitmap(&texture, role, Rgb::WHITE).map(Some)
                    }
                    None => Ok(whole(if factor >= cutoff { 1.0 } else { 0.0 })),
                }
            }
            (Checked::Valid(AlphaMode::Blend), Some(texture)) => {
                self.bitmap(&texture, Role::Alpha(None), Rgb::splat(factor)).map(Some)
            }
            (Checked::Valid(AlphaMode::Blend), None) => Ok(whole(factor)),
            _ => Ok(None),
        }
    }

    fn principled(&mut self) -> Result<Principled, LoadError> {
        let pbr = &self.json.pbr_metallic_roughness;
        let roughness_map = pbr.metallic_roughness_texture.as_ref();
        let mut principled = Principled {
            metallic: self.scalar(pbr.metallic_factor.0, roughness_map, Channel::B)?,
            roughness: self.scalar(pbr.roughness_factor.0, roughness_map, Channel::G)?,
            ..Principled::new(self.base_color()?)
        };
        let Some(extensions) = &self.json.extensions else {
            return Ok(principled);
        };
        if let Some(transmission) = &extensions.transmission {
            let texture = transmission.transmission_texture.as_ref();
            principled.spec_trans = self.scalar(transmission.transmission_factor.0, texture, Channel::R)?;
        }
        if let Some(ior) = &extensions.ior {
            principled.ior = self.ior(ior.ior.0);
        }
        let volume = Volume::of(self.asset, self.json, self.name)?;
        principled.thin = volume.as_ref().is_none_or(|volume| volume.thickness_factor == 0.0);
        if !principled.thin && volume.is_some_and(|volume| volume.attenuation_distance.is_some()) {
            self.note("absorption within KHR_materials_volume is ignored");
        }
        if let Some(specular) = &extensions.specular {
            self.specular(&mut principled, specular)?;
        }
        if let Some(clearcoat) = Clearcoat::of(self.asset, self.json, self.name)? {
            self.clearcoat(&mut principled, &clearcoat)?;
        }
        // What transmits nothing has no walls.
        principled.thin &= principled.spec_trans != Scalar::Constant(0.0);
        Ok(principled)
    }

    fn ior(&mut self, ior: f32) -> f32 {
        if (1.0..=100.0).contains(&ior) {
            return ior.max(LEAST_IOR);
        }
        self.note("the index of refraction is not within 1 and 100; 1.5 is used");
        1.5
    }

    fn specular(&mut self, principled: &mut Principled, specular: &Specular) -> Result<(), LoadError> {
        // The strength is in the alpha channel.
        principled.specular = match &specular.specular_texture {
            Some(info) => {
                let factor = Rgb::splat(unit(specular.specular_factor.0));
                let bitmap = self.bitmap(&Reference::of(info), Role::Alpha(None), factor)?;
                Scalar::Varying(bitmap, Channel::Mean)
            }
            None => Scalar::Constant(unit(specular.specular_factor.0)),
        };
        let color = Rgb::from(specular.specular_color_factor.0).map(|c| if c.is_finite() { c.max(0.0) } else { 1.0 });
        // Factors have no limit, but the reflectance has: what is beyond 1 is a higher index.
        let most = color.max_component().max(1.0);
        if most > 1.0 && principled.spec_trans == Scalar::Constant(0.0) {
            let amplitude = (principled.ior - 1.0) / (principled.ior + 1.0);
            // The index is infinite at 1.
            let amplitude = (amplitude * amplitude * most).min(0.9).sqrt();
            principled.ior = ((1.0 + amplitude) / (1.0 - amplitude)).max(LEAST_IOR);
        } else if most > 1.0 {
            self.note("KHR_materials_specular is limited to factors of 1 where the material transmits light");
        }
        let color = color / most;
        principled.specular_color = match &specular.specular_color_texture {
            Some(info) => self.bitmap(&Reference::of(info), Role::Colour(Some(Encoding::Srgb)), color)?,
            None => Spectrum::Constant(color),
        };
        Ok(())
    }

    fn clearcoat(&mut self, principled: &mut Principled, coat: &Clearcoat) -> Result<(), LoadError> {
        principled.clearcoat = self.scalar(coat.clearcoat_factor, coat.clearcoat_texture.as_ref(), Channel::R)?;
        if principled.clearcoat == Scalar::Constant(0.0) {
            return Ok(());
        }
        let texture = coat.clearcoat_roughness_texture.as_ref();
        principled.clearcoat_roughness = self.scalar(coat.clearcoat_roughness_factor, texture, Channel::G)?;
        if coat.clearcoat_normal_texture.is_some() || self.json.normal_texture.is_some() {
            self.note("the clear coat follows the normal map of what is below");
        }
        Ok(())
    }

    fn relief(&mut self) -> Result<Option<Relief>, LoadError> {
        let Some(normals) = &self.json.normal_texture else {
            return Ok(None);
        };
        if !normals.scale.is_finite() {
            return Err(self
                .asset
                .error(format!("{}.normalTexture.scale", self.name), "is not finite"));
        }
        let reference = Reference::of_normals(self.asset, normals, self.name)?;
        let role = Role::Colour(Some(Encoding::Linear));
        Ok(Some(Relief::NormalMap {
            map: self.textures.map(self.asset, &reference, role, self.name)?,
            scale: normals.scale,
        }))
    }

    fn emission(&mut self) -> Result<(Option<Emission>, Option<Spectrum>), LoadError> {
        let strength = self.json.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
        let strength = strength.map_or(1.0, |s| s.emissive_strength.0);
        let radiance = Rgb::from(self.json.emissive_factor.0) * strength;
        if !radiance.to_array().iter().all(|c| (0.0..=MOST_RADIANCE).contains(c)) {
            return Err(self.asset.error(
                format!("{}.emissiveFactor", self.name),
                format!("with its strength it is not within 0 and {MOST_RADIANCE:e}"),
            ));
        }
        if radiance.is_black() {
            return Ok((None, None));
        }
        let emission = Emission {
            radiance,
            both_sides: self.json.double_sided,
        };
        let map = match &self.json.emissive_texture {
            Some(info) => {
                let role = Role::Colour(Some(Encoding::Srgb));
                Some(self.bitmap(&Reference::of(info), role, Rgb::WHITE)?)
            }
            None => None,
        };
        Ok((Some(emission), map))
    }
}
