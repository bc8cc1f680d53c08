//! Colours and numbers of materials and lights: constants, bitmaps, checkerboards, mesh attributes.

use super::super::bitmap::{Role, load_texture};
use super::super::load::LoadError;
use super::Importer;
use super::document::{Property, Tag, Value};
use super::props::Props;
use super::spectrum::SpectrumValue;
use super::transform;
use crate::image::Image;
use crate::material::{Channel, Checkerboard, Scalar, Spectrum};
use crate::math::{Affine2, DVec3, Rgb, Vec2};
use crate::texture::{Encoding, Filter, Texture, TextureMap, Wrap};

/// What a colour is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// A share of light, in [0, 1].
    Reflectance,
    /// A number without a limit, such as an index of refraction.
    Unbounded,
    /// Emitted light.
    Emission,
}

/// How the colours of a texture are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Color(Use),
    /// Its luminance.
    Number,
}

impl Importer<'_> {
    /// A parameter that is a colour.
    pub(super) fn color(
        &mut self,
        props: &mut Props,
        name: &'static str,
        default: f64,
        used_as: Use,
    ) -> Result<Spectrum, LoadError> {
        match props.take(name) {
            None => Ok(Spectrum::Constant(Rgb::splat(default as f32))),
            Some(property) => self.color_of(props, property, used_as),
        }
    }

    /// A parameter that is a colour and the same everywhere.
    pub(super) fn constant(
        &mut self,
        props: &mut Props,
        name: &'static str,
        default: f64,
        used_as: Use,
    ) -> Result<Rgb, LoadError> {
        let Some(property) = props.take(name) else {
            return Ok(Rgb::splat(default as f32));
        };
        match self.color_of(props, property, used_as)? {
            Spectrum::Constant(rgb) => Ok(rgb),
            _ => Err(props.error_at(
                property,
                "varies over the surface; expected <rgb>, <float> or <spectrum>",
            )),
        }
    }

    fn color_of(&mut self, props: &Props, property: &Property, used_as: Use) -> Result<Spectrum, LoadError> {
        match &property.value {
            Value::Object(node) => self.texture(*node, Part::Color(used_as)),
            value => match plain_color(value, used_as) {
                Some(rgb) => Ok(Spectrum::Constant(checked(props, property, rgb, used_as)?)),
                None => Err(props.error_at(
                    property,
                    "is no colour; expected <rgb>, <float>, <spectrum> or <texture>",
                )),
            },
        }
    }

    /// A parameter that is a number.
    pub(super) fn number(&mut self, props: &mut Props, name: &'static str, default: f64) -> Result<Scalar, LoadError> {
        let Some(property) = props.take(name) else {
            return Ok(Scalar::Constant(default as f32));
        };
        let spectrum = match &property.value {
            Value::Object(node) => self.texture(*node, Part::Number)?,
            value => match plain_color(value, Use::Unbounded).map(luminance) {
                Some(number) if (0.0..=1.0).contains(&number) => Spectrum::Constant(Rgb::splat(number as f32)),
                Some(number) => return Err(props.error_at(property, format!("is {number}; expected 0 to 1"))),
                None => return Err(props.error_at(property, "is no number; expected <float> or <texture>")),
            },
        };
        Ok(match spectrum {
            Spectrum::Constant(rgb) => Scalar::Constant(rgb.r),
            varying => Scalar::Varying(varying, Channel::R),
        })
    }

    /// A parameter that is a number, for what takes the mean of the channels of a colour.
    pub(super) fn grey(&mut self, props: &mut Props, name: &'static str, default: f64) -> Result<Spectrum, LoadError> {
        Ok(match self.number(props, name, default)? {
            Scalar::Constant(value) => Spectrum::Constant(Rgb::splat(value)),
            Scalar::Varying(spectrum, _) => spectrum,
        })
    }

    fn texture(&mut self, node: usize, part: Part) -> Result<Spectrum, LoadError> {
        let mut props = Props::new(self.document, node);
        let used_as = match part {
            Part::Color(used_as) => used_as,
            Part::Number => Use::Reflectance,
        };
        let constant = |rgb: Rgb| {
            Spectrum::Constant(match part {
                Part::Color(_) => rgb,
                Part::Number => Rgb::splat(rgb.luminance()),
            })
        };
        if props.node.tag != Tag::Texture {
            return Err(props.error("is no texture; expected <texture>"));
        }
        let spectrum = match props.node.plugin.as_str() {
            "bitmap" => {
                let role = |encoding| match part {
                    Part::Number => Role::Luminance(encoding),
                    Part::Color(Use::Emission) => Role::Radiance(Some(encoding)),
                    Part::Color(_) => Role::Colour(Some(encoding)),
                };
                Spectrum::Bitmap(self.bitmap(&mut props, role)?, Rgb::WHITE)
            }
            "checkerboard" => {
                let first = constant(self.constant(&mut props, "color0", 0.4, used_as)?);
                let second = constant(self.constant(&mut props, "color1", 0.2, used_as)?);
                let to_uv = to_uv(&mut props)?;
                let (Spectrum::Constant(first), Spectrum::Constant(second)) = (first, second) else {
                    return Err(props.error("has colours that vary"));
                };
                Spectrum::Checkerboard(Checkerboard {
                    to_uv,
                    // Where it asks for a number, Mitsuba exchanges the two.
                    colors: match part {
                        Part::Color(_) => [first, second],
                        Part::Number => [second, first],
                    },
                })
            }
            "mesh_attribute" => {
                let name = props.string("name")?.unwrap_or_default();
                if !["vertex_", "face_"].iter().any(|start| name.starts_with(start)) {
                    return Err(props.error(format!(
                        "the name \"{name}\" begins neither with vertex_ nor with face_"
                    )));
                }
                let most = if used_as == Use::Emission { 1e30 } else { 1.0 };
                let scale = props.float_in("scale", 1.0, 0.0..=most)?;
                Spectrum::VertexColor(None, Rgb::splat(scale as f32))
            }
            "srgb" => constant(self.constant(&mut props, "color", 1.0, used_as)?),
            "uniform" => constant(self.constant(&mut props, "value", 1.0, Use::Unbounded)?),
            "rawconstant" => constant(to_rgb(raw(&mut props)?)),
            _ => {
                return Err(props.error(
                    "is not supported; supported textures: bitmap, checkerboard, mesh_attribute, srgb, uniform, rawconstant",
                ));
            }
        };
        props.finish()?;
        Ok(spectrum)
    }

    /// A texture of vectors: the map of a normal map.
    pub(super) fn vectors(&mut self, node: usize) -> Result<TextureMap, LoadError> {
        let mut props = Props::new(self.document, node);
        let map = match props.node.plugin.as_str() {
            "bitmap" => self.bitmap(&mut props, |encoding| Role::Colour(Some(encoding)))?,
            "rawconstant" => {
                let value = to_rgb(raw(&mut props)?.clamp(DVec3::ZERO, DVec3::ONE));
                self.textures.push(Texture::Rgb32(Image::filled(1, 1, value)));
                TextureMap::new(self.textures.len() as u32 - 1)
            }
            _ => return Err(props.error("is not supported here; supported textures: bitmap, rawconstant")),
        };
        props.finish()?;
        Ok(map)
    }

    /// A texture of heights: the map of a bump map.
    pub(super) fn heights(&mut self, node: usize) -> Result<TextureMap, LoadError> {
        match self.texture(node, Part::Number)? {
            Spectrum::Bitmap(map, _) => Ok(map),
            _ => Err(Props::new(self.document, node).error("is not supported here; supported textures: bitmap")),
        }
    }

    fn bitmap(&mut self, props: &mut Props, role: impl Fn(Encoding) -> Role) -> Result<TextureMap, LoadError> {
        let filename = props.string("filename")?;
        let filename = filename.ok_or_else(|| props.error("has no <string name=\"filename\">"))?;
        let encoding = if props.boolean("raw", false)? {
            Encoding::Linear
        } else {
            Encoding::Srgb
        };
        let filters = [("bilinear", Filter::Bilinear), ("nearest", Filter::Nearest)];
        let wraps = [
            ("repeat", Wrap::Repeat),
            ("mirror", Wrap::Mirror),
            ("clamp", Wrap::Clamp),
        ];
        let filter = props.word("filter_type", &filters, Filter::Bilinear)?;
        let wrap = props.word("wrap_mode", &wraps, Wrap::Repeat)?;
        let to_uv = to_uv(props)?;
        // How it is stored.
        props.ignore(&["format", "accel"]);
        let path = self.document.file(filename);
        let key = (path, role(encoding));
        let texture = match self.bitmaps.get(&key) {
            Some(&texture) => texture,
            None => {
                let (texture, hash) = load_texture(&key.0, key.1)?;
                self.hasher.update(hash.as_bytes());
                self.textures.push(texture);
                self.bitmaps.insert(key, self.textures.len() as u32 - 1);
                self.textures.len() as u32 - 1
            }
        };
        // Here, v = 0 is the top row.
        let upside_down = Affine2::from_cols(Vec2::X, Vec2::NEG_Y, Vec2::Y);
        Ok(TextureMap {
            to_uv: upside_down * to_uv,
            wrap: [wrap; 2],
            filter,
            ..TextureMap::new(texture)
        })
    }
}

