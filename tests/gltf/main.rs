//! glTF files: what is read is what the format says, and what cannot be is an error that names its place. The files are
//! made here.

mod cameras_and_lights;
mod errors;
mod file;
mod geometry;
mod materials;
mod picture;
#[path = "../support/mod.rs"]
mod support;
mod textures;
