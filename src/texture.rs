//! Bitmap textures, decoded to linear before interpolation.

use crate::image::Image;
use crate::math::{Affine2, Rgb, Vec2, srgb_decode};
use prefetch_index::prefetch_index;
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

/// What lies beyond the edges of a bitmap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Wrap {
    /// The bitmap again.
    #[default]
    Repeat,
    /// Its mirror image.
    Mirror,
    /// The texels of the edge.
    Clamp,
}

/// What lies between texel centres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Filter {
    /// The bilinear mean of the four around.
    #[default]
    Bilinear,
    /// The nearest.
    Nearest,
}

/// Placement of a bitmap on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureMap {
    /// Index of the texture in the scene.
    pub texture: u32,
    /// Texture coordinates of the mesh to those of the bitmap.
    pub to_uv: Affine2,
    /// What lies beyond the edges, by column and row.
    pub wrap: [Wrap; 2],
    /// What lies between texels.
    pub filter: Filter,
}

impl TextureMap {
    /// The whole bitmap on each unit of the texture coordinates.
    pub fn new(texture: u32) -> TextureMap {
        TextureMap {
            texture,
            to_uv: Affine2::IDENTITY,
            wrap: [Wrap::Repeat; 2],
            filter: Filter::Bilinear,
        }
    }

    /// The colour at texture coordinates of the mesh.
    #[inline(always)]
    pub fn lookup(&self, textures: &[Texture], uv: Vec2) -> Rgb {
        let place = self.place(textures, uv);
        place.blend(&place.texels(textures))
    }

    /// Where texture coordinates of the mesh lie on the bitmap.
    #[inline(always)]
    pub fn place(&self, textures: &[Texture], uv: Vec2) -> TexturePlace {
        TexturePlace {
            texture: self.texture,
            footprint: self.footprint(&textures[self.texture as usize], uv),
        }
    }

    /// How much the mean of the channels grows along the two texture coordinates of the mesh, by the bilinear interpolant
    /// around them, whatever the filter.
    pub fn gradient(&self, textures: &[Texture], uv: Vec2) -> Vec2 {
        let texture = &textures[self.texture as usize];
        let footprint = self.footprint(texture, uv);
        let mean = |rgb: Rgb| (rgb.r + rgb.g + rgb.b) * (1.0 / 3.0);
        let [a, b, c, d] = texture.texels(footprint.indices).decode().map(mean);
        let (width, height) = texture.size();
        // Rows go down, v goes up.
        let columns = (b - a) * (1.0 - footprint.fy) + (d - c) * footprint.fy;
        let rows = (c - a) * (1.0 - footprint.fx) + (d - b) * footprint.fx;
        let by_bitmap = Vec2::new(columns * width as f32, -rows * height as f32);
        self.to_uv.matrix2.transpose() * by_bitmap
    }

    #[inline(always)]
    fn footprint(&self, texture: &Texture, uv: Vec2) -> Footprint {
        let (width, height) = texture.size();
        let mut footprint = Footprint::new(width, height, self.wrap, self.to_uv.transform_point2(uv));
        if self.filter == Filter::Nearest {
            footprint.fx = footprint.fx.round();
            footprint.fy = footprint.fy.round();
        }
        footprint
    }
}

static SRGB_TO_LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|i| srgb_decode(i as f32 / 255.0)));

/// A place on a bitmap: finding it takes arithmetic and reading its texels takes memory, and loops that do only one of the
/// two are faster.
#[derive(Clone, Copy, Debug)]
pub struct TexturePlace {
    texture: u32,
    footprint: Footprint,
}

/// The texels around a place, as they are stored.
#[derive(Clone, Copy, Debug)]
pub enum Texels {
    /// Three bytes each.
    Rgb8([[u8; 3]; 4], Encoding),
    /// Linear floating point.
    Rgb32([Rgb; 4]),
}

impl TexturePlace {
    /// Asks for the texels around it.
    #[inline(always)]
    pub fn prefetch(&self, textures: &[Texture]) {
        match &textures[self.texture as usize] {
            Texture::Rgb8(image, _) => self.footprint.indices.map(|i| prefetch_index(&image.pixels, i)),
            Texture::Rgb32(image) => self.footprint.indices.map(|i| prefetch_index(&image.pixels, i)),
        };
    }

