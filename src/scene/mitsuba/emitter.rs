//! Lights that are no surface, and the environment.

use super::super::desc::{EnvironmentDesc, Falloff, LightDesc, SlideDesc};
use super::super::environment::sanitise_radiance;
use super::super::input::read_file;
use super::super::load::LoadError;
use super::Importer;
use super::props::Props;
use super::texture::Use;
use crate::image::ldr::LdrImage;
use crate::image::{self, Decoded, Image};
use crate::light::Emission;
use crate::material::Spectrum;
use crate::math::{DAffine3, DMat3, DVec3, Rgb, srgb_decode};
use std::path::Path;
use std::sync::Arc;

const SUPPORTED: &str = "area (within a shape), constant, envmap, point, spot, directional";

/// Rows of an environment map up to which it is read with more of them.
const FINE_ROWS: u32 = 2048;

impl Importer<'_> {
    /// An emitter of the scene itself.
    pub(super) fn emitter(&mut self, node: usize) -> Result<(), LoadError> {
        let mut props = Props::new(self.document, node);
        // How often it is sampled changes noise alone.
        props.ignore(&["sampling_weight"]);
        match props.node.plugin.as_str() {
            "constant" => {
                let radiance = self.constant(&mut props, "radiance", 1.0, Use::Emission)?;
                props.ignore(&["to_world"]);
                self.set_environment(&props, EnvironmentDesc::Constant(radiance))?;
            }
            "envmap" => {
                let environment = self.environment_map(&mut props)?;
                self.set_environment(&props, environment)?;
            }
            "point" => {
                let intensity = self.constant(&mut props, "intensity", 1.0, Use::Emission)?;
                let to_world = props.take_to_world()?;
                let position = props.vector("position")?.unwrap_or(to_world.translation);
                self.lights.push(LightDesc::Point { position, intensity });
            }
            "spot" => {
                let intensity = self.constant(&mut props, "intensity", 1.0, Use::Emission)?;
                let cutoff = props.float_in("cutoff_angle", 20.0, 1e-3..=180.0)?;
                let beam = props.float_in("beam_width", cutoff * 0.75, 0.0..)?;
                let to_world = props.take_to_world()?;
                let (factor, slide) = self.slide(&mut props, &to_world, cutoff)?;
                self.lights.push(LightDesc::Spot {
                    slide,
                    position: to_world.translation,
                    direction: to_world.matrix3.z_axis,
                    intensity: intensity * factor,
                    // A beam as wide as the cone ends at once.
                    angles: [beam.min(cutoff * (1.0 - 1e-6)).to_radians(), cutoff.to_radians()],
                    falloff: Falloff::Angle,
                });
            }
            "directional" => {
                let irradiance = self.constant(&mut props, "irradiance", 1.0, Use::Emission)?;
                let to_world = props.take_to_world()?;
                let direction = props.vector("direction")?.unwrap_or(to_world.matrix3.z_axis);
                if direction.try_normalize().is_none() {
                    return Err(props.error("has a direction without length"));
                }
                self.lights.push(LightDesc::Distant {
                    direction,
                    irradiance,
                    radius: 0.0,
                });
            }
            "area" => return Err(props.error("stands outside of a shape; put it into the shape that emits")),
            _ => return Err(props.error(format!("is not supported; supported emitters: {SUPPORTED}"))),
        }
        props.finish()
    }

    /// The emitter of a shape: emission, and what it is multiplied by over the surface.
    pub(super) fn area(&mut self, node: usize) -> Result<(Emission, Option<Spectrum>), LoadError> {
        let mut props = Props::new(self.document, node);
        props.ignore(&["sampling_weight"]);
        if props.node.plugin != "area" {
            let problem = "is not supported within a shape; supported: area";
            return Err(props.error(problem));
        }
        let (radiance, map) = match self.color(&mut props, "radiance", 1.0, Use::Emission)? {
            Spectrum::Constant(radiance) => (radiance, None),
            varying => (Rgb::WHITE, Some(varying)),
        };
        props.finish()?;
        let emission = Emission {
            radiance,
            both_sides: false,
        };
        Ok((emission, map))
    }

    /// The texture of a spot: a factor if it is the same everywhere, else what it casts.
    fn slide(
        &mut self,
        props: &mut Props,
        to_world: &DAffine3,
        cutoff: f64,
    ) -> Result<(Rgb, Option<SlideDesc>), LoadError> {
        let factor = match self.color(props, "texture", 1.0, Use::Emission)? {
            Spectrum::Constant(factor) => return Ok((factor, None)),
            Spectrum::VertexColor(..) => return Err(props.error("has a mesh attribute for a texture, and no mesh")),
            factor @ (Spectrum::Bitmap(..) | Spectrum::Checkerboard(_)) => factor,
        };
        if cutoff >= 90.0 {
            return Err(props.error("has a texture, and a cutoff_angle that is not below 90 degrees"));
        }
        let axes = to_world.matrix3;
        let is_square = |a: DVec3, b: DVec3| (a.dot(b)).abs() < 1e-3 && (a.length() - b.length()).abs() < 1e-3;
        let [x, y, z] = [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis / axes.z_axis.length());
        if !(is_square(x, y) && is_square(y, z) && is_square(z, x)) {
            return Err(props.error("has a texture, and a to_world that is no rotation and scale"));
        }
        Ok((Rgb::WHITE, Some(SlideDesc { factor, axes: [x, y] })))
    }

    fn set_environment(&mut self, props: &Props, environment: EnvironmentDesc) -> Result<(), LoadError> {
        match self.environment.replace(environment) {
            None => Ok(()),
            Some(_) => Err(props.error("is the second environment of the scene, which has one at most")),
        }
    }

    fn environment_map(&mut self, props: &mut Props) -> Result<EnvironmentDesc, LoadError> {
        let filename = props.string("filename")?;
        let filename = filename.ok_or_else(|| props.error("has no <string name=\"filename\">"))?;
        props.boolean("mis_compensation", false)?;
        let scale = props.float_in("scale", 1.0, 0.0..=1e30)? as f32;
        let matrix = props.take_to_world()?.matrix3;
        let is_rotation = (matrix.transpose() * matrix - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-3);
        if !is_rotation {
            return Err(props.error("has a to_world that scales or shears; expected a rotation"));
        }
        let path = self.document.file(filename);
        let bytes = read_file(&path)?;
        self.hasher.update(blake3::hash(&bytes).as_bytes());
        let mut image = decode(&path, &bytes)?;
        drop(bytes);
        for note in sanitise_radiance(&mut image, scale, &path) {
            self.warn(note);
        }
        Ok(EnvironmentDesc::Map {
            image: Arc::new(from_edge_to_edge(&image)),
            scale,
            rotation_degrees: 0.0,
            to_world: matrix,
        })
    }
}

