//! The outside of a file: JSON alone, or JSON and bytes in one (GLB), and what its extensions ask for.

use super::super::load::LoadError;
use super::{Notes, key_error};
use gltf::json::mesh::Semantic;
use gltf::json::validation::{Checked, Error as Fault, Validate};
use gltf::json::{self, Root};
use serde::Deserialize;
use std::path::Path;

/// Extensions that are honoured, [`APPROXIMATED`] apart.
const SUPPORTED: [&str; 9] = [
    "KHR_lights_punctual",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// The extension of which the essence is shown; materials that use more are named in warnings.
const APPROXIMATED: &str = "KHR_materials_volume";

/// Placement of a node, in 64 bits: the types of the crate have 32.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct Placement {
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

/// The JSON of a file.
pub(super) struct Document {
    pub(super) root: Root,
    /// One for each node.
    pub(super) placements: Vec<Placement>,
}

/// The JSON and, of a GLB, the bytes.
pub(super) fn split<'a>(path: &Path, bytes: &'a [u8]) -> Result<(&'a [u8], Option<&'a [u8]>), LoadError> {
    let error = |message: String| LoadError::Syntax {
        path: path.to_owned(),
        message,
    };
    let Some(header) = bytes.strip_prefix(b"glTF") else {
        return Ok((bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None));
    };
    let word = |at: usize| {
        let bytes = header.get(at..at + 4)?;
        Some(u32::from_le_bytes(bytes.try_into().ok()?))
    };
    let (Some(version), Some(length)) = (word(0), word(4)) else {
        return Err(error(
            "the GLB header is cut short; copy or export the file again".into(),
        ));
    };
    if version != 2 {
        return Err(error(format!(
            "the file is GLB version {version}; only version 2 is read: export it as glTF 2.0"
        )));
    }
    let whole = bytes
        .get(12..length as usize)
        .ok_or_else(|| error(cut_short("the file", length.into(), bytes.len())))?;
    let mut chunks = Chunks { rest: whole, error };
    let json = match chunks.next()? {
        Some((b"JSON", json)) => json,
        _ => return Err(chunks.fault("the first chunk of the GLB is not JSON")),
    };
    // The format says to skip kinds that are not known.
    while let Some((kind, content)) = chunks.next()? {
        if kind == b"BIN\0" {
            return Ok((json, Some(content)));
        }
    }
    Ok((json, None))
}

fn cut_short(what: &str, says: u64, there: usize) -> String {
    format!("{what} says it has {says} bytes, but {there} are there; copy or export the file again")
}

/// Kind and content.
type Chunk<'a> = (&'a [u8; 4], &'a [u8]);

/// The chunks of a GLB.
struct Chunks<'a, F> {
    rest: &'a [u8],
    error: F,
}

impl<'a, F: Fn(String) -> LoadError> Chunks<'a, F> {
    fn next(&mut self) -> Result<Option<Chunk<'a>>, LoadError> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let Some((head, rest)) = self.rest.split_first_chunk::<8>() else {
            return Err(self.fault("a chunk of the GLB has no header"));
        };
        let ([l0, l1, l2, l3, kind @ ..], length) = (head, rest.len());
        let says = u32::from_le_bytes([*l0, *l1, *l2, *l3]);
        let Some((content, rest)) = rest.split_at_checked(says as usize) else {
            return Err((self.error)(cut_short("a chunk of the GLB", says.into(), length)));
        };
        self.rest = rest;
        Ok(Some((kind, content)))
    }

    fn fault(&self, message: &str) -> LoadError {
        (self.error)(format!("{message}; export the file again"))
    }
}

