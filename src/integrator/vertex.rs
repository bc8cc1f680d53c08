//! One vertex of the paths of a batch: equation 5, in steps that each fetch or calculate for all paths.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is read and written in many columns at once"
)]

use super::batch::{Batch, Escaped, Lanes, Paths, SampleId, Vertices};
use super::roulette::{self, Round};
use super::{BounceSampling, Roulette, Settings};
use crate::accel::{Hit, Ray};
use crate::bsdf::{Bsdf, BsdfEval, BsdfSample, Diffuse};
use crate::columns::padded;
use crate::interaction::{SurfaceInteraction, surface_point};
use crate::light::{AreaLight, Chosen, Emitter, Environment, LightSample};
use crate::material::Material;
use crate::math::{DVec3, Frame, Rgb, Vec3};
use crate::sampling::mis::power_heuristic;
use crate::sampling::{Dimension, Sampler};
use crate::scene::{Scene, SceneFeatures};
use pulp::{Arch, Simd, WithSimd};

/// The channels in f64.
#[inline(always)]
pub(super) fn wide(rgb: Rgb) -> DVec3 {
    DVec3::from(rgb.to_array().map(f64::from))
}

/// Starts a path at the camera for each sample.
pub(super) fn start<const F: u32>(scene: &Scene, settings: &Settings, batch: &mut Batch) {
    Arch::new().dispatch(Start(Shading::<F> { scene, settings }, batch));
}

/// Scatters each path at its hit: adds what it meets, prepares direct light, and the ray that carries the recursion.
pub(super) fn scatter<const F: u32>(scene: &Scene, settings: &Settings, depth: u32, batch: &mut Batch) {
    Arch::new().dispatch(Scatter(Shading::<F> { scene, settings }, depth, batch));
}

/// [`Shading::start`], compiled for each instruction set.
struct Start<'a, const F: u32>(Shading<'a, F>, &'a mut Batch);

impl<const F: u32> WithSimd for Start<'_, F> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.0.start(self.1);
    }
}

/// [`Shading::scatter`], compiled for each instruction set.
struct Scatter<'a, const F: u32>(Shading<'a, F>, u32, &'a mut Batch);

impl<const F: u32> WithSimd for Scatter<'_, F> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.0.scatter(self.1, self.2);
    }
}

/// The random numbers of a sample, and its ray.
#[inline(always)]
pub(super) fn camera_ray(scene: &Scene, settings: &Settings, SampleId { sample, y, x }: SampleId) -> (Sampler, Ray) {
    let camera = &scene.camera;
    let sampler = Sampler::new(settings.sampler, settings.seed, x, y, sample);
    let jitter = sampler.get_2d(Dimension::Pixel);
    let lens = if camera.has_lens() {
        sampler.get_2d(Dimension::Lens)
    } else {
        [0.5; 2]
    };
    (sampler, camera.ray(x, y, jitter, lens))
}

/// Everything about scattering but the rays. `F` is the set of features that the code is compiled for.
#[derive(Clone, Copy)]
pub(super) struct Shading<'a, const F: u32> {
    pub(super) scene: &'a Scene,
    pub(super) settings: &'a Settings,
}

