//! Reading a scene: the scene file, and every mesh, material library and image that it uses.

use super::bitmap::{Bitmaps, load_texture};
use super::desc::{ObjectDesc, SceneDesc};
use super::environment::load_environment;
use super::file::{self, EnvironmentEntry, MeshEntry, SceneFile};
use super::framing::framing;
use super::gltf;
use super::input::{open, read_bytes, read_file};
use super::mitsuba;
use super::obj::{self, MapKind, MtlMaterial, ObjError, ObjPart, ObjScene};
use super::obj_material::{self, Converted};
use super::origin;
use super::ply::{self, PlyError};
use super::value::{Document, KeyError};
use super::warnings;
use crate::image::ImageError;
use crate::material::{Material, Scattering, Spectrum};
use crate::math::{DAffine3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use crate::texture::Texture;
use rayon::prelude::*;
use std::collections::HashMap;
use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// How to read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoadOptions {
    /// Whether what would be a warning is an error.
    pub strict: bool,
    /// Angle at an edge in degrees, below which faces of meshes without normals are smoothed: [`TriangleMesh::smooth`]. `None`
    /// leaves them flat.
    pub smooth_angle: Option<f64>,
    /// Name of the camera of a glTF file, or of its node; without, the first one. Other formats have one camera.
    pub camera: Option<String>,
    /// Names and values of a scene's parameters, which go before its own. Mitsuba scenes have such.
    pub defines: Vec<(String, String)>,
}

/// Why a scene cannot be read. Every message names the file.
#[derive(Debug, Error)]
pub enum LoadError {
    /// A file cannot be opened or read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// The extension is none of a scene.
    #[error("{}: not a scene; expected a .toml, .json, .gltf, .glb, .xml, .obj or .ply file", .0.display())]
    Format(PathBuf),
    /// The scene file is not well-formed.
    #[error("{}: {message}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What the parser says, with the line.
        message: String,
    },
    /// A key is unknown, missing, or has a wrong value.
    #[error("{}: {key}: {problem}", path.display())]
    Key {
        /// The file.
        path: PathBuf,
        /// Dotted path of the key.
        key: String,
        /// What is wrong and what to write instead.
        problem: String,
    },
    /// A mesh file is damaged.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// The same of a PLY file.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// An image file is damaged.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// There is a warning, and warnings were to be errors.
    #[error("{0} (an error because of --strict)")]
    Strict(String),
}

/// Reads a scene file (`.toml`, `.json`, `.gltf`, `.glb`, or `.xml` of Mitsuba 3) or a mesh on its own (`.obj`, `.ply`: the
/// camera frames its bounds, under a constant environment of radiance 1). Files are read in parallel on the current rayon pool.
///
/// # Errors
/// [`LoadError`] for anything that leaves no defined scene. What has a visible default is a warning in the description
/// instead, unless `options.strict`.
pub fn load(path: &Path, options: LoadOptions) -> Result<SceneDesc, LoadError> {
    let extension = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or("")
        .to_ascii_lowercase();
    if let Some((name, value)) = options.defines.first()
        && extension != "xml"
    {
        return Err(LoadError::Key {
            path: path.to_owned(),
            key: format!("-D {name}={value}"),
            problem: "only scenes of Mitsuba (.xml) have parameters; remove the option".into(),
        });
    }
    let mut desc = match extension.as_str() {
        "gltf" | "glb" => gltf::load(path, options.camera.as_deref())?,
        _ if options.camera.is_some() => {
            return Err(LoadError::Key {
                path: path.to_owned(),
                key: "--camera".into(),
                problem: "names a camera of a glTF file; other scenes have one camera".into(),
            });
        }
        "toml" | "json" => load_scene_file(path, extension == "toml")?,
        "obj" | "ply" => load_mesh_alone(path)?,
        "xml" => mitsuba::load(path, &options.defines)?,
        _ => return Err(LoadError::Format(path.to_owned())),
    };
    if let Some(degrees) = options.smooth_angle {
        smooth(&mut desc, degrees);
    }
    let unfit = warnings::of(&desc);
    desc.warnings.extend(unfit);
    match desc.warnings.first() {
        Some(warning) if options.strict => Err(LoadError::Strict(warning.clone())),
        _ => Ok(desc),
    }
}

/// Smooths meshes without normals, and tells the scene from the one that it was.
fn smooth(desc: &mut SceneDesc, degrees: f64) {
    for mesh in desc.meshes.iter_mut().filter(|mesh| mesh.normals.is_empty()) {
        Arc::make_mut(mesh).smooth(degrees);
    }
    let mut hasher = blake3::Hasher::new();
    hasher.update(desc.hash.as_bytes()).update(&degrees.to_le_bytes());
    desc.hash = hasher.finalize().to_hex().to_string();
}