/// Reads the JSON, and checks what refers to what, and which extensions are asked for.
pub(super) fn parse(path: &Path, text: &[u8], notes: &mut Notes) -> Result<Document, LoadError> {
    #[derive(Deserialize)]
    struct Versioned {
        asset: Asset,
    }
    #[derive(Deserialize)]
    struct Asset {
        version: String,
        #[serde(rename = "minVersion")]
        least: Option<String>,
    }
    #[derive(Deserialize)]
    struct Nodes {
        #[serde(default)]
        nodes: Vec<Placement>,
    }
    let syntax = |error: serde_json::Error| LoadError::Syntax {
        path: path.to_owned(),
        message: format!("not the JSON of glTF: {error}"),
    };
    // First, so that other versions are not refused for a detail.
    let Versioned { asset } = serde_json::from_slice(text).map_err(syntax)?;
    let version = asset.least.as_ref().unwrap_or(&asset.version);
    if !(asset.version.starts_with("2.") && version.starts_with("2.")) {
        return Err(key_error(
            path,
            "asset.version",
            format!("{version:?} is not read; export the file as glTF 2.0"),
        ));
    }
    let root: Root = serde_json::from_slice(text).map_err(syntax)?;
    let Nodes { nodes } = serde_json::from_slice(text).map_err(syntax)?;
    check_extensions(path, &root, notes)?;
    check_references(path, &root)?;
    if !root.animations.is_empty() {
        notes.add("animations are ignored: everything is where the nodes place it", "");
    }
    Ok(Document {
        root,
        placements: nodes,
    })
}

fn check_extensions(path: &Path, root: &Root, notes: &mut Notes) -> Result<(), LoadError> {
    for (i, name) in root.extensions_required.iter().enumerate() {
        // What must be there to show the file must be right as well.
        if !SUPPORTED.contains(&name.as_str()) {
            return Err(key_error(
                path,
                format!("extensionsRequired[{i}]"),
                format!(
                    "{name} is not supported, and the file says that it cannot be shown without; export it without. \
                     Supported are {}",
                    SUPPORTED.join(", ")
                ),
            ));
        }
    }
    for name in &root.extensions_used {
        if !SUPPORTED.contains(&name.as_str()) && name != APPROXIMATED {
            notes.add(format!("the extension {name} is not supported and is ignored"), "");
        }
    }
    Ok(())
}

/// Checks every index, and that everything is there that must be.
fn check_references(path: &Path, root: &Root) -> Result<(), LoadError> {
    // The validation that follows relies on these before it has checked them.
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let positions = primitive.attributes.get(&Checked::Valid(Semantic::Positions));
            if positions.is_some_and(|index| index.value() >= root.accessors.len()) {
                return Err(key_error(
                    path,
                    format!("meshes[{m}].primitives[{p}].attributes.POSITION"),
                    "there is no accessor of that index",
                ));
            }
        }
    }
    let mut first = None;
    root.validate(root, json::Path::new, &mut |place, fault| {
        if first.is_none() {
            let place = place().to_string();
            if !is_harmless(&place, fault) {
                first = Some((place, fault));
            }
        }
    });
    match first {
        None => Ok(()),
        Some((place, fault)) => Err(key_error(
            path,
            place,
            match fault {
                Fault::IndexOutOfBounds => "there is nothing of that index",
                Fault::Invalid => "the value is none that glTF 2.0 has",
                Fault::Missing => "is missing; glTF 2.0 requires it",
                Fault::Oversize => "is larger than memory can be",
                Fault::Unsupported => "is not supported",
            },
        )),
    }
}

/// What the crate objects to although nothing depends on it, the format allows it, or it is checked elsewhere.
fn is_harmless(place: &str, fault: Fault) -> bool {
    // Extremes of positions, which some exporters leave out, and the positions themselves.
    place.ends_with(".min")
        || place.ends_with(".max")
        || place.ends_with("attributes[\"POSITION\"]") && fault == Fault::Missing
        // An accessor without a view is all zeros.
        || place.starts_with("accessors[") && place.ends_with("].bufferView") && fault == Fault::Missing
        || place.ends_with("[\"<invalid semantic name>\"]")
        || fault == Fault::Unsupported
}
