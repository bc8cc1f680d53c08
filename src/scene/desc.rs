//! A scene as it was read: everything decoded, in f64 where positions are composed, nothing baked yet.

use crate::camera::CameraDesc;
use crate::image::Image;
use crate::light::Emission;
pub use crate::light::Falloff;
use crate::material::{Material, Spectrum};
use crate::math::{DAffine3, DMat3, DVec3, Rgb};
use crate::mesh::TriangleMesh;
use crate::texture::Texture;
use std::sync::Arc;

/// A scene description: what [`crate::scene::load`] returns and [`crate::scene::Scene::build`] takes.
#[derive(Clone, Debug)]
pub struct SceneDesc {
    /// The view.
    pub camera: CameraDesc,
    /// The part of the image that is wanted, as columns and rows `[x0, y0, x1, y1]`, the ends excluded; `None`: all of it.
    pub crop: Option<[u32; 4]>,
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
    /// Light from points and from far away.
    pub lights: Vec<LightDesc>,
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
        /// Turn of the content after that: a rotation, which may mirror.
        to_world: DMat3,
    },
}

/// A pattern that is cast like a slide: it fills the square around the circle at the edge of a cone that is below a right angle
/// from its axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlideDesc {
    /// What the intensity is multiplied by; vertex colours are white here.
    pub factor: Spectrum,
    /// Where its texture coordinates grow, at right angles to the direction of the light; of any length above 0.
    pub axes: [DVec3; 2],
}

/// A light that is no surface.
#[derive(Clone, Debug, PartialEq)]
pub enum LightDesc {
    /// The same in all directions from a point.
    Point {
        /// Where.
        position: DVec3,
        /// Radiant intensity [W·sr⁻¹].
        intensity: Rgb,
    },
    /// A cone from a point.
    Spot {
        /// Where.
        position: DVec3,
        /// Where to; any length above 0.
        direction: DVec3,
        /// Radiant intensity along the axis [W·sr⁻¹].
        intensity: Rgb,
        /// Angles from the axis, in radians: up to the first, all of the intensity; from the second on, none. In [0, π], the
        /// second above the first.
        angles: [f64; 2],
        /// What is between the two.
        falloff: Falloff,
        /// What it casts through its cone.
        slide: Option<SlideDesc>,
    },
    /// Parallel light, or a disc at infinity.
    Distant {
        /// Where the light goes; any length above 0.
        direction: DVec3,
        /// On a surface that faces it [W·m⁻²].
        irradiance: Rgb,
        /// Radius of the disc as an angle, in radians, in [0, π/2); 0 is parallel light.
        radius: f64,
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
    /// What the emission is multiplied by where it varies over the surface; not of a constant.
    pub emission_map: Option<Spectrum>,
}
