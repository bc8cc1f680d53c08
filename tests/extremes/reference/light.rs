//! Emitters and the densities of sampling them.

use super::geometry::{Geometry, Hit, Interaction};
use super::rgb;
use embrace::light::{Chosen, Emission, Emitter, Environment, LightSampler};
use embrace::math::{DVec3, Vec3};
use embrace::sampling::{Dimension, Sampler};
use embrace::scene::{EnvironmentDesc, Scene};
use std::f64::consts::{PI, TAU};

/// All emitters of a scene.
pub(super) struct Lights<'a> {
    areas: Vec<AreaLight>,
    environment: Option<Sky<'a>>,
    /// Only for the choice between emitters.
    choice: &'a LightSampler,
}

struct AreaLight {
    corners: [DVec3; 3],
    normal: DVec3,
    emission: Emission,
    offset: f64,
    area: f64,
}

/// Where light arrives.
pub(super) struct Origin {
    pub(super) p: DVec3,
    /// The side it is sampled on; zero for both.
    pub(super) n: DVec3,
}

impl Origin {
    /// What the choice of an emitter depends on: it is made in f32, and which one is drawn by which numbers is shared.
    fn rounded(&self) -> [Vec3; 2] {
        [self.p.as_vec3(), self.n.as_vec3()]
    }
}

/// Light from infinity.
enum Sky<'a> {
    Constant(DVec3),
    Map(Map<'a>),
}

struct Map<'a> {
    /// Only to find out which texel random bits select.
    table: &'a Environment,
    width: usize,
    height: usize,
    texels: Vec<Texel>,
    rotation: f64,
}

struct Texel {
    radiance: DVec3,
    /// Probability over the mean one.
    probability: f64,
}

/// A direction towards an emitter.
pub(super) struct LightSample {
    pub(super) wi: DVec3,
    /// Black if the emitter turns its back.
    pub(super) radiance: DVec3,
    /// [1/sr]
    pub(super) pdf_w: f64,
    /// On the emitter; 1 for the environment.
    pub(super) cos: f64,
    /// Where the shadow ray ends; `None`: at infinity.
    pub(super) target: Option<DVec3>,
}

fn luminance(rgb: DVec3) -> f64 {
    DVec3::new(0.2126, 0.7152, 0.0722).dot(rgb)
}