fn load_scene_file(path: &Path, is_toml: bool) -> Result<SceneDesc, LoadError> {
    // May be a pipe: who names it waits for it.
    let bytes = fs::read(path).map_err(|source| LoadError::Read {
        path: path.to_owned(),
        source,
    })?;
    let syntax = |message: String| LoadError::Syntax {
        path: path.to_owned(),
        message,
    };
    let text = std::str::from_utf8(&bytes).map_err(|e| syntax(format!("not UTF-8 text: {e}")))?;
    let value: serde_json::Value = if is_toml {
        toml::from_str(text).map_err(|e| syntax(e.to_string().trim_end().to_owned()))?
    } else {
        let Document(value) = serde_json::from_str(text).map_err(|e| syntax(e.to_string()))?;
        value
    };
    let base = path.parent().unwrap_or(Path::new(""));
    let file = file::parse(&value, base).map_err(|KeyError { key, problem }| LoadError::Key {
        path: path.to_owned(),
        key,
        problem,
    })?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes);
    assemble(file, base, hasher)
}

fn load_mesh_alone(path: &Path) -> Result<SceneDesc, LoadError> {
    let name = path
        .file_name()
        .map(|n| n.to_string_lossy().into_owned())
        .unwrap_or_default();
    let file = SceneFile {
        camera: framing(DVec3::ZERO, DVec3::ONE),
        crop: None,
        max_depth: None,
        environment: Some(EnvironmentEntry::Constant(Rgb::WHITE)),
        materials: Vec::new(),
        bitmaps: Bitmaps::default(),
        lights: Vec::new(),
        meshes: vec![MeshEntry {
            file: name,
            material: None,
            to_world: DAffine3::IDENTITY,
            emission: None,
        }],
    };
    let mut desc = assemble(file, path.parent().unwrap_or(Path::new("")), blake3::Hasher::new())?;
    if let Some((low, high)) = origin::bounds(&desc) {
        desc.camera = framing(low, high);
    }
    Ok(desc)
}

/// Passes bytes on and hashes them.
pub(super) struct Hashing<R> {
    inner: R,
    hasher: blake3::Hasher,
}

impl<R> Hashing<R> {
    pub(super) fn new(inner: R) -> Hashing<R> {
        let hasher = blake3::Hasher::new();
        Hashing { inner, hasher }
    }

    pub(super) fn finish(&self) -> blake3::Hash {
        self.hasher.finalize()
    }
}

impl<R: Read> Read for Hashing<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.hasher.update(&buffer[..count]);
        Ok(count)
    }
}

/// An OBJ file and the hash over it and its material libraries.
fn read_obj(path: &Path) -> Result<(ObjScene, blake3::Hash), LoadError> {
    let file = open(path).map_err(|source| LoadError::Read {
        path: path.to_owned(),
        source,
    })?;
    let mut reader = Hashing::new(file);
    let mut libraries = blake3::Hasher::new();
    let base = path.parent().unwrap_or(Path::new(""));
    let scene = obj::read(path, &mut reader, |name| {
        let bytes = read_bytes(&base.join(name))?;
        libraries.update(&bytes);
        Ok(bytes)
    })?;
    reader.hasher.update(libraries.finalize().as_bytes());
    Ok((scene, reader.hasher.finalize()))
}

/// A mesh file and the hash over all that belongs to it.
fn read_mesh(path: &Path) -> Result<(ObjScene, blake3::Hash), LoadError> {
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) {
        return read_obj(path);
    }
    let bytes = read_file(path)?;
    let (hash, read) = rayon::join(|| blake3::hash(&bytes), || ply::read(path, &bytes));
    drop(bytes);
    let mut ply = read?;
    let warnings = std::mem::take(&mut ply.warnings);
    let mesh = ply.into_mesh().ok_or_else(|| LoadError::Key {
        path: path.to_owned(),
        key: "element face".into(),
        problem: "there are too many faces to give each vertices of its own; give vertices colours instead".into(),
    })?;
    let part = ObjPart {
        material_name: None,
        material: None,
        mesh,
    };
    let scene = ObjScene {
        parts: vec![part],
        materials: Vec::new(),
        warnings,
    };
    Ok((scene, hash))
}

