//! The path tracer: the article's `Shade` as a loop, over a batch of paths at a time.
//!
//! At each vertex, one emitter sample (equations 6 to 10) and one bounce that carries the recursion (equation 11). A
//! bounce that happens to hit an emitter estimates the same direct light; the two are combined by multiple importance
//! sampling. Roulette ends the path and keeps the weight.
//!
//! All paths of a batch make the same step before any makes the next one, for three reasons: a backend traces camera and
//! shadow rays faster together than alone; what some paths need from memory can arrive while others are traced
//! ([`super::fetch`]); and a loop that only calculates becomes vector instructions. What a path computes does not depend on
//! the others in its batch.

use super::batch::{Batch, EscapedPath, Lanes, Paths, SampleId, Together, Vertices};
use super::fetch;
use super::vertex::{camera_ray, wide};
use super::{Kernel, RayCounts, Settings};
use crate::accel::{Accel, Hit, Ray};
use crate::film::Rect;
use crate::interaction::surface_point;
use crate::sampling::Sampler;
use crate::scene::{Scene, SceneFeatures};

/// Estimates radiance in one scene.
struct PathTracer<'a, A> {
    kernel: &'a Kernel,
    scene: &'a Scene,
    accel: &'a A,
    settings: &'a Settings,
}

/// Traces the paths of a batch.
pub(super) fn trace<A: Accel>(
    kernel: &Kernel,
    scene: &Scene,
    accel: &A,
    settings: &Settings,
    batch: &mut Batch,
    counts: &mut RayCounts,
) {
    let tracer = PathTracer {
        kernel,
        scene,
        accel,
        settings,
    };
    tracer.trace(batch, counts);
}

/// Traces the camera rays of a batch alone, and tells which met something.
pub(super) fn first_hits<A: Accel>(
    kernel: &Kernel,
    scene: &Scene,
    accel: &A,
    settings: &Settings,
    batch: &mut Batch,
) -> impl Iterator<Item = (SampleId, Ray, Hit)> {
    let tracer = PathTracer {
        kernel,
        scene,
        accel,
        settings,
    };
    (kernel.start)(scene, settings, batch);
    // Nothing scatters: no vertex needs anything.
    tracer.advance(0, batch, |_, _, _| ());
    let Batch {
        samples, hits, lanes, ..
    } = batch;
    let paths = &lanes.paths;
    let lanes = hits.iter().enumerate();
    lanes.map(|(i, hit)| (samples[paths.sample[i] as usize], paths.ray(i), *hit))
}

