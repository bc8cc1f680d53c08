//! Scene files and the meshes and materials they refer to.

pub mod obj;
