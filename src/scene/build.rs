//! From description to the immutable scene that is rendered.

use super::desc::{EnvironmentDesc, ObjectDesc, SceneDesc};
use super::features::SceneFeatures;
use super::lights::{self, EmissionMaps};
use super::origin;
use super::slide::Slides;
use crate::accel::{Geometry, Hit, Placement};
use crate::bsdf::Bsdf;
use crate::camera::{Camera, CameraDesc, CameraError};
use crate::interaction::{SurfaceInteraction, surface_point, texture_directions};
use crate::light::{
    Emission, EnvSampling, Environment, EnvironmentError, LightSample, LightSampler, LightSamplerBuilder, LightSampling,
};
use crate::material::{Material, ReliefShadow, Resolved};
use crate::math::{DAffine3, DVec3, Rgb, Vec2, Vec3};
use crate::mesh::TriangleMesh;
use crate::texture::Texture;
use rayon::prelude::*;
use std::sync::Arc;
use thiserror::Error;

/// Up to this many triangles in total, meshes that stand in several places are copied to each of them: one flat
/// structure is traversed faster than instances. Above it they share their triangles.
const FLATTEN_LIMIT: usize = 1 << 22;

/// What a surface does with light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Index into [`Scene::materials`].
    pub material: u32,
    /// Emission, and the index of the first triangle among the lights.
    pub emission: Option<(Emission, u32)>,
    /// Whether it reflects and refracts without any spread, so that sampling emitters is pointless.
    pub is_delta: bool,
    /// Whether light may come from behind, too.
    pub transmits: bool,
    /// Whether [`Scene::general_bsdf`] has to be asked how it scatters.
    pub is_general: bool,
}

/// Everything that rendering reads, except the acceleration structure.
#[derive(Debug)]
pub struct Scene {
    /// What the origin of rendering is in the coordinates of the description. Zero unless the scene stands far off:
    /// everything below, camera and geometry, is relative to it.
    pub origin: DVec3,
    /// The view.
    pub camera: Camera,
    /// Meshes and where they stand.
    pub geometry: Geometry,
    /// What each placement does with light.
    pub surfaces: Vec<Surface>,
    /// Materials by index.
    pub materials: Vec<Material>,
    /// Bitmaps by index.
    pub textures: Vec<Texture>,
    /// Emitters.
    pub lights: LightSampler,
    /// Emission that varies over surfaces.
    pub emission_maps: EmissionMaps,
    /// What spots cast.
    pub(super) slides: Slides,
    /// What the scene requires.
    pub features: SceneFeatures,
    /// Path length that the scene asks for.
    pub max_depth: Option<u32>,
    /// Hash of the description.
    pub hash: String,
}

/// How to build.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SceneOptions {
    /// How the environment will be sampled: uniform sampling needs no table.
    pub env_sampling: EnvSampling,
    /// How emitters will be chosen.
    pub light_sampling: LightSampling,
    /// Whether the scene will be rendered with multiple importance sampling alone, so that the environment may leave to
    /// bounces what they find as well ([`EnvSampling::Compensated`]).
    pub mis: bool,
    /// Whether repeated meshes share their triangles.
    pub instancing: Instancing,
}

/// Whether meshes that stand in several places are instanced.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Instancing {
    /// When copies would make the scene large.
    #[default]
    Auto,
    /// Always, for meshes that stand in more than one place.
    Always,
    /// Never.
    Never,
}

