//! The path tracer: the article's `Shade` as a loop, over a batch of paths at a time.
//!
//! At each vertex, one emitter sample (equations 6 to 10) and one bounce that carries the recursion (equation 11). A
//! bounce that happens to hit an emitter estimates the same direct light; the two are combined by multiple importance
//! sampling. Roulette ends the path and keeps the weight.
//!
//! All paths of a batch make the same step before any makes the next one, for three reasons: a backend traces camera and
//! shadow rays faster together than alone; a loop that only fetches from an environment map, far larger than the
//! caches, waits for many texels at once; and a loop that does one thing keeps the processor's pipelines full. What a
//! path computes does not depend on the others in its batch.

use super::{BounceSampling, Roulette, Settings};
use crate::accel::{Accel, Hit, Ray};
use crate::bsdf::{Bsdf, BsdfSample};
use crate::film::Rect;
use crate::interaction::{SurfaceInteraction, texture_coordinates};
use crate::light::{Emitter, EnvironmentPoint, LightSample};
use crate::math::{DVec3, Rgb, Vec3};
use crate::sampling::mis::power_heuristic;
use crate::sampling::{Dimension, Sampler};
use crate::scene::{Scene, SceneFeatures};
use serde::Serialize;

/// Scattering events before roulette by throughput begins: short paths carry most of the image.
const ROULETTE_DEPTH: u32 = 4;

/// Most that a path may survive a round of roulette by throughput with: white walls would else trap it for good.
const MAX_SURVIVAL: f32 = 0.95;

/// Least that a path may survive such a round with. However little a path carries, the emitter that it meets may be as much
/// brighter; by throughput alone a path of 1e-12 would survive once in 1e12 samples, and the light that it brings be
/// missing from every image. Of such paths, 1 in 400 survives two rounds.
const MIN_SURVIVAL: f32 = 0.05;

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

/// Paths that advance together. Enough to fill packets of rays for several bounces, and few enough that their state stays
/// in a core's own cache.
const BATCH: usize = 256;

/// Names one sample of one pixel of the full image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct SampleId {
    /// Index of the sample.
    pub sample: u32,
    /// Row.
    pub y: u32,
    /// Column.
    pub x: u32,
}

/// A path on its way. Its ray is kept apart, where a backend finds all rays side by side.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Index into [`Batch::radiance`].
    sample: u32,
    sampler: Sampler,
    throughput: Rgb,
    /// Undoes the solid-angle factor of refraction in roulette decisions.
    eta_squared: f32,
    bounce: Bounce,
}

/// What the next hit on an emitter needs to know of the bounce that led there.
#[derive(Clone, Copy, Debug)]
struct Bounce {
    /// Where it started.
    p: Vec3,
    /// Its density [1/sr]; infinite for camera rays and delta lobes.
    pdf_w: f32,
}

/// The state of a batch of paths. Kept from one batch to the next so that rendering does not allocate.
#[derive(Debug, Default)]
pub struct Batch {
    /// By sample: which one, and the light so far. In f64: an f32 sum of equal addends is off by more than 1e-4 after
    /// 10,000 bounces.
    samples: Vec<SampleId>,
    radiance: Vec<DVec3>,
    /// By path, those that are still on their way.
    paths: Vec<Path>,
    rays: Vec<Ray>,
    hits: Vec<Option<Hit>>,
    /// The rays of one block of pixels, where only a part of it is wanted, and what they meet.
    block_rays: Vec<Ray>,
    block_hits: Vec<Option<Hit>>,
    /// By path: the emitter to sample at its hit; if that is the environment, the sample.
    emitters: Vec<Emitter>,
    environment_samples: Vec<Option<LightSample>>,
    /// From random bits to a texel to a place on the environment, each with the path that asks.
    texel_bits: Vec<(u32, u64)>,
    texels: Vec<(u32, u32)>,
    lookups: Vec<(u32, EnvironmentPoint)>,
    /// Rays towards emitters; and by ray, the sample and the light that arrives if nothing is in between.
    shadow_rays: Vec<Ray>,
    shadow_light: Vec<(u32, Rgb)>,
    occluded: Vec<bool>,
}