impl<A: Accel> PathTracer<'_, A> {
    fn trace(&self, batch: &mut Batch, counts: &mut RayCounts) {
        (self.kernel.start)(self.scene, self.settings, batch);
        counts.camera += batch.samples.len() as u64;
        for depth in 0.. {
            self.advance(depth, batch, |hits, paths, vertices| {
                (self.kernel.fetch)(self.scene, self.settings, depth, hits, paths, vertices);
            });
            (self.kernel.scatter)(self.scene, self.settings, depth, batch);
            match depth {
                0 => batch.note_seen_light(),
                // What bounces met counts; what emitters send to where they ended does not.
                1 => batch.keep_direct(),
                _ => {}
            }
            counts.bounce += batch.alive.len() as u64;
            counts.shadow += batch.shadow_rays.len() as u64;
            self.add_unoccluded(batch);
            if batch.alive.is_empty() {
                if depth == 0 {
                    batch.keep_direct();
                }
                return;
            }
        }
    }

    /// Finds what each path meets, moves those that meet something together, and lets `fetch` make the steps of
    /// [`super::fetch`].
    fn advance(&self, depth: u32, batch: &mut Batch, fetch: impl Fn(&[Hit], &Paths, &mut Vertices)) {
        let has_cutouts = self.has_cutouts();
        let has_discs = self.scene.lights.has_discs();
        let has_sky = has_discs || self.scene.features.contains(SceneFeatures::ENVIRONMENT);
        let Batch {
            samples,
            alive,
            lanes,
            hits,
            together,
            ..
        } = batch;
        let Lanes {
            paths,
            escaped,
            vertices,
            ..
        } = &mut **lanes;
        hits.clear();
        escaped.paths.clear();
        together.hits.clear();
        vertices.start_fetching(self.kernel.fetches_ahead);
        // Rays from the camera have their own way.
        let list = self.accel.list().filter(|_| depth > 0 && !has_cutouts);
        if let Some(list) = list {
            together.rays.clear();
            together.rays.extend(alive.iter().map(|&i| paths.ray(i as usize)));
            list.intersect(&together.rays, &mut together.hits);
        }
        for (nth, i) in alive.iter().map(|&i| i as usize).enumerate() {
            let ray = paths.ray(i);
            let hit = if has_cutouts {
                let sampler = paths.sampler(i, self.settings.sampler, depth);
                self.nearest_opaque(ray, &sampler)
            } else if depth == 0 || list.is_some() {
                if nth == together.hits.len() {
                    self.intersect_block(nth, samples, paths, together);
                }
                together.hits[nth]
            } else {
                self.accel.intersect(&ray)
            };
            if let Some(hit) = hit {
                if i != hits.len() {
                    paths.copy(i, hits.len());
                }
                hits.push(hit);
                if self.kernel.fetches_ahead && hits.len().is_multiple_of(fetch::TOGETHER) {
                    fetch(hits, paths, vertices);
                }
            } else if has_sky {
                if has_discs {
                    escaped.p.set(escaped.paths.len(), paths.p.vec3(i));
                    escaped.n.set(escaped.paths.len(), paths.n.vec3(i));
                }
                escaped.directions.set(escaped.paths.len(), ray.direction);
                escaped.paths.push(EscapedPath {
                    sample: paths.sample[i],
                    throughput: paths.throughput.rgb(i),
                    pdf_w: paths.pdf_w[i],
                    environment_pmf: paths.environment_pmf[i],
                });
            }
        }
        for _ in 0..fetch::STEPS {
            fetch(hits, paths, vertices);
        }
    }

    /// Finds what the camera rays of a block of pixels meet, that of the sample `first`. Of triangles at the same distance, a
    /// backend may find another one in other company, so the company is always the same: where only a part of a block is
    /// wanted, the rest is traced as well.
    fn intersect_block(&self, first: usize, samples: &[SampleId], paths: &Paths, together: &mut Together) {
        let Together { rays, hits, block_hits } = together;
        let [x1, y1] = self.scene.camera.resolution();
        let image = Rect { x0: 0, y0: 0, x1, y1 };
        let block = |id: &SampleId| Rect::block(id.x, id.y);
        let start = &samples[first];
        let ids = samples[first..].iter();
        let ids = ids.take_while(|id| id.sample == start.sample && block(id) == block(start));
        let ids = &samples[first..first + ids.count()];
        let block = block(start).intersection(image);
        rays.clear();
        if ids.len() as u64 == block.pixels() {
            rays.extend((first..first + ids.len()).map(|i| paths.ray(i)));
            self.accel.intersect_coherent(rays, hits);
            return;
        }
        let whole = || block.coordinates().map(|(x, y)| SampleId { x, y, ..*start });
        rays.extend(whole().map(|id| camera_ray(self.scene, self.settings, id).1));
        block_hits.clear();
        self.accel.intersect_coherent(rays, block_hits);
        let wanted = whole().zip(&*block_hits).filter(|(id, _)| ids.contains(id));
        hits.extend(wanted.map(|(_, hit)| hit));
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
        match self.accel.list() {
            Some(list) => list.occluded(&batch.shadow_rays, &mut batch.occluded),
            None => self.accel.occluded_many(&batch.shadow_rays, &mut batch.occluded),
        }
        for (occluded, (sample, light)) in batch.occluded.iter().zip(&batch.shadow_light) {
            if !occluded {
                batch.radiance[*sample as usize] += wide(*light);
            }
        }
    }

    /// Whether light may pass some surfaces by chance.
    fn has_cutouts(&self) -> bool {
        self.scene.features.contains(SceneFeatures::CUTOUTS)
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
        material.opacity(&self.scene.textures, || surface_point(&self.scene.geometry, hit))
    }
}
