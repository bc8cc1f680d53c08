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
    /// Factors on emission, which may exceed 1; the encoding as given.
    Radiance(Option<Encoding>),
    /// Heights of any sign and size, linear unless stated.
    Height(Option<Encoding>),
    /// The alpha channel, 1 everywhere if there is none. With a threshold it becomes 1 from there on, and 0 below.
    Alpha(Option<Threshold>),
    /// A number: the luminance of reflectance.
    Luminance(Encoding),
}

impl Role {
    fn encoding(self) -> Option<Encoding> {
        match self {
            Role::Colour(encoding) | Role::Radiance(encoding) => encoding,
            Role::Luminance(encoding) => Some(encoding),
            Role::Height(encoding) => encoding.or(Some(Encoding::Linear)),
            Role::Coverage | Role::Alpha(_) => None,
        }
    }
}

/// A number that can be told from others, in a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Threshold(u32);

impl Threshold {
    pub(super) fn new(value: f32) -> Threshold {
        Threshold(value.to_bits())
    }

    fn get(self) -> f32 {
        f32::from_bits(self.0)
    }
}

/// The bitmaps wanted, each once.
#[derive(Debug, Default)]
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
    Ok((decode_texture(path, &bytes, role)?, blake3::hash(&bytes)))
}

/// Decodes a bitmap that is in memory. `path` is for messages, and for formats that are told by the name.
pub(super) fn decode_texture(path: &Path, bytes: &[u8], role: Role) -> Result<Texture, LoadError> {
    let texture = match (image::read(path, bytes)?, role) {
        (Decoded::Linear(_), Role::Alpha(threshold)) => without_alpha(threshold),
        (Decoded::Linear(image), role) => Texture::Rgb32(sanitise(image, role)),
        (Decoded::Encoded(LdrImage::Bits8 { alpha: Some(alpha), .. }), Role::Alpha(threshold)) => {
            let texel = |a| threshold.map_or(a, |least| step(f32::from(a) / 255.0, least));
            Texture::Rgb8(map_pixels(alpha, |a| [texel(a); 3]), Encoding::Linear)
        }
        (Decoded::Encoded(LdrImage::Bits8 { .. }), Role::Alpha(threshold)) => without_alpha(threshold),
        (Decoded::Encoded(LdrImage::Bits8 { alpha: Some(alpha), .. }), Role::Coverage) => {
            Texture::Rgb8(map_pixels(alpha, |a| [a; 3]), Encoding::Linear)
        }
        (Decoded::Encoded(LdrImage::Bits8 { rgb, .. }), Role::Coverage) => Texture::Rgb8(rgb, Encoding::Linear),
        (Decoded::Encoded(LdrImage::Bits8 { rgb, .. }), role) => {
            Texture::Rgb8(rgb, role.encoding().unwrap_or(Encoding::Srgb))
        }
        (Decoded::Encoded(LdrImage::Bits16 { alpha: Some(alpha), .. }), Role::Coverage | Role::Alpha(None)) => {
            Texture::Rgb32(map_pixels(alpha, Rgb::splat))
        }
        (Decoded::Encoded(LdrImage::Bits16 { alpha: Some(alpha), .. }), Role::Alpha(Some(least))) => {
            Texture::Rgb8(map_pixels(alpha, |a| [step(a, least); 3]), Encoding::Linear)
        }
        (Decoded::Encoded(LdrImage::Bits16 { .. }), Role::Alpha(threshold)) => without_alpha(threshold),
        (Decoded::Encoded(LdrImage::Bits16 { rgb, .. }), role) => {
            // Sixteen bits are linear unless the scene says otherwise: the default of sRGB is for eight.
            let srgb = role.encoding() == Some(Encoding::Srgb);
            Texture::Rgb32(map_pixels(rgb, |c| {
                Rgb::from(if srgb { c.map(srgb_decode) } else { c })
            }))
        }
    };
    Ok(match role {
        Role::Luminance(_) => luminance(texture),
        _ => texture,
    })
}

fn step(alpha: f32, least: Threshold) -> u8 {
    if alpha >= least.get() { u8::MAX } else { 0 }
}

/// One texel is all that an image without alpha has to say of it.
fn without_alpha(threshold: Option<Threshold>) -> Texture {
    let texel = threshold.map_or(u8::MAX, |least| step(1.0, least));
    Texture::Rgb8(Image::filled(1, 1, [texel; 3]), Encoding::Linear)
}

/// The luminance in all channels. What is grey stays as it is.
fn luminance(texture: Texture) -> Texture {
    let to_grey = |rgb: Rgb| Rgb::splat(rgb.luminance());
    match texture {
        Texture::Rgb8(image, encoding) if image.pixels.iter().any(|[r, g, b]| r != g || g != b) => {
            let linear = |c: [u8; 3]| {
                let c = c.map(|c| f32::from(c) / 255.0);
                Rgb::from(if encoding == Encoding::Srgb {
                    c.map(srgb_decode)
                } else {
                    c
                })
            };
            Texture::Rgb32(map_pixels(image, |c| to_grey(linear(c))))
        }
        Texture::Rgb8(image, encoding) => Texture::Rgb8(image, encoding),
        Texture::Rgb32(image) => Texture::Rgb32(map_pixels(image, to_grey)),
    }
}

fn map_pixels<T, U>(image: Image<T>, f: impl Fn(T) -> U) -> Image<U> {
    Image {
        width: image.width,
        height: image.height,
        pixels: image.pixels.into_iter().map(f).collect(),
    }
}

/// Numbers from a file of unlimited range: NaN becomes 0, and what is beyond the range of the role its end.
fn sanitise(image: Image<Rgb>, role: Role) -> Image<Rgb> {
    let (low, high) = match role {
        Role::Colour(_) | Role::Luminance(_) | Role::Coverage | Role::Alpha(_) => (0.0, 1.0),
        Role::Radiance(_) => (0.0, 1e30),
        Role::Height(_) => (-1e18, 1e18),
    };
    map_pixels(image, |rgb| {
        rgb.map(|c| if c.is_nan() { 0.0 } else { c.clamp(low, high) })
    })
}
