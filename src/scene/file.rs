//! The schema of scene files, TOML or JSON (docs/scene-format.md), with files still named and not yet read.

use super::build::is_invertible;
use super::value::{Field, KeyError, Table, nearest};
use crate::bsdf::PLASTIC_MIN_ALPHA;
use crate::camera::CameraDesc;
use crate::light::Emission;
use crate::math::{DAffine3, DMat3, DVec3, Rgb};
use crate::texture::Encoding;
use serde_json::Value;

type Result<T> = std::result::Result<T, KeyError>;

/// Largest radiance: products with areas, reflectances and densities then stay within f32.
const MAX_RADIANCE: f64 = 1e30;

/// Largest factor on an environment map.
const MAX_SCALE: f64 = 1e15;

/// Largest part of a complex index; its fourth power is still within f32.
const MAX_INDEX: f64 = 1e6;

/// Largest coordinate and length of the camera: rays from farther away hit nothing.
const MAX_LENGTH: f64 = 1e18;

/// A scene file as written.
#[derive(Debug)]
pub(super) struct SceneFile {
    pub(super) camera: CameraDesc,
    pub(super) max_depth: Option<u32>,
    pub(super) environment: Option<EnvironmentEntry>,
    pub(super) materials: Vec<(String, MaterialEntry)>,
    pub(super) meshes: Vec<MeshEntry>,
}

#[derive(Debug)]
pub(super) enum EnvironmentEntry {
    Constant(Rgb),
    File {
        file: String,
        scale: f32,
        rotation_degrees: f64,
    },
}

/// A colour or the bitmap that it comes from.
#[derive(Debug)]
pub(super) enum ColourEntry {
    Rgb(Rgb),
    Texture { file: String, encoding: Option<Encoding> },
}

#[derive(Debug)]
pub(super) enum MaterialEntry {
    Diffuse {
        reflectance: ColourEntry,
    },
    Conductor {
        eta: Rgb,
        k: Rgb,
        alpha: f32,
    },
    Dielectric {
        ior: f32,
        alpha: f32,
    },
    Mirror {
        reflectance: Rgb,
    },
    Plastic {
        reflectance: ColourEntry,
        specular: Rgb,
        alpha: f32,
    },
}

#[derive(Debug)]
pub(super) struct MeshEntry {
    pub(super) file: String,
    /// Index into the materials; `None`: those of the mesh file.
    pub(super) material: Option<usize>,
    pub(super) to_world: DAffine3,
    pub(super) emission: Option<Emission>,
}

/// Reads the whole schema out of parsed TOML or JSON.
pub(super) fn parse(value: &Value) -> Result<SceneFile> {
    let root = Table::root(value)?;
    // Names for people; nothing in the image depends on it.
    if let Some(name) = root.get("name") {
        name.string()?;
    }
    let camera = camera(&root.require("camera")?.table()?)?;
    let max_depth = match root.get("integrator") {
        Some(integrator) => {
            let table = integrator.table()?;
            let max_depth = table.get("max_depth").map(|f| f.count()).transpose()?;
            table.finish()?;
            max_depth
        }
        None => None,
    };
    let environment = root.get("environment").map(|f| environment(&f)).transpose()?;
    let materials = match root.get("materials") {
        Some(field) => field
            .table()?
            .entries()
            .map(|(name, field)| Ok((name.to_owned(), material(&field.table()?)?)))
            .collect::<Result<Vec<_>>>()?,
        None => Vec::new(),
    };
    let meshes = match root.get("meshes") {
        Some(field) => field
            .array()?
            .iter()
            .map(|f| mesh(&f.table()?, &materials))
            .collect::<Result<Vec<_>>>()?,
        None => Vec::new(),
    };
    root.finish()?;
    Ok(SceneFile {
        camera,
        max_depth,
        environment,
        materials,
        meshes,
    })
}

