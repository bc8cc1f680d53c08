//! The choice between emitters: one alias table over all emitting triangles and the environment, by power.

use super::{AreaLight, Emission, Environment, EnvironmentPoint, LightSample};
use crate::math::{Rgb, Vec3};
use crate::sampling::{AliasTable, Dimension, Sampler};

/// Draws directions towards emitters and knows the density of any direction.
#[derive(Clone, Debug, Default)]
pub struct LightSampler {
    areas: Vec<AreaLight>,
    environment: Option<Environment>,
    /// Absent if there is nothing to choose from.
    table: Option<AliasTable>,
    environment_pmf: f32,
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

/// Collects the emitters of a scene.
#[derive(Clone, Debug, Default)]
pub struct LightSamplerBuilder {
    areas: Vec<AreaLight>,
    weights: Vec<f64>,
}

impl LightSamplerBuilder {
    /// Number of triangles so far: the index that the next one gets.
    pub fn len(&self) -> usize {
        self.areas.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// Adds an emitting triangle in world coordinates, its corners counter-clockwise from the front.
    pub fn push(&mut self, corners: [Vec3; 3], emission: Emission) {
        let (light, area) = AreaLight::new(corners, emission);
        self.weights.push(area * emission.exitance());
        self.areas.push(light);
    }

    /// Builds the table. `radius` is that of a sphere around the scene: through its cross-section comes the
    /// environment's power. Emitters without power are never drawn.
    pub fn build(self, environment: Option<Environment>, radius: f64) -> LightSampler {
        let LightSamplerBuilder { mut areas, mut weights } = self;
        if let Some(environment) = &environment {
            weights.push(std::f64::consts::PI * radius * radius * environment.fluence());
        }
        let table = AliasTable::new(weights.iter().copied());
        let mut environment_pmf = 0.0;
        if let Some(table) = &table {
            let pmf = table.implied_pmf();
            for ((light, pmf), power) in areas.iter_mut().zip(&pmf).zip(&weights) {
                light.pdf_a = if *power > 0.0 {
                    (pmf * light.emission.exitance() / power) as f32
                } else {
                    0.0
                };
            }
            environment_pmf = pmf.get(areas.len()).map_or(0.0, |&pmf| pmf as f32);
        }
        LightSampler {
            areas,
            environment,
            table,
            environment_pmf,
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

    /// Draws an emitter. `AREA` and `ENVIRONMENT` say which kinds the scene may have.
    #[inline(always)]
    pub fn choose<const AREA: bool, const ENVIRONMENT: bool>(&self, bits: u64) -> Emitter {
        let Some(table) = &self.table else {
            return Emitter::None;
        };
        if ENVIRONMENT && (!AREA || self.areas.is_empty()) {
            return Emitter::Environment;
        }
        let emitter = table.sample(bits);
        if ENVIRONMENT && emitter as usize == self.areas.len() {
            Emitter::Environment
        } else {
            Emitter::Area(emitter)
        }
    }

    /// An emitting triangle.
    #[inline(always)]
    pub fn area(&self, light: u32) -> &AreaLight {
        &self.areas[light as usize]
    }

    /// Draws a direction from `p` towards a triangle. `None` if it carries no light.
    #[inline(always)]
    pub fn sample_area(&self, light: u32, p: Vec3, sampler: &Sampler) -> Option<LightSample> {
        self.areas[light as usize].sample(p, sampler.get_2d(Dimension::LightPosition))
    }

    /// The sample of the environment at a place drawn by [`Environment::sample`]. `None` if it carries no light.
    #[inline(always)]
    pub fn sample_environment(&self, environment: &Environment, point: &EnvironmentPoint) -> Option<LightSample> {
        let (radiance, pdf_w) = self.environment_lookup(environment, point);
        (pdf_w > 0.0 && pdf_w.is_finite() && !radiance.is_black()).then_some(LightSample {
            wi: point.wi,
            radiance,
            pdf_w,
            target: None,
        })
    }

    /// Draws a direction from `p` towards any emitter: the steps above in one, for a single point. `None` if it carries
    /// no light.
    pub fn sample(&self, p: Vec3, sampler: &Sampler) -> Option<LightSample> {
        match (
            self.choose::<true, true>(sampler.get_u64(Dimension::LightChoice)),
            &self.environment,
        ) {
            (Emitter::Area(light), _) => self.sample_area(light, p, sampler),
            (Emitter::Environment, Some(environment)) => {
                let texel = environment.choose_texel(sampler.get_u64(Dimension::Texel));
                let point = environment.sample(texel, sampler.get_2d(Dimension::LightPosition));
                self.sample_environment(environment, &point)
            }
            _ => None,
        }
    }

    /// Density [1/sr] with which [`LightSampler::sample`] draws the direction to a point on an emitting triangle, at
    /// this squared distance and under this cosine on the light.
    #[inline]
    pub fn area_pdf_w(&self, light: u32, distance_squared: f32, cos: f32) -> f32 {
        self.areas[light as usize].pdf_w(distance_squared, cos)
    }

    /// Radiance from a place on the environment, and the density [1/sr] with which [`LightSampler::sample`] draws it.
    #[inline]
    pub fn environment_lookup(&self, environment: &Environment, point: &EnvironmentPoint) -> (Rgb, f32) {
        let (radiance, pdf_w) = environment.lookup(point);
        (radiance, pdf_w * self.environment_pmf)
    }

    /// Bytes of the triangles and of the choice table; the environment counts for itself.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.areas) + self.table.as_ref().map_or(0, AliasTable::memory_bytes)
    }
}
