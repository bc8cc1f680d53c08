//! What must hold for any bytes at all. Each check takes what a fuzzer makes up and panics where the library breaks a
//! promise; the fuzz targets (`fuzz/`) and the ordinary test (`tests/fuzz/main.rs`) run the same code.

pub(crate) mod alias;
pub(crate) mod environment;
pub(crate) mod gltf;
pub(crate) mod mitsuba;
pub(crate) mod obj;
pub(crate) mod ply;
pub(crate) mod scene_file;
pub(crate) mod triangles;

mod folder;

/// Panics if something does not hold for the bytes.
pub(crate) type Check = fn(&[u8]);

/// Every check by the name of its fuzz target and of its folder of the corpus.
pub(crate) const ALL: [(&str, Check); 8] = [
    ("alias", alias::check),
    ("environment", environment::check),
    ("gltf", gltf::check),
    ("mitsuba", mitsuba::check),
    ("obj", obj::check),
    ("ply", ply::check),
    ("scene_file", scene_file::check),
    ("triangles", triangles::check),
];
