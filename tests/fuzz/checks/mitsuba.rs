//! Scenes of Mitsuba. Zero bytes separate files: the scene, what it may include (`part.xml`), and a serialized mesh
//! (`mesh.serialized`); a mesh, an image and a map are there for it to name.

use super::folder::Folder;
use super::obj::split;
use super::scene_file::{MESH, tiles};

const PART: &[u8] = b"<scene version=\"3.0.0\"><bsdf type=\"diffuse\" id=\"paint\"/></scene>";

thread_local! {
    static FOLDER: Folder = {
        let folder = Folder::new();
        folder.write("tiles.png", &tiles());
        folder.write("mesh.obj", MESH.as_bytes());
        folder.write("sky.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\n\x70\x70\x70\x80\x40\x70\xff\x7f\x10\x20\x30\x80\x0f\x00\x00\x80");
        folder
    };
}

pub(crate) fn check(data: &[u8]) {
    let (scene, rest) = split(data);
    let (part, serialized) = split(rest);
    FOLDER.with(|folder| {
        folder.write("scene.xml", scene);
        folder.write("part.xml", if part.is_empty() { PART } else { part });
        folder.write("mesh.serialized", serialized);
        folder.check("scene.xml");
    });
}