impl Batch {
    /// Takes the next samples to compute, up to 256; false if there are none.
    pub fn fill(&mut self, samples: &mut impl Iterator<Item = SampleId>) -> bool {
        self.samples.clear();
        self.samples.extend(samples.take(BATCH));
        !self.samples.is_empty()
    }

    /// The samples and their radiance [W·m⁻²·sr⁻¹], once a kernel has computed them.
    pub fn results(&self) -> impl Iterator<Item = (SampleId, Rgb)> {
        let radiance = self.radiance.iter().map(|sum| Rgb::from(sum.to_array()));
        self.samples.iter().copied().zip(radiance)
    }
}

/// The probability that random numbers, which are multiples of 2⁻²⁴, meet exactly: `p` rounded down to the next, but not to
/// 0. Any other would be met by too many; one below 2⁻²⁴ by the number 0, at a weight of 1 / `p`.
#[inline]
fn drawable(p: f32) -> f32 {
    const STEPS: f32 = 16_777_216.0;
    ((p * STEPS) as i32).max(i32::from(p > 0.0)) as f32 / STEPS
}

/// Adds what an emitter sends along a path to its sample. Most surfaces send nothing.
#[inline(always)]
fn add(radiance: &mut [DVec3], path: &Path, emitted: Rgb) {
    if !emitted.is_black() {
        radiance[path.sample as usize] += wide(path.throughput * emitted);
    }
}

/// The channels in f64.
#[inline]
fn wide(rgb: Rgb) -> DVec3 {
    DVec3::from(rgb.to_array().map(f64::from))
}

/// Estimates radiance in one scene. `F` is the set of features that the code is compiled for.
struct PathTracer<'a, A, const F: u32> {
    scene: &'a Scene,
    accel: &'a A,
    settings: &'a Settings,
}

/// Traces the paths of a batch.
pub(super) fn trace<A: Accel, const F: u32>(
    scene: &Scene,
    accel: &A,
    settings: &Settings,
    batch: &mut Batch,
    counts: &mut RayCounts,
) {
    PathTracer::<A, F> { scene, accel, settings }.trace(batch, counts);
}

