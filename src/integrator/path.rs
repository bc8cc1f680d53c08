//! The path tracer: the article's `Shade` as a loop, over a batch of paths at a time.
//!
//! At each vertex, one emitter sample (equations 6 to 10) and one bounce that carries the recursion (equation 11). A
//! bounce that happens to hit an emitter estimates the same direct light; the two are combined by multiple importance
//! sampling. Roulette ends the path and keeps the weight.
//!
//! All paths of a batch make the same step before any makes the next one, for three reasons: a backend traces camera and
//! shadow rays faster together than alone; a loop that only fetches waits for many loads at once; and a loop that only
//! calculates becomes vector instructions. What a path computes does not depend on the others in its batch.

use super::batch::{Batch, EscapedPath, Lanes, SampleId};
use super::vertex::Shading;
use super::{RayCounts, Settings};
use crate::accel::{Accel, Hit, Ray};
use crate::film::Rect;
use crate::interaction::texture_coordinates;
use crate::math::{DVec3, Rgb};
use crate::sampling::Sampler;
use crate::scene::{Scene, SceneFeatures};
use pulp::{Arch, Simd, WithSimd};

/// The channels in f64.
#[inline(always)]
pub(super) fn wide(rgb: Rgb) -> DVec3 {
    DVec3::from(rgb.to_array().map(f64::from))
}

/// Estimates radiance in one scene. `F` is the set of features that the code is compiled for.
struct PathTracer<'a, A, const F: u32> {
    accel: &'a A,
    shading: Shading<'a, F>,
}

/// Traces the paths of a batch.
pub(super) fn trace<A: Accel, const F: u32>(
    scene: &Scene,
    accel: &A,
    settings: &Settings,
    batch: &mut Batch,
    counts: &mut RayCounts,
) {
    let shading = Shading { scene, settings };
    PathTracer::<A, F> { accel, shading }.trace(batch, counts);
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

impl<A: Accel, const F: u32> PathTracer<'_, A, F> {
    fn trace(&self, batch: &mut Batch, counts: &mut RayCounts) {
        let arch = Arch::new();
        arch.dispatch(Start(self.shading, batch));
        counts.camera += batch.samples.len() as u64;
        for depth in 0.. {
            self.advance(depth, batch);
            arch.dispatch(Scatter(self.shading, depth, batch));
            counts.bounce += batch.alive.len() as u64;
            counts.shadow += batch.shadow_rays.len() as u64;
            self.add_unoccluded(batch);
            if batch.alive.is_empty() {
                return;
            }
        }
    }

    /// Finds what each path meets, and moves those that meet something together.
    fn advance(&self, depth: u32, batch: &mut Batch) {
        let has_cutouts = self.has_cutouts();
        if depth == 0 && !has_cutouts {
            self.intersect_camera(batch);
        }
        let Batch {
            alive,
            lanes,
            hits,
            camera_hits,
            ..
        } = batch;
        let Lanes { paths, escaped, .. } = &mut **lanes;
        hits.clear();
        escaped.paths.clear();
        for i in alive.iter().map(|&i| i as usize) {
            let ray = paths.ray(i);
            let hit = if has_cutouts {
                let sampler = paths.sampler(i, self.shading.settings.sampler, depth);
                self.nearest_opaque(ray, &sampler)
            } else if depth == 0 {
                camera_hits[i]
            } else {
                self.accel.intersect(&ray)
            };
            if let Some(hit) = hit {
                if i != hits.len() {
                    paths.copy(i, hits.len());
                }
                hits.push(hit);
            } else if Shading::<F>::ENVIRONMENT {
                escaped.directions.set(escaped.paths.len(), ray.direction);
                escaped.paths.push(EscapedPath {
                    sample: paths.sample[i],
                    throughput: paths.throughput.rgb(i),
                    p: paths.p.vec3(i),
                    n: paths.n.vec3(i),
                    pdf_w: paths.pdf_w[i],
                });
            }
        }
    }

    /// Finds what camera rays meet, those of a block of pixels together. Of triangles at the same distance, a backend may
    /// find another one in other company, so the company is always the same: where only a part of a block is wanted, the
    /// rest is traced as well.
    fn intersect_camera(&self, batch: &mut Batch) {
        let Batch {
            samples,
            lanes,
            camera_hits,
            block_rays,
            block_hits,
            ..
        } = batch;
        let [x1, y1] = self.shading.scene.camera.resolution();
        let image = Rect { x0: 0, y0: 0, x1, y1 };
        let block = |id: &SampleId| Rect::block(id.x, id.y);
        let together = |a: &SampleId, b: &SampleId| a.sample == b.sample && block(a) == block(b);
        let mut first = 0;
        camera_hits.clear();
        for ids in samples.chunk_by(together) {
            let range = first..first + ids.len();
            first += ids.len();
            let block = block(&ids[0]).intersection(image);
            block_rays.clear();
            if ids.len() as u64 == block.pixels() {
                block_rays.extend(range.map(|i| lanes.paths.ray(i)));
                self.accel.intersect_coherent(block_rays, camera_hits);
                continue;
            }
            let whole = || block.coordinates().map(|(x, y)| SampleId { x, y, ..ids[0] });
            block_rays.extend(whole().map(|id| self.shading.camera_ray(id).1));
            block_hits.clear();
            self.accel.intersect_coherent(block_rays, block_hits);
            let wanted = whole().zip(&*block_hits).filter(|(id, _)| ids.contains(id));
            camera_hits.extend(wanted.map(|(_, hit)| hit));
        }
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

    /// Whether light may pass some surfaces by chance.
    fn has_cutouts(&self) -> bool {
        // The kernel for everything also asks the scene: the queries of a backend may disagree about a hit at the very
        // end of a segment, and the image must not depend on the kernel.
        SceneFeatures(F).contains(SceneFeatures::CUTOUTS)
            && self.shading.scene.features.contains(SceneFeatures::CUTOUTS)
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
        let material =
            &self.shading.scene.materials[self.shading.scene.surfaces[hit.placement as usize].material as usize];
        if material.opacity.is_none() {
            return 1.0;
        }
        material.opacity(
            &self.shading.scene.textures,
            texture_coordinates(&self.shading.scene.geometry, hit),
        )
    }
}