    /// Reads the texels around it.
    #[inline(always)]
    pub fn texels(&self, textures: &[Texture]) -> Texels {
        textures[self.texture as usize].texels(self.footprint.indices)
    }

    /// The colour at the place, given the texels around it.
    #[inline(always)]
    pub fn blend(&self, texels: &Texels) -> Rgb {
        let [a, b, c, d] = texels.decode();
        let Footprint { fx, fy, .. } = self.footprint;
        a.lerp(b, fx).lerp(c.lerp(d, fx), fy)
    }
}

impl Texels {
    /// As linear colours.
    #[inline(always)]
    fn decode(&self) -> [Rgb; 4] {
        match self {
            Texels::Rgb8(texels, Encoding::Srgb) => {
                let decode = &*SRGB_TO_LINEAR;
                texels.map(|texel| Rgb::from(texel.map(|c| decode[usize::from(c)])))
            }
            Texels::Rgb8(texels, Encoding::Linear) => {
                texels.map(|texel| Rgb::from(texel.map(|c| f32::from(c) * (1.0 / 255.0))))
            }
            Texels::Rgb32(texels) => *texels,
        }
    }
}

/// The four texels around a texture coordinate: indices and the weights of the second column and row.
#[derive(Clone, Copy, Debug)]
struct Footprint {
    indices: [usize; 4],
    fx: f32,
    fy: f32,
}

impl Footprint {
    /// `v = 0` is the bottom edge of the image; texel centres lie at (i + 1/2) / n.
    #[inline(always)]
    fn new(width: u32, height: u32, [wrap_x, wrap_y]: [Wrap; 2], uv: Vec2) -> Footprint {
        let (x, x0, x1) = neighbours(wrap_x.period(uv.x), width, wrap_x);
        let (y, y0, y1) = neighbours(1.0 - wrap_y.period(uv.y), height, wrap_y);
        let row = width as usize;
        Footprint {
            indices: [y0 * row + x0, y0 * row + x1, y1 * row + x0, y1 * row + x1],
            fx: x,
            fy: y,
        }
    }
}

impl Wrap {
    /// The coordinate in [0, 1] that looks the same.
    #[inline(always)]
    fn period(self, c: f32) -> f32 {
        // Coordinates that are not finite look up the first texel: a defined value for a damaged mesh.
        if !c.is_finite() {
            return 0.0;
        }
        match self {
            Wrap::Repeat => c - c.floor(),
            Wrap::Mirror => {
                let c = c * 0.5 - (c * 0.5).floor();
                1.0 - (2.0 * c - 1.0).abs()
            }
            Wrap::Clamp => c.clamp(0.0, 1.0),
        }
    }
}

/// The fraction and the two texels that surround the coordinate `c` in [0, 1].
#[inline(always)]
fn neighbours(c: f32, n: u32, wrap: Wrap) -> (f32, usize, usize) {
    let position = c * n as f32 - 0.5;
    let low = position.floor();
    // From -1 to n - 1: comparisons are a tenth of the time of a division with remainder.
    let i = low as i32;
    let n = n as i32;
    let (before, after) = match wrap {
        Wrap::Repeat => (n - 1, 0),
        Wrap::Mirror | Wrap::Clamp => (0, n - 1),
    };
    let first = if i < 0 { before } else { i.min(n - 1) };
    let second = if i + 1 >= n { after } else { i + 1 };
    (position - low, first as usize, second as usize)
}

impl Texture {
    /// Columns and rows.
    #[inline(always)]
    pub fn size(&self) -> (u32, u32) {
        match self {
            Texture::Rgb8(image, _) => (image.width, image.height),
            Texture::Rgb32(image) => (image.width, image.height),
        }
    }

