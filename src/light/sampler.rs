//! The choice between emitters: triangles by a [`LightTree`], the environment against all of them by the light that each
//! would bring to a point without occlusion.

use super::environment::Irradiance;
use super::tree::{Leaf, LightTree, Visit};
use super::{AreaLight, Emission, Environment, EnvironmentPoint, LightSample};
use crate::math::Vec3;
use crate::sampling::{Dimension, Sampler};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Least probability of the environment and of all triangles together, where there are both and each may contribute:
/// either may hide the other from a point, which no estimate knows.
const LEAST_PMF: f32 = 0.05;

/// How a triangle is chosen among those that emit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightSampling {
    /// By an estimate of what each brings to the point, without occlusion; the environment likewise.
    #[default]
    Contribution,
    /// By power, wherever the point is, as the article does. The environment, where there is one, gets half of the samples.
    Power,
}

/// Draws directions towards emitters and knows the density of any direction.
#[derive(Clone, Debug, Default)]
pub struct LightSampler {
    areas: Vec<AreaLight>,
    /// Absent without triangles that emit.
    tree: Option<LightTree>,
    environment: Option<Environment>,
    /// Absent unless there is a choice between the environment and triangles.
    irradiance: Option<Irradiance>,
    sampling: LightSampling,
}

/// An emitter that was drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Emitter {
    /// There is none to sample.
    None,
    /// A triangle, by its index.
    Area(u32),
    /// The environment.
    Environment,
}

/// What [`LightSampler::choose`] has drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chosen {
    /// The emitter.
    pub emitter: Emitter,
    /// The probability of it.
    pub pmf: f32,
    /// The probability with which the environment is drawn at this point, as [`LightSampler::environment_pmf`] states it.
    pub environment_pmf: f32,
}

impl Chosen {
    /// There is nothing to sample.
    pub const NONE: Chosen = Chosen {
        emitter: Emitter::None,
        pmf: 0.0,
        environment_pmf: 0.0,
    };
}

/// Collects the emitters of a scene.
#[derive(Clone, Debug, Default)]
pub struct LightSamplerBuilder {
    triangles: Vec<([Vec3; 3], Emission)>,
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
        self.triangles.push((corners, emission));
    }

    /// Builds the tree. Emitters without power are never drawn.
    pub fn build(self, environment: Option<Environment>, sampling: LightSampling) -> LightSampler {
        let (areas, leaves): (Vec<AreaLight>, Vec<Option<Leaf>>) = self
            .triangles
            .par_iter()
            .enumerate()
            .map(|(index, &(corners, emission))| {
                let (light, area) = AreaLight::new(corners, emission);
                let mass = area * emission.exitance() / PI;
                let leaf = Leaf {
                    index: index as u32,
                    corners,
                    normal: light.normal(),
                    both_sides: emission.both_sides,
                    mass,
                };
                (
                    light,
                    (mass > 0.0 && mass.is_finite() && light.has_density()).then_some(leaf),
                )
            })
            .unzip();
        let leaves: Vec<Leaf> = leaves.into_iter().flatten().collect();
        let tree = LightTree::new(
            &leaves,
            areas.len(),
            environment.is_none(),
            sampling == LightSampling::Power,
        );
        let irradiance = match (&tree, &environment) {
            (Some(_), Some(environment)) => Some(environment.irradiance()),
            _ => None,
        };
        LightSampler {
            areas,
            tree,
            environment,
            irradiance,
            sampling,
        }
    }
}

impl LightSampler {
    /// Number of emitters: triangles, and one for the environment.
    pub fn len(&self) -> usize {
        self.areas.len() + usize::from(self.environment.is_some())
    }

    /// Whether there are no emitters at all.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The environment, if the scene has one.
    pub fn environment(&self) -> Option<&Environment> {
        self.environment.as_ref()
    }

    /// Draws an emitter for the point `p` of a surface by 64 random bits, of which the high ones matter most, and states the
    /// probability of it. `n` is the unit normal on the side that light comes from; zero if it may come from both. `AREA` and
    /// `ENVIRONMENT` say which kinds the scene may have.
    #[inline(always)]
    pub fn choose<const AREA: bool, const ENVIRONMENT: bool>(&self, p: Vec3, n: Vec3, bits: u64) -> Chosen {
        let Some(tree) = self.tree.as_ref().filter(|_| AREA) else {
            return match &self.environment {
                Some(_) if ENVIRONMENT => Chosen {
                    emitter: Emitter::Environment,
                    pmf: 1.0,
                    environment_pmf: 1.0,
                },
                _ => Chosen::NONE,
            };
        };
        let visit = tree.visit(p, n);
        let mut u = (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0);
        let mut environment_pmf = 0.0;
        if ENVIRONMENT && let Some(irradiance) = &self.irradiance {
            environment_pmf = self.environment_share(irradiance, n, &visit);
            if u < f64::from(environment_pmf) {
                return Chosen {
                    emitter: Emitter::Environment,
                    pmf: environment_pmf,
                    environment_pmf,
                };
            }
            u = (u - f64::from(environment_pmf)) / (1.0 - f64::from(environment_pmf));
        }
        let (emitter, pmf) = match visit.choose(u) {
            Some((light, pmf)) => (Emitter::Area(light), pmf * (1.0 - environment_pmf)),
            None => (Emitter::None, 0.0),
        };
        Chosen {
            emitter,
            pmf,
            environment_pmf,
        }
    }

