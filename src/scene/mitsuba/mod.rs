//! Scenes of Mitsuba 3 in XML: those that a path tracer of surfaces can render.
//!
//! The text becomes a tree of objects with their parameters ([`document`]), which is converted from the scene downwards. Every
//! parameter that is not used in the end is an error, as it is in Mitsuba. What is read, approximated and refused is listed
//! in `docs/scene-format.md`.

mod bsdf;
mod document;
mod emitter;
mod mirrored;
mod parameters;
mod props;
mod sensor;
mod serialized;
mod shape;
mod spectrum;
mod tables;
mod tessellate;
mod texture;
mod transform;
mod xml;
mod xml_value;

use super::bitmap::Role;
use super::desc::{EnvironmentDesc, LightDesc, ObjectDesc, SceneDesc};
use super::framing::framing;
use super::load::LoadError;
use super::origin;
use crate::material::Material;
use crate::math::DVec3;
use crate::mesh::TriangleMesh;
use crate::texture::Texture;
use document::{Document, Tag};
use props::Props;
use shape::MeshKey;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Reads a scene. `defines` are the values of its parameters (`$name`), which go before those in the file.
pub(super) fn load(path: &Path, defines: &[(String, String)]) -> Result<SceneDesc, LoadError> {
    let document = xml::read(path, defines)?;
    let mut importer = Importer {
        document: &document,
        hasher: document.hasher.clone(),
        warnings: Vec::new(),
        materials: Vec::new(),
        materials_of_nodes: HashMap::new(),
        default_materials: [None; 2],
        mirrored_materials: HashMap::new(),
        turned_textures: HashMap::new(),
        textures: Vec::new(),
        bitmaps: HashMap::new(),
        meshes: Vec::new(),
        meshes_of_keys: HashMap::new(),
        groups: HashMap::new(),
        objects: Vec::new(),
        lights: Vec::new(),
        environment: None,
    };
    let mut scene = Props::new(&document, 0);
    let integrator = scene.child(Tag::Integrator)?;
    let max_depth = match integrator {
        Some(integrator) => importer.integrator(integrator)?,
        None => None,
    };
    let sensors = scene.children(Tag::Sensor);
    let view = match sensors.first() {
        Some(&sensor) => Some(importer.sensor(sensor)?),
        None => None,
    };
    if sensors.len() > 1 {
        importer.warn(format!(
            "{}: {} sensors; the first is used",
            path.display(),
            sensors.len()
        ));
    }
    for shape in scene.children(Tag::Shape) {
        importer.shape(shape)?;
    }
    for emitter in scene.children(Tag::Emitter) {
        importer.emitter(emitter)?;
    }
    // What something refers to has been converted; the others have no effect.
    for unused in [Tag::Bsdf, Tag::Texture, Tag::Film, Tag::Sampler, Tag::Filter] {
        scene.children(unused);
    }
    scene.finish()?;

    let Importer {
        hasher,
        mut warnings,
        materials,
        textures,
        meshes,
        objects,
        lights,
        environment,
        ..
    } = importer;
    let (camera, crop) = view.unwrap_or_else(|| {
        warnings.push(format!("{}: no sensor; the camera frames all there is", path.display()));
        (framing(-DVec3::ONE, DVec3::ONE), None)
    });
    let mut desc = SceneDesc {
        camera,
        crop,
        max_depth,
        environment,
        materials,
        textures,
        meshes,
        objects,
        lights,
        hash: hasher.finalize().to_hex().to_string(),
        warnings,
    };
    if sensors.is_empty()
        && let Some((low, high)) = origin::bounds(&desc)
    {
        desc.camera = framing(low, high);
    }
    Ok(desc)
}

/// What has been converted so far.
struct Importer<'a> {
    document: &'a Document,
    hasher: blake3::Hasher,
    warnings: Vec<String>,
    materials: Vec<(String, Material)>,
    materials_of_nodes: HashMap<usize, u32>,
    /// Of surfaces without one, and of lamps without one.
    default_materials: [Option<u32>; 2],
    /// What materials become on surfaces with mirrored texture coordinates, and what the textures of normal maps do.
    mirrored_materials: HashMap<u32, u32>,
    turned_textures: HashMap<u32, u32>,
    textures: Vec<Texture>,
    bitmaps: HashMap<(PathBuf, Role), u32>,
    meshes: Vec<Arc<TriangleMesh<DVec3>>>,
    meshes_of_keys: HashMap<MeshKey, Vec<usize>>,
    groups: HashMap<usize, Vec<ObjectDesc>>,
    objects: Vec<ObjectDesc>,
    lights: Vec<LightDesc>,
    environment: Option<EnvironmentDesc>,
}

impl Importer<'_> {
    /// Says what is approximated or left out.
    fn warn(&mut self, note: String) {
        self.warnings.push(note);
    }
}
