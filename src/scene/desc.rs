//! A scene as it was read: everything decoded, in f64 where positions are composed, nothing baked yet.

use crate::camera::CameraDesc;
use crate::image::Image;
use crate::light::Emission;
use crate::material::Material;
use crate::math::{DAffine3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use crate::texture::Texture;
use std::sync::Arc;

/// A scene description: what [`crate::scene::load`] returns and [`crate::scene::Scene::build`] takes.
#[derive(Clone, Debug)]
pub struct SceneDesc {
    /// The view.
    pub camera: CameraDesc,
    /// Largest number of scattering events of a path; `None`: roulette alone ends paths.
    pub max_depth: Option<u32>,
    /// Light from infinity.
    pub environment: Option<EnvironmentDesc>,
    /// Materials and their names, for messages.
    pub materials: Vec<(String, Material)>,
    /// Bitmaps that the materials refer to.
    pub textures: Vec<Texture>,
    /// Validated meshes.
    pub meshes: Vec<Arc<TriangleMesh<DVec3>>>,
    /// What stands where.
    pub objects: Vec<ObjectDesc>,
    /// Hash over the scene file and everything it refers to, in hexadecimal.
    pub hash: String,
    /// What was mended or left out on reading, a sentence each.
    pub warnings: Vec<String>,
}

/// Light from infinity.
#[derive(Clone, Debug)]
pub enum EnvironmentDesc {
    /// The same radiance from everywhere.
    Constant(Rgb),
    /// A latitude-longitude map (orientation: [`crate::light::Environment`]).
    Map {
        /// Texels, finite and 0 or more.
        image: Arc<Image<Rgb>>,
        /// Factor on every texel.
        scale: f32,
        /// Turn of the content about +Y, right-handed, in degrees.
        rotation_degrees: f64,
    },
}

/// A mesh standing in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectDesc {
    /// For messages: the entry of the scene file and the mesh file.
    pub name: String,
    /// Index into [`SceneDesc::meshes`].
    pub mesh: usize,
    /// Index into [`SceneDesc::materials`].
    pub material: usize,
    /// Mesh to world; invertible.
    pub to_world: DAffine3,
    /// Emission, if any.
    pub emission: Option<Emission>,
}
