//! Scene files, TOML or, where they begin with a brace, JSON. Zero bytes separate files: the scene, the mesh it may name
//! (`mesh.obj`) and the material library of that; the ones of a small scene stand in for those left out.

use super::folder::Folder;
use super::obj::split;
use std::io::Cursor;

pub(super) const MESH: &str = "mtllib mesh.mtl\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 1 0\n\
    usemtl paint\nf 1/1/1 2/2/1 3/3/1\nf 1//1 3//1 4//1\nusemtl glass\nf 1 2 5\n";
const LIBRARY: &str =
    "newmtl paint\nKd 0.5 0.4 0.3\nmap_Kd tiles.png\nmap_d tiles.png\nnewmtl glass\nillum 7\nNi 1.5\nKe 1 1 1\n";

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float u\nproperty float v\nproperty float red\nproperty float green\nproperty float blue\nelement face 1\n\
    property list uchar uint vertex_indices\nend_header\n-1 0 1 0 0 1 0 0\n1 0 1 1 0 0 1 0\n1 0 -1 1 1 0 0 1\n\
    -1 0 -1 0 1 1 1 1\n4 0 1 2 3\n";

thread_local! {
    /// One for all calls: three of its files never change.
    static FOLDER: Folder = {
        let folder = Folder::new();
        folder.write("tiles.png", &tiles());
        folder.write("mesh.ply", PLY.as_bytes());
        folder.write("sky.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n\x80\x80\x80\x80\x40\x80\xff\x81\x10\x20\x30\x80\xff\x00\x00\x8a");
        folder
    };
}

pub(super) fn tiles() -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image::RgbaImage::from_fn(3, 2, |x, y| {
        image::Rgba([80 * x as u8, 200 * y as u8, 90, 100 + 70 * x as u8])
    })
    .write_to(&mut bytes, image::ImageFormat::Png)
    .expect("a PNG in memory");
    bytes.into_inner()
}

pub(crate) fn check(data: &[u8]) {
    let (scene, rest) = split(data);
    let (mesh, library) = split(rest);
    let or = |given: &[u8], default: &str| {
        if given.is_empty() {
            default.as_bytes().to_vec()
        } else {
            given.to_vec()
        }
    };
    let name = if scene.trim_ascii_start().starts_with(b"{") {
        "scene.json"
    } else {
        "scene.toml"
    };
    FOLDER.with(|folder| {
        folder.write(name, scene);
        folder.write("mesh.obj", &or(mesh, MESH));
        folder.write("mesh.mtl", &or(library, LIBRARY));
        folder.check(name);
    });
}
