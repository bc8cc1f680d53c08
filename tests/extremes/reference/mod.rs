//! The estimator in f64: what `embrace::integrator` computes with its default settings, written to be read.
//!
//! One path at a time, one vertex after the other, every ray against every triangle. Shared with the library are the
//! inputs (vertices and parameters as the built scene holds them, in f32), the random numbers, which texel and which emitter
//! they select, and the probability of that emitter; everything else is computed here, in f64 and from the formulas. Maps from random numbers to
//! directions are the library's, since another map would be another path. Bitmaps, instances and cut-outs are left out.
//!
//! Every path keeps a record of its decisions and of how close each of them was, to compare with the path in f32.

mod bsdf;
mod geometry;
mod light;

pub(crate) use geometry::{Geometry, Hit, Ray, TriangleName};

use bsdf::Bsdf;
use embrace::camera::CameraDesc;
use embrace::integrator::{SampleId, Settings};
use embrace::math::{DVec3, Rgb};
use embrace::sampling::{Dimension, Sampler};
use embrace::scene::{Scene, SceneDesc};
use geometry::Interaction;
use light::{LightSample, Lights, Origin};

/// Roulette by throughput: its factor, and the least and the most that a path may survive a round with, early and late.
const ROULETTE_FACTOR: f64 = 3.0;
const SURVIVAL: [(f64, f64); 2] = [(0.5, 1.0), (0.05, 0.95)];
const EARLY: u32 = 4;

/// A scene, ready for the estimator.
pub(crate) struct Reference<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    camera: Camera,
    pub(crate) geometry: Geometry,
    lights: Lights<'a>,
}

/// A path and its decisions.
#[derive(Default)]
pub(crate) struct Path {
    /// [W·m⁻²·sr⁻¹], by channel.
    pub(crate) radiance: DVec3,
    pub(crate) vertices: Vec<Vertex>,
}

/// One step of a path.
pub(crate) struct Vertex {
    /// The ray that leads here.
    pub(crate) ray: Ray,
    /// What it meets.
    pub(crate) hit: Option<Hit>,
    /// Whether the emitter sample is occluded, if there is one.
    pub(crate) occluded: Option<bool>,
    pub(crate) margins: Margins,
}

/// How far the decisions at a vertex were from going the other way; infinite where there was none.
#[derive(Clone, Copy)]
pub(crate) struct Margins {
    /// Whether the emitter sample is worth a ray: the cosine that is nearest to zero.
    pub(crate) light: f64,
    /// Which tangents the shading normal has: they change with the sign of its z.
    pub(crate) frame: f64,
    /// Which lobe: the change of the cosine that it depends on.
    pub(crate) lobe: f64,
    /// Whether the surface scatters into the bounce: the cosine that is nearest to zero.
    pub(crate) bounce: f64,
    /// Whether the path goes on: the random number against the probability, relative to it.
    pub(crate) roulette: f64,
}

impl<'a> Reference<'a> {
    /// For the scene that was built from this description.
    pub(crate) fn new(desc: &SceneDesc, scene: &'a Scene, settings: &'a Settings) -> Reference<'a> {
        let geometry = Geometry::new(&scene.geometry);
        Reference {
            scene,
            settings,
            camera: Camera::new(&desc.camera, scene),
            lights: Lights::new(desc.environment.as_ref(), scene, &geometry),
            geometry,
        }
    }

    /// One sample of one pixel.
    pub(crate) fn path(&self, SampleId { sample, y, x }: SampleId) -> Path {
        let mut sampler = Sampler::new(self.settings.sampler, self.settings.seed, x, y, sample);
        let mut ray = self.camera.ray(x, y, &sampler);
        let mut throughput = DVec3::ONE;
        let mut roulette_scale = ROULETTE_FACTOR;
        let mut previous = Origin {
            p: ray.origin,
            n: DVec3::ZERO,
        };
        let mut bounce_pdf_w = f64::INFINITY;
        let mut path = Path::default();
        for depth in 0.. {
            let hit = self.geometry.intersect(&ray);
            path.vertices.push(Vertex {
                ray,
                hit,
                occluded: None,
                margins: Margins::NONE,
            });
            let vertex = path.vertices.last_mut().expect("the vertex just pushed");
            let Some(hit) = hit else {
                let (radiance, light_pdf_w) = self.lights.escaped(ray.direction, &previous);
                path.radiance += throughput * radiance * power_heuristic(bounce_pdf_w, light_pdf_w);
                break;
            };
            let si = Interaction::new(&self.geometry, &hit, -ray.direction, self.settings.smooth_terminator);
            let (radiance, light_pdf_w) = self.lights.met(self.scene, &hit, &si, &previous);
            path.radiance += throughput * radiance * power_heuristic(bounce_pdf_w, light_pdf_w);
            if Some(depth) == self.settings.max_depth {
                break;
            }
            let surface = &self.scene.surfaces[hit.name.placement as usize];
            let bsdf = Bsdf::new(&self.scene.materials[surface.material as usize], si.front);
            if bsdf.is_black() {
                break;
            }
            let wo = si.frame.to_local(si.wo);
            vertex.margins.frame = si.frame.margin();
            let here = Origin {
                p: si.p,
                n: if surface.transmits {
                    DVec3::ZERO
                } else {
                    si.frame.normal()
                },
            };
            if !surface.is_delta
                && let Some(light) = self.lights.sample(&here, &sampler)
            {
                let wi = si.frame.to_local(light.wi);
                vertex.margins.light = light.cos.abs().min(bsdf.margin(wo, wi));
                if let Some((ray, radiance)) = direct(&light, &si, &bsdf, wo, wi) {
                    let occluded = self.geometry.occluded(&ray);
                    vertex.occluded = Some(occluded);
                    if !occluded {
                        path.radiance += throughput * radiance;
                    }
                }
            }

            let lobe = f64::from(sampler.get_1d(Dimension::Lobe));
            let u = sampler.get_2d(Dimension::Direction).map(f64::from);
            vertex.margins.lobe = bsdf.lobe_margin(wo, lobe, u);
            let drawn = bsdf.sample_direction(wo, lobe, u);
            vertex.margins.bounce = drawn.map_or(f64::INFINITY, |(wi, _)| bsdf.margin(wo, wi));
            let Some(sample) = drawn.and_then(|drawn| bsdf.weigh(wo, drawn)) else {
                break;
            };
            throughput *= sample.weight;
            roulette_scale *= sample.eta_squared;
            if depth == 0 {
                roulette_scale /= throughput.max_element();
            }
            let (least, most) = SURVIVAL[usize::from(depth + 1 >= EARLY)];
            let survival = (throughput.max_element() * roulette_scale).clamp(least, most);
            let u = f64::from(sampler.get_1d(Dimension::Roulette));
            vertex.margins.roulette = (u / survival - 1.0).abs();
            if u >= survival {
                break;
            }
            throughput /= survival;
            (previous, bounce_pdf_w) = (here, sample.pdf_w);
            sampler.set_bounce(depth + 1);
            ray = si.spawn_ray(si.frame.to_world(sample.wi), sample.wi.z < 0.0);
        }
        path
    }
}

