//! The path tracer: the article's `Shade` as a loop.
//!
//! At each vertex, one emitter sample (equations 6 to 10) and one bounce that carries the recursion (equation 11). A
//! bounce that happens to hit an emitter estimates the same direct light; the two are combined by multiple importance
//! sampling. Roulette ends the path and keeps the weight.

use super::{BounceSampling, Roulette, Settings};
use crate::accel::{Accel, Hit, Ray};
use crate::bsdf::{Bsdf, BsdfSample};
use crate::interaction::{SurfaceInteraction, texture_coordinates};
use crate::math::{Rgb, Vec3};
use crate::sampling::mis::power_heuristic;
use crate::sampling::{Dimension, Sampler};
use crate::scene::{Scene, SceneFeatures};

/// Scattering events before roulette by throughput begins: short paths carry most of the image.
const ROULETTE_DEPTH: u32 = 4;

/// Most that a path may survive a round of roulette by throughput with: white walls would else trap it for good.
const MAX_SURVIVAL: f32 = 0.95;

/// Rays traced, by purpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayCounts {
    /// From the camera.
    pub camera: u64,
    /// That carry the recursion.
    pub bounce: u64,
    /// Towards emitters.
    pub shadow: u64,
}

impl RayCounts {
    /// Sum of two counts.
    pub fn plus(self, other: RayCounts) -> RayCounts {
        RayCounts {
            camera: self.camera + other.camera,
            bounce: self.bounce + other.bounce,
            shadow: self.shadow + other.shadow,
        }
    }
}

/// Estimates radiance in one scene. `F` is the set of features that the code is compiled for.
pub struct PathTracer<'a, A, const F: u32> {
    scene: &'a Scene,
    accel: &'a A,
    settings: &'a Settings,
}

/// One sample of the pixel in column `x`, row `y` of the full image.
pub(super) fn sample_pixel<A: Accel, const F: u32>(
    scene: &Scene,
    accel: &A,
    settings: &Settings,
    x: u32,
    y: u32,
    sample: u32,
    counts: &mut RayCounts,
) -> Rgb {
    let sampler = Sampler::new(settings.sampler, settings.seed, x, y, sample);
    let jitter = sampler.get_2d(Dimension::Pixel);
    let lens = if scene.camera.has_lens() {
        sampler.get_2d(Dimension::Lens)
    } else {
        [0.5; 2]
    };
    let ray = scene.camera.ray(x, y, jitter, lens);
    PathTracer::<A, F> { scene, accel, settings }.radiance(ray, sampler, counts)
}

/// What the next hit on an emitter needs to know of the bounce that led there.
struct Bounce {
    /// Where it started.
    p: Vec3,
    /// Its density [1/sr]; infinite for camera rays and delta lobes.
    pdf_w: f32,
}

