//! Fetching what vertices need while rays are still traced.
//!
//! A ray waits for one node of the tree after the other, and meanwhile memory could bring other things. So hits do not wait
//! for the last ray of their batch: after every [`TOGETHER`] of them, all that are on their way make one step, which reads
//! what the step before has asked for, and asks for what the next one reads. With more hits between two steps, rays would
//! drive what has arrived out of the cache again.
//!
//! 1. Ask which corners the triangle has; draw the random numbers for a direction towards the environment, and ask for the
//!    slot of its table.
//! 2. Read the corners, and ask for the vertices; read the slot, and ask for the texels of the environment.
//! 3. Read the vertices and these texels; find the place on a bitmap, and ask for the texels there.
//! 4. Read them.
//!
//! What is drawn and computed is the same as in one go.

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is read and written in many columns at once"
)]

use super::batch::{Paths, Vertices};
use super::vertex::Shading;
use super::{BounceSampling, Settings};
use crate::accel::Hit;
use crate::columns::{WIDTH, padded};
use crate::interaction::{ShadingTriangle, texture_coordinates_between};
use crate::sampling::Dimension;
use crate::scene::{Scene, SceneFeatures};
use pulp::{Arch, Simd, WithSimd};
use std::ops::Range;

/// Hits between two steps: whole groups of lanes, as loops over columns cover them.
pub(super) const TOGETHER: usize = WIDTH;

/// Bytes of a scene that stay in a core's own cache.
const CACHED_BYTES: usize = 1 << 20;

/// Whether it pays to ask for memory a step ahead, which takes instructions.
pub(super) fn is_ahead(scene: &Scene) -> bool {
    scene.memory_by_part().iter().map(|(_, bytes)| bytes).sum::<usize>() > CACHED_BYTES
}

/// Steps that the last hits have to make.
pub(super) const STEPS: usize = 4;

/// How many hits have made each of the first three steps.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Progress {
    /// Whether memory is asked for a step ahead. Else hits make the first three steps in one.
    is_ahead: bool,
    asked: usize,
    found: usize,
    read: usize,
}

impl Progress {
    /// That of no hits; `is_ahead` as [`is_ahead`] says.
    pub(super) fn new(is_ahead: bool) -> Progress {
        Progress {
            is_ahead,
            ..Progress::default()
        }
    }

    /// One step further, where there are `hits` hits.
    #[inline(always)]
    fn after(self, hits: usize) -> Progress {
        let Progress {
            is_ahead, asked, found, ..
        } = self;
        Progress {
            is_ahead,
            asked: hits,
            found: if is_ahead { asked } else { hits },
            read: if is_ahead { found } else { hits },
        }
    }
}

/// Takes every hit one step further. `depth` is that of the vertices, `paths` what led to them.
pub(super) fn step<const F: u32>(
    scene: &Scene,
    settings: &Settings,
    depth: u32,
    hits: &[Hit],
    paths: &Paths,
    vertices: &mut Vertices,
) {
    Arch::new().dispatch(Step(Shading::<F> { scene, settings }, depth, hits, paths, vertices));
}

/// [`Shading::step`], compiled for each instruction set.
struct Step<'a, const F: u32>(Shading<'a, F>, u32, &'a [Hit], &'a Paths, &'a mut Vertices);

impl<const F: u32> WithSimd for Step<'_, F> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Step(shading, depth, hits, paths, vertices) = self;
        if SceneFeatures(F).contains(SceneFeatures::SMOOTH_NORMALS) {
            shading.step::<true>(depth, hits, paths, vertices);
        } else {
            shading.step::<false>(depth, hits, paths, vertices);
        }
    }
}