fn camera(table: &Table<'_>) -> Result<CameraDesc> {
    let resolution = table.require("resolution")?;
    let sides = resolution.array()?;
    let [width, height] = sides.as_slice() else {
        return Err(resolution.error("expected an array of 2 whole numbers: width and height"));
    };
    let desc = CameraDesc {
        position: table.require("position")?.vector(MAX_LENGTH)?,
        look_at: table.require("look_at")?.vector(MAX_LENGTH)?,
        up: table.get("up").map_or(Ok(DVec3::Y), |f| f.vector(MAX_LENGTH))?,
        vfov_degrees: table.require("vfov")?.number()?,
        resolution: [width.count()?, height.count()?],
        aperture_radius: table
            .get("aperture_radius")
            .map_or(Ok(0.0), |f| f.number_in(0.0, MAX_LENGTH))?,
        focus_distance: table
            .get("focus_distance")
            .map(|f| f.number_in(0.0, MAX_LENGTH))
            .transpose()?,
        mirrored: table
            .get("mirrored")
            .map_or(Ok(false), |f| f.word(&[("no", false), ("yes", true)]))?,
    };
    table.finish()?;
    Ok(desc)
}

fn environment(field: &Field<'_>) -> Result<EnvironmentEntry> {
    let table = field.table()?;
    let file = table.get("file").map(|f| f.string()).transpose()?;
    let radiance = table.get("radiance").map(|f| f.rgb_in(0.0, MAX_RADIANCE)).transpose()?;
    let scale = table.get("scale").map_or(Ok(1.0), |f| f.number_in(0.0, MAX_SCALE))? as f32;
    let rotation_degrees = table.get("rotation_deg").map_or(Ok(0.0), |f| f.number())?;
    table.finish()?;
    match (file, radiance) {
        (Some(file), None) => Ok(EnvironmentEntry::File {
            file: file.to_owned(),
            scale,
            rotation_degrees,
        }),
        (None, Some(radiance)) => Ok(EnvironmentEntry::Constant(radiance * scale)),
        (Some(_), Some(_)) => Err(field.error("has both `file` and `radiance`; keep one")),
        (None, None) => Err(field.error("needs `file` (a latitude-longitude map) or `radiance` = [r, g, b]")),
    }
}

#[derive(Clone, Copy)]
enum MaterialKind {
    Diffuse,
    Conductor,
    Dielectric,
    Mirror,
    Plastic,
}

fn material(table: &Table<'_>) -> Result<MaterialEntry> {
    let kind = table.require("type")?.word(&[
        ("diffuse", MaterialKind::Diffuse),
        ("conductor", MaterialKind::Conductor),
        ("dielectric", MaterialKind::Dielectric),
        ("mirror", MaterialKind::Mirror),
        ("plastic", MaterialKind::Plastic),
    ])?;
    let alpha = |default: f64, low: f64| -> Result<f32> {
        Ok(table.get("alpha").map_or(Ok(default), |f| f.number_in(low, 1.0))? as f32)
    };
    let entry = match kind {
        MaterialKind::Diffuse => MaterialEntry::Diffuse {
            reflectance: colour(table)?,
        },
        MaterialKind::Conductor => {
            let eta = table.require("eta")?;
            let index = eta.rgb_in(0.0, MAX_INDEX)?;
            if index.to_array().contains(&0.0) {
                return Err(eta.error("an index of 0 reflects nothing that is defined; give values above 0"));
            }
            MaterialEntry::Conductor {
                eta: index,
                k: table.require("k")?.rgb_in(0.0, MAX_INDEX)?,
                alpha: alpha(0.0, 0.0)?,
            }
        }
        MaterialKind::Dielectric => MaterialEntry::Dielectric {
            ior: table.require("ior")?.number_in(0.01, 100.0)? as f32,
            alpha: alpha(0.0, 0.0)?,
        },
        MaterialKind::Mirror => MaterialEntry::Mirror {
            reflectance: table.get("rgb").map_or(Ok(Rgb::WHITE), |f| f.rgb_in(0.0, 1.0))?,
        },
        MaterialKind::Plastic => MaterialEntry::Plastic {
            reflectance: colour(table)?,
            specular: table
                .get("specular")
                .map_or(Ok(Rgb::splat(0.04)), |f| f.rgb_in(0.0, 1.0))?,
            alpha: alpha(0.1, f64::from(PLASTIC_MIN_ALPHA))?,
        },
    };
    table.finish()?;
    Ok(entry)
}