fn decode(path: &Path, bytes: &[u8]) -> Result<Image<Rgb>, LoadError> {
    let image = |width, height, pixels: Vec<Rgb>| Image { width, height, pixels };
    Ok(match image::read(path, bytes)? {
        Decoded::Linear(image) => image,
        Decoded::Encoded(LdrImage::Bits8 { rgb, .. }) => {
            let linear = |c: &[u8; 3]| Rgb::from(c.map(|c| srgb_decode(f32::from(c) / 255.0)));
            image(rgb.width, rgb.height, rgb.pixels.iter().map(linear).collect())
        }
        Decoded::Encoded(LdrImage::Bits16 { rgb, .. }) => {
            let linear = |c: &[f32; 3]| Rgb::from(c.map(srgb_decode));
            image(rgb.width, rgb.height, rgb.pixels.iter().map(linear).collect())
        }
    })
}

/// The map with its first and last row not half a row from the poles, where ours are, but at them, where Mitsuba's are.
/// A map that is not large gets four or two rows for one: interpolated between them, the new rows differ from the old by a
/// quarter or half of what interpolation itself does.
fn from_edge_to_edge(image: &Image<Rgb>) -> Image<Rgb> {
    let finer = match image.height {
        0..=512 => 4,
        513..=FINE_ROWS => 2,
        _ => 1,
    };
    let height = image.height * finer;
    let last = image.height - 1;
    let mut pixels = Vec::with_capacity(image.width as usize * height as usize);
    for row in 0..height {
        let position = (f64::from(row) + 0.5) / f64::from(height) * f64::from(last);
        let upper = (position as u32).min(last);
        let lower = (upper + 1).min(last);
        let fraction = (position - f64::from(upper)) as f32;
        pixels.extend((0..image.width).map(|x| image.at(x, upper).lerp(*image.at(x, lower), fraction)));
    }
    Image {
        width: image.width,
        height,
        pixels,
    }
}
