//! Shapes: meshes of files, and flat and curved shapes as triangles.

use super::super::build::is_invertible;
use super::super::desc::ObjectDesc;
use super::super::input::{open, read_file};
use super::super::load::{Hashing, LoadError};
use super::super::{obj, ply};
use super::bsdf::one_sided;
use super::document::{Tag, Value};
use super::mirrored::is_mirrored;
use super::props::Props;
use super::{Importer, serialized, tessellate};
use crate::material::{Scattering, Spectrum};
use crate::math::{DAffine3, DMat3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const SUPPORTED: &str = "obj, ply, serialized, rectangle, cube, sphere, disk, cylinder, shapegroup and instance";

/// What a mesh is made from: shapes with the same share it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct MeshKey {
    source: Source,
    is_flipped: bool,
    /// What the scene says about it.
    has_face_normals: Option<bool>,
    /// The attribute that is kept as colours.
    attribute: Option<String>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Source {
    Rectangle,
    Cube,
    Sphere,
    Disk,
    Cylinder,
    Obj { path: PathBuf, flips_v: bool },
    Ply { path: PathBuf, flips_v: bool },
    Serialized { path: PathBuf, index: u32 },
}

impl Importer<'_> {
    /// A shape of the scene itself.
    pub(super) fn shape(&mut self, node: usize) -> Result<(), LoadError> {
        let mut props = Props::new(self.document, node);
        match props.node.plugin.as_str() {
            // It is where its instances are.
            "shapegroup" => {
                self.group(node)?;
                Ok(())
            }
            "instance" => {
                let to_world = props.take_to_world()?;
                let group = props.child(Tag::Shape)?;
                let is_group = |&group: &usize| self.document.nodes[group].plugin == "shapegroup";
                let group = group
                    .filter(is_group)
                    .ok_or_else(|| props.error("refers to no shapegroup"))?;
                let name = self.name_of(node);
                for object in self.group(group)? {
                    let to_world = to_world * object.to_world;
                    if !is_invertible(&to_world) {
                        return Err(props.error("has a size that 64-bit numbers cannot hold"));
                    }
                    self.objects.push(ObjectDesc {
                        name: format!("{name}: {}", object.name),
                        to_world,
                        ..object
                    });
                }
                props.finish()
            }
            _ => {
                let objects = self.simple_shape(node)?;
                self.objects.extend(objects);
                Ok(())
            }
        }
    }

    /// What stands in a group, where it stands there.
    fn group(&mut self, node: usize) -> Result<Vec<ObjectDesc>, LoadError> {
        if let Some(objects) = self.groups.get(&node) {
            return Ok(objects.clone());
        }
        let mut props = Props::new(self.document, node);
        props.ignore(&["to_world"]);
        let mut objects = Vec::new();
        for shape in props.children(Tag::Shape) {
            if ["shapegroup", "instance"].contains(&self.document.nodes[shape].plugin.as_str()) {
                return Err(Props::new(self.document, shape).error("cannot stand within a shapegroup"));
            }
            let parts = self.simple_shape(shape)?;
            if parts.iter().any(|object| object.emission.is_some()) {
                return Err(Props::new(self.document, shape).error("emits light, which nothing in a shapegroup may"));
            }
            objects.extend(parts);
        }
        props.finish()?;
        self.groups.insert(node, objects.clone());
        Ok(objects)
    }

    fn name_of(&self, node: usize) -> String {
        let node = &self.document.nodes[node];
        let place = self.document.describe(node.place);
        match node.id.as_str() {
            "" => format!("{place}: {}", node.plugin),
            id => format!("{place}: {} \"{id}\"", node.plugin),
        }
    }

    fn simple_shape(&mut self, node: usize) -> Result<Vec<ObjectDesc>, LoadError> {
        let mut props = Props::new(self.document, node);
        let mut to_world = props.take_to_world()?;
        let mut is_flipped = props.boolean("flip_normals", false)?;
        // For derivatives of images.
        props.ignore(&["silhouette_sampling_weight"]);
        let emitter = props.child(Tag::Emitter)?;
        let bsdf = props.child(Tag::Bsdf)?;
        let source = match props.node.plugin.as_str() {
            "rectangle" => Source::Rectangle,
            "cube" => Source::Cube,
            "disk" => Source::Disk,
            "sphere" => {
                let center = props.vector("center")?.unwrap_or(DVec3::ZERO);
                let radius = props.float_in("radius", 1.0, f64::MIN_POSITIVE..)?;
                to_world *= DAffine3::from_scale_rotation_translation(DVec3::splat(radius), Default::default(), center);
                Source::Sphere
            }
            "cylinder" => {
                let p0 = props.vector("p0")?.unwrap_or(DVec3::ZERO);
                let p1 = props.vector("p1")?.unwrap_or(DVec3::Z);
                let radius = props.float_in("radius", 1.0, f64::MIN_POSITIVE..)?;
                let axis = (p1 - p0).try_normalize();
                let axis = axis.ok_or_else(|| props.error("has p0 and p1 at the same point"))?;
                let scale = DMat3::from_diagonal(DVec3::new(radius, radius, (p1 - p0).length()));
                to_world *= DAffine3::from_mat3_translation(frame(axis) * scale, p0);
                Source::Cylinder
            }
            plugin @ ("obj" | "ply" | "serialized") => {
                let filename = props.string("filename")?;
                let filename = filename.ok_or_else(|| props.error("has no <string name=\"filename\">"))?;
                let path = self.document.file(filename);
                match plugin {
                    "obj" => Source::Obj {
                        path,
                        flips_v: props.boolean("flip_tex_coords", true)?,
                    },
                    "ply" => Source::Ply {
                        path,
                        flips_v: props.boolean("flip_tex_coords", false)?,
                    },
                    _ => {
                        let index = props.integer("shape_index")?.unwrap_or(0);
                        let index = u32::try_from(index)
                            .map_err(|_| props.error(format!("has a shape_index of {index}; expected 0 or more")))?;
                        Source::Serialized { path, index }
                    }
                }
            }
            _ => return Err(props.error(format!("is not supported; supported shapes: {SUPPORTED}"))),
        };
        if !is_invertible(&to_world) {
            return Err(props.error("has a size that 64-bit numbers cannot hold"));
        }
        if matches!(source, Source::Sphere | Source::Cylinder) && to_world.matrix3.determinant() < 0.0 {
            // A mirror turns these inside out, and no others.
            is_flipped = !is_flipped;
        }
        let has_file = matches!(
            source,
            Source::Obj { .. } | Source::Ply { .. } | Source::Serialized { .. }
        );
        let says = props
            .node
            .properties
            .iter()
            .any(|property| property.name == "face_normals");
        let has_face_normals = match says && (has_file || source == Source::Cube) {
            true => Some(props.boolean("face_normals", false)?),
            false => None,
        };
        let key = MeshKey {
            source,
            is_flipped,
            has_face_normals,
            attribute: self.attribute(node)?,
        };
        let meshes = self.meshes_of(&props, key)?;
        let (emission, emission_map) = match emitter {
            None => (None, None),
            Some(emitter) => {
                let (emission, map) = self.area(emitter)?;
                (Some(emission), map)
            }
        };
        let material = match bsdf {
            Some(bsdf) => self.material(bsdf, 0)?,
            None => self.default_material(emission.is_some()),
        };
        props.finish()?;
        let name = self.name_of(node);
        let mut objects = Vec::new();
        for mesh in meshes {
            let is_mirrored = is_mirrored(&self.meshes[mesh]) != (to_world.matrix3.determinant() < 0.0);
            let material = if is_mirrored {
                self.for_mirrored(material)
            } else {
                material
            };
            objects.push(ObjectDesc {
                name: name.clone(),
                mesh,
                material: material as usize,
                to_world,
                emission,
                emission_map,
            });
        }
        Ok(objects)
    }

    /// What surfaces without a BSDF are made of: lamps reflect nothing.
    fn default_material(&mut self, emits: bool) -> u32 {
        if let Some(material) = self.default_materials[usize::from(emits)] {
            return material;
        }
        let (name, albedo) = if emits { ("lamp", 0.0) } else { ("default", 0.5) };
        let reflectance = Spectrum::Constant(Rgb::splat(albedo));
        let material = self.add_material(name.into(), one_sided(Scattering::Diffuse { reflectance }));
        self.default_materials[usize::from(emits)] = Some(material);
        material
    }

    /// The mesh attribute that the materials or the emitter of a shape ask for.
    fn attribute(&self, shape: usize) -> Result<Option<String>, LoadError> {
        let mut found: Option<&str> = None;
        let mut seen = HashSet::new();
        let mut ahead = vec![shape];
        while let Some(node) = ahead.pop() {
            if !seen.insert(node) {
                continue;
            }
            let node = &self.document.nodes[node];
            for property in &node.properties {
                match &property.value {
                    Value::Object(child) => ahead.push(*child),
                    Value::String(name) if node.plugin == "mesh_attribute" && property.name == "name" => {
                        if found.is_some_and(|found| found != name) {
                            let problem = "uses more than one mesh attribute, which is not supported";
                            return Err(Props::new(self.document, shape).error(problem));
                        }
                        found = Some(name);
                    }
                    _ => {}
                }
            }
        }
        Ok(found.map(str::to_owned))
    }

    /// The meshes of a shape, each of which is made once.
    fn meshes_of(&mut self, props: &Props, key: MeshKey) -> Result<Vec<usize>, LoadError> {
        if let Some(meshes) = self.meshes_of_keys.get(&key) {
            return Ok(meshes.clone());
        }
        let mut loaded = match &key.source {
            Source::Rectangle => vec![tessellate::rectangle()],
            Source::Cube => vec![tessellate::cube()],
            Source::Sphere => vec![tessellate::sphere()],
            Source::Disk => vec![tessellate::disk()],
            Source::Cylinder => vec![tessellate::cylinder()],
            Source::Obj { path, flips_v } => self.load_obj(&key, path, *flips_v)?,
            Source::Ply { path, flips_v } => self.load_ply(props, &key, path, *flips_v)?,
            Source::Serialized { path, index } => {
                let (serialized, hash) = serialized::read(path, *index)?;
                self.hasher.update(hash.as_bytes());
                let mut mesh = serialized.mesh;
                // The scene's word goes before the file's.
                shade(
                    &mut mesh,
                    key.has_face_normals.unwrap_or(serialized.has_face_normals),
                    false,
                );
                vec![mesh]
            }
        };
        if key.source == Source::Cube && key.has_face_normals == Some(true) {
            loaded.iter_mut().for_each(|mesh| mesh.normals.clear());
        }
        if let Some(name) = &key.attribute
            && loaded.iter().any(|mesh| mesh.colors.is_empty())
        {
            return Err(props.error(format!(
                "has no mesh attribute \"{name}\", which its material asks for; only ply shapes have such"
            )));
        }
        let mut meshes = Vec::new();
        for mut mesh in loaded {
            if key.is_flipped {
                tessellate::flip(&mut mesh);
            }
            self.meshes.push(Arc::new(mesh));
            meshes.push(self.meshes.len() - 1);
        }
        self.meshes_of_keys.insert(key, meshes.clone());
        Ok(meshes)
    }

    fn load_obj(&mut self, key: &MeshKey, path: &Path, flips_v: bool) -> Result<Vec<TriangleMesh<DVec3>>, LoadError> {
        let file = open(path).map_err(|source| LoadError::Read {
            path: path.to_owned(),
            source,
        })?;
        let mut reader = Hashing::new(file);
        // Its own materials have no meaning here.
        let scene = obj::read(path, &mut reader, |_| Ok(Vec::new()))?;
        self.hasher.update(reader.finish().as_bytes());
        let warnings = scene.warnings.into_iter();
        self.warnings
            .extend(warnings.filter(|warning| !warning.contains("material")));
        let finished = |part: obj::ObjPart| {
            let mut mesh = part.mesh;
            // Colours of vertices are attributes, which only PLY files have there.
            mesh.colors.clear();
            if flips_v {
                flip_v(&mut mesh);
            }
            shade(&mut mesh, key.has_face_normals == Some(true), true);
            mesh
        };
        Ok(scene.parts.into_iter().map(finished).collect())
    }

    fn load_ply(
        &mut self,
        props: &Props,
        key: &MeshKey,
        path: &Path,
        flips_v: bool,
    ) -> Result<Vec<TriangleMesh<DVec3>>, LoadError> {
        let bytes = read_file(path)?;
        self.hasher.update(blake3::hash(&bytes).as_bytes());
        let mut ply = ply::read(path, &bytes)?;
        self.warnings.append(&mut ply.warnings);
        if flips_v {
            flip_v(&mut ply.mesh);
        }
        shade(&mut ply.mesh, key.has_face_normals == Some(true), false);
        let Some(name) = &key.attribute else {
            return Ok(vec![ply.mesh]);
        };
        let names: Vec<String> = ply.attributes.iter().map(|attribute| attribute.name.clone()).collect();
        let mesh = ply.into_mesh_colored_by(name).ok_or_else(|| {
            let has = if names.is_empty() {
                "none".to_owned()
            } else {
                names.join(", ")
            };
            props.error(format!(
                "has no mesh attribute \"{name}\", which its material asks for; its file has {has}"
            ))
        })?;
        Ok(vec![mesh])
    }
}

fn flip_v(mesh: &mut TriangleMesh<DVec3>) {
    mesh.uvs.iter_mut().for_each(|uv| uv.y = 1.0 - uv.y);
}

/// Gives a mesh the normals that it is to have: none, or smooth ones, by place or by vertex, where it brings none.
fn shade(mesh: &mut TriangleMesh<DVec3>, has_face_normals: bool, by_place: bool) {
    if has_face_normals {
        mesh.normals.clear();
    } else if mesh.normals.is_empty() {
        if by_place {
            mesh.smooth(180.0);
        } else {
            mesh.smooth_by_vertex();
        }
    }
}

/// Two directions at right angles to a third (Duff and others 2017, "Building an Orthonormal Basis, Revisited").
fn frame(n: DVec3) -> DMat3 {
    let sign = 1f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    DMat3::from_cols(
        DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        DVec3::new(b, sign + n.y * n.y * a, -n.y),
        n,
    )
}
