//! Scenes: read from files, described, and baked for rendering.

mod bitmap;
mod build;
mod desc;
mod environment;
mod export;
mod features;
mod file;
mod framing;
mod gltf;
mod input;
mod lights;
mod load;
mod mitsuba;
mod number;
pub mod obj;
mod obj_material;
mod origin;
pub mod ply;
mod slide;
mod value;
mod warnings;

pub use build::{Instancing, Scene, SceneError, SceneOptions, Surface};
pub use desc::{EnvironmentDesc, Falloff, LightDesc, ObjectDesc, SceneDesc, SlideDesc};
pub use export::{Export, ExportError, ExportFile, SaveError, material_type, save};
pub use features::SceneFeatures;
pub use lights::EmissionMaps;
pub use load::{LoadError, LoadOptions, load};
pub(crate) use value::nearest;
