//! The schema of scene files, TOML or JSON (docs/scene-format.md), with files still named and not yet read.

use super::bitmap::{Bitmaps, Role};
use super::build::is_invertible;
use super::desc::LightDesc;
use super::value::{Field, KeyError, Table, nearest};
use crate::camera::CameraDesc;
use crate::light::Emission;
use crate::material::{Material, Spectrum};
use crate::math::{DAffine3, DMat3, DVec3};
use serde_json::Value;
use std::collections::HashMap;
use std::path::Path;

mod camera;
mod colour;
mod light;
mod material;
#[cfg(test)]
mod tests;

pub(super) use light::EnvironmentEntry;
pub(super) use material::BACKS;

type Result<T> = std::result::Result<T, KeyError>;

/// Largest radiance: products with areas, reflectances and densities then stay within f32.
pub(super) const MAX_RADIANCE: f64 = 1e30;

/// Largest coordinate and length: rays from farther away hit nothing.
const MAX_LENGTH: f64 = 1e18;

/// A scene file as written.
#[derive(Debug)]
pub(super) struct SceneFile {
    pub(super) camera: CameraDesc,
    pub(super) crop: Option<[u32; 4]>,
    pub(super) max_depth: Option<u32>,
    pub(super) environment: Option<EnvironmentEntry>,
    /// Those in use, in the order of their first use. Indices of textures are those of `bitmaps`.
    pub(super) materials: Vec<(String, Material)>,
    pub(super) bitmaps: Bitmaps,
    pub(super) meshes: Vec<MeshEntry>,
    pub(super) lights: Vec<LightDesc>,
}

#[derive(Debug)]
pub(super) struct MeshEntry {
    pub(super) file: String,
    /// Index into the materials; `None`: those of the mesh file.
    pub(super) material: Option<usize>,
    pub(super) to_world: DAffine3,
    pub(super) emission: Option<(Emission, Option<Spectrum>)>,
}

/// What names and files mean.
struct Context<'a> {
    /// Where relative file names begin.
    base: &'a Path,
    bitmaps: &'a mut Bitmaps,
    materials: &'a HashMap<&'a str, usize>,
}

impl Context<'_> {
    /// The index of a bitmap.
    fn bitmap(&mut self, file: &str, role: Role) -> u32 {
        self.bitmaps.want(self.base.join(file), role) as u32
    }

    /// The index of a material that is named.
    fn material(&self, field: &Field<'_>) -> Result<u32> {
        let name = field.string()?;
        match self.materials.get(name) {
            Some(index) => Ok(*index as u32),
            None => Err(match nearest(name, self.materials.keys().copied()) {
                Some(near) => field.error(format!("there is no material \"{name}\"; did you mean \"{near}\"?")),
                None => field.error(format!(
                    "there is no material \"{name}\"; add a table [materials.{name}]"
                )),
            }),
        }
    }
}

/// Reads the whole schema out of parsed TOML or JSON. File names are relative to `base`.
pub(super) fn parse(value: &Value, base: &Path) -> Result<SceneFile> {
    let root = Table::root(value)?;
    // Names for people; nothing in the image depends on it.
    if let Some(name) = root.get("name") {
        name.string()?;
    }
    let (camera, crop) = camera::camera(&root.require("camera")?.table()?)?;
    let max_depth = match root.get("integrator") {
        Some(integrator) => {
            let table = integrator.table()?;
            let max_depth = table.get("max_depth").map(|f| f.count()).transpose()?;
            table.finish()?;
            max_depth
        }
        None => None,
    };
    let environment = root.get("environment").map(|f| light::environment(&f)).transpose()?;

    // All materials are checked, but only those in use ask for their bitmaps.
    let tables = match root.get("materials") {
        Some(field) => {
            let table = field.table()?;
            table.entries().collect::<Vec<_>>()
        }
        None => Vec::new(),
    };
    let read = |of: &[usize], bitmaps: &mut Bitmaps| {
        let materials = of.iter().enumerate().map(|(i, &table)| (tables[table].0, i)).collect();
        let mut context = Context {
            base,
            bitmaps,
            materials: &materials,
        };
        of.iter()
            .map(|&table| {
                let (name, field) = &tables[table];
                Ok(((*name).to_owned(), material::material(&field.table()?, &mut context)?))
            })
            .collect::<Result<Vec<_>>>()
    };
    let all: Vec<usize> = (0..tables.len()).collect();
    let checked = read(&all, &mut Bitmaps::default())?;
    material::check_nesting(&checked)?;
    let names = all.iter().map(|&i| (tables[i].0, i)).collect();
    let mut bitmaps = Bitmaps::default();
    let mut context = Context {
        base,
        bitmaps: &mut bitmaps,
        materials: &names,
    };
    let mut meshes = array(&root, "meshes", |f| mesh(&f.table()?, &mut context))?;
    let used = in_use(&meshes, &checked);
    let materials = read(&used, &mut bitmaps)?;
    let place: HashMap<usize, usize> = used.iter().enumerate().map(|(place, &index)| (index, place)).collect();
    for mesh in &mut meshes {
        mesh.material = mesh.material.map(|index| place[&index]);
    }
    let mut context = Context {
        base,
        bitmaps: &mut bitmaps,
        materials: &names,
    };
    let lights = array(&root, "lights", |f| light::light(&f.table()?, &mut context))?;
    root.finish()?;
    Ok(SceneFile {
        camera,
        crop,
        max_depth,
        environment,
        materials,
        bitmaps,
        meshes,
        lights,
    })
}

/// The tables of an array that may be left out.
fn array<T>(root: &Table<'_>, key: &'static str, read: impl FnMut(&Field<'_>) -> Result<T>) -> Result<Vec<T>> {
    match root.get(key) {
        Some(field) => field.array()?.iter().map(read).collect(),
        None => Ok(Vec::new()),
    }
}

/// Indices of the materials that meshes name, then of those that these refer to, each once.
fn in_use(meshes: &[MeshEntry], materials: &[(String, Material)]) -> Vec<usize> {
    let mut is_used = vec![false; materials.len()];
    let mut used = Vec::new();
    let mut add = |material: usize, used: &mut Vec<usize>| {
        if !std::mem::replace(&mut is_used[material], true) {
            used.push(material);
        }
    };
    for material in meshes.iter().filter_map(|mesh| mesh.material) {
        add(material, &mut used);
    }
    let mut next = 0;
    while let Some(&material) = used.get(next) {
        for part in materials[material].1.parts() {
            add(part as usize, &mut used);
        }
        next += 1;
    }
    used
}

fn mesh(table: &Table<'_>, context: &mut Context<'_>) -> Result<MeshEntry> {
    // For people, like the name of the scene.
    if let Some(name) = table.get("name") {
        name.string()?;
    }
    let material = table.get("material").map(|f| context.material(&f)).transpose()?;
    let emission = table
        .get("emission")
        .map(|f| {
            let table = f.table()?;
            let radiance = table.require("radiance")?.rgb_in(0.0, MAX_RADIANCE)?;
            let both_sides = table
                .get("sides")
                .map_or(Ok(false), |f| f.word(&[("front", false), ("both", true)]))?;
            let map = colour::colour(&table, MAX_RADIANCE, Role::Radiance, context)?;
            if let (Some(Spectrum::Constant(_)), Some(rgb)) = (map, table.get("rgb")) {
                return Err(rgb.error("belongs into `radiance`"));
            }
            table.finish()?;
            Ok((Emission { radiance, both_sides }, map))
        })
        .transpose()?;
    let entry = MeshEntry {
        file: table.require("file")?.string()?.to_owned(),
        material: material.map(|m| m as usize),
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