    /// The probability with which [`LightSampler::choose`] draws a triangle: the same bits.
    #[inline]
    pub fn area_pmf(&self, light: u32, p: Vec3, n: Vec3) -> f32 {
        let Some(tree) = &self.tree else { return 0.0 };
        let visit = tree.visit(p, n);
        let rest = match &self.irradiance {
            Some(irradiance) => 1.0 - self.environment_share(irradiance, n, &visit),
            None => 1.0,
        };
        visit.pmf(light) * rest
    }

    /// An emitting triangle.
    #[inline(always)]
    pub fn area(&self, light: u32) -> &AreaLight {
        &self.areas[light as usize]
    }

    /// The probability with which [`LightSampler::choose`] draws the environment: the same bits.
    #[inline]
    pub fn environment_pmf(&self, p: Vec3, n: Vec3) -> f32 {
        match (&self.tree, &self.irradiance) {
            (Some(tree), Some(irradiance)) => self.environment_share(irradiance, n, &tree.visit(p, n)),
            _ => f32::from(self.tree.is_none() && self.environment.is_some()),
        }
    }

    /// Draws a direction from `p` towards a triangle that was drawn with probability `pmf`. `None` if it carries no light.
    #[inline(always)]
    pub fn sample_area(&self, light: u32, pmf: f32, p: Vec3, u: [f32; 2]) -> Option<LightSample> {
        self.areas[light as usize].sample(pmf, p, u)
    }

    /// The sample of the environment at a place drawn by [`Environment::sample`], the environment being drawn with
    /// probability `pmf`. `None` if it carries no light.
    #[inline(always)]
    pub fn sample_environment(
        &self,
        environment: &Environment,
        pmf: f32,
        point: &EnvironmentPoint,
    ) -> Option<LightSample> {
        let (radiance, pdf_w) = environment.lookup(point);
        let pdf_w = pdf_w * pmf;
        (pdf_w > 0.0 && pdf_w.is_finite() && !radiance.is_black()).then_some(LightSample {
            wi: point.wi,
            radiance,
            pdf_w,
            target: None,
        })
    }

    /// Draws a direction from `p` towards any emitter: the steps above in one, for a single point. `None` if it carries
    /// no light.
    pub fn sample(&self, p: Vec3, n: Vec3, sampler: &Sampler) -> Option<LightSample> {
        let u = sampler.get_2d(Dimension::LightPosition);
        let Chosen { emitter, pmf, .. } = self.choose::<true, true>(p, n, sampler.get_u64(Dimension::LightChoice));
        match (emitter, &self.environment) {
            (Emitter::Area(light), _) => self.sample_area(light, pmf, p, u),
            (Emitter::Environment, Some(environment)) => {
                let texel = environment.choose_texel(sampler.get_u64(Dimension::Texel));
                self.sample_environment(environment, pmf, &environment.sample(texel, u))
            }
            _ => None,
        }
    }

    /// Density [1/sr] with which [`LightSampler::sample`] draws the direction from `p` to a point on an emitting triangle,
    /// at this squared distance and under this cosine on the light.
    #[inline]
    pub fn area_pdf_w(&self, light: u32, p: Vec3, n: Vec3, distance_squared: f32, cos: f32) -> f32 {
        self.areas[light as usize].pdf_w(self.area_pmf(light, p, n), distance_squared, cos)
    }

    /// Bytes of the triangles and of the tree; the environment counts for itself.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.areas) + self.tree.as_ref().map_or(0, LightTree::memory_bytes)
    }

    /// The share of samples that the environment gets, given the irradiance that it and all triangles bring.
    #[inline(always)]
    fn environment_share(&self, irradiance: &Irradiance, n: Vec3, visit: &Visit) -> f32 {
        if self.sampling == LightSampling::Power {
            return 0.5;
        }
        let (environment, areas) = (irradiance.at(n), visit.irradiance());
        if areas <= 0.0 {
            1.0
        } else if environment <= 0.0 {
            0.0
        } else {
            // Their sum may be beyond what f32 holds.
            let share = 1.0 / (1.0 + areas / environment);
            share.clamp(LEAST_PMF, 1.0 - LEAST_PMF)
        }
    }
}
