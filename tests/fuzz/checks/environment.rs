//! Image files: EXR (a layer of it as well) and Radiance HDR as the environment of a scene, PNG, JPEG and (whatever is none of these) TGA as a
//! texture.

use super::folder::Folder;
use embrace::image::{exr, hdr};
use std::path::Path;

const CAMERA: &str = "[camera]\nposition = [0, 1, 3]\nlook_at = [0, 0, 0]\nvfov = 50\nresolution = [4, 4]\n";
const ENVIRONMENT: &str = "[environment]\nfile = \"picture\"\nrotation_deg = 30\n[[meshes]]\nfile = \"mesh.obj\"\n";
const TEXTURE: &str = "[environment]\nradiance = [1, 1, 1]\n[materials.m]\ntype = \"diffuse\"\ntexture = \"picture.tga\"\n\
    [[meshes]]\nfile = \"mesh.obj\"\nmaterial = \"m\"\n";
const MESH: &str = "v -1 0 1\nv 1 0 1\nv 0 0 -1\nvt 0 0\nvt 1 0\nvt 0.5 1\nf 1/1 2/2 3/3\n";

thread_local! {
    static FOLDER: Folder = {
        let folder = Folder::new();
        folder.write("map.toml", [CAMERA, ENVIRONMENT].concat().as_bytes());
        folder.write("texture.toml", [CAMERA, TEXTURE].concat().as_bytes());
        folder.write("mesh.obj", MESH.as_bytes());
        folder
    };
}

pub(crate) fn check(data: &[u8]) {
    let is_map = exr::is_exr(data) || hdr::is_hdr(data);
    if exr::is_exr(data) {
        // Whole or an error; a scene reads the colours alone.
        if let Ok(layer) = exr::read_layer(data, Path::new("picture"), "albedo", ["R", "G", "B"]) {
            assert_eq!(layer.pixels.len(), layer.width as usize * layer.height as usize);
        }
    }
    let (name, scene) = if is_map {
        ("picture", "map.toml")
    } else {
        ("picture.tga", "texture.toml")
    };
    FOLDER.with(|folder| {
        folder.write(name, data);
        folder.check(scene);
    });
}
