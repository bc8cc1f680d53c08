//! Writing a description as a scene file, and the meshes and images that it refers to.

use super::desc::{EnvironmentDesc, Falloff, LightDesc, ObjectDesc, SceneDesc, SlideDesc};
use super::file::{self, BACKS};
use super::ply::write_ply;
use super::value::KeyError;
use crate::image::exr::{self, ExrMetadata};
use crate::image::{Image, ImageError, ldr};
use crate::material::Spectrum;
use crate::math::{DAffine3, DMat3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use crate::texture::{Encoding, Texture};
use std::collections::HashSet;
use std::io::Write;
use std::path::Path;
use text::{Item, Keys, key, section};
use thiserror::Error;

mod material;
mod save;
mod text;

pub use material::material_type;
pub use save::{SaveError, save};

/// A scene file and the files beside it, ready to be written. Loading it gives the description again: the same objects and
/// lights in the same order, everything to the bit, but other names for objects, another hash, and no warnings.
#[derive(Debug)]
pub struct Export<'a> {
    /// The scene file, in TOML.
    pub scene: String,
    /// The other files by their names within the folder.
    pub files: Vec<(String, ExportFile<'a>)>,
}

/// The content of a file beside a scene file.
#[derive(Clone, Copy, Debug)]
pub enum ExportFile<'a> {
    /// PLY.
    Mesh(&'a TriangleMesh<DVec3>),
    /// PNG.
    Bytes(&'a Image<[u8; 3]>),
    /// OpenEXR.
    Floats(&'a Image<Rgb>),
}

/// Why a description cannot be said in a scene file.
#[derive(Debug, Error)]
#[error("cannot be written as a scene file: {key}: {problem}")]
pub struct ExportError {
    /// Dotted path of the key that would hold it.
    pub key: String,
    /// What is wrong with it.
    pub problem: String,
}

impl<'a> Export<'a> {
    /// Prepares the files of a scene. `folder` is where those beside the scene file will be, relative to it.
    ///
    /// # Errors
    /// [`ExportError`] where the description has values that no scene file may have.
    pub fn new(desc: &'a SceneDesc, folder: &str) -> Result<Export<'a>, ExportError> {
        let mut files = Vec::new();
        let names = Names::new(desc, folder, &mut files);
        let mut text = String::new();
        for warning in &desc.warnings {
            for line in warning.lines() {
                text += &format!("# {}\n", line.replace(char::is_control, " "));
            }
        }
        section(&mut text, "[camera]", &camera(desc));
        if let Some(max_depth) = desc.max_depth {
            section(&mut text, "[integrator]", &vec![("max_depth", Item::Count(max_depth))]);
        }
        if let Some(environment) = &desc.environment {
            section(
                &mut text,
                "[environment]",
                &self::environment(environment, folder, &mut files),
            );
        }
        for ((_, material), name) in desc.materials.iter().zip(&names.materials) {
            let keys = material::material(material, &names);
            section(&mut text, &format!("[materials.{}]", key(name)), &keys);
        }
        let mut is_written = vec![false; desc.meshes.len()];
        for object in &desc.objects {
            let file = format!("mesh-{}.ply", object.mesh);
            section(
                &mut text,
                "[[meshes]]",
                &mesh(object, &format!("{folder}/{file}"), &names),
            );
            if !std::mem::replace(&mut is_written[object.mesh], true) {
                files.push((file, ExportFile::Mesh(&desc.meshes[object.mesh])));
            }
        }
        for light in &desc.lights {
            section(&mut text, "[[lights]]", &self::light(light, &names));
        }
        check(&text)?;
        Ok(Export { scene: text, files })
    }
}

impl ExportFile<'_> {
    /// Writes the content. `path` is for messages only.
    ///
    /// # Errors
    /// What `out` says, as [`ImageError::Write`].
    pub fn write(&self, out: impl Write, path: &Path) -> Result<(), ImageError> {
        match self {
            ExportFile::Mesh(mesh) => write_ply(mesh, out).map_err(|source| ImageError::Write {
                path: path.to_owned(),
                source,
            }),
            ExportFile::Bytes(image) => ldr::write_png(out, image, path),
            ExportFile::Floats(image) => exr::write(out, image, &ExrMetadata::default(), path),
        }
    }
}

/// What materials and textures are called in the scene file.
struct Names {
    /// By index of the material; no two are the same.
    materials: Vec<String>,
    /// By index of the texture, those in use: the file, and the encoding of 8-bit ones.
    textures: Vec<Option<(String, Option<Encoding>)>>,
}

impl Names {
    /// Adds the textures in use to `files`.
    fn new<'a>(desc: &'a SceneDesc, folder: &str, files: &mut Vec<(String, ExportFile<'a>)>) -> Names {
        let mut taken: HashSet<String> = BACKS.iter().map(|(word, _)| (*word).to_owned()).collect();
        let materials = desc.materials.iter().map(|(name, _)| {
            let name = if name.is_empty() { "material" } else { name };
            let mut unique = name.to_owned();
            let mut count = 1u64;
            while !taken.insert(unique.clone()) {
                count += 1;
                unique = format!("{name}-{count}");
            }
            unique
        });
        let materials = materials.collect();
        let mut textures = vec![None; desc.textures.len()];
        let of_materials = desc.materials.iter().flat_map(|(_, material)| material.textures());
        let of_lamps = desc.objects.iter().filter_map(|object| object.emission_map?.texture());
        let of_spots = desc.lights.iter().filter_map(|light| match light {
            LightDesc::Spot { slide, .. } => slide.as_ref()?.factor.texture(),
            LightDesc::Point { .. } | LightDesc::Distant { .. } => None,
        });
        for texture in of_materials
            .chain(of_lamps)
            .chain(of_spots)
            .map(|texture| texture as usize)
        {
            let (extension, encoding, file) = match &desc.textures[texture] {
                Texture::Rgb8(image, encoding) => ("png", Some(*encoding), ExportFile::Bytes(image)),
                Texture::Rgb32(image) => ("exr", None, ExportFile::Floats(image)),
            };
            textures[texture].get_or_insert_with(|| {
                let name = format!("texture-{texture}.{extension}");
                let path = format!("{folder}/{name}");
                files.push((name, file));
                (path, encoding)
            });
        }
        Names { materials, textures }
    }

    fn material(&self, index: u32) -> &str {
        &self.materials[index as usize]
    }

    fn texture(&self, index: u32) -> &(String, Option<Encoding>) {
        self.textures[index as usize]
            .as_ref()
            .expect("every texture that a material or a lamp refers to has a name")
    }
}

/// Reads what was written, so that nobody finds out later that it cannot be.
fn check(text: &str) -> Result<(), ExportError> {
    let value = ::toml::from_str(text).map_err(|e| ExportError {
        key: "syntax".into(),
        problem: e.to_string().trim_end().to_owned(),
    })?;
    match file::parse(&value, Path::new("")) {
        Ok(_) => Ok(()),
        Err(KeyError { key, problem }) => Err(ExportError { key, problem }),
    }
}

fn camera(desc: &SceneDesc) -> Keys {
    let camera = &desc.camera;
    let mut keys = vec![
        ("position", camera.position.into()),
        ("look_at", camera.look_at.into()),
        ("up", camera.up.into()),
        ("vfov", camera.vfov_degrees.into()),
        ("resolution", Item::List(camera.resolution.map(Item::Count).into())),
    ];
    if camera.aperture_radius != 0.0 {
        keys.push(("aperture_radius", camera.aperture_radius.into()));
    }
    keys.extend(
        camera
            .focus_distance
            .map(|distance| ("focus_distance", distance.into())),
    );
    if let Some(crop) = desc.crop {
        keys.push(("crop", Item::List(crop.map(Item::Count).into())));
    }
    if camera.mirrored {
        keys.push(("mirrored", true.into()));
    }
    keys
}

fn environment<'a>(environment: &'a EnvironmentDesc, folder: &str, files: &mut Vec<(String, ExportFile<'a>)>) -> Keys {
    match environment {
        EnvironmentDesc::Constant(radiance) => vec![("radiance", (*radiance).into())],
        EnvironmentDesc::Map {
            image,
            scale,
            rotation_degrees,
            to_world,
        } => {
            let file = "environment.exr";
            files.push((file.to_owned(), ExportFile::Floats(image)));
            let mut keys = vec![("file", format!("{folder}/{file}").as_str().into())];
            if *scale != 1.0 {
                keys.push(("scale", (*scale).into()));
            }
            if *rotation_degrees != 0.0 {
                keys.push(("rotation_deg", (*rotation_degrees).into()));
            }
            if *to_world != DMat3::IDENTITY {
                keys.push(("transform", to_world.transpose().to_cols_array_2d().into()));
            }
            keys
        }
    }
}

fn mesh(object: &ObjectDesc, file: &str, names: &Names) -> Keys {
    let mut keys = vec![
        ("name", object.name.as_str().into()),
        ("file", file.into()),
        ("material", names.material(object.material as u32).into()),
    ];
    if object.to_world != DAffine3::IDENTITY {
        let [x, y, z] = object.to_world.matrix3.transpose().to_cols_array_2d();
        let at = object.to_world.translation;
        let row = |r: [f64; 3], t: f64| [r[0], r[1], r[2], t];
        let rows = [row(x, at.x), row(y, at.y), row(z, at.z), [0.0, 0.0, 0.0, 1.0]];
        keys.push(("transform", rows.into()));
    }
    if let Some(emission) = object.emission {
        let (factor, map) = match object.emission_map {
            None => (Rgb::WHITE, Keys::new()),
            Some(Spectrum::Constant(factor)) => (factor, Keys::new()),
            Some(map) => (Rgb::WHITE, material::colour(&map, names)),
        };
        let mut emitted = vec![("radiance", (emission.radiance * factor).into())];
        emitted.extend(map);
        if emission.both_sides {
            emitted.push(("sides", "both".into()));
        }
        keys.push(("emission", Item::Table(emitted)));
    }
    keys
}

fn light(light: &LightDesc, names: &Names) -> Keys {
    match light {
        LightDesc::Point { position, intensity } => vec![
            ("type", "point".into()),
            ("position", (*position).into()),
            ("intensity", (*intensity).into()),
        ],
        LightDesc::Spot {
            position,
            direction,
            intensity,
            angles,
            falloff,
            slide,
        } => {
            let falloff = match falloff {
                Falloff::Angle => "angle",
                Falloff::Cosine => "cosine",
            };
            let mut keys = vec![
                ("type", "spot".into()),
                ("position", (*position).into()),
                ("direction", (*direction).into()),
                ("intensity", (*intensity).into()),
                match angles.map(degrees) {
                    [Some(beam), Some(edge)] => ("angles_deg", [beam, edge].into()),
                    _ => ("angles_rad", (*angles).into()),
                },
                ("falloff", falloff.into()),
            ];
            if let Some(SlideDesc { factor, axes: [u, v] }) = slide {
                let mut table = material::colour(factor, names);
                table.extend([("u_axis", (*u).into()), ("v_axis", (*v).into())]);
                keys.push(("slide", Item::Table(table)));
            }
            keys
        }
        LightDesc::Distant {
            direction,
            irradiance,
            radius,
        } => vec![
            ("type", "distant".into()),
            ("direction", (*direction).into()),
            ("irradiance", (*irradiance).into()),
            match degrees(*radius) {
                Some(radius) => ("radius_deg", radius.into()),
                None => ("radius_rad", (*radius).into()),
            },
        ],
    }
}

/// The shortest number of degrees that is read as this angle, to the bit, if there is one: degrees are coarser than radians
/// in parts of their range.
fn degrees(radians: f64) -> Option<f64> {
    let near = radians.to_degrees();
    let steps = std::iter::successors(Some(near), |d| Some(d.next_down())).take(4);
    steps
        .chain(std::iter::successors(Some(near), |d| Some(d.next_up())).take(4))
        .filter(|d| d.to_radians().to_bits() == radians.to_bits())
        .min_by_key(|d| format!("{d:?}").len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_are_written_where_they_are_read_as_the_same_angle() {
        for d in [0.0f64, 1.0, 22.5, 20.0, 75.3, 89.999, 179.0, 180.0] {
            assert_eq!(degrees(d.to_radians()), Some(d));
        }
        let (mut found, count) = (0, 1000);
        for i in 1..=count {
            let angle = f64::from(i) * 1.5e-3;
            if let Some(d) = degrees(angle) {
                assert_eq!(d.to_radians().to_bits(), angle.to_bits());
                found += 1;
            }
        }
        assert!(found > count / 4 && found < count, "{found}");
    }
}