impl Margins {
    const NONE: Margins = Margins {
        light: f64::INFINITY,
        frame: f64::INFINITY,
        lobe: f64::INFINITY,
        bounce: f64::INFINITY,
        roulette: f64::INFINITY,
    };
}

/// Direct light by one emitter sample, and the ray that tells whether it arrives; `None` if the surface sends none back.
fn direct(light: &LightSample, si: &Interaction, bsdf: &Bsdf, wo: DVec3, wi: DVec3) -> Option<(Ray, DVec3)> {
    if light.radiance == DVec3::ZERO {
        return None;
    }
    let (value, bsdf_pdf_w) = bsdf.eval(wo, wi);
    if value == DVec3::ZERO {
        return None;
    }
    let ray = match light.target {
        Some(target) => si.spawn_ray_to(target, wi.z < 0.0),
        None => si.spawn_ray(light.wi, wi.z < 0.0),
    };
    let weight = power_heuristic(light.pdf_w, bsdf_pdf_w) / light.pdf_w;
    Some((ray, value * light.radiance * weight))
}

/// The weight of a sample of the first of two densities; all of it if that one is infinite.
fn power_heuristic(pdf: f64, other: f64) -> f64 {
    if pdf == f64::INFINITY {
        1.0
    } else {
        pdf * pdf / (pdf * pdf + other * other)
    }
}

fn rgb(Rgb { r, g, b }: Rgb) -> DVec3 {
    DVec3::new(r.into(), g.into(), b.into())
}

/// The camera of the description, standing where the scene has it.
struct Camera {
    origin: DVec3,
    right: DVec3,
    up: DVec3,
    forward: DVec3,
    /// Half of the image at unit distance.
    half_size: [f64; 2],
    resolution: [f64; 2],
    aperture_radius: f64,
    focus_distance: f64,
}

impl Camera {
    fn new(desc: &CameraDesc, scene: &Scene) -> Camera {
        let view = desc.look_at - desc.position;
        let forward = view.normalize();
        let right = forward.cross(desc.up).normalize();
        let resolution = desc.resolution.map(f64::from);
        let half_height = (0.5 * desc.vfov_degrees.to_radians()).tan();
        Camera {
            // The middle of the lens, in the coordinates of the vertices.
            origin: scene.camera.ray(0, 0, [0.5; 2], [0.5; 2]).origin.as_dvec3(),
            right,
            up: right.cross(forward),
            forward,
            half_size: [half_height * resolution[0] / resolution[1], half_height],
            resolution,
            aperture_radius: desc.aperture_radius,
            focus_distance: desc.focus_distance.unwrap_or(view.length()),
        }
    }

    fn ray(&self, x: u32, y: u32, sampler: &Sampler) -> Ray {
        let jitter = sampler.get_2d(Dimension::Pixel).map(f64::from);
        let ndc_x = 2.0 * (f64::from(x) + jitter[0]) / self.resolution[0] - 1.0;
        let ndc_y = 1.0 - 2.0 * (f64::from(y) + jitter[1]) / self.resolution[1];
        let through = self.forward + self.right * (ndc_x * self.half_size[0]) + self.up * (ndc_y * self.half_size[1]);
        let mut offset = DVec3::ZERO;
        if self.aperture_radius > 0.0 {
            let [lens_x, lens_y] = bsdf::disk(sampler.get_2d(Dimension::Lens).map(f64::from));
            offset = (self.right * lens_x + self.up * lens_y) * self.aperture_radius;
        }
        Ray {
            origin: self.origin + offset,
            direction: (through * self.focus_distance - offset).normalize(),
            t_max: f64::INFINITY,
        }
    }
}