impl<A: Accel, const F: u32> PathTracer<'_, A, F> {
    const ENVIRONMENT: bool = SceneFeatures(F).contains(SceneFeatures::ENVIRONMENT);
    const AREA_LIGHTS: bool = SceneFeatures(F).contains(SceneFeatures::AREA_LIGHTS);
    const CUTOUTS: bool = SceneFeatures(F).contains(SceneFeatures::CUTOUTS);

    /// Radiance that arrives along a camera ray [W·m⁻²·sr⁻¹].
    #[inline]
    fn radiance(&self, mut ray: Ray, mut sampler: Sampler, counts: &mut RayCounts) -> Rgb {
        let depth_limit = self.settings.depth_limit();
        let mut radiance = Rgb::BLACK;
        let mut throughput = Rgb::WHITE;
        // Undoes the solid-angle factor of refraction in roulette decisions.
        let mut eta_squared = 1.0;
        let mut bounce = Bounce {
            p: ray.origin,
            pdf_w: f32::INFINITY,
        };
        let mut depth = 0;
        counts.camera += 1;
        loop {
            sampler.set_bounce(depth);
            let Some(hit) = self.intersect(ray, &sampler) else {
                if Self::ENVIRONMENT {
                    radiance += throughput * self.escaped(&ray, &bounce);
                }
                return radiance;
            };
            let Some(si) = self.interaction(&hit, -ray.direction) else {
                return radiance;
            };
            if Self::AREA_LIGHTS {
                radiance += throughput * self.emitted(&hit, &si, &bounce);
            }
            if depth == depth_limit {
                return radiance;
            }
            let bsdf = self.bsdf(&hit, &si);
            if bsdf.is_black() {
                return radiance;
            }
            let wo = si.frame.to_local(si.wo);
            let is_delta = bsdf.is_delta();
            if !is_delta {
                radiance += throughput * self.direct(&si, &bsdf, wo, &sampler, counts);
            }
            depth += 1;
            // Past the limit a bounce counts only by the emitter it hits, and not even so without MIS.
            if depth == depth_limit && !self.settings.mis && !is_delta {
                return radiance;
            }

            let Some(sample) = self.sample_bounce(&bsdf, wo, &sampler) else {
                return radiance;
            };
            throughput *= sample.weight;
            eta_squared *= sample.eta_squared;
            let survival = self.survival(throughput, eta_squared, depth);
            if survival < 1.0 {
                if sampler.get_1d(Dimension::Roulette) >= survival {
                    return radiance;
                }
                throughput = throughput / survival;
            }
            ray = si.spawn_ray(si.frame.to_world(sample.wi), sample.wi.z < 0.0);
            bounce = Bounce {
                p: si.p,
                pdf_w: sample.pdf_w,
            };
            counts.bounce += 1;
        }
    }

    /// Direct light by one emitter sample (equations 6 to 10).
    #[inline]
    fn direct(&self, si: &SurfaceInteraction, bsdf: &Bsdf, wo: Vec3, sampler: &Sampler, counts: &mut RayCounts) -> Rgb {
        let lights = &self.scene.lights;
        let Some(light) = (match (Self::AREA_LIGHTS, Self::ENVIRONMENT) {
            (true, true) => lights.sample::<true, true>(si.p, sampler),
            (true, false) => lights.sample::<true, false>(si.p, sampler),
            (false, _) => lights.sample::<false, true>(si.p, sampler),
        }) else {
            return Rgb::BLACK;
        };
        let wi = si.frame.to_local(light.wi);
        let eval = bsdf.eval(wo, wi);
        if eval.value.is_black() {
            return Rgb::BLACK;
        }
        let weight = if self.settings.mis {
            power_heuristic(light.pdf_w, self.bounce_pdf_w(bsdf, wi, eval.pdf_w))
        } else {
            1.0
        };
        let transmitted = wi.z < 0.0;
        let ray = match light.target {
            Some(target) => si.spawn_ray_to(target, transmitted),
            None => Some(si.spawn_ray(light.wi, transmitted)),
        };
        let Some(ray) = ray else { return Rgb::BLACK };
        counts.shadow += 1;
        eval.value * light.radiance * (weight * self.transmittance(ray) / light.pdf_w)
    }

    /// Environment light that a ray which hits nothing brings.
    #[inline]
    fn escaped(&self, ray: &Ray, bounce: &Bounce) -> Rgb {
        let (radiance, light_pdf_w) = self.scene.lights.environment_eval(ray.direction);
        radiance * self.hit_weight(bounce, light_pdf_w)
    }

    /// Light that the emitter at a hit brings.
    #[inline]
    fn emitted(&self, hit: &Hit, si: &SurfaceInteraction, bounce: &Bounce) -> Rgb {
        let Some((emission, first_light)) = &self.scene.surfaces[hit.placement as usize].emission else {
            return Rgb::BLACK;
        };
        let radiance = emission.from_side(si.front);
        if radiance.is_black() {
            return Rgb::BLACK;
        }
        let cos = si.ng.dot(si.wo);
        let light_pdf_w =
            self.scene
                .lights
                .area_pdf_w(first_light + hit.triangle, bounce.p.distance_squared(si.p), cos);
        radiance * self.hit_weight(bounce, light_pdf_w)
    }

    /// The weight of an emitter that a bounce hit, whose emitter sample would have had this density.
    #[inline]
    fn hit_weight(&self, bounce: &Bounce, light_pdf_w: f32) -> f32 {
        if bounce.pdf_w == f32::INFINITY {
            1.0
        } else if self.settings.mis {
            power_heuristic(bounce.pdf_w, light_pdf_w)
        } else {
            0.0
        }
    }

    /// The direction that carries the recursion (equation 11).
    #[inline]
    fn sample_bounce(&self, bsdf: &Bsdf, wo: Vec3, sampler: &Sampler) -> Option<BsdfSample> {
        let lobe = if bsdf.has_lobes() {
            sampler.get_1d(Dimension::Lobe)
        } else {
            0.0
        };
        let u = sampler.get_2d(Dimension::Direction);
        match self.settings.bounce_sampling {
            BounceSampling::Cosine if !bsdf.is_delta() => bsdf.sample_hemisphere(wo, true, lobe, u),
            BounceSampling::Uniform if !bsdf.is_delta() => bsdf.sample_hemisphere(wo, false, lobe, u),
            _ => bsdf.sample(wo, lobe, u),
        }
    }

    /// Density of [`Self::sample_bounce`], given that of the BSDF's own sampling.
    #[inline]
    fn bounce_pdf_w(&self, bsdf: &Bsdf, wi: Vec3, bsdf_pdf_w: f32) -> f32 {
        match self.settings.bounce_sampling {
            BounceSampling::Bsdf => bsdf_pdf_w,
            BounceSampling::Cosine => bsdf.hemisphere_pdf_w(true, wi),
            BounceSampling::Uniform => bsdf.hemisphere_pdf_w(false, wi),
        }
    }

    /// The probability that the path goes on after its `depth`-th scattering event.
    #[inline]
    fn survival(&self, throughput: Rgb, eta_squared: f32, depth: u32) -> f32 {
        let carried = throughput.max_component();
        if carried <= 0.0 {
            return 0.0;
        }
        match self.settings.roulette {
            Roulette::Off => 1.0,
            Roulette::Fixed(survival) => survival,
            Roulette::Throughput if depth < ROULETTE_DEPTH => 1.0,
            Roulette::Throughput => (carried * eta_squared).min(MAX_SURVIVAL),
        }
    }

    #[inline]
    fn interaction(&self, hit: &Hit, wo: Vec3) -> Option<SurfaceInteraction> {
        let lift = self.settings.smooth_terminator;
        if SceneFeatures(F).contains(SceneFeatures::SMOOTH_NORMALS) {
            SurfaceInteraction::new::<true>(&self.scene.geometry, hit, wo, lift)
        } else {
            SurfaceInteraction::new::<false>(&self.scene.geometry, hit, wo, lift)
        }
    }

    #[inline]
    fn bsdf(&self, hit: &Hit, si: &SurfaceInteraction) -> Bsdf {
        let features = SceneFeatures(F);
        let surface = &self.scene.surfaces[hit.placement as usize];
        let material = &self.scene.materials[surface.material as usize];
        let textures = &self.scene.textures;
        match (
            features.contains(SceneFeatures::TEXTURES),
            features.contains(SceneFeatures::SPECULAR),
        ) {
            (false, false) => material.bsdf::<false, false>(textures, si),
            (true, false) => material.bsdf::<true, false>(textures, si),
            (false, true) => material.bsdf::<false, true>(textures, si),
            (true, true) => material.bsdf::<true, true>(textures, si),
        }
    }

    /// The nearest hit that is there: a partly transparent surface lets a ray pass by chance.
    #[inline]
    fn intersect(&self, mut ray: Ray, sampler: &Sampler) -> Option<Hit> {
        if !Self::CUTOUTS {
            return self.accel.intersect(&ray);
        }
        let mut surfaces = 0;
        loop {
            let hit = self.accel.intersect(&ray)?;
            let opacity = self.opacity(&hit);
            if opacity >= 1.0 || sampler.get_opacity(surfaces) < opacity {
                return Some(hit);
            }
            surfaces += 1;
            ray.t_min = hit.t.next_up();
        }
    }

    /// The fraction of light that passes along a segment.
    #[inline]
    fn transmittance(&self, mut ray: Ray) -> f32 {
        // The kernel for everything also asks the scene: the two queries of a backend may disagree about a hit at the
        // very end of the segment, and the image must not depend on the kernel.
        if !Self::CUTOUTS || !self.scene.features.contains(SceneFeatures::CUTOUTS) {
            return if self.accel.occluded(&ray) { 0.0 } else { 1.0 };
        }
        let mut transmittance = 1.0;
        while let Some(hit) = self.accel.intersect(&ray) {
            transmittance *= 1.0 - self.opacity(&hit);
            if transmittance == 0.0 {
                break;
            }
            ray.t_min = hit.t.next_up();
        }
        transmittance
    }

    fn opacity(&self, hit: &Hit) -> f32 {
        let material = &self.scene.materials[self.scene.surfaces[hit.placement as usize].material as usize];
        if material.opacity.is_none() {
            return 1.0;
        }
        material.opacity(&self.scene.textures, texture_coordinates(&self.scene.geometry, hit))
    }
}