impl<const F: u32> Shading<'_, F> {
    pub(super) const ENVIRONMENT: bool = SceneFeatures(F).contains(SceneFeatures::ENVIRONMENT);
    const AREA_LIGHTS: bool = SceneFeatures(F).contains(SceneFeatures::AREA_LIGHTS);
    const PUNCTUAL: bool = SceneFeatures(F).contains(SceneFeatures::PUNCTUAL);
    const GENERAL: bool = SceneFeatures(F).contains(SceneFeatures::GENERAL);

    /// Starts a path at the camera for each sample.
    #[inline(always)]
    fn start(self, batch: &mut Batch) {
        let n = batch.samples.len();
        batch.radiance.clear();
        batch.radiance.resize(n, DVec3::ZERO);
        batch.alive.clear();
        batch.alive.extend(0..n as u32);
        let Lanes { paths, coordinates, .. } = &mut *batch.lanes;
        for (i, SampleId { x, y, sample }) in batch.samples.iter().enumerate() {
            for (column, value) in coordinates.iter_mut().zip([x, y, sample]) {
                column[i] = *value;
            }
        }
        for i in 0..padded(n) {
            let [x, y, sample] = [0, 1, 2].map(|k| coordinates[k][i]);
            let (sampler, ray) = camera_ray(self.scene, self.settings, SampleId { x, y, sample });
            paths.sample[i] = i as u32;
            paths.keys[0][i] = sampler.key[0];
            paths.keys[1][i] = sampler.key[1];
            paths.index[i] = sampler.index;
            paths.throughput.set(i, Rgb::WHITE);
            paths.roulette_scale[i] = roulette::FACTOR;
            paths.origin.set(i, ray.origin);
            paths.direction.set(i, ray.direction);
            paths.p.set(i, ray.origin);
            paths.n.set(i, Vec3::ZERO);
            paths.pdf_w[i] = f32::INFINITY;
            paths.environment_pmf[i] = 0.0;
        }
    }

    /// Scatters each path at its hit: adds what it meets, prepares direct light, and the ray that carries the recursion.
    #[inline(always)]
    fn scatter(self, depth: u32, batch: &mut Batch) {
        batch.alive.clear();
        batch.shadow_rays.clear();
        batch.shadow_light.clear();
        if Self::ENVIRONMENT {
            self.add_escaped(batch);
        }
        if Self::PUNCTUAL && self.scene.lights.has_discs() {
            self.add_discs(batch);
        }
        if batch.hits.is_empty() {
            return;
        }
        self.find_interactions(batch);
        if Self::AREA_LIGHTS {
            self.add_emitted(batch);
        }
        if depth == self.settings.depth_limit() {
            return;
        }
        let n = batch.hits.len();
        let Lanes { paths, vertices, .. } = &mut *batch.lanes;
        self.find_bsdfs(&batch.hits, depth, paths, vertices);
        self.draw_numbers(n, depth, paths, vertices);
        self.sample_lights(&batch.hits, vertices);
        self.scatter_diffuse(n, paths, vertices);
        self.scatter_others(depth, paths, vertices);
        self.spawn(n, depth + 1, paths, vertices);
        let Lanes { paths, vertices, .. } = &*batch.lanes;
        for i in 0..n {
            if vertices.is_lit[i] & vertices.is_plain[i] != 0 {
                batch.shadow_rays.push(Ray {
                    origin: vertices.shadow_origin.vec3(i),
                    direction: vertices.shadow_direction.vec3(i),
                    t_min: 0.0,
                    t_max: vertices.shadow_t_max[i],
                });
                let light = (paths.sample[i], vertices.shadow_light.rgb(i));
                batch.shadow_light.push(light);
            }
            if vertices.goes_on[i] & vertices.is_plain[i] != 0 {
                batch.alive.push(i as u32);
            }
        }
    }

    /// Adds the environment's light to paths that met nothing.
    #[inline(always)]
    fn add_escaped(self, batch: &mut Batch) {
        let Some(environment) = self.scene.lights.environment() else {
            return;
        };
        let Escaped {
            paths,
            directions,
            places,
            ..
        } = &mut batch.lanes.escaped;
        let n = paths.len();
        environment.locate_lanes(n, directions, places);
        environment.fetch_lanes(0..n, places);
        environment.lookup_lanes(n, places);
        for (i, path) in paths.iter().enumerate() {
            let (radiance, pdf_w) = places.found(i);
            let light = radiance * self.hit_weight(path.pdf_w, || pdf_w * path.environment_pmf);
            batch.radiance[path.sample as usize] += wide(path.throughput * light);
        }
    }

    /// Adds the light of discs to paths that met nothing.
    #[inline(never)]
    fn add_discs(self, batch: &mut Batch) {
        let Escaped {
            paths,
            directions,
            p,
            n,
            ..
        } = &batch.lanes.escaped;
        let lights = &self.scene.lights;
        for (i, path) in paths.iter().enumerate() {
            for (disc, radiance) in lights.discs(directions.vec3(i)) {
                let light_pdf_w = || lights.disc_pdf_w(disc, p.vec3(i), n.vec3(i));
                let light = radiance * self.hit_weight(path.pdf_w, light_pdf_w);
                batch.radiance[path.sample as usize] += wide(path.throughput * light);
            }
        }
    }

    /// Computes what shading needs to know of each hit.
    #[inline(always)]
    fn find_interactions(self, batch: &mut Batch) {
        let Batch { hits, lanes, .. } = batch;
        let Lanes { paths, vertices, .. } = &mut **lanes;
        if SceneFeatures(F).contains(SceneFeatures::SMOOTH_NORMALS) {
            self.interact::<true>(hits, paths, vertices);
        } else {
            self.interact::<false>(hits, paths, vertices);
        }
    }

    #[inline(always)]
    fn interact<const SMOOTH: bool>(self, hits: &[Hit], paths: &Paths, vertices: &mut Vertices) {
        let lift = self.settings.smooth_terminator;
        for i in 0..padded(hits.len()) {
            let (triangle, hit) = vertices.triangle::<SMOOTH>(i);
            let ray = paths.ray(i);
            let (p, winding, is_plain) = triangle.plain_point(&ray, &hit);
            let si = SurfaceInteraction::at::<SMOOTH>(&triangle, &ray, &hit, p, winding, lift);
            vertices.set_interaction(i, &si);
            vertices.is_plain[i] = u32::from(is_plain);
        }
        let all_plain = (0..hits.len()).fold(1, |all, i| all & vertices.is_plain[i]);
        if all_plain == 0 {
            self.interact_exactly::<SMOOTH>(hits, paths, vertices);
        }
    }

    #[cold]
    fn interact_exactly<const SMOOTH: bool>(self, hits: &[Hit], paths: &Paths, vertices: &mut Vertices) {
        for (i, hit) in hits.iter().enumerate() {
            if vertices.is_plain[i] == 0 {
                let ray = paths.ray(i);
                let lift = self.settings.smooth_terminator;
                if let Some(si) = SurfaceInteraction::new::<SMOOTH>(&self.scene.geometry, &ray, hit, lift) {
                    vertices.set_interaction(i, &si);
                    vertices.is_plain[i] = 1;
                }
            }
        }
    }

    /// The interaction of lane `i`, whose path has not been turned yet.
    #[inline(always)]
    fn interaction(self, i: usize, paths: &Paths, vertices: &Vertices) -> SurfaceInteraction {
        let direction = paths.direction.vec3(i);
        if SceneFeatures(F).contains(SceneFeatures::SMOOTH_NORMALS) {
            vertices.interaction::<true>(i, direction)
        } else {
            vertices.interaction::<false>(i, direction)
        }
    }

    /// Adds the light of emitters that paths met.
    #[inline(always)]
    fn add_emitted(self, batch: &mut Batch) {
        let Lanes { paths, vertices, .. } = &*batch.lanes;
        for (i, hit) in batch.hits.iter().enumerate() {
            let Some((emission, first_light)) = &self.scene.surfaces[hit.placement as usize].emission else {
                continue;
            };
            let mut radiance = emission.from_side(vertices.front[i] > 0.0);
            if Self::PUNCTUAL
                && let Some(factor) = self.scene.emission_at(hit)
            {
                radiance *= factor;
            }
            if radiance.is_black() || vertices.is_plain[i] == 0 {
                continue;
            }
            let cos = vertices.ng.vec3(i).dot(paths.direction.vec3(i));
            let (p, n) = (paths.p.vec3(i), paths.n.vec3(i));
            let light_pdf_w = || {
                let distance_squared = p.distance_squared(vertices.p.vec3(i));
                let lights = &self.scene.lights;
                lights.area_pdf_w(first_light + hit.triangle, p, n, distance_squared, cos)
            };
            let light = radiance * self.hit_weight(paths.pdf_w[i], light_pdf_w);
            batch.radiance[paths.sample[i] as usize] += wide(paths.throughput.rgb(i) * light);
        }
    }

    /// Finds how each hit scatters.
    #[inline(always)]
    fn find_bsdfs(self, hits: &[Hit], depth: u32, paths: &Paths, vertices: &mut Vertices) {
        vertices.others.clear();
        let mut bitmaps = vertices.bitmaps.iter().map(|(i, ..)| *i as usize).peekable();
        for (i, hit) in hits.iter().enumerate() {
            if bitmaps.next_if_eq(&i).is_some() {
                continue;
            }
            let (bsdf, shadow) = if self.is_general(hit) {
                let sampler = paths.sampler(i, self.settings.sampler, depth);
                let mut si = self.interaction(i, paths, vertices);
                let choice = || sampler.get_1d(Dimension::Blend);
                let scattering = self.scene.general_bsdf(hit, &mut si, choice);
                vertices.ns.set(i, si.frame.n);
                scattering
            } else {
                (self.bsdf(hit, vertices.front[i] > 0.0), None)
            };
            match bsdf {
                Bsdf::Diffuse(Diffuse { reflectance })
                    if (self.settings.bounce_sampling == BounceSampling::Bsdf && shadow.is_none())
                        || reflectance.is_black() =>
                {
                    vertices.reflectance.set(i, reflectance);
                }
                _ => vertices.others.push((i as u32, bsdf, shadow)),
            }
        }
        for ((i, place, tint), texels) in vertices.bitmaps.iter().zip(&vertices.bitmap_texels) {
            vertices.reflectance.set(*i as usize, place.blend(texels) * *tint);
        }
    }

    #[inline(always)]
    pub(super) fn is_general(&self, hit: &Hit) -> bool {
        Self::GENERAL && self.scene.surfaces[hit.placement as usize].is_general
    }

    /// The environment, if no other emitter can be chosen.
    #[inline(always)]
    pub(super) fn only_sky(&self) -> Option<&Environment> {
        let lights = &self.scene.lights;
        lights.environment().filter(|_| lights.len() == 1)
    }

    #[inline(always)]
    pub(super) fn material(&self, hit: &Hit) -> &Material {
        &self.scene.materials[self.scene.surfaces[hit.placement as usize].material as usize]
    }

    #[inline(always)]
    fn bsdf(&self, hit: &Hit, front: bool) -> Bsdf {
        let features = SceneFeatures(F);
        let material = self.material(hit);
        let textures = &self.scene.textures;
        let point = || surface_point(&self.scene.geometry, hit);
        // What asks for a direction in the surface takes the general way.
        let tangent = || [1.0, 0.0];
        match (
            features.contains(SceneFeatures::TEXTURES),
            features.contains(SceneFeatures::SPECULAR),
        ) {
            (false, false) => material.bsdf::<false, false, false>(textures, point, front, tangent),
            (true, false) => material.bsdf::<true, false, false>(textures, point, front, tangent),
            (false, true) => material.bsdf::<false, true, false>(textures, point, front, tangent),
            (true, true) => material.bsdf::<true, true, false>(textures, point, front, tangent),
        }
    }

    /// Draws the random numbers that most paths need.
    #[inline(always)]
    fn draw_numbers(self, n: usize, depth: u32, paths: &Paths, vertices: &mut Vertices) {
        let n = padded(n);
        let kind = self.settings.sampler;
        let sampler = |i| paths.sampler(i, kind, depth);
        if Self::AREA_LIGHTS || Self::PUNCTUAL {
            for i in 0..n {
                let [high, low] = sampler(i).get_bits(Dimension::LightChoice);
                vertices.light_choice[0][i] = high;
                vertices.light_choice[1][i] = low;
            }
        }
        if !Self::ENVIRONMENT && (Self::AREA_LIGHTS || Self::PUNCTUAL) {
            for i in 0..n {
                vertices
                    .light_position
                    .set(i, sampler(i).get_2d(Dimension::LightPosition));
            }
        }
        for i in 0..n {
            vertices.direction.set(i, sampler(i).get_2d(Dimension::Direction));
        }
        if self.settings.roulette != Roulette::Off {
            for i in 0..n {
                vertices.roulette[i] = sampler(i).get_1d(Dimension::Roulette);
            }
        }
    }

    /// Draws the emitter sample of each hit.
    #[inline(always)]
    fn sample_lights(self, hits: &[Hit], vertices: &mut Vertices) {
        let lights = &self.scene.lights;
        let n = hits.len();
        vertices.emitters.clear();
        vertices.sky.clear();
        vertices.apart.clear();
        for (i, hit) in hits.iter().enumerate() {
            let [high, low] = [0, 1].map(|k| vertices.light_choice[k][i]);
            let bits = u64::from(high) << 32 | u64::from(low);
            let surface = &self.scene.surfaces[hit.placement as usize];
            let n = if surface.transmits {
                Vec3::ZERO
            } else {
                vertices.ns.vec3(i)
            };
            let p = vertices.p.vec3(i);
            let chosen = match (Self::AREA_LIGHTS, Self::ENVIRONMENT) {
                _ if surface.is_delta => Chosen::NONE,
                _ if Self::PUNCTUAL => lights.choose_any(p, n, bits),
                (true, true) => lights.choose::<true, true>(p, n, bits),
                (true, false) => lights.choose::<true, false>(p, n, bits),
                (false, true) => lights.choose::<false, true>(p, n, bits),
                (false, false) => Chosen::NONE,
            };
            vertices.light_side.set(i, n);
            vertices.emitter_pmf[i] = chosen.pmf;
            vertices.environment_pmf[i] = chosen.environment_pmf;
            match chosen.emitter {
                Emitter::Area(light) if Self::AREA_LIGHTS => {
                    vertices.area_lights.set(i, lights.area(light).to_array());
                    if Self::PUNCTUAL && self.scene.emission_varies(light) {
                        vertices.apart.push(i as u32);
                    }
                }
                Emitter::Punctual(_) | Emitter::Distant(_) if Self::PUNCTUAL => vertices.apart.push(i as u32),
                Emitter::Environment if Self::ENVIRONMENT => vertices.sky.push(i as u32),
                _ => {}
            }
            vertices.emitters.push(chosen.emitter);
        }
        if Self::AREA_LIGHTS {
            for i in 0..padded(n) {
                let light = AreaLight::from_array(vertices.area_lights.get(i));
                let sample = light.sample(
                    vertices.emitter_pmf[i],
                    vertices.p.vec3(i),
                    vertices.light_position.get(i),
                );
                vertices.set_light(i, sample);
            }
        }
        if Self::ENVIRONMENT
            && let Some(environment) = lights.environment()
        {
            if self.only_sky().is_none() {
                for &i in &vertices.sky {
                    let i = i as usize;
                    vertices.texels[i] = environment.choose_texel(vertices.texel_bits(i));
                }
                let places = &mut vertices.places;
                environment.sample_lanes(0..n, &vertices.texels, &vertices.light_position, places);
                environment.fetch_lanes(vertices.sky.iter().map(|i| *i as usize), places);
            }
            environment.lookup_lanes(n, &mut vertices.places);
            for k in 0..vertices.sky.len() {
                let i = vertices.sky[k] as usize;
                let (pmf, places) = (vertices.emitter_pmf[i], &vertices.places);
                let sample = lights.sample_environment(pmf, places.get(i).wi, places.found(i));
                vertices.set_light(i, sample);
            }
        }
        if Self::PUNCTUAL && !vertices.apart.is_empty() {
            self.sample_apart(vertices);
        }
        for i in 0..n {
            if vertices.emitters[i] == Emitter::None {
                vertices.set_light(i, None);
            }
        }
    }

    /// Draws the emitter samples that have no columns.
    #[inline(never)]
    fn sample_apart(self, vertices: &mut Vertices) {
        let lights = &self.scene.lights;
        for k in 0..vertices.apart.len() {
            let i = vertices.apart[k] as usize;
            let (pmf, u) = (vertices.emitter_pmf[i], vertices.light_position.get(i));
            let sample = match vertices.emitters[i] {
                Emitter::Punctual(light) => self.scene.sample_punctual(light, pmf, vertices.p.vec3(i)),
                Emitter::Distant(light) => lights.sample_distant(light, pmf, u),
                Emitter::Area(light) => {
                    let factor = self.scene.emission_at_sample(light, u).unwrap_or(Rgb::WHITE);
                    let sample = vertices.light(i);
                    let radiance = sample.radiance * factor;
                    (!radiance.is_black()).then_some(LightSample { radiance, ..sample })
                }
                Emitter::None | Emitter::Environment => None,
            };
            vertices.set_light(i, sample);
        }
    }

    /// Scatters at diffuse hits.
    #[inline(always)]
    fn scatter_diffuse(self, n: usize, paths: &Paths, vertices: &mut Vertices) {
        if vertices.others.len() == n {
            return;
        }
        let mis = self.settings.mis;
        for i in 0..padded(n) {
            let si = self.interaction(i, paths, vertices);
            let bsdf = Diffuse {
                reflectance: vertices.reflectance.rgb(i),
            };
            let light = vertices.light(i);
            let wi = si.frame.to_local(light.wi);
            let eval = bsdf.eval(wi);
            let shadow = Self::direct(mis, &light, &si, wi, eval, eval.pdf_w, paths.throughput.rgb(i));
            vertices.set_shadow(i, shadow);
        }
        for i in 0..padded(n) {
            let bsdf = Diffuse {
                reflectance: vertices.reflectance.rgb(i),
            };
            let frame = Frame::from_normal(vertices.ns.vec3(i));
            let sample = bsdf.sample(vertices.direction.get(i));
            vertices.set_bounce(i, &frame, sample);
        }
    }

    /// Scatters at the other hits.
    #[inline(always)]
    fn scatter_others(self, depth: u32, paths: &Paths, vertices: &mut Vertices) {
        let mis = self.settings.mis;
        for k in 0..vertices.others.len() {
            let (i, bsdf, relief) = vertices.others[k];
            let relief = relief.filter(|_| Self::GENERAL);
            let i = i as usize;
            if bsdf.is_black() {
                vertices.set_shadow(i, None);
                vertices.goes_on[i] = 0;
                continue;
            }
            let si = self.interaction(i, paths, vertices);
            let wo = si.frame.to_local(si.wo);
            let light = vertices.light(i);
            let shadow = if light.pdf_w > 0.0 {
                let wi = si.frame.to_local(light.wi);
                let mut eval = bsdf.eval(wo, wi);
                if let Some(relief) = relief {
                    eval.value *= relief.factor(wi);
                }
                let pdf_w = self.bounce_pdf_w(&bsdf, wi, eval.pdf_w);
                Self::direct(mis, &light, &si, wi, eval, pdf_w, paths.throughput.rgb(i))
            } else {
                None
            };
            vertices.set_shadow(i, shadow);
            let sampler = paths.sampler(i, self.settings.sampler, depth);
            let mut sample = self.sample_bounce(&bsdf, wo, &sampler, vertices.direction.get(i));
            if let Some(relief) = relief {
                sample = sample.map(|sample| BsdfSample {
                    weight: sample.weight * relief.factor(sample.wi),
                    ..sample
                });
            }
            vertices.set_bounce(i, &si.frame, sample);
        }
    }

    /// Direct light by one emitter sample (equations 6 to 10) in the local direction `wi`, and the ray that tells whether
    /// it arrives. `pdf_w` is the density with which a bounce goes there.
    #[inline(always)]
    fn direct(
        mis: bool,
        light: &LightSample,
        si: &SurfaceInteraction,
        wi: Vec3,
        eval: BsdfEval,
        pdf_w: f32,
        throughput: Rgb,
    ) -> Option<(Ray, Rgb)> {
        let weight = if mis { power_heuristic(light.pdf_w, pdf_w) } else { 1.0 };
        let transmitted = wi.z < 0.0;
        let away = si.spawn_ray(light.wi, transmitted);
        let (ray, is_ray) = match light.target {
            Some(target) => {
                let ray = si.spawn_ray_to(target, transmitted);
                (ray.unwrap_or(away), ray.is_some())
            }
            None => (away, true),
        };
        let is_lit = is_ray & (light.pdf_w > 0.0) & !eval.value.is_black();
        let light = throughput * (eval.value * light.radiance * (weight / light.pdf_w));
        is_lit.then_some((ray, light))
    }

    /// Turns the paths that go on after their `depth`-th scattering event.
    #[inline(always)]
    fn spawn(self, n: usize, depth: u32, paths: &mut Paths, vertices: &mut Vertices) {
        // Past the limit a bounce counts only by the emitter it hits, and not even so without MIS.
        let is_last = depth == self.settings.depth_limit() && !self.settings.mis;
        let is_first = depth == 1;
        let round = Round::new(self.settings.roulette, depth);
        for i in 0..padded(n) {
            let si = self.interaction(i, paths, vertices);
            let mut throughput = paths.throughput.rgb(i) * vertices.weight.rgb(i);
            let first = if is_first { throughput.max_component() } else { 1.0 };
            let roulette_scale = paths.roulette_scale[i] * vertices.eta_squared[i] / first;
            let pdf_w = vertices.pdf_w[i];
            let mut goes_on = !is_last | (pdf_w == f32::INFINITY);
            if let Some(round) = round {
                let survival = round.survival(throughput * roulette_scale);
                goes_on &= vertices.roulette[i] < survival;
                throughput = throughput / survival;
            }
            goes_on &= throughput.max_component() > 0.0;
            vertices.goes_on[i] &= u32::from(goes_on);
            paths.throughput.set(i, throughput);
            paths.roulette_scale[i] = roulette_scale;
            paths.p.set(i, si.p);
            paths.n.set(i, vertices.light_side.vec3(i));
            paths.pdf_w[i] = pdf_w;
            paths.environment_pmf[i] = vertices.environment_pmf[i];
            paths.origin.set(i, si.origin(vertices.transmitted[i] > 0.0));
            paths.direction.set(i, vertices.wi.vec3(i));
        }
    }

    /// The weight of an emitter that a bounce of density `pdf_w` hit, whose emitter sample would have had the other one.
    #[inline(always)]
    fn hit_weight(&self, pdf_w: f32, light_pdf_w: impl FnOnce() -> f32) -> f32 {
        if pdf_w == f32::INFINITY {
            1.0
        } else if self.settings.mis {
            power_heuristic(pdf_w, light_pdf_w())
        } else {
            0.0
        }
    }

    /// The direction that carries the recursion (equation 11).
    #[inline(always)]
    fn sample_bounce(&self, bsdf: &Bsdf, wo: Vec3, sampler: &Sampler, u: [f32; 2]) -> Option<BsdfSample> {
        let lobe = if bsdf.has_lobes() {
            sampler.get_1d(Dimension::Lobe)
        } else {
            0.0
        };
        match self.settings.bounce_sampling {
            BounceSampling::Cosine if !bsdf.has_delta() => bsdf.sample_hemisphere(wo, true, lobe, u),
            BounceSampling::Uniform if !bsdf.has_delta() => bsdf.sample_hemisphere(wo, false, lobe, u),
            _ => bsdf.sample(wo, lobe, u),
        }
    }

    /// Density of [`Self::sample_bounce`], given that of the BSDF's own sampling.
    #[inline(always)]
    fn bounce_pdf_w(&self, bsdf: &Bsdf, wi: Vec3, bsdf_pdf_w: f32) -> f32 {
        match self.settings.bounce_sampling {
            BounceSampling::Bsdf => bsdf_pdf_w,
            _ if bsdf.has_delta() => bsdf_pdf_w,
            BounceSampling::Cosine => bsdf.hemisphere_pdf_w(true, wi),
            BounceSampling::Uniform => bsdf.hemisphere_pdf_w(false, wi),
        }
    }
}