fn to_uv(props: &mut Props) -> Result<Affine2, LoadError> {
    let to_uv = props
        .matrix("to_uv")?
        .map_or(Affine2::IDENTITY, |m| transform::of_uv(&m));
    if to_uv.is_finite() {
        Ok(to_uv)
    } else {
        Err(props.error("has a to_uv beyond 32-bit numbers"))
    }
}

/// The parameter of a constant that is not touched: a number or a vector.
fn raw(props: &mut Props) -> Result<DVec3, LoadError> {
    match props.take("value").map(|property| &property.value) {
        Some(Value::Float(f)) => Ok(DVec3::splat(*f)),
        Some(Value::Integer(i)) => Ok(DVec3::splat(*i as f64)),
        Some(Value::Vector(v)) => Ok(*v),
        _ => Err(props.error("has no parameter \"value\" that is a number or a vector")),
    }
}

/// A value that is a colour by itself.
fn plain_color(value: &Value, used_as: Use) -> Option<DVec3> {
    match value {
        Value::Float(f) => Some(DVec3::splat(*f)),
        Value::Integer(i) => Some(DVec3::splat(*i as f64)),
        Value::Rgb(rgb) => Some(*rgb),
        Value::Spectrum(spectrum) if used_as == Use::Emission => Some(spectrum.emission().max(DVec3::ZERO)),
        Value::Spectrum(spectrum) => Some(match (spectrum, used_as) {
            // The integral of what reflects 1 exceeds it by rounding.
            (SpectrumValue::Samples(_), Use::Reflectance) => spectrum.surface().clamp(DVec3::ZERO, DVec3::ONE),
            (SpectrumValue::Samples(_), _) => spectrum.surface().max(DVec3::ZERO),
            (SpectrumValue::Uniform(_), _) => spectrum.surface(),
        }),
        _ => None,
    }
}

fn checked(props: &Props, property: &Property, rgb: DVec3, used_as: Use) -> Result<Rgb, LoadError> {
    let is_share = used_as == Use::Reflectance;
    if rgb.min_element() < 0.0 || is_share && rgb.max_element() > 1.0 {
        let range = if is_share { "in [0, 1]" } else { "0 or more" };
        return Err(props.error_at(
            property,
            format!("is {:?}; expected components {range}", rgb.to_array()),
        ));
    }
    Ok(to_rgb(rgb.min(DVec3::splat(1e30))))
}

fn to_rgb(rgb: DVec3) -> Rgb {
    Rgb::from(rgb.as_vec3().to_array())
}

fn luminance(rgb: DVec3) -> f64 {
    rgb.dot(DVec3::new(0.212671, 0.715160, 0.072169))
}
