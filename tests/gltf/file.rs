//! Small glTF files.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use embrace::scene::{LoadError, LoadOptions, SceneDesc, load};
use serde_json::{Value, json};
use std::fs;
use std::io::Cursor;
use std::path::Path;
use tempfile::TempDir;

pub(crate) const U8: u32 = 5121;
pub(crate) const I8: u32 = 5120;
pub(crate) const U16: u32 = 5123;
pub(crate) const I16: u32 = 5122;
pub(crate) const U32: u32 = 5125;
pub(crate) const F32: u32 = 5126;

/// A file in the making: its JSON, and the bytes of its one buffer.
#[derive(Clone, Debug)]
pub(crate) struct File {
    pub(crate) json: Value,
    pub(crate) bytes: Vec<u8>,
}

impl File {
    pub(crate) fn new() -> File {
        File {
            json: json!({ "asset": { "version": "2.0" } }),
            bytes: Vec::new(),
        }
    }

    /// A square from -1 to 1 in x and y that faces +z, in a node, with corners in the order of the picture's: top left, top
    /// right, bottom right, bottom left.
    pub(crate) fn square(material: Option<Value>) -> File {
        let mut file = File::new();
        let material = material.map(|material| file.add("materials", material));
        let mesh = file.square_mesh(material);
        file.add("nodes", json!({ "mesh": mesh }));
        file
    }

    pub(crate) fn square_mesh(&mut self, material: Option<usize>) -> usize {
        let attributes = json!({
            "POSITION": self.floats("VEC3", &[-1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, -1.0, 0.0, -1.0, -1.0, 0.0]),
            "NORMAL": self.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]),
            "TEXCOORD_0": self.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]),
        });
        let indices = self.accessor(&[0, 2, 1, 0, 3, 2], U8, "SCALAR", 6);
        let mut primitive = json!({ "attributes": attributes, "indices": indices });
        if let Some(material) = material {
            primitive["material"] = json!(material);
        }
        self.add("meshes", json!({ "primitives": [primitive] }))
    }

    /// Appends to a list of the root; the index in it.
    pub(crate) fn add(&mut self, list: &str, value: Value) -> usize {
        if self.json[list].is_null() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        self.add(
            "bufferViews",
            json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }),
        )
    }

    pub(crate) fn accessor(&mut self, bytes: &[u8], component: u32, shape: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.add(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "type": shape, "count": count }),
        )
    }

    pub(crate) fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let components = match shape {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, F32, shape, values.len() / components)
    }

    /// A texture of an image in the buffer.
    pub(crate) fn texture(&mut self, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let image = self.add("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        self.add("textures", json!({ "source": image }))
    }

    /// The JSON with the buffer as a data URI.
    pub(crate) fn text(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if !self.bytes.is_empty() {
            let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.bytes));
            json["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": uri }]);
        }
        json.to_string().into_bytes()
    }

    /// The same in one binary file.
    pub(crate) fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        glb(&[(b"JSON", json.to_string().as_bytes()), (b"BIN\0", &self.bytes)])
    }

    pub(crate) fn try_load(&self) -> Result<SceneDesc, LoadError> {
        in_folder(&[("scene.gltf", &self.text())], "scene.gltf", None)
    }

    #[track_caller]
    pub(crate) fn load(&self) -> SceneDesc {
        self.try_load().unwrap_or_else(|e| panic!("{e}"))
    }

    /// The scene with one camera and one light, so that nothing is to be said of their absence.
    #[track_caller]
    pub(crate) fn load_without_warnings(&self) -> SceneDesc {
        let mut file = self.clone();
        let camera = file.add(
            "cameras",
            json!({ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }),
        );
        file.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([{ "type": "point" }]);
        let lights = json!({ "KHR_lights_punctual": { "light": 0 } });
        file.add(
            "nodes",
            json!({ "camera": camera, "extensions": lights, "translation": [0, 0, 5] }),
        );
        let desc = file.load();
        assert_eq!(desc.warnings, [""; 0]);
        desc
    }

    /// The one warning beside those of a missing camera and light.
    #[track_caller]
    pub(crate) fn warning(&self) -> String {
        let desc = self.load();
        let mut warnings: Vec<String> = desc
            .warnings
            .into_iter()
            .filter(|w| !w.contains("has no camera") && !w.contains("has no light"))
            .collect();
        assert_eq!(warnings.len(), 1, "{warnings:?}");
        warnings.remove(0)
    }

    #[track_caller]
    pub(crate) fn error(&self) -> String {
        match self.try_load() {
            Ok(desc) => panic!("no error, but {} objects", desc.objects.len()),
            Err(error) => error.to_string(),
        }
    }
}

pub(crate) fn glb(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (kind, content) in chunks {
        let length = content.len().next_multiple_of(4);
        body.extend((length as u32).to_le_bytes());
        body.extend(*kind);
        body.extend(*content);
        body.resize(body.len() + length - content.len(), b' ');
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((body.len() as u32 + 12).to_le_bytes());
    file.extend(body);
    file
}

/// Loads one of some files that are in a folder together.
pub(crate) fn in_folder(files: &[(&str, &[u8])], scene: &str, camera: Option<&str>) -> Result<SceneDesc, LoadError> {
    let folder: TempDir = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in files {
        fs::write(folder.path().join(name), bytes).expect("a file in a temporary folder");
    }
    load(
        &Path::new(folder.path()).join(scene),
        LoadOptions {
            camera: camera.map(str::to_owned),
            ..LoadOptions::default()
        },
    )
}

/// A PNG of 2 x 2 texels, row by row from the top.
pub(crate) fn png(texels: [[u8; 4]; 4]) -> Vec<u8> {
    encode(
        &image::RgbaImage::from_fn(2, 2, |x, y| image::Rgba(texels[(2 * y + x) as usize])).into(),
        image::ImageFormat::Png,
    )
}

pub(crate) fn encode(image: &image::DynamicImage, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).expect("an image in memory");
    bytes.into_inner()
}