impl<const F: u32> Shading<'_, F> {
    #[inline(always)]
    fn step<const SMOOTH: bool>(self, depth: u32, hits: &[Hit], paths: &Paths, vertices: &mut Vertices) {
        let from = vertices.progress;
        let to = from.after(hits.len());
        vertices.progress = to;
        for k in vertices.bitmap_texels.len()..vertices.bitmaps.len() {
            let texels = vertices.bitmaps[k].1.texels(&self.scene.textures);
            vertices.bitmap_texels.push(texels);
        }
        let scatters = depth != self.settings.depth_limit();
        if Self::ENVIRONMENT && scatters {
            self.ask_for_sky(from.asked..to.asked, depth, paths, vertices);
            self.find_sky(from.found..to.found, vertices);
            self.read_sky(from.read..to.read, vertices);
        }
        self.ask_for_corners(&hits[from.asked..], vertices);
        self.find_corners(from.found..to.found, hits, vertices);
        self.read_vertices::<SMOOTH>(from.read..to.read, hits, scatters, vertices);
    }

    #[inline(always)]
    fn ask_for_corners(self, hits: &[Hit], vertices: &Vertices) {
        if vertices.progress.is_ahead {
            for hit in hits {
                self.scene.geometry.prefetch_corners(hit);
            }
        }
    }

    #[inline(always)]
    fn find_corners(self, lanes: Range<usize>, hits: &[Hit], vertices: &mut Vertices) {
        let geometry = &self.scene.geometry;
        for i in lanes {
            let corners = geometry.corners(&hits[i]);
            if vertices.progress.is_ahead {
                geometry.prefetch_vertices(hits[i].placement, corners);
            }
            for k in 0..3 {
                vertices.corner_indices[k][i] = corners[k];
            }
        }
    }

    #[inline(always)]
    fn read_vertices<const SMOOTH: bool>(
        self,
        lanes: Range<usize>,
        hits: &[Hit],
        scatters: bool,
        vertices: &mut Vertices,
    ) {
        let Scene { geometry, textures, .. } = self.scene;
        let has_bitmaps = SceneFeatures(F).contains(SceneFeatures::TEXTURES)
            && self.settings.bounce_sampling == BounceSampling::Bsdf
            && scatters;
        for i in lanes {
            let hit = &hits[i];
            let corners = [0, 1, 2].map(|k| vertices.corner_indices[k][i]);
            let triangle = ShadingTriangle::of_corners::<SMOOTH>(geometry, hit.placement, corners);
            vertices.hit.set(i, [hit.t, hit.u, hit.v]);
            for k in 0..3 {
                vertices.corners[k].set(i, triangle.corners[k]);
                if SMOOTH {
                    vertices.normals[k].set(i, triangle.normals[k]);
                }
            }
            vertices.orientation[i] = triangle.orientation;
            if has_bitmaps
                && !self.is_general(hit)
                && let Some((map, tint)) = self.material(hit).diffuse_bitmap()
            {
                let place = map.place(textures, texture_coordinates_between(geometry, hit, || corners));
                if vertices.progress.is_ahead {
                    place.prefetch(textures);
                }
                vertices.bitmaps.push((i as u32, place, tint));
            }
        }
    }

    /// Draws what a direction towards the environment takes.
    #[inline(always)]
    fn ask_for_sky(self, lanes: Range<usize>, depth: u32, paths: &Paths, vertices: &mut Vertices) {
        let sampler = |i| paths.sampler(i, self.settings.sampler, depth);
        for i in lanes.start..padded(lanes.end) {
            let [high, low] = sampler(i).get_bits(Dimension::Texel);
            vertices.texel_choice[0][i] = high;
            vertices.texel_choice[1][i] = low;
        }
        for i in lanes.start..padded(lanes.end) {
            vertices
                .light_position
                .set(i, sampler(i).get_2d(Dimension::LightPosition));
        }
        if vertices.progress.is_ahead
            && let Some(environment) = self.only_sky()
        {
            for i in lanes {
                environment.prefetch_choice(vertices.texel_bits(i));
            }
        }
    }

    /// Finds the direction towards the environment, unless another emitter may be chosen instead.
    #[inline(always)]
    fn find_sky(self, lanes: Range<usize>, vertices: &mut Vertices) {
        if let Some(environment) = self.only_sky() {
            for i in lanes.clone() {
                vertices.texels[i] = environment.choose_texel(vertices.texel_bits(i));
            }
            let Vertices {
                progress,
                places,
                texels,
                light_position,
                ..
            } = vertices;
            environment.sample_lanes(lanes.clone(), texels, light_position, places);
            if progress.is_ahead {
                for i in lanes {
                    environment.prefetch_texels(i, places);
                }
            }
        }
    }

    #[inline(always)]
    fn read_sky(self, lanes: Range<usize>, vertices: &mut Vertices) {
        if let Some(environment) = self.only_sky() {
            environment.fetch_lanes(lanes, &mut vertices.places);
        }
    }
}