    #[inline(always)]
    fn texels(&self, indices: [usize; 4]) -> Texels {
        match self {
            Texture::Rgb8(image, encoding) => Texels::Rgb8(indices.map(|i| image.pixels[i]), *encoding),
            Texture::Rgb32(image) => Texels::Rgb32(indices.map(|i| image.pixels[i])),
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
        let texture = [two_by_two()];
        assert_eq!(
            TextureMap::new(0).lookup(&texture, Vec2::new(0.25, 0.25)),
            Rgb::new(0.0, 1.0, 0.0)
        );
        assert_eq!(
            TextureMap::new(0).lookup(&texture, Vec2::new(0.75, 0.75)),
            Rgb::new(1.0, 0.0, 0.0)
        );
    }

    #[test]
    fn lookups_repeat_and_blend_across_the_border() {
        let texture = [two_by_two()];
        let a = TextureMap::new(0).lookup(&texture, Vec2::new(0.0, 0.25));
        assert!((a.r - 0.5).abs() < 1e-6 && (a.g - 1.0).abs() < 1e-6, "{a:?}");
        let far = TextureMap::new(0).lookup(&texture, Vec2::new(-3.0, 5.25));
        assert!((far.r - a.r).abs() < 1e-5 && (far.g - a.g).abs() < 1e-5);
        assert!(
            TextureMap::new(0)
                .lookup(&texture, Vec2::new(f32::NAN, f32::INFINITY))
                .is_finite()
        );
    }

    #[test]
    fn srgb_texels_are_decoded_before_they_are_blended() {
        let texture = [Texture::Rgb8(
            Image {
                width: 2,
                height: 1,
                pixels: vec![[0; 3], [255; 3]],
            },
            Encoding::Srgb,
        )];
        assert!((TextureMap::new(0).lookup(&texture, Vec2::new(0.5, 0.5)).r - 0.5).abs() < 1e-6);
    }

    #[test]
    fn beyond_the_edges_lie_the_bitmap_its_mirror_image_or_its_edge() {
        let texture = [two_by_two()];
        let at = |wrap: Wrap, u: f32| {
            let map = TextureMap {
                wrap: [wrap, Wrap::Repeat],
                filter: Filter::Nearest,
                ..TextureMap::new(0)
            };
            map.lookup(&texture, Vec2::new(u, 0.25)).r
        };
        // The bottom row: green, white.
        for (u, repeat, mirror, clamp) in [
            (-0.3, 1.0, 0.0, 0.0),
            (-0.7, 0.0, 1.0, 0.0),
            (1.3, 0.0, 1.0, 1.0),
            (1.7, 1.0, 0.0, 1.0),
            (0.3, 0.0, 0.0, 0.0),
        ] {
            assert_eq!(at(Wrap::Repeat, u), repeat, "{u}");
            assert_eq!(at(Wrap::Mirror, u), mirror, "{u}");
            assert_eq!(at(Wrap::Clamp, u), clamp, "{u}");
        }
    }

    #[test]
    fn the_nearest_texel_fills_its_square() {
        let texture = [two_by_two()];
        let map = TextureMap {
            filter: Filter::Nearest,
            ..TextureMap::new(0)
        };
        for u in [0.51, 0.6, 0.75, 0.9, 0.99] {
            for v in [0.01, 0.25, 0.49] {
                assert_eq!(map.lookup(&texture, Vec2::new(u, v)), Rgb::WHITE, "({u}, {v})");
            }
        }
    }

    #[test]
    fn the_gradient_is_the_slope_of_lookups_between() {
        let texture = [two_by_two()];
        let map = TextureMap {
            to_uv: Affine2::from_scale_angle_translation(Vec2::new(0.5, 0.25), 0.4, Vec2::new(0.1, 0.2)),
            ..TextureMap::new(0)
        };
        for (u, v) in [(0.3, 0.4), (1.1, 0.2), (-0.6, 2.3)] {
            let mean = |u: f32, v: f32| {
                let rgb = map.lookup(&texture, Vec2::new(u, v));
                (rgb.r + rgb.g + rgb.b) / 3.0
            };
            const STEP: f32 = 1e-2;
            let slope = Vec2::new(
                mean(u + STEP, v) - mean(u - STEP, v),
                mean(u, v + STEP) - mean(u, v - STEP),
            ) / (2.0 * STEP);
            let gradient = map.gradient(&texture, Vec2::new(u, v));
            assert!(
                (slope - gradient).length() < 0.02,
                "{slope} for {gradient} at ({u}, {v})"
            );
        }
    }
}