/// Makes colours of a surface reflect no more than there is, and says how many did not.
fn sanitise_colors(mesh: &mut TriangleMesh<DVec3>, path: &Path) -> Option<String> {
    let mut above = 0;
    for color in &mut mesh.colors {
        let clamped = color.map(|c| c.min(1.0));
        above += u64::from(clamped != *color);
        *color = clamped;
    }
    (above > 0).then(|| {
        format!(
            "{}: {above} vertex colours are above 1 and are set to 1",
            path.display()
        )
    })
}

/// Whether a material, or one that it refers to, has vertex colours somewhere.
fn shows_vertex_colors(materials: &[(String, Material)], first: usize) -> bool {
    let mut found = vec![first];
    let mut next = 0;
    while let Some(&index) = found.get(next) {
        let material = &materials[index].1;
        let mut has_any = false;
        material.visit_spectra(&mut |spectrum| has_any |= matches!(spectrum, Spectrum::VertexColor(..)));
        if has_any {
            return true;
        }
        for part in material.parts().map(|part| part as usize) {
            if !found.contains(&part) {
                found.push(part);
            }
        }
        next += 1;
    }
    false
}

/// A material of a mesh file, and the bitmaps it asks for, by [`MapKind`].
struct MtlUse<'a> {
    mtl: &'a MtlMaterial,
    file: &'a Path,
    bitmaps: [Option<usize>; MapKind::ALL.len()],
    is_colored: bool,
}

