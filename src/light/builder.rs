//! Collecting the emitters of a scene.

use super::distant::DistantLights;
use super::sampler::{LightSampler, LightSampling};
use super::tree::{Leaf, LightTree, Profile};
use super::{AreaLight, DistantLight, Emission, Environment, PunctualLight};
use crate::math::Vec3;
use rayon::prelude::*;
use std::f64::consts::PI;

/// Least size of a tree with light from points, which may all be in one, in radii of the scene.
const LEAST_SIZE: f64 = 1.0 / 64.0;

/// Collects the emitters of a scene.
#[derive(Clone, Debug)]
pub struct LightSamplerBuilder {
    /// Corners, emission, and the mean of what it is multiplied by.
    triangles: Vec<([Vec3; 3], Emission, f32)>,
    punctual: Vec<PunctualLight>,
    distant: Vec<DistantLight>,
    scene_radius: f64,
}

impl Default for LightSamplerBuilder {
    fn default() -> Self {
        LightSamplerBuilder {
            triangles: Vec::new(),
            punctual: Vec::new(),
            distant: Vec::new(),
            scene_radius: 1.0,
        }
    }
}

impl LightSamplerBuilder {
    /// Number of triangles so far: the index that the next one gets.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Adds an emitting triangle in world coordinates, its corners counter-clockwise from the front.
    pub fn push(&mut self, corners: [Vec3; 3], emission: Emission) {
        self.push_varying(corners, emission, 1.0);
    }

    /// The same for one whose emission varies: it has this luminance in the mean, relative to `emission`.
    pub fn push_varying(&mut self, corners: [Vec3; 3], emission: Emission, mean: f32) {
        self.triangles.push((corners, emission, mean));
    }

    /// Adds light from a point.
    pub fn push_punctual(&mut self, light: PunctualLight) {
        self.punctual.push(light);
    }

    /// Adds light from far away.
    pub fn push_distant(&mut self, light: DistantLight) {
        self.distant.push(light);
    }

    /// Number of lights that are no triangles so far.
    pub fn others(&self) -> usize {
        self.punctual.len() + self.distant.len()
    }

    /// Says how large the scene is: half of its diagonal. It tells what the power of light from far away is, and how far
    /// from points their light arrives.
    pub fn set_scene_radius(&mut self, radius: f64) {
        if radius > 0.0 && radius.is_finite() {
            self.scene_radius = radius;
        }
    }

    /// Builds the tree. Emitters without power are never drawn.
    pub fn build(self, environment: Option<Environment>, sampling: LightSampling) -> LightSampler {
        let by_power = sampling == LightSampling::Power;
        let (areas, leaves): (Vec<AreaLight>, Vec<Option<Leaf>>) = self
            .triangles
            .par_iter()
            .enumerate()
            .map(|(index, &(corners, emission, mean))| {
                let (light, area) = AreaLight::new(corners, emission);
                let mass = area * emission.exitance() / PI * f64::from(mean);
                let leaf = Leaf {
                    index: index as u32,
                    corners,
                    normal: light.normal(),
                    profile: if emission.both_sides {
                        Profile::BothSides
                    } else {
                        Profile::Front
                    },
                    mass,
                };
                let is_drawn = mass > 0.0 && mass.is_finite() && light.has_density();
                (light, is_drawn.then_some(leaf))
            })
            .unzip();
        let punctual = self.punctual.par_iter().enumerate().map(|(index, light)| {
            let leaf = Leaf {
                index: (areas.len() + index) as u32,
                corners: [light.position(); 3],
                normal: light.axis(),
                profile: light.profile(),
                mass: if by_power { light.power() / PI } else { light.mass() },
            };
            (leaf.mass > 0.0 && leaf.mass.is_finite()).then_some(leaf)
        });
        let leaves: Vec<Leaf> = leaves.into_par_iter().chain(punctual).flatten().collect();
        let power = PI * leaves.iter().map(|leaf| leaf.mass).sum::<f64>();
        let is_alone = environment.is_none() && self.distant.is_empty();
        let least_size = if self.punctual.is_empty() {
            0.0
        } else {
            LEAST_SIZE * self.scene_radius
        };
        let emitters = areas.len() + self.punctual.len();
        let tree = LightTree::new(&leaves, emitters, is_alone, by_power, least_size);
        let has_choice = tree.is_some() || !self.distant.is_empty();
        let irradiance = environment.as_ref().filter(|_| has_choice).map(Environment::irradiance);
        let distant = DistantLights::new(self.distant, by_power);
        let powers = [distant.facing() * PI * self.scene_radius.powi(2), power];
        LightSampler {
            areas,
            punctual: self.punctual,
            distant,
            tree,
            environment,
            irradiance,
            sampling,
            powers,
        }
    }
}
