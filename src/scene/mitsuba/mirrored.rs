//! Normal maps on surfaces whose texture coordinates are mirrored.
//!
//! The second number of a normal map goes along a direction at right angles to the first. In Mitsuba 3.9 that is always
//! the one to the left, seen from outside; here it is the one in which v grows. Where texture coordinates are mirrored on
//! the surface, the two are opposite, and the map's green is turned over for them to agree. A mesh counts as a whole.

use super::Importer;
use crate::image::Image;
use crate::material::{Back, General, Relief, Scattering};
use crate::math::{DVec3, Rgb};
use crate::mesh::TriangleMesh;
use crate::texture::{Encoding, Texture};

/// Whether texture coordinates are mirrored on most of a mesh, by their area.
pub(super) fn is_mirrored(mesh: &TriangleMesh<DVec3>) -> bool {
    let area = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|i| mesh.uvs[i as usize].as_dvec2());
        (b - a).perp_dot(c - a)
    };
    !mesh.uvs.is_empty() && mesh.indices.iter().map(area).sum::<f64>() < 0.0
}

impl Importer<'_> {
    /// The same material for surfaces with mirrored texture coordinates.
    pub(super) fn for_mirrored(&mut self, index: u32) -> u32 {
        if let Some(&mirrored) = self.mirrored_materials.get(&index) {
            return mirrored;
        }
        let (name, before) = self.materials[index as usize].clone();
        let mut material = before.clone();
        if let Some(Relief::NormalMap { map, .. }) = &mut material.relief {
            map.texture = self.with_green_turned(map.texture);
        }
        if let Back::Material(other) = &mut material.back {
            *other = self.for_mirrored(*other);
        }
        if let Scattering::General(General::Blend { materials, .. }) = &mut material.scattering {
            *materials = materials.map(|part| self.for_mirrored(part));
        }
        let mirrored = if material == before {
            index
        } else {
            self.add_material(name, material)
        };
        self.mirrored_materials.insert(index, mirrored);
        mirrored
    }

    fn with_green_turned(&mut self, texture: u32) -> u32 {
        if let Some(&turned) = self.turned_textures.get(&texture) {
            return turned;
        }
        let linear = |image: &Image<Rgb>| {
            let turn = |c: &Rgb| Rgb::new(c.r, 1.0 - c.g, c.b);
            Texture::Rgb32(Image {
                width: image.width,
                height: image.height,
                pixels: image.pixels.iter().map(turn).collect(),
            })
        };
        let turned = match &self.textures[texture as usize] {
            Texture::Rgb8(image, Encoding::Linear) => {
                let mut image = image.clone();
                image.pixels.iter_mut().for_each(|[_, g, _]| *g = 255 - *g);
                Texture::Rgb8(image, Encoding::Linear)
            }
            Texture::Rgb8(image, Encoding::Srgb) => linear(&Image {
                width: image.width,
                height: image.height,
                pixels: image
                    .pixels
                    .iter()
                    .map(|c| Rgb::from(c.map(|c| crate::math::srgb_decode(f32::from(c) / 255.0))))
                    .collect(),
            }),
            Texture::Rgb32(image) => linear(image),
        };
        self.textures.push(turned);
        let turned = self.textures.len() as u32 - 1;
        self.turned_textures.insert(texture, turned);
        turned
    }
}
