//! PLY meshes (Turk 1994, "The PLY Polygon File Format").

mod write;

pub use write::write_ply;