impl<A: Accel, const F: u32> PathTracer<'_, A, F> {
    const ENVIRONMENT: bool = SceneFeatures(F).contains(SceneFeatures::ENVIRONMENT);
    const AREA_LIGHTS: bool = SceneFeatures(F).contains(SceneFeatures::AREA_LIGHTS);

    fn trace(&self, batch: &mut Batch, counts: &mut RayCounts) {
        let depth_limit = self.settings.depth_limit();
        self.start(batch);
        counts.camera += batch.paths.len() as u64;
        for depth in 0.. {
            self.intersect(depth, batch);
            if Self::ENVIRONMENT {
                self.add_escaped(batch);
            }
            if depth == depth_limit {
                if Self::AREA_LIGHTS {
                    self.add_emitted(batch);
                }
                return;
            }
            self.choose_emitters(batch);
            if Self::ENVIRONMENT {
                self.sample_environment(batch);
            }
            self.scatter(depth, batch);
            counts.bounce += batch.paths.len() as u64;
            counts.shadow += batch.shadow_rays.len() as u64;
            self.add_unoccluded(batch);
            if batch.paths.is_empty() {
                return;
            }
        }
    }

    /// Starts a path at the camera for each sample.
    fn start(&self, batch: &mut Batch) {
        batch.radiance.clear();
        batch.radiance.resize(batch.samples.len(), DVec3::ZERO);
        batch.paths.clear();
        batch.rays.clear();
        for (i, id) in batch.samples.iter().enumerate() {
            let (sampler, ray) = self.camera_ray(*id);
            batch.paths.push(Path {
                sample: i as u32,
                sampler,
                throughput: Rgb::WHITE,
                eta_squared: 1.0,
                bounce: Bounce {
                    p: ray.origin,
                    pdf_w: f32::INFINITY,
                },
            });
            batch.rays.push(ray);
        }
    }

    #[inline(always)]
    fn camera_ray(&self, SampleId { sample, y, x }: SampleId) -> (Sampler, Ray) {
        let camera = &self.scene.camera;
        let sampler = Sampler::new(self.settings.sampler, self.settings.seed, x, y, sample);
        let jitter = sampler.get_2d(Dimension::Pixel);
        let lens = if camera.has_lens() {
            sampler.get_2d(Dimension::Lens)
        } else {
            [0.5; 2]
        };
        (sampler, camera.ray(x, y, jitter, lens))
    }

    /// Finds what each path meets.
    fn intersect(&self, depth: u32, batch: &mut Batch) {
        let Batch { paths, rays, hits, .. } = batch;
        hits.clear();
        if self.has_cutouts() {
            hits.extend(
                rays.iter()
                    .zip(&*paths)
                    .map(|(ray, path)| self.nearest_opaque(*ray, &path.sampler)),
            );
        } else if depth == 0 {
            self.intersect_camera(batch);
        } else {
            hits.extend(rays.iter().map(|ray| self.accel.intersect(ray)));
        }
    }

    /// Finds what camera rays meet, those of a block of pixels together. Of triangles at the same distance, a backend may
    /// find another one in other company, so the company is always the same: where only a part of a block is wanted, the
    /// rest is traced as well.
    fn intersect_camera(&self, batch: &mut Batch) {
        let [x1, y1] = self.scene.camera.resolution();
        let image = Rect { x0: 0, y0: 0, x1, y1 };
        let block = |id: &SampleId| Rect::block(id.x, id.y);
        let together = |a: &SampleId, b: &SampleId| a.sample == b.sample && block(a) == block(b);
        let mut first = 0;
        for ids in batch.samples.chunk_by(together) {
            let rays = &batch.rays[first..first + ids.len()];
            first += ids.len();
            let block = block(&ids[0]).intersection(image);
            if ids.len() as u64 == block.pixels() {
                self.accel.intersect_coherent(rays, &mut batch.hits);
                continue;
            }
            let whole = || block.coordinates().map(|(x, y)| SampleId { x, y, ..ids[0] });
            batch.block_rays.clear();
            batch.block_rays.extend(whole().map(|id| self.camera_ray(id).1));
            batch.block_hits.clear();
            self.accel.intersect_coherent(&batch.block_rays, &mut batch.block_hits);
            let wanted = whole().zip(&batch.block_hits).filter(|(id, _)| ids.contains(id));
            batch.hits.extend(wanted.map(|(_, hit)| hit));
        }
    }

    /// Adds the environment's light to paths that met nothing.
    fn add_escaped(&self, batch: &mut Batch) {
        let Some(environment) = self.scene.lights.environment() else {
            return;
        };
        batch.lookups.clear();
        for (i, (hit, ray)) in batch.hits.iter().zip(&batch.rays).enumerate() {
            if hit.is_none() {
                batch.lookups.push((i as u32, environment.locate(ray.direction)));
            }
        }
        for (i, point) in &batch.lookups {
            let path = &batch.paths[*i as usize];
            let (radiance, light_pdf_w) = self.scene.lights.environment_lookup(environment, point);
            let light = radiance * self.hit_weight(&path.bounce, light_pdf_w);
            batch.radiance[path.sample as usize] += wide(path.throughput * light);
        }
    }

    /// Adds the light of emitters that paths met.
    fn add_emitted(&self, batch: &mut Batch) {
        for ((path, ray), hit) in batch.paths.iter().zip(&batch.rays).zip(&batch.hits) {
            let Some(hit) = hit else { continue };
            if let Some(si) = self.interaction(ray, hit) {
                add(&mut batch.radiance, path, self.emitted(hit, &si, &path.bounce));
            }
        }
    }

    /// Chooses the emitter to sample at each hit.
    fn choose_emitters(&self, batch: &mut Batch) {
        let lights = &self.scene.lights;
        batch.emitters.clear();
        batch
            .emitters
            .extend(batch.paths.iter().zip(&batch.hits).map(|(path, hit)| {
                let scatters = hit.is_some_and(|hit| !self.scene.surfaces[hit.placement as usize].is_delta);
                match (Self::AREA_LIGHTS, Self::ENVIRONMENT) {
                    _ if !scatters => Emitter::None,
                    (true, true) => lights.choose::<true, true>(&path.sampler),
                    (true, false) => lights.choose::<true, false>(&path.sampler),
                    (false, true) => lights.choose::<false, true>(&path.sampler),
                    (false, false) => Emitter::None,
                }
            }));
    }

    /// Samples the environment for the hits that chose it, which needs no hit point.
    fn sample_environment(&self, batch: &mut Batch) {
        let lights = &self.scene.lights;
        let Some(environment) = lights.environment() else {
            return;
        };
        let Batch {
            paths,
            emitters,
            environment_samples,
            texel_bits,
            texels,
            lookups,
            ..
        } = batch;
        texel_bits.clear();
        for (i, (emitter, path)) in emitters.iter().zip(&*paths).enumerate() {
            if *emitter == Emitter::Environment {
                texel_bits.push((i as u32, path.sampler.get_u64(Dimension::Texel)));
            }
        }
        texels.clear();
        texels.extend(texel_bits.iter().map(|&(i, bits)| (i, environment.choose_texel(bits))));
        lookups.clear();
        lookups.extend(texels.iter().map(|&(i, texel)| {
            let u = paths[i as usize].sampler.get_2d(Dimension::LightPosition);
            (i, environment.sample(texel, u))
        }));
        environment_samples.resize(paths.len(), None);
        for (i, point) in lookups {
            environment_samples[*i as usize] = lights.sample_environment(environment, point);
        }
    }

    /// Scatters each path at its hit: prepares direct light, and the ray that carries the recursion. Paths that end are
    /// removed; the others keep their order.
    fn scatter(&self, depth: u32, batch: &mut Batch) {
        batch.shadow_rays.clear();
        batch.shadow_light.clear();
        let mut alive = 0;
        for i in 0..batch.paths.len() {
            if let Some((path, ray)) = self.scatter_path(depth, i, batch) {
                batch.paths[alive] = path;
                batch.rays[alive] = ray;
                alive += 1;
            }
        }
        batch.paths.truncate(alive);
        batch.rays.truncate(alive);
    }

    /// Adds the light of emitter samples that arrives.
    fn add_unoccluded(&self, batch: &mut Batch) {
        if self.has_cutouts() {
            for (ray, (sample, light)) in batch.shadow_rays.iter().zip(&batch.shadow_light) {
                batch.radiance[*sample as usize] += wide(*light * self.transmittance(*ray));
            }
            return;
        }
        batch.occluded.clear();
        self.accel.occluded_many(&batch.shadow_rays, &mut batch.occluded);
        for (occluded, (sample, light)) in batch.occluded.iter().zip(&batch.shadow_light) {
            if !occluded {
                batch.radiance[*sample as usize] += wide(*light);
            }
        }
    }

    /// One vertex of a path: equation 5. Returns the path and the ray to its next vertex.
    #[inline(always)]
    fn scatter_path(&self, depth: u32, i: usize, batch: &mut Batch) -> Option<(Path, Ray)> {
        let hit = batch.hits[i]?;
        let mut path = batch.paths[i];
        let si = self.interaction(&batch.rays[i], &hit)?;
        if Self::AREA_LIGHTS {
            add(&mut batch.radiance, &path, self.emitted(&hit, &si, &path.bounce));
        }
        let bsdf = self.bsdf(&hit, &si);
        if bsdf.is_black() {
            return None;
        }
        let wo = si.frame.to_local(si.wo);
        let is_delta = bsdf.is_delta();
        if let Some(light) = self.sample_light(batch, i, &path, &si)
            && let Some((ray, light)) = self.direct(&light, &si, &bsdf, wo)
        {
            batch.shadow_rays.push(ray);
            batch.shadow_light.push((path.sample, path.throughput * light));
        }
        let depth = depth + 1;
        // Past the limit a bounce counts only by the emitter it hits, and not even so without MIS.
        if depth == self.settings.depth_limit() && !self.settings.mis && !is_delta {
            return None;
        }

        let sample = self.sample_bounce(&bsdf, wo, &path.sampler)?;
        path.throughput *= sample.weight;
        path.eta_squared *= sample.eta_squared;
        let survival = self.survival(path.throughput, path.eta_squared, depth);
        if survival < 1.0 {
            if path.sampler.get_1d(Dimension::Roulette) >= survival {
                return None;
            }
            path.throughput = path.throughput / survival;
        }
        path.bounce = Bounce {
            p: si.p,
            pdf_w: sample.pdf_w,
        };
        path.sampler.set_bounce(depth);
        let ray = si.spawn_ray(si.frame.to_world(sample.wi), sample.wi.z < 0.0);
        Some((path, ray))
    }

    /// The emitter sample of a path at its hit; `None` if it carries no light.
    #[inline(always)]
    fn sample_light(&self, batch: &Batch, i: usize, path: &Path, si: &SurfaceInteraction) -> Option<LightSample> {
        match batch.emitters[i] {
            Emitter::Area(light) if Self::AREA_LIGHTS => self.scene.lights.sample_area(light, si.p, &path.sampler),
            Emitter::Environment if Self::ENVIRONMENT => batch.environment_samples[i],
            _ => None,
        }
    }

    /// Direct light by one emitter sample (equations 6 to 10), and the ray that tells whether it arrives.
    #[inline(always)]
    fn direct(&self, light: &LightSample, si: &SurfaceInteraction, bsdf: &Bsdf, wo: Vec3) -> Option<(Ray, Rgb)> {
        let wi = si.frame.to_local(light.wi);
        let eval = bsdf.eval(wo, wi);
        if eval.value.is_black() {
            return None;
        }
        let weight = if self.settings.mis {
            power_heuristic(light.pdf_w, self.bounce_pdf_w(bsdf, wi, eval.pdf_w))
        } else {
            1.0
        };
        let transmitted = wi.z < 0.0;
        let ray = match light.target {
            Some(target) => si.spawn_ray_to(target, transmitted)?,
            None => si.spawn_ray(light.wi, transmitted),
        };
        Some((ray, eval.value * light.radiance * (weight / light.pdf_w)))
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
    #[allow(clippy::manual_clamp, reason = "clamp keeps NaN, and a path of NaN would never end")]
    fn survival(&self, throughput: Rgb, eta_squared: f32, depth: u32) -> f32 {
        let carried = throughput.max_component();
        if carried <= 0.0 {
            return 0.0;
        }
        match self.settings.roulette {
            Roulette::Off => 1.0,
            Roulette::Fixed(survival) => drawable(survival),
            Roulette::Throughput if depth < ROULETTE_DEPTH => 1.0,
            Roulette::Throughput => (carried * eta_squared).max(MIN_SURVIVAL).min(MAX_SURVIVAL),
        }
    }

    #[inline]
    fn interaction(&self, ray: &Ray, hit: &Hit) -> Option<SurfaceInteraction> {
        let lift = self.settings.smooth_terminator;
        if SceneFeatures(F).contains(SceneFeatures::SMOOTH_NORMALS) {
            SurfaceInteraction::new::<true>(&self.scene.geometry, ray, hit, lift)
        } else {
            SurfaceInteraction::new::<false>(&self.scene.geometry, ray, hit, lift)
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

    /// Whether light may pass some surfaces by chance.
    fn has_cutouts(&self) -> bool {
        // The kernel for everything also asks the scene: the queries of a backend may disagree about a hit at the very
        // end of a segment, and the image must not depend on the kernel.
        SceneFeatures(F).contains(SceneFeatures::CUTOUTS) && self.scene.features.contains(SceneFeatures::CUTOUTS)
    }

    /// The nearest hit that is there: a partly transparent surface lets a ray pass by chance.
    fn nearest_opaque(&self, mut ray: Ray, sampler: &Sampler) -> Option<Hit> {
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
    fn transmittance(&self, mut ray: Ray) -> f32 {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_met_by_exactly_as_many_random_numbers() {
        let step = 1.0 / 16_777_216.0;
        for p in [
            f32::MIN_POSITIVE,
            1e-9,
            step,
            1.5 * step,
            1e-6,
            0.05,
            0.3,
            MAX_SURVIVAL,
            1f32.next_down(),
        ] {
            let met = drawable(p);
            assert!(met > 0.0 && met < 1.0 && (met - p).abs() <= step, "{p} {met}");
            assert_eq!((met / step).fract(), 0.0, "{p} {met}");
        }
        assert_eq!([0.0, f32::NAN].map(drawable), [0.0; 2]);
    }
}
