//! Scenes: read from files, described, and baked for rendering.

mod build;
mod desc;
mod features;

pub use build::{Instancing, Scene, SceneError, SceneOptions, Surface};
pub use desc::{EnvironmentDesc, ObjectDesc, SceneDesc};
pub use features::SceneFeatures;
