//! glTF files: text, where the bytes begin with a brace, else GLB. Zero bytes separate text from what is in `data.bin` beside
//! it; an image stands there as well.

use super::folder::Folder;
use super::obj::split;
use super::scene_file::tiles;

thread_local! {
    static FOLDER: Folder = {
        let folder = Folder::new();
        folder.write("tiles.png", &tiles());
        folder
    };
}

pub(crate) fn check(data: &[u8]) {
    FOLDER.with(|folder| {
        if data.trim_ascii_start().starts_with(b"{") {
            let (text, bytes) = split(data);
            folder.write("scene.gltf", text);
            folder.write("data.bin", bytes);
            folder.check("scene.gltf");
        } else {
            folder.write("scene.glb", data);
            folder.check("scene.glb");
        }
    });
}
