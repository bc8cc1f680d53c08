//! Bitmap textures: bilinear, repeating, decoded to linear before interpolation.

use crate::image::Image;
use crate::math::{Rgb, Vec2, srgb_decode};
use std::sync::LazyLock;

/// How the numbers of an 8-bit image stand for light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// The sRGB transfer function.
    Srgb,
    /// Proportional.
    Linear,
}

/// A colour bitmap. Eight-bit images stay eight-bit in memory.
#[derive(Clone, Debug, PartialEq)]
pub enum Texture {
    /// Three bytes a texel.
    Rgb8(Image<[u8; 3]>, Encoding),
    /// Linear floating point.
    Rgb32(Image<Rgb>),
}

/// Placement of a bitmap on the surface: texture coordinates are scaled, then shifted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureMap {
    /// Index of the texture in the scene.
    pub texture: u32,
    /// Repeats per unit of the texture coordinates.
    pub scale: Vec2,
    /// Shift after scaling.
    pub offset: Vec2,
}

static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb_decode(i as f32 / 255.0)));

/// The four texels around a texture coordinate: indices and the weights of the second column and row.
struct Footprint {
    indices: [usize; 4],
    fx: f32,
    fy: f32,
}

impl Footprint {
    /// `uv` repeats with period 1; `v = 0` is the bottom edge of the image; texel centres lie at (i + 1/2) / n.
    #[inline(always)]
    fn new(width: u32, height: u32, uv: Vec2) -> Footprint {
        // Coordinates that are not finite look up the first texel: a defined value for a damaged mesh.
        let wrap = |c: f32| if c.is_finite() { c - c.floor() } else { 0.0 };
        let (x, x0, x1) = neighbours(wrap(uv.x), width);
        let (y, y0, y1) = neighbours(1.0 - wrap(uv.y), height);
        let row = width as usize;
        Footprint {
            indices: [y0 * row + x0, y0 * row + x1, y1 * row + x0, y1 * row + x1],
            fx: x,
            fy: y,
        }
    }

    #[inline(always)]
    fn blend(&self, texel: impl Fn(usize) -> Rgb) -> Rgb {
        let [a, b, c, d] = self.indices.map(texel);
        a.lerp(b, self.fx).lerp(c.lerp(d, self.fx), self.fy)
    }
}

/// The fraction and the two texels, wrapping, that surround the coordinate `c` in [0, 1].
#[inline(always)]
fn neighbours(c: f32, n: u32) -> (f32, usize, usize) {
    let position = c * n as f32 - 0.5;
    let low = position.floor();
    // From -1 to n - 1: comparisons are a tenth of the time of a division with remainder.
    let i = low as i32;
    let n = n as i32;
    let first = if i < 0 { n - 1 } else { i.min(n - 1) };
    let second = if first + 1 == n { 0 } else { first + 1 };
    (position - low, first as usize, second as usize)
}

impl Texture {
    /// The colour at a texture coordinate.
    #[inline(always)]
    pub fn lookup(&self, uv: Vec2) -> Rgb {
        match self {
            Texture::Rgb8(image, encoding) => {
                let footprint = Footprint::new(image.width, image.height, uv);
                match encoding {
                    Encoding::Srgb => {
                        let decode = &*SRGB_TO_LINEAR;
                        footprint.blend(|i| Rgb::from(image.pixels[i].map(|c| decode[usize::from(c)])))
                    }
                    Encoding::Linear => {
                        footprint.blend(|i| Rgb::from(image.pixels[i].map(|c| f32::from(c) * (1.0 / 255.0))))
                    }
                }
            }
            Texture::Rgb32(image) => Footprint::new(image.width, image.height, uv).blend(|i| image.pixels[i]),
        }
    }

    /// Bytes of the texels.
    pub fn memory_bytes(&self) -> usize {
        match self {
            Texture::Rgb8(image, _) => size_of_val(&*image.pixels),
            Texture::Rgb32(image) => size_of_val(&*image.pixels),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_by_two() -> Texture {
        // Top row black, red; bottom row green, white.
        Texture::Rgb8(
            Image {
                width: 2,
                height: 2,
                pixels: vec![[0, 0, 0], [255, 0, 0], [0, 255, 0], [255, 255, 255]],
            },
            Encoding::Linear,
        )
    }

    #[test]
    fn v_zero_is_the_bottom_row_and_texel_centres_are_exact() {
        let texture = two_by_two();
        assert_eq!(texture.lookup(Vec2::new(0.25, 0.25)), Rgb::new(0.0, 1.0, 0.0));
        assert_eq!(texture.lookup(Vec2::new(0.75, 0.75)), Rgb::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn lookups_repeat_and_blend_across_the_border() {
        let texture = two_by_two();
        let a = texture.lookup(Vec2::new(0.0, 0.25));
        assert!((a.r - 0.5).abs() < 1e-6 && (a.g - 1.0).abs() < 1e-6, "{a:?}");
        let far = texture.lookup(Vec2::new(-3.0, 5.25));
        assert!((far.r - a.r).abs() < 1e-5 && (far.g - a.g).abs() < 1e-5);
        assert!(texture.lookup(Vec2::new(f32::NAN, f32::INFINITY)).is_finite());
    }

    #[test]
    fn srgb_texels_are_decoded_before_they_are_blended() {
        let texture = Texture::Rgb8(
            Image {
                width: 2,
                height: 1,
                pixels: vec![[0; 3], [255; 3]],
            },
            Encoding::Srgb,
        );
        assert!((texture.lookup(Vec2::new(0.5, 0.5)).r - 0.5).abs() < 1e-6);
    }
}