impl<'a> Lights<'a> {
    pub(super) fn new(desc: Option<&EnvironmentDesc>, scene: &'a Scene, geometry: &Geometry) -> Lights<'a> {
        let mut areas = Vec::new();
        for triangle in &geometry.0 {
            let Some((emission, _)) = scene.surfaces[triangle.name.placement as usize].emission else {
                continue;
            };
            areas.push(AreaLight {
                corners: triangle.corners,
                normal: triangle.normal(),
                emission,
                offset: triangle.offset(),
                area: triangle.area(),
            });
        }
        let environment = desc.map(|desc| match desc {
            EnvironmentDesc::Constant(radiance) => Sky::Constant(rgb(*radiance)),
            EnvironmentDesc::Map {
                image,
                scale,
                rotation_degrees,
                ..
            } => {
                let (width, height) = (image.width as usize, image.height as usize);
                let radiance = |k: usize| rgb(image.pixels[k]) * f64::from(*scale);
                let sin_theta = |k: usize| (PI * ((k / width) as f64 + 0.5) / height as f64).sin();
                let count = width * height;
                let light: f64 = (0..count).map(|k| luminance(radiance(k)) * sin_theta(k)).sum();
                let mean_luminance = light / (0..count).map(sin_theta).sum::<f64>();
                // With MIS, what is not brighter than the mean is left to bounces.
                let weight = |k: usize| (luminance(radiance(k)) - mean_luminance).max(0.0) * sin_theta(k);
                let mean = (0..count).map(weight).sum::<f64>() / count as f64;
                let texels = (0..count).map(|k| Texel {
                    radiance: radiance(k),
                    probability: weight(k) / mean,
                });
                Sky::Map(Map {
                    table: scene.lights.environment().expect("the environment of the description"),
                    width,
                    height,
                    texels: texels.collect(),
                    rotation: rotation_degrees.to_radians(),
                })
            }
        });
        Lights {
            areas,
            environment,
            choice: &scene.lights,
        }
    }

    /// Radiance of the environment, and the density of sampling its direction from `previous`.
    pub(super) fn escaped(&self, wi: DVec3, previous: &Origin) -> (DVec3, f64) {
        let (radiance, pdf_w) = self.environment(wi);
        let [p, n] = previous.rounded();
        (radiance, pdf_w * f64::from(self.choice.environment_pmf(p, n)))
    }

    /// Radiance of the environment, and the density of sampling its direction once it is chosen.
    fn environment(&self, wi: DVec3) -> (DVec3, f64) {
        match &self.environment {
            None => (DVec3::ZERO, 0.0),
            Some(Sky::Constant(radiance)) => (*radiance, 1.0 / (2.0 * TAU)),
            Some(Sky::Map(map)) => map.lookup(map.locate(wi)),
        }
    }

    /// Radiance of the emitter at a hit, and the density of sampling it from `previous`.
    pub(super) fn met(&self, scene: &Scene, hit: &Hit, si: &Interaction, previous: &Origin) -> (DVec3, f64) {
        match scene.surfaces[hit.name.placement as usize].emission {
            Some((emission, first)) if si.front || emission.both_sides => {
                let light = first + hit.name.triangle;
                let [p, n] = previous.rounded();
                let pmf = f64::from(self.choice.area_pmf(light, p, n));
                let pdf_a = pmf / self.areas[light as usize].area;
                let pdf_w = pdf_a * previous.p.distance_squared(si.p) / si.ng.dot(si.wo);
                (rgb(emission.radiance), pdf_w)
            }
            _ => (DVec3::ZERO, 0.0),
        }
    }

    /// Draws a direction towards an emitter.
    pub(super) fn sample(&self, from: &Origin, sampler: &Sampler) -> Option<LightSample> {
        let u = sampler.get_2d(Dimension::LightPosition).map(f64::from);
        let [p, n] = from.rounded();
        let bits = sampler.get_u64(Dimension::LightChoice);
        let Chosen { emitter, pmf, .. } = self.choice.choose::<true, true>(p, n, bits);
        let pmf = f64::from(pmf);
        match (emitter, &self.environment) {
            (Emitter::Area(light), _) => Some(self.areas[light as usize].sample(pmf, from.p, u)),
            (Emitter::Environment, Some(sky)) => {
                let wi = match sky {
                    Sky::Constant(_) => uniform_sphere(u),
                    Sky::Map(map) => map.sample(map.table.choose_texel(sampler.get_u64(Dimension::Texel)), u),
                };
                let (radiance, pdf_w) = self.environment(wi);
                Some(LightSample {
                    wi,
                    radiance,
                    pdf_w: pdf_w * pmf,
                    cos: 1.0,
                    target: None,
                })
            }
            _ => None,
        }
    }
}

impl AreaLight {
    fn sample(&self, pmf: f64, p: DVec3, [u, v]: [f64; 2]) -> LightSample {
        // Heitz 2019, "A low-distortion map between triangle and square".
        let half = 0.5 * u.min(v);
        let [a, b, c] = self.corners;
        let point = a + (b - a) * (u - half) + (c - a) * (v - half);
        let wi = (point - p).normalize();
        let cos = -self.normal.dot(wi);
        LightSample {
            wi,
            radiance: if cos > 0.0 || self.emission.both_sides {
                rgb(self.emission.radiance)
            } else {
                DVec3::ZERO
            },
            pdf_w: pmf / self.area * p.distance_squared(point) / cos.abs(),
            cos,
            target: Some(point + self.normal * (self.offset * cos.signum())),
        }
    }
}

impl Map<'_> {
    /// A direction around the centre of a texel, tent-distributed over the image.
    fn sample(&self, texel: u32, u: [f64; 2]) -> DVec3 {
        let (column, row) = (texel as usize % self.width, texel as usize / self.width);
        let u_image = (column as f64 + 0.5 + tent(u[0])) / self.width as f64;
        let v_image = (row as f64 + 0.5 + tent(u[1])) / self.height as f64;
        // Past a pole, back on the same meridian.
        let v_image = v_image.abs();
        let v_image = 1.0 - (1.0 - v_image).abs();
        let (sin_theta, cos_theta) = (PI * v_image).sin_cos();
        let (sin_phi, cos_phi) = (TAU * u_image - self.rotation).sin_cos();
        DVec3::new(sin_phi * sin_theta, cos_theta, -cos_phi * sin_theta)
    }

    /// Image coordinates of a direction, and the sine of the angle to the pole.
    fn locate(&self, wi: DVec3) -> ([f64; 2], f64) {
        let sin_theta = wi.x.hypot(wi.z);
        let phi = wi.x.atan2(-wi.z) + self.rotation;
        ([phi / TAU, sin_theta.atan2(wi.y) / PI], sin_theta)
    }

    /// Radiance and density, both interpolated bilinearly, wrapping around and repeating the rows at the poles.
    fn lookup(&self, ([u, v], sin_theta): ([f64; 2], f64)) -> (DVec3, f64) {
        let (column, row) = (u * self.width as f64 - 0.5, v * self.height as f64 - 0.5);
        let (mut radiance, mut probability) = (DVec3::ZERO, 0.0);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let tent = |c: f64, d: i64| if d == 0 { 1.0 - (c - c.floor()) } else { c - c.floor() };
            let x = (column.floor() as i64 + dx).rem_euclid(self.width as i64) as usize;
            let y = (row.floor() as i64 + dy).clamp(0, self.height as i64 - 1) as usize;
            let weight = tent(column, dx) * tent(row, dy);
            let texel = &self.texels[y * self.width + x];
            radiance += texel.radiance * weight;
            probability += texel.probability * weight;
        }
        (radiance, probability / (TAU * PI * sin_theta))
    }
}

fn uniform_sphere([u, v]: [f64; 2]) -> DVec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (TAU * v).sin_cos();
    DVec3::new(r * cos, r * sin, z)
}

/// A number in (-1, 1) with the density 1 − |x|.
fn tent(u: f64) -> f64 {
    (1.0 - (2.0 * u).min(2.0 - 2.0 * u).sqrt()).copysign(u - 0.5)
}