fn assemble(file: SceneFile, base: &Path, mut hasher: blake3::Hasher) -> Result<SceneDesc, LoadError> {
    let mut warnings = Vec::new();

    // Mesh files, each once.
    let mut obj_paths: Vec<PathBuf> = Vec::new();
    let mut obj_of_entry = Vec::with_capacity(file.meshes.len());
    let mut obj_index: HashMap<&str, usize> = HashMap::new();
    for entry in &file.meshes {
        obj_of_entry.push(*obj_index.entry(&entry.file).or_insert_with(|| {
            obj_paths.push(base.join(&entry.file));
            obj_paths.len() - 1
        }));
    }
    let (environment, objs) = rayon::join(
        || file.environment.as_ref().map(|e| load_environment(e, base)).transpose(),
        || {
            obj_paths
                .par_iter()
                .map(|path| read_mesh(path))
                .collect::<Result<Vec<_>, _>>()
        },
    );
    let (environment, objs) = (environment?, objs?);
    let mut objs: Vec<ObjScene> = objs
        .into_iter()
        .map(|(mut obj, hash)| {
            hasher.update(hash.as_bytes());
            warnings.append(&mut obj.warnings);
            obj
        })
        .collect();

    for (entry, &obj) in file.meshes.iter().zip(&obj_of_entry) {
        if entry
            .material
            .is_none_or(|material| shows_vertex_colors(&file.materials, material))
        {
            let parts = &mut objs[obj].parts;
            warnings.extend(
                parts
                    .iter_mut()
                    .filter_map(|part| sanitise_colors(&mut part.mesh, &obj_paths[obj])),
            );
        }
    }

    // Bitmaps of the scene file, then those that materials of mesh files in use want.
    let mut bitmaps = file.bitmaps;
    let required = bitmaps.wanted.len();
    let mut mtl_index: HashMap<(usize, usize), usize> = HashMap::new();
    let mut mtl_used: Vec<MtlUse<'_>> = Vec::new();
    let mut seen_instead = HashMap::new();
    for (entry, &obj) in file.meshes.iter().zip(&obj_of_entry) {
        for material in objs[obj]
            .parts
            .iter()
            .filter_map(|part| part.material)
            .filter(|_| entry.material.is_none())
        {
            mtl_index.entry((obj, material)).or_insert_with(|| {
                let mtl = &objs[obj].materials[material];
                let library = obj_paths[obj].with_file_name(&mtl.library);
                let directory = library.parent().unwrap_or(Path::new(""));
                let bitmaps = MapKind::ALL.map(|kind| {
                    let map = mtl.map(kind)?;
                    let bitmap = bitmaps.want(directory.join(&map.file), obj_material::role(kind, map));
                    seen_instead.entry(bitmap).or_insert(obj_material::without(kind));
                    Some(bitmap)
                });
                let of_this = |part: &&ObjPart| part.material == Some(material);
                mtl_used.push(MtlUse {
                    mtl,
                    file: &obj_paths[obj],
                    bitmaps,
                    is_colored: objs[obj]
                        .parts
                        .iter()
                        .filter(of_this)
                        .any(|part| !part.mesh.colors.is_empty()),
                });
                mtl_used.len() - 1
            });
        }
    }

    // Decode the bitmaps; those of the scene file must be there, those of material libraries have a default.
    let decoded: Vec<Result<(Texture, blake3::Hash), LoadError>> = bitmaps
        .wanted
        .par_iter()
        .map(|(path, role)| load_texture(path, *role))
        .collect();
    let mut textures = Vec::new();
    let mut texture_of_bitmap = Vec::with_capacity(decoded.len());
    for (bitmap, result) in decoded.into_iter().enumerate() {
        texture_of_bitmap.push(match result {
            Ok((texture, hash)) => {
                hasher.update(hash.as_bytes());
                textures.push(texture);
                Some(textures.len() as u32 - 1)
            }
            Err(error) if bitmap < required => return Err(error),
            Err(error) => {
                let instead = seen_instead.get(&bitmap).copied().unwrap_or_default();
                warnings.push(format!("{error}; {instead}"));
                None
            }
        });
    }

    // Materials: the named ones, then those of the mesh files, then a default for parts without one. Bitmaps of the scene
    // file are all there, so that their indices are those of the textures.
    let mut materials = file.materials;
    let first_mtl = materials.len();
    let mut mtl_emission = Vec::with_capacity(mtl_used.len());
    for used in &mtl_used {
        let bitmaps = used.bitmaps.map(|bitmap| texture_of_bitmap[bitmap?]);
        let Converted {
            material,
            emission,
            emission_map,
            notes,
        } = obj_material::convert(used.mtl, bitmaps, &textures, used.is_colored);
        let (file, name) = (used.file.display(), &used.mtl.name);
        warnings.extend(notes.iter().map(|note| format!("{file}: material {name}: {note}")));
        materials.push((name.clone(), material));
        mtl_emission.push((emission, emission_map));
    }
    drop(mtl_used);

    // Objects: one per part of each mesh entry.
    let mut default_materials = [None; 2];
    let mut part_base = Vec::with_capacity(objs.len());
    let mut meshes: Vec<Arc<TriangleMesh<DVec3>>> = Vec::new();
    let mut parts: Vec<Vec<Option<usize>>> = Vec::with_capacity(objs.len());
    for obj in &mut objs {
        part_base.push(meshes.len());
        parts.push(obj.parts.iter().map(|part| part.material).collect());
        meshes.extend(obj.parts.drain(..).map(|part| Arc::new(part.mesh)));
    }
    let mut objects = Vec::new();
    for (i, (entry, &obj)) in file.meshes.iter().zip(&obj_of_entry).enumerate() {
        for (part, part_material) in parts[obj].iter().enumerate() {
            let from_mtl = part_material.and_then(|m| mtl_index.get(&(obj, m)).copied());
            let (material, mtl_emission) = match (entry.material, from_mtl) {
                (Some(named), _) => (named, (None, None)),
                (None, Some(mtl)) => (first_mtl + mtl, mtl_emission[mtl]),
                (None, None) => {
                    let is_colored = !meshes[part_base[obj] + part].colors.is_empty();
                    let (name, material) = &DEFAULT_MATERIALS[usize::from(is_colored)];
                    let index = *default_materials[usize::from(is_colored)].get_or_insert_with(|| {
                        materials.push(((*name).into(), material.clone()));
                        materials.len() - 1
                    });
                    (index, (None, None))
                }
            };
            objects.push(ObjectDesc {
                name: format!("meshes[{i}] ({})", entry.file),
                mesh: part_base[obj] + part,
                material,
                to_world: entry.to_world,
                emission: entry.emission.map(|(emission, _)| emission).or(mtl_emission.0),
                emission_map: match entry.emission {
                    Some((_, map)) => map,
                    None => mtl_emission.1,
                },
            });
        }
    }

    let environment = environment.map(|(environment, hash, mut notes)| {
        hasher.update(hash.as_bytes());
        warnings.append(&mut notes);
        environment
    });
    Ok(SceneDesc {
        camera: file.camera,
        crop: file.crop,
        max_depth: file.max_depth,
        environment,
        materials,
        textures,
        meshes,
        objects,
        lights: file.lights,
        hash: hasher.finalize().to_hex().to_string(),
        warnings,
    })
}

/// Parts of mesh files for which nobody names a material: those without vertex colours, and those with them.
const DEFAULT_MATERIALS: [(&str, Material); 2] = [
    ("default", diffuse(Spectrum::Constant(Rgb::splat(0.5)))),
    ("vertex colours", diffuse(Spectrum::VertexColor(None, Rgb::WHITE))),
];

const fn diffuse(reflectance: Spectrum) -> Material {
    Material::new(Scattering::Diffuse { reflectance })
}
