//! Bitmaps of materials, each read once.

use super::input::read_file;
use super::load::LoadError;
use crate::image::ldr::LdrImage;
use crate::image::{self, Decoded, Image};
use crate::math::{Rgb, srgb_decode};
use crate::texture::{Encoding, Texture};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// What a bitmap is for, which decides how its numbers are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Role {
    /// Reflectance; the encoding as given.
    Colour(Option<Encoding>),
    /// How much of a surface is there: the alpha channel if there is one, else the colour, linear.
    Coverage,
}

/// The bitmaps wanted, each once.
#[derive(Default)]
pub(super) struct Bitmaps {
    pub(super) wanted: Vec<(PathBuf, Role)>,
    index: HashMap<(PathBuf, Role), usize>,
}

impl Bitmaps {
    /// The number of a bitmap, whether it has been asked for or not.
    pub(super) fn want(&mut self, path: PathBuf, role: Role) -> usize {
        *self.index.entry((path.clone(), role)).or_insert_with(|| {
            self.wanted.push((path, role));
            self.wanted.len() - 1
        })
    }
}

/// Decodes a bitmap; with the hash over its file.
pub(super) fn load_texture(path: &Path, role: Role) -> Result<(Texture, blake3::Hash), LoadError> {
    let bytes = read_file(path)?;
    let hash = blake3::hash(&bytes);
    let texture = match (image::read(path, &bytes)?, role) {
        (Decoded::Linear(image), _) => Texture::Rgb32(sanitise_reflectance(image)),
        (Decoded::Encoded(LdrImage::Bits8 { alpha: Some(alpha), .. }), Role::Coverage) => {
            Texture::Rgb8(map_pixels(alpha, |a| [a; 3]), Encoding::Linear)
        }
        (Decoded::Encoded(LdrImage::Bits8 { rgb, .. }), Role::Coverage) => Texture::Rgb8(rgb, Encoding::Linear),
        (Decoded::Encoded(LdrImage::Bits8 { rgb, .. }), Role::Colour(encoding)) => {
            Texture::Rgb8(rgb, encoding.unwrap_or(Encoding::Srgb))
        }
        (Decoded::Encoded(LdrImage::Bits16 { alpha: Some(alpha), .. }), Role::Coverage) => {
            Texture::Rgb32(map_pixels(alpha, Rgb::splat))
        }
        (Decoded::Encoded(LdrImage::Bits16 { rgb, .. }), role) => {
            // Sixteen bits are linear unless the scene says otherwise: the default of sRGB is for eight.
            let srgb = role == Role::Colour(Some(Encoding::Srgb));
            Texture::Rgb32(map_pixels(rgb, |c| {
                Rgb::from(if srgb { c.map(srgb_decode) } else { c })
            }))
        }
    };
    Ok((texture, hash))
}

fn map_pixels<T, U>(image: Image<T>, f: impl Fn(T) -> U) -> Image<U> {
    Image {
        width: image.width,
        height: image.height,
        pixels: image.pixels.into_iter().map(f).collect(),
    }
}

/// Reflectance from a file of unlimited range: NaN and negative become 0, what exceeds 1 becomes 1.
fn sanitise_reflectance(image: Image<Rgb>) -> Image<Rgb> {
    map_pixels(image, |rgb| {
        rgb.map(|c| if c.is_nan() { 0.0 } else { c.clamp(0.0, 1.0) })
    })
}
