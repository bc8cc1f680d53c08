//! glTF 2.0 scenes: `.gltf` with files beside it, and `.glb`.
//!
//! The crate `gltf` has the types of the JSON and checks what refers to what. Bytes are read here: its own reader takes
//! offsets and lengths on trust, and panics where they are wrong.
//!
//! What the format leaves to who shows it is decided here, and written down in docs/scene-format.md.

mod accessor;
mod camera;
mod container;
mod layer;
mod light;
mod material;
mod mesh;
mod node;
mod notes;
mod resource;
mod texture;

use super::desc::{EnvironmentDesc, ObjectDesc, SceneDesc};
use super::framing::framing;
use super::input::read_file;
use super::load::LoadError;
use super::origin;
use crate::math::{DAffine3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use container::Document;
use gltf::json::Root;
use mesh::{MeshRead, Shape, VertexAlpha};
use notes::Notes;
use rayon::prelude::*;
use resource::Buffers;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Most placements of primitives: nodes times primitives can be many more than a file has bytes.
const MOST_OBJECTS: usize = 1 << 22;

fn key_error(path: &Path, key: impl Into<String>, problem: impl Into<String>) -> LoadError {
    LoadError::Key {
        path: path.to_owned(),
        key: key.into(),
        problem: problem.into(),
    }
}

/// The JSON of a file and where the file is.
struct Asset<'a> {
    path: &'a Path,
    root: Root,
}

impl Asset<'_> {
    fn error(&self, key: impl Into<String>, problem: impl Into<String>) -> LoadError {
        key_error(self.path, key, problem)
    }
}

/// `nodes[3]`, and the name in the file if it has one.
fn label(list: &str, index: usize, name: Option<&str>) -> String {
    match name.filter(|name| !name.is_empty()) {
        Some(name) => format!("{list}[{index}] ({name})"),
        None => format!("{list}[{index}]"),
    }
}

/// Reads a file. `camera` names a camera of it; without, the first of the scene is taken.
pub(super) fn load(path: &Path, camera: Option<&str>) -> Result<SceneDesc, LoadError> {
    let bytes = read_file(path)?;
    let mut notes = Notes::default();
    let (json, blob) = container::split(path, &bytes)?;
    let Document { root, placements } = container::parse(path, json, &mut notes)?;
    let asset = &Asset { path, root };
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes);
    let buffers = Buffers::read(asset, blob, &mut hasher)?;

    let placed = node::place(asset, &placements, &mut notes)?;
    // Another view is another scene.
    if let Some(name) = camera {
        hasher.update(name.as_bytes());
    }
    let camera = camera::choose(asset, &placed, camera, &mut notes)?;
    let lights = light::read(asset, &placed, &mut notes)?;

    let mut parts = Parts::default();
    for node in &placed {
        parts.add(asset, node, &mut notes)?;
    }
    let Parts {
        shapes, list: parts, ..
    } = parts;
    mesh::check_work(asset, &buffers, &shapes)?;
    let reads: Vec<Result<MeshRead, LoadError>> = shapes
        .par_iter()
        .map(|(shape, place)| mesh::read(asset, &buffers, shape, place))
        .collect();
    let mut meshes: Vec<(Arc<TriangleMesh<DVec3>>, VertexAlpha)> = Vec::new();
    let mut mesh_of_shape = Vec::with_capacity(reads.len());
    for (read, (_, place)) in reads.into_iter().zip(&shapes) {
        let read = read?;
        read.notes.into_iter().for_each(|note| notes.add(note, place));
        mesh_of_shape.push(read.mesh.map(|mesh| {
            meshes.push((Arc::new(mesh), read.alpha));
            meshes.len() - 1
        }));
    }

    let mut materials = material::Materials::new(asset);
    let mut objects = Vec::with_capacity(parts.len());
    for part in parts {
        let Some(mesh) = mesh_of_shape[part.shape] else {
            continue;
        };
        let (vertices, alpha) = &meshes[mesh];
        let material = materials.get(part.material, !vertices.colors.is_empty(), *alpha, &mut notes)?;
        let (emission, emission_map) = materials.emission(material);
        objects.push(ObjectDesc {
            name: part.name,
            mesh,
            material,
            to_world: part.to_world,
            emission,
            emission_map,
        });
    }
    let has_lamps = !lights.is_empty() || objects.iter().any(|object| materials.is_lamp(object.material));
    let (materials, textures) = materials.finish(&buffers, &mut hasher)?;

    let environment = (!has_lamps).then(|| {
        notes.add("has no light; a constant environment of radiance 1 lights it", "");
        EnvironmentDesc::Constant(Rgb::WHITE)
    });
    let mut desc = SceneDesc {
        crop: None,
        camera: camera.clone().unwrap_or_else(|| framing(DVec3::ZERO, DVec3::ONE)),
        max_depth: None,
        environment,
        materials,
        textures,
        meshes: meshes.into_iter().map(|(mesh, _)| mesh).collect(),
        objects,
        lights,
        hash: hasher.finalize().to_hex().to_string(),
        warnings: Vec::new(),
    };
    if camera.is_none() {
        notes.add("has no camera; one that sees all of it is used", "");
        if let Some((low, high)) = origin::bounds(&desc) {
            desc.camera = framing(low, high);
        }
    }
    desc.warnings = notes.sentences(path);
    Ok(desc)
}

/// A primitive that stands somewhere.
struct Part {
    name: String,
    shape: usize,
    material: Option<usize>,
    to_world: DAffine3,
}

/// What stands where, and the triangles that it takes, each once.
#[derive(Default)]
struct Parts {
    /// With the place in the file that first asks for it.
    shapes: Vec<(Shape, String)>,
    index: HashMap<Shape, usize>,
    list: Vec<Part>,
}

impl Parts {
    fn add(&mut self, asset: &Asset<'_>, placed: &node::Placed, notes: &mut Notes) -> Result<(), LoadError> {
        let node = &asset.root.nodes[placed.node];
        let Some(m) = node.mesh.map(|mesh| mesh.value()) else {
            return Ok(());
        };
        let name = label("nodes", placed.node, node.name.as_deref());
        if !super::build::is_invertible(&placed.to_world) {
            notes.add("the transform flattens the mesh, which is left out", &name);
            return Ok(());
        }
        if node.skin.is_some() {
            notes.add("the skin is ignored: the mesh is shown as it was bound", &name);
        }
        let mesh = &asset.root.meshes[m];
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("meshes[{m}].primitives[{p}]");
            let material = primitive.material.map(|material| material.value());
            let set = material::set_of(asset, material, notes)?;
            let Some(shape) = Shape::of(primitive, set, &place, notes) else {
                continue;
            };
            let shape = *self.index.entry(shape).or_insert_with_key(|shape| {
                self.shapes.push((shape.clone(), place.clone()));
                self.shapes.len() - 1
            });
            if self.list.len() == MOST_OBJECTS {
                return Err(asset.error(
                    format!("nodes[{}].mesh", placed.node),
                    format!("nodes place more than {MOST_OBJECTS} primitives in all; merge some"),
                ));
            }
            self.list.push(Part {
                name: format!("{name}, {place}"),
                shape,
                material,
                to_world: placed.to_world,
            });
        }
        Ok(())
    }
}
