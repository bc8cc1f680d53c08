//! The choice between emitters: triangles and points by a [`LightTree`], the environment, lights from far away and the whole
//! tree against each other by the light that each would bring to a point without occlusion.

use super::distant::DistantLights;
use super::environment::Irradiance;
use super::tree::{LightTree, Visit};
use super::{AreaLight, Environment, LightSample, PunctualLight};
use crate::math::{Rgb, Vec3};
use crate::sampling::{Dimension, Sampler};

/// Least probability of the environment, of all lights from far away, and of the tree, where there is more than one of them
/// and each may contribute: any may hide the others from a point, which no estimate knows.
const LEAST_PMF: f32 = 0.05;

/// How an emitter is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightSampling {
    /// By an estimate of what each brings to the point, without occlusion; the environment likewise.
    #[default]
    Contribution,
    /// By power, wherever the point is, as the article does: that of light from far away is what passes through the scene. The
    /// environment, where there is one, gets half of the samples.
    Power,
}

/// Draws directions towards emitters and knows the density of any direction.
#[derive(Clone, Debug, Default)]
pub struct LightSampler {
    pub(super) areas: Vec<AreaLight>,
    /// In the tree they come after the triangles.
    pub(super) punctual: Vec<PunctualLight>,
    pub(super) distant: DistantLights,
    /// Absent without triangles or points that emit.
    pub(super) tree: Option<LightTree>,
    pub(super) environment: Option<Environment>,
    /// Absent unless there is a choice between the environment and others.
    pub(super) irradiance: Option<Irradiance>,
    pub(super) sampling: LightSampling,
    /// Power [W] as luminance: what lights from far away send through the scene, and what all in the tree send.
    pub(super) powers: [f64; 2],
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
    /// A point, by its index.
    Punctual(u32),
    /// Light from far away, by its index.
    Distant(u32),
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

/// What is drawn first: the probabilities of the environment, of all lights from far away, and of the tree.
#[derive(Clone, Copy)]
struct Shares {
    environment: f32,
    distant: f32,
    tree: f32,
}

impl LightSampler {
    /// Number of emitters: triangles, points, lights from far away, and one for the environment.
    pub fn len(&self) -> usize {
        let others = self.punctual.len() + self.distant.len();
        self.areas.len() + others + usize::from(self.environment.is_some())
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
    /// `ENVIRONMENT` say which kinds the scene may have; others it must not have: see [`LightSampler::choose_any`].
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

    /// [`LightSampler::choose`] for scenes that may have all kinds of emitters.
    #[inline(always)]
    pub fn choose_any(&self, p: Vec3, n: Vec3, bits: u64) -> Chosen {
        let chosen = if self.distant.is_empty() {
            self.choose::<true, true>(p, n, bits)
        } else {
            self.choose_among_all(p, n, bits)
        };
        match chosen.emitter {
            Emitter::Area(leaf) if leaf as usize >= self.areas.len() => Chosen {
                emitter: Emitter::Punctual(leaf - self.areas.len() as u32),
                ..chosen
            },
            _ => chosen,
        }
    }

    /// The choice where there is light from far away. What comes from the tree is called a triangle.
    #[inline(never)]
    fn choose_among_all(&self, p: Vec3, n: Vec3, bits: u64) -> Chosen {
        let visit = self.tree.as_ref().map(|tree| tree.visit(p, n));
        let shares = self.shares(n, visit.as_ref());
        let [environment, distant, in_tree] = [shares.environment, shares.distant, shares.tree].map(f64::from);
        let u = (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0);
        // Where rounding leaves a gap after the last that can contribute, it belongs to that one.
        let (emitter, pmf) = if environment > 0.0 && (u < environment || distant + in_tree == 0.0) {
            (Emitter::Environment, shares.environment)
        } else if distant > 0.0 && (u < environment + distant || in_tree == 0.0) {
            let u = ((u - environment) / distant).clamp(0.0, 1.0f64.next_down());
            match self.distant.choose(u, n) {
                Some((light, pmf)) => (Emitter::Distant(light), pmf * shares.distant),
                None => (Emitter::None, 0.0),
            }
        } else {
            let u = ((u - environment - distant) / in_tree).clamp(0.0, 1.0f64.next_down());
            match visit.filter(|_| in_tree > 0.0).and_then(|visit| visit.choose(u)) {
                Some((leaf, pmf)) => (Emitter::Area(leaf), pmf * shares.tree),
                None => (Emitter::None, 0.0),
            }
        };
        Chosen {
            emitter,
            pmf,
            environment_pmf: shares.environment,
        }
    }

    /// The probability with which [`LightSampler::choose_any`] draws an emitter: the same bits.
    pub fn pmf(&self, emitter: Emitter, p: Vec3, n: Vec3) -> f32 {
        match emitter {
            Emitter::None => 0.0,
            Emitter::Area(light) => self.area_pmf(light, p, n),
            Emitter::Environment => self.environment_pmf(p, n),
            Emitter::Punctual(light) => self.area_pmf(light + self.areas.len() as u32, p, n),
            Emitter::Distant(light) => self.distant_pmf(light, p, n),
        }
    }

    /// The probability with which [`LightSampler::choose`] draws a triangle: the same bits.
    #[inline]
    pub fn area_pmf(&self, light: u32, p: Vec3, n: Vec3) -> f32 {
        let Some(tree) = &self.tree else { return 0.0 };
        let visit = tree.visit(p, n);
        let rest = match &self.irradiance {
            _ if !self.distant.is_empty() => self.shares(n, Some(&visit)).tree,
            Some(irradiance) => 1.0 - self.environment_share(irradiance, n, &visit),
            None => 1.0,
        };
        visit.pmf(light) * rest
    }

    fn distant_pmf(&self, light: u32, p: Vec3, n: Vec3) -> f32 {
        let visit = self.tree.as_ref().map(|tree| tree.visit(p, n));
        self.distant.pmf(light, n) * self.shares(n, visit.as_ref()).distant
    }

    /// An emitting triangle.
    #[inline(always)]
    pub fn area(&self, light: u32) -> &AreaLight {
        &self.areas[light as usize]
    }

    /// The probability with which [`LightSampler::choose`] draws the environment: the same bits.
    #[inline]
    pub fn environment_pmf(&self, p: Vec3, n: Vec3) -> f32 {
        if !self.distant.is_empty() {
            let visit = self.tree.as_ref().map(|tree| tree.visit(p, n));
            return self.shares(n, visit.as_ref()).environment;
        }
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

    /// The sample of the environment in a direction drawn by [`Environment::sample`], where [`Environment::lookup`] has found
    /// this radiance and density, the environment being drawn with probability `pmf`. `None` if it carries no light.
    #[inline(always)]
    pub fn sample_environment(&self, pmf: f32, wi: Vec3, (radiance, pdf_w): (Rgb, f32)) -> Option<LightSample> {
        let pdf_w = pdf_w * pmf;
        (pdf_w > 0.0 && pdf_w.is_finite() && !radiance.is_black()).then_some(LightSample {
            wi,
            radiance,
            pdf_w,
            target: None,
        })
    }

    /// The direction from `p` towards a point that was drawn with probability `pmf`. `None` if it carries no light.
    #[inline]
    pub fn sample_punctual(&self, light: u32, pmf: f32, p: Vec3) -> Option<LightSample> {
        self.punctual[light as usize].sample(pmf, p)
    }

    /// Draws a direction towards a light from far away that was drawn with probability `pmf`. `None` if it carries no light.
    #[inline]
    pub fn sample_distant(&self, light: u32, pmf: f32, u: [f32; 2]) -> Option<LightSample> {
        self.distant.sample(light, pmf, u)
    }

    /// Whether rays that meet nothing may meet a disc.
    pub fn has_discs(&self) -> bool {
        self.distant.has_discs()
    }

    /// Discs that a ray along the unit direction `wi` meets if nothing is in between: index and radiance.
    #[inline]
    pub fn discs(&self, wi: Vec3) -> impl Iterator<Item = (u32, Rgb)> {
        self.distant.met(wi)
    }

    /// Density [1/sr] with which [`LightSampler::sample`] draws a direction from `p` to a disc.
    #[inline]
    pub fn disc_pdf_w(&self, disc: u32, p: Vec3, n: Vec3) -> f32 {
        self.distant.disc_pdf_w(disc) * self.distant_pmf(disc, p, n)
    }

    /// Draws a direction from `p` towards any emitter: the steps above in one, for a single point. `None` if it carries
    /// no light. Emission of triangles does not vary here.
    pub fn sample(&self, p: Vec3, n: Vec3, sampler: &Sampler) -> Option<LightSample> {
        let u = sampler.get_2d(Dimension::LightPosition);
        let Chosen { emitter, pmf, .. } = self.choose_any(p, n, sampler.get_u64(Dimension::LightChoice));
        match (emitter, &self.environment) {
            (Emitter::Area(light), _) => self.sample_area(light, pmf, p, u),
            (Emitter::Punctual(light), _) => self.sample_punctual(light, pmf, p),
            (Emitter::Distant(light), _) => self.sample_distant(light, pmf, u),
            (Emitter::Environment, Some(environment)) => {
                let texel = environment.choose_texel(sampler.get_u64(Dimension::Texel));
                let point = environment.sample(texel, u);
                self.sample_environment(pmf, point.wi, environment.lookup(&point))
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

    /// Bytes of all emitters and of the tree; the environment counts for itself.
    pub fn memory_bytes(&self) -> usize {
        let lights = size_of_val(&*self.areas) + size_of_val(&*self.punctual) + self.distant.memory_bytes();
        lights + self.tree.as_ref().map_or(0, LightTree::memory_bytes)
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

    /// The shares where there is light from far away, by the irradiance that each brings; or by power, where the environment,
    /// which has none to compare, gets half.
    fn shares(&self, n: Vec3, visit: Option<&Visit>) -> Shares {
        let environment = self
            .irradiance
            .as_ref()
            .map_or(0.0, |irradiance| f64::from(irradiance.at(n)));
        let weights = match self.sampling {
            LightSampling::Contribution => [
                environment,
                self.distant.irradiance(n),
                visit.map_or(0.0, |visit| f64::from(visit.irradiance())),
            ],
            LightSampling::Power => {
                let [distant, tree] = self.powers;
                [if environment > 0.0 { distant + tree } else { 0.0 }, distant, tree]
            }
        };
        // Estimates may be beyond what f32 holds.
        let weights = weights.map(|weight| weight.min(f64::from(f32::MAX)));
        let total: f64 = weights.iter().sum();
        let at_least = weights.map(|weight| {
            if weight > 0.0 {
                (weight / total).max(LEAST_PMF.into())
            } else {
                0.0
            }
        });
        let total: f64 = at_least.iter().sum();
        let [environment, distant, tree] = at_least.map(|share| if share > 0.0 { (share / total) as f32 } else { 0.0 });
        Shares {
            environment,
            distant,
            tree,
        }
    }
}
