//! Colours and numbers that may vary over a surface.

use crate::math::{Affine2, Rgb, Vec2};
use crate::texture::{Texture, TextureMap};

/// What a varying quantity is looked up by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Texture coordinates.
    pub uv: Vec2,
    /// Colour of the mesh, interpolated between its vertices; white where it has none.
    pub color: Rgb,
}

/// A colour that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Spectrum {
    /// The same everywhere.
    Constant(Rgb),
    /// From a bitmap, times a tint.
    Bitmap(TextureMap, Rgb),
    /// Two colours in turn.
    Checkerboard(Checkerboard),
    /// The vertex colours of the mesh, times a tint, times a bitmap if there is one.
    VertexColor(Option<TextureMap>, Rgb),
}

/// Two colours in turn: the first where the transformed texture coordinates are both in the first or both in the second
/// half of their period, the other one elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checkerboard {
    /// Texture coordinates to the pattern, whose period is 1.
    pub to_uv: Affine2,
    /// The colours.
    pub colors: [Rgb; 2],
}

impl Checkerboard {
    fn at(&self, uv: Vec2) -> Rgb {
        let uv = self.to_uv.transform_point2(uv);
        let is_first = |c: f32| c - c.floor() > 0.5;
        self.colors[usize::from(is_first(uv.x) != is_first(uv.y))]
    }
}

impl Spectrum {
    /// The colour at a point.
    #[inline(always)]
    pub fn at<const TEXTURES: bool>(&self, textures: &[Texture], point: impl Fn() -> SurfacePoint) -> Rgb {
        if !TEXTURES {
            // Without the feature the scene has no colour that varies: the branches are compiled out.
            return match self {
                Spectrum::Constant(rgb) => *rgb,
                _ => Rgb::BLACK,
            };
        }
        match self {
            Spectrum::Constant(rgb) => *rgb,
            Spectrum::Bitmap(map, tint) => map.lookup(textures, point().uv) * *tint,
            Spectrum::Checkerboard(pattern) => pattern.at(point().uv),
            Spectrum::VertexColor(map, tint) => {
                let point = point();
                let bitmap = map.as_ref().map_or(Rgb::WHITE, |map| map.lookup(textures, point.uv));
                point.color * *tint * bitmap
            }
        }
    }

    /// The bitmap, if there is one.
    pub fn texture(&self) -> Option<u32> {
        match self {
            Spectrum::Constant(_) | Spectrum::Checkerboard(_) | Spectrum::VertexColor(None, _) => None,
            Spectrum::Bitmap(map, _) | Spectrum::VertexColor(Some(map), _) => Some(map.texture),
        }
    }

    /// Whether it is not the same everywhere.
    pub fn varies(&self) -> bool {
        !matches!(self, Spectrum::Constant(_))
    }
}

/// Which number is taken of a colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// The mean of the three.
    Mean,
    /// Rec. 709 luminance.
    Luminance,
}

/// A number that may vary over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    /// The same everywhere.
    Constant(f32),
    /// A number of a colour.
    Varying(Spectrum, Channel),
}

impl Scalar {
    /// The number at a point.
    #[inline]
    pub fn at(&self, textures: &[Texture], point: impl Fn() -> SurfacePoint) -> f32 {
        match self {
            Scalar::Constant(value) => *value,
            Scalar::Varying(spectrum, channel) => {
                let rgb = spectrum.at::<true>(textures, point);
                match channel {
                    Channel::R => rgb.r,
                    Channel::G => rgb.g,
                    Channel::B => rgb.b,
                    Channel::Mean => (rgb.r + rgb.g + rgb.b) * (1.0 / 3.0),
                    Channel::Luminance => rgb.luminance(),
                }
            }
        }
    }

    /// The bitmap, if there is one.
    pub fn texture(&self) -> Option<u32> {
        match self {
            Scalar::Constant(_) => None,
            Scalar::Varying(spectrum, _) => spectrum.texture(),
        }
    }

    /// Whether it is not the same everywhere.
    pub fn varies(&self) -> bool {
        matches!(self, Scalar::Varying(spectrum, _) if spectrum.varies())
    }
}