/// Why a description is no scene.
#[derive(Debug, Error, PartialEq)]
pub enum SceneError {
    /// The camera cannot be.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The environment cannot be.
    #[error("environment: {0}")]
    Environment(#[from] EnvironmentError),
    /// A transform cannot be inverted.
    #[error("{0}: transform: the matrix is singular or not finite; it would flatten the mesh")]
    Transform(String),
    /// A vertex ends up out of the range of f32.
    #[error("{0}: transform: it moves a vertex beyond what 32-bit coordinates can hold")]
    Overflow(String),
    /// A light that is no surface cannot be.
    #[error("light {index} (from 0): {problem}")]
    Light {
        /// Its index in the description.
        index: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// More placements, triangles or emitters than 32-bit indices can name.
    #[error("the scene has more {0} than 32-bit indices can name")]
    TooMany(&'static str),
}

impl Scene {
    /// Bakes a description.
    ///
    /// # Errors
    /// A camera, transform or environment that cannot be rendered; see [`SceneError`].
    pub fn build(mut desc: SceneDesc, options: SceneOptions) -> Result<Scene, SceneError> {
        for object in &desc.objects {
            if !is_invertible(&object.to_world) {
                return Err(SceneError::Transform(object.name.clone()));
            }
        }
        let origin = origin::choose(&desc);
        let camera = Camera::new(&CameraDesc {
            position: desc.camera.position - origin,
            look_at: desc.camera.look_at - origin,
            ..desc.camera
        })?;
        let to_rendering = DAffine3::from_translation(-origin);
        for object in &mut desc.objects {
            object.to_world = to_rendering * object.to_world;
        }
        let geometry = place(desc.meshes, &desc.objects, options.instancing);
        for (placement, object) in geometry.placements.iter().zip(&desc.objects) {
            let mesh = &geometry.meshes[placement.mesh as usize];
            let moved = placement.to_world.unwrap_or(glam::Affine3A::IDENTITY);
            if !mesh
                .positions
                .par_iter()
                .all(|p| moved.transform_point3(*p).is_finite())
            {
                return Err(SceneError::Overflow(object.name.clone()));
            }
        }
        let materials: Vec<Material> = desc.materials.into_iter().map(|(_, material)| material).collect();

        let mut lights = LightSamplerBuilder::default();
        let mut emission_maps = EmissionMaps::default();
        let mut surfaces = Vec::with_capacity(desc.objects.len());
        for (placement, object) in desc.objects.iter().enumerate() {
            let emission = add_emission(
                placement as u32,
                object,
                &geometry,
                &desc.textures,
                &mut lights,
                &mut emission_maps,
            );
            surfaces.push(Surface {
                material: object.material as u32,
                emission,
                is_delta: parts(&materials, object.material).all(Material::is_delta),
                transmits: parts(&materials, object.material).any(Material::transmits),
                is_general: parts(&materials, object.material).any(Material::is_general),
            });
        }
        let slides = lights::add(&desc.lights, origin, &mut lights)?;
        // The tree has one bit for other purposes.
        if lights.len() + lights.others() >= 1 << 31 {
            return Err(SceneError::TooMany("emitters"));
        }
        let has_others = lights.others() > 0;
        if has_others && let Some((lo, hi)) = geometry.bounds() {
            lights.set_scene_radius(0.5 * (hi.as_dvec3() - lo.as_dvec3()).length());
        }

        let environment = match desc.environment {
            None => None,
            Some(EnvironmentDesc::Constant(radiance)) => {
                (!radiance.is_black()).then_some(Environment::Constant(radiance))
            }
            Some(EnvironmentDesc::Map {
                image,
                scale,
                rotation_degrees,
                to_world,
            }) => {
                let sampling = match options.env_sampling {
                    EnvSampling::Importance if options.mis => EnvSampling::Compensated,
                    sampling => sampling,
                };
                Some(Environment::from_map(&image, scale, rotation_degrees, sampling)?.turned(to_world)?)
            }
        };
        let used = |condition: fn(&Material) -> bool| {
            surfaces
                .iter()
                .any(|s| parts(&materials, s.material as usize).any(condition))
        };
        let features = SceneFeatures::ENVIRONMENT
            .when(environment.is_some())
            .union(SceneFeatures::AREA_LIGHTS.when(!lights.is_empty()))
            .union(SceneFeatures::TEXTURES.when(used(Material::varies)))
            .union(SceneFeatures::SMOOTH_NORMALS.when(geometry.meshes.iter().any(|m| !m.normals.is_empty())))
            .union(SceneFeatures::SPECULAR.when(used(|m| !m.is_diffuse())))
            .union(SceneFeatures::CUTOUTS.when(used(|m| m.opacity.is_some())))
            .union(SceneFeatures::GENERAL.when(surfaces.iter().any(|s| s.is_general)))
            .union(SceneFeatures::PUNCTUAL.when(has_others || !emission_maps.is_empty()));
        Ok(Scene {
            origin,
            camera,
            lights: lights.build(environment, options.light_sampling),
            emission_maps,
            slides,
            geometry,
            surfaces,
            materials,
            textures: desc.textures,
            features,
            max_depth: desc.max_depth,
            hash: desc.hash,
        })
    }

    /// How a surface with a general material scatters at a hit, whose shading normal it may turn, and what of light a turned
    /// normal does not get. `choice` gives a number in [0, 1) that mixtures choose by.
    #[inline(never)]
    pub fn general_bsdf(
        &self,
        hit: &Hit,
        si: &mut SurfaceInteraction,
        choice: impl Fn() -> f32,
    ) -> (Bsdf, Option<ReliefShadow>) {
        let material = &self.materials[self.surfaces[hit.placement as usize].material as usize];
        let point = || surface_point(&self.geometry, hit);
        let resolved = material.resolve(&self.materials, &self.textures, point, si.front, choice);
        let Some(Resolved {
            material,
            relief,
            front,
        }) = resolved
        else {
            return (Bsdf::Mirror(Rgb::BLACK), None);
        };
        let mut shadow = None;
        let directions = texture_directions(&self.geometry, hit);
        if let (Some(relief), Some(directions)) = (relief, directions) {
            let side = if si.front { 1.0 } else { -1.0 };
            let plain = si.frame.n;
            let n = relief.normal(&self.textures, point().uv, plain * side, directions) * side;
            // A facet that turns away is not seen: its mirror image is (Schuessler and others 2017, "Microfacet-based Normal
            // Mapping for Robust Monte Carlo Path Tracing").
            let is_seen = n.dot(si.wo) > 0.0;
            si.set_shading_normal(if is_seen { n } else { plain * (2.0 * plain.dot(n)) - n });
            if !material.is_diffuse() {
                si.lift_reflection();
            }
            shadow = Some(ReliefShadow::new(plain, &si.frame));
        }
        let tangent = || {
            let local = directions.map_or(Vec3::X, |[dp_du, _]| si.frame.to_local(dp_du));
            let along = Vec2::new(local.x, local.y).try_normalize().unwrap_or(Vec2::X);
            along.to_array()
        };
        let bsdf = material.bsdf::<true, true, true>(&self.textures, point, front, tangent);
        (bsdf, shadow)
    }

    /// What emission is multiplied by at a hit; `None` where it does not vary.
    #[inline]
    pub fn emission_at(&self, hit: &Hit) -> Option<Rgb> {
        self.emission_maps.at(&self.textures, &self.geometry, hit)
    }

    /// Whether the emission of a triangle among the lights varies.
    #[inline]
    pub fn emission_varies(&self, light: u32) -> bool {
        self.emission_maps.vary(light)
    }

    /// The same where [`crate::light::AreaLight::sample`] comes to on a triangle among the lights from a place `u` of the unit
    /// square.
    #[inline]
    pub fn emission_at_sample(&self, light: u32, u: [f32; 2]) -> Option<Rgb> {
        self.emission_maps.at_sample(&self.textures, &self.geometry, light, u)
    }

    /// The light from a point at `p`; see [`LightSampler::sample_punctual`].
    pub fn sample_punctual(&self, light: u32, pmf: f32, p: Vec3) -> Option<LightSample> {
        let sample = self.lights.sample_punctual(light, pmf, p)?;
        if self.slides.is_empty() {
            return Some(sample);
        }
        let factor = self.slides.at(&self.textures, light, p).unwrap_or(Rgb::WHITE);
        let radiance = sample.radiance * factor;
        (!radiance.is_black()).then_some(LightSample { radiance, ..sample })
    }

    /// Triangles of all placements, instances counted each.
    pub fn triangles(&self) -> u64 {
        self.geometry
            .placements
            .iter()
            .map(|p| self.geometry.meshes[p.mesh as usize].indices.len() as u64)
            .sum()
    }

    /// Placements that share a mesh by a transform.
    pub fn instances(&self) -> usize {
        self.geometry.placements.iter().filter(|p| p.to_world.is_some()).count()
    }

    /// Bytes by part, in the order of their names.
    pub fn memory_by_part(&self) -> Vec<(&'static str, usize)> {
        let (environment, environment_table) = self.lights.environment().map_or((0, 0), Environment::memory_bytes);
        vec![
            ("meshes", self.geometry.meshes.iter().map(|m| m.memory_bytes()).sum()),
            ("textures", self.textures.iter().map(Texture::memory_bytes).sum()),
            ("environment", environment),
            ("environment_table", environment_table),
            ("lights", self.lights.memory_bytes()),
        ]
    }
}

/// Adds the triangles of a placement to the lights, if they emit: the emission, and the index of the first.
fn add_emission(
    placement: u32,
    object: &ObjectDesc,
    geometry: &Geometry,
    textures: &[Texture],
    lights: &mut LightSamplerBuilder,
    emission_maps: &mut EmissionMaps,
) -> Option<(Emission, u32)> {
    let emission = object.emission.filter(|e| !e.radiance.is_black())?;
    let means = match &object.emission_map {
        Some(map) => Some(lights::mean_emission(map, &emission, textures, geometry, placement)?),
        None => None,
    };
    let first = lights.len() as u32;
    let Placement { mesh, to_world } = &geometry.placements[placement as usize];
    let is_mirrored = to_world.is_some_and(|m| m.matrix3.determinant() < 0.0);
    for triangle in 0..geometry.meshes[*mesh as usize].indices.len() as u32 {
        let [a, b, c] = geometry.world_triangle(placement, triangle);
        let corners = if is_mirrored { [a, c, b] } else { [a, b, c] };
        let mean = means.as_ref().map_or(1.0, |means| means[triangle as usize]);
        lights.push_varying(corners, emission, mean);
    }
    if let Some(map) = object.emission_map {
        emission_maps.insert(placement, map, first..lights.len() as u32, is_mirrored);
    }
    Some((emission, first))
}

/// A material and all that it refers to, to any depth.
fn parts(materials: &[Material], first: usize) -> impl Iterator<Item = &Material> {
    let mut found = vec![first];
    let mut next = 0;
    std::iter::from_fn(move || {
        let material = &materials[*found.get(next)?];
        next += 1;
        for part in material.parts().map(|part| part as usize) {
            if !found.contains(&part) {
                found.push(part);
            }
        }
        Some(material)
    })
}

/// Whether a transform keeps volumes: its determinant must not vanish against the product of its column lengths.
pub(super) fn is_invertible(transform: &DAffine3) -> bool {
    let m = transform.matrix3;
    let size = m.x_axis.length() * m.y_axis.length() * m.z_axis.length();
    transform.is_finite() && size > 0.0 && (m.determinant() / size).abs() > 1e-12
}

/// Decides what is copied to its place and what is instanced, and does it, rounding to f32. Placements are in the order of
/// the objects.
fn place(meshes: Vec<Arc<TriangleMesh<DVec3>>>, objects: &[ObjectDesc], instancing: Instancing) -> Geometry {
    let mut uses = vec![0usize; meshes.len()];
    for object in objects {
        uses[object.mesh] += 1;
    }
    let flattened: usize = objects.iter().map(|o| meshes[o.mesh].indices.len()).sum();
    let share = match instancing {
        Instancing::Auto => flattened > FLATTEN_LIMIT,
        Instancing::Always => true,
        Instancing::Never => false,
    };
    // Shared meshes are stored once, around a middle of their own; the others once for each of their objects.
    let mut shared_index: Vec<Option<(u32, DVec3)>> = vec![None; meshes.len()];
    let mut to_round: Vec<(Arc<TriangleMesh<DVec3>>, DAffine3)> = Vec::new();
    let mut placements = Vec::with_capacity(objects.len());
    for object in objects {
        let mesh = &meshes[object.mesh];
        let placement = if share && uses[object.mesh] > 1 {
            let (index, middle) = *shared_index[object.mesh].get_or_insert_with(|| {
                let (lo, hi) = mesh.bounds();
                let middle = origin::of_box(lo, hi);
                to_round.push((mesh.clone(), DAffine3::from_translation(-middle)));
                (to_round.len() as u32 - 1, middle)
            });
            let m = object.to_world * DAffine3::from_translation(middle);
            let to_world = glam::Affine3A::from_mat3_translation(m.matrix3.as_mat3(), m.translation.as_vec3());
            (index, Some(to_world))
        } else {
            to_round.push((mesh.clone(), object.to_world));
            (to_round.len() as u32 - 1, None)
        };
        placements.push(Placement {
            mesh: placement.0,
            to_world: placement.1,
        });
    }
    drop(meshes);
    let rounded = to_round.into_par_iter().map(|(mesh, transform)| {
        // The last to use a mesh takes its arrays.
        Arc::new(Arc::unwrap_or_clone(mesh).into_f32(&transform))
    });
    Geometry {
        meshes: rounded.collect(),
        placements,
    }
}