fn colour(table: &Table<'_>) -> Result<ColourEntry> {
    let rgb = table.get("rgb");
    let texture = table.get("texture");
    let encoding = table
        .get("encoding")
        .map(|f| {
            f.word(&[("srgb", Encoding::Srgb), ("linear", Encoding::Linear)])
                .map(|e| (f, e))
        })
        .transpose()?;
    match (rgb, texture) {
        (Some(rgb), None) => match encoding {
            Some((field, _)) => Err(field.error("belongs to a `texture`; `rgb` is always linear")),
            None => Ok(ColourEntry::Rgb(rgb.rgb_in(0.0, 1.0)?)),
        },
        (None, Some(texture)) => Ok(ColourEntry::Texture {
            file: texture.string()?.to_owned(),
            encoding: encoding.map(|(_, encoding)| encoding),
        }),
        (Some(rgb), Some(_)) => Err(rgb.error("stands beside `texture`; keep one")),
        (None, None) => {
            // Names the table and not a key that may be any of two.
            table
                .require("rgb")
                .map(|_| ColourEntry::Rgb(Rgb::BLACK))
                .map_err(|e| KeyError {
                    problem: "is missing; give `rgb` = [r, g, b] or `texture` = \"file\"".into(),
                    ..e
                })
        }
    }
}

fn mesh(table: &Table<'_>, materials: &[(String, MaterialEntry)]) -> Result<MeshEntry> {
    let material = match table.get("material") {
        None => None,
        Some(field) => {
            let name = field.string()?;
            let names = || materials.iter().map(|(name, _)| name.as_str());
            Some(
                names()
                    .position(|n| n == name)
                    .ok_or_else(|| match nearest(name, names()) {
                        Some(near) => field.error(format!("there is no material \"{name}\"; did you mean \"{near}\"?")),
                        None => field.error(format!(
                            "there is no material \"{name}\"; add a table [materials.{name}]"
                        )),
                    })?,
            )
        }
    };
    let emission = table
        .get("emission")
        .map(|f| {
            let table = f.table()?;
            let radiance = table.require("radiance")?.rgb_in(0.0, MAX_RADIANCE)?;
            let both_sides = table
                .get("sides")
                .map_or(Ok(false), |f| f.word(&[("front", false), ("both", true)]))?;
            table.finish()?;
            Ok(Emission { radiance, both_sides })
        })
        .transpose()?;
    let entry = MeshEntry {
        file: table.require("file")?.string()?.to_owned(),
        material,
        to_world: table
            .get("transform")
            .map_or(Ok(DAffine3::IDENTITY), |f| transform(&f))?,
        emission,
    };
    table.finish()?;
    Ok(entry)
}

/// A 4 × 4 matrix in rows, for column vectors.
fn transform(field: &Field<'_>) -> Result<DAffine3> {
    let rows = field.array()?;
    let [x, y, z, w] = rows.as_slice() else {
        return Err(field.error(format!("expected 4 rows of 4 numbers, found {} rows", rows.len())));
    };
    let [x, y, z] = [x.numbers::<4>()?, y.numbers::<4>()?, z.numbers::<4>()?];
    if w.numbers::<4>()? != [0.0, 0.0, 0.0, 1.0] {
        return Err(w.error("the last row must be [0, 0, 0, 1]: projections are not supported"));
    }
    let column = |i: usize| DVec3::new(x[i], y[i], z[i]);
    let transform = DAffine3 {
        matrix3: DMat3::from_cols(column(0), column(1), column(2)),
        translation: column(3),
    };
    if !is_invertible(&transform) {
        return Err(field.error("the matrix is singular: it would flatten the mesh"));
    }
    Ok(transform)
}
