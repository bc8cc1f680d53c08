//! The state of a batch of paths, column by column.

use super::fetch::Progress;
use crate::accel::{Hit, Ray};
use crate::bsdf::{Bsdf, BsdfSample};
use crate::columns::{Column, Columns, LANES};
use crate::interaction::{ShadingTriangle, SurfaceInteraction};
use crate::light::{AreaLightColumns, Emitter, EnvironmentColumns, LightSample};
use crate::material::ReliefShadow;
use crate::math::{DVec3, Frame, Rgb, Vec3};
use crate::sampling::{Sampler, SamplerKind};
use crate::texture::{Texels, TexturePlace};
use serde::Serialize;

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

/// The state of a batch of paths. Kept from one batch to the next so that rendering does not allocate.
#[derive(Debug, Default)]
pub struct Batch {
    /// By sample: which one, and the light so far. In f64: an f32 sum of equal addends is off by more than 1e-4 after
    /// 10,000 bounces.
    pub(super) samples: Vec<SampleId>,
    pub(super) radiance: Vec<DVec3>,
    /// Whether the camera ray met light.
    sees_light: Vec<bool>,
    /// The light of at most one scattering event, if it is wanted apart.
    pub(super) direct: Vec<DVec3>,
    pub(super) keeps_direct: bool,
    pub(super) together: Together,
    /// Lanes of the paths that go on to a next vertex, ascending.
    pub(super) alive: Vec<u32>,
    /// By lane of the paths that met a surface.
    pub(super) hits: Vec<Hit>,
    pub(super) lanes: Box<Lanes>,
    /// Rays towards emitters; and by ray, the sample and the light that arrives if nothing is in between.
    pub(super) shadow_rays: Vec<Ray>,
    pub(super) shadow_light: Vec<(u32, Rgb)>,
    pub(super) occluded: Vec<bool>,
}

impl Batch {
    /// Takes the next samples to compute, up to [`LANES`]; false if there are none.
    pub fn fill(&mut self, samples: &mut impl Iterator<Item = SampleId>) -> bool {
        self.samples.clear();
        self.samples.extend(samples.take(LANES));
        !self.samples.is_empty()
    }

    /// A batch of which kernels also tell [`Batch::direct`].
    pub fn with_direct() -> Batch {
        Batch {
            keeps_direct: true,
            ..Batch::default()
        }
    }

    /// Keeps the light so far as the direct part, if it is wanted.
    pub(super) fn keep_direct(&mut self) {
        if self.keeps_direct {
            self.direct.clone_from(&self.radiance);
        }
    }

    /// Keeps which samples have light before anything has scattered.
    pub(super) fn note_seen_light(&mut self) {
        self.sees_light.clear();
        self.sees_light
            .extend(self.radiance.iter().map(|light| *light != DVec3::ZERO));
    }

    /// The samples and their radiance [W·m⁻²·sr⁻¹], once a kernel has computed them, and whether the camera ray met an emitter
    /// or the environment.
    pub fn results(&self) -> impl Iterator<Item = (SampleId, Rgb, bool)> {
        let radiance = self.radiance.iter().map(|sum| Rgb::from(sum.to_array()));
        let lights = radiance.zip(self.sees_light.iter().copied());
        self.samples
            .iter()
            .copied()
            .zip(lights)
            .map(|(id, (radiance, sees))| (id, radiance, sees))
    }

    /// The part of each of [`Batch::results`] that was scattered at most once: emission seen directly and the article's
    /// L_dir. The rest is indirect light. Nothing unless the batch was made to tell.
    pub fn direct(&self) -> impl Iterator<Item = Rgb> {
        self.direct.iter().map(|sum| Rgb::from(sum.to_array()))
    }
}

/// Rays that are traced together.
#[derive(Debug, Default)]
pub(super) struct Together {
    pub(super) rays: Vec<Ray>,
    /// What the rays of all paths meet, in their order, as far as they are traced.
    pub(super) hits: Vec<Option<Hit>>,
    /// What a block of camera rays meets, of which not all are wanted.
    pub(super) block_hits: Vec<Option<Hit>>,
}

/// All columns. In one allocation, so that the compiler knows which do not overlap.
#[derive(Debug, Default)]
pub(super) struct Lanes {
    /// Column, row and index of the samples.
    pub(super) coordinates: [Column<u32>; 3],
    pub(super) paths: Paths,
    pub(super) escaped: Escaped,
    pub(super) vertices: Vertices,
}

/// Paths on their way from one vertex to the next.
#[derive(Debug, Default)]
pub(super) struct Paths {
    /// Index into [`Batch::radiance`].
    pub(super) sample: Column<u32>,
    pub(super) keys: [Column<u32>; 2],
    pub(super) index: Column<u32>,
    pub(super) throughput: Columns<3>,
    /// What roulette multiplies the throughput by: a constant, over the weight of the first scattering, and the square of
    /// the index ratios that light was refracted by, so that paths inside glass do not die of what they regain on leaving.
    pub(super) roulette_scale: Column<f32>,
    /// The ray to the next vertex.
    pub(super) origin: Columns<3>,
    pub(super) direction: Columns<3>,
    /// What the next hit on an emitter needs to know of the vertex that led there: where it is, the side that light was
    /// sampled on (both if zero), and the density of the direction [1/sr]; infinite for camera rays and delta lobes.
    pub(super) p: Columns<3>,
    pub(super) n: Columns<3>,
    pub(super) pdf_w: Column<f32>,
    /// The probability with which the environment was sampled there.
    pub(super) environment_pmf: Column<f32>,
}

impl Paths {
    /// The ray of lane `i`.
    #[inline(always)]
    pub(super) fn ray(&self, i: usize) -> Ray {
        Ray::new(self.origin.vec3(i), self.direction.vec3(i))
    }

    /// The random numbers of lane `i` at a bounce.
    #[inline(always)]
    pub(super) fn sampler(&self, i: usize, kind: SamplerKind, bounce: u32) -> Sampler {
        Sampler {
            kind,
            key: [self.keys[0][i], self.keys[1][i]],
            index: self.index[i],
            bounce,
        }
    }

    /// Makes lane `to` like lane `from`.
    #[inline(always)]
    pub(super) fn copy(&mut self, from: usize, to: usize) {
        let Paths {
            sample,
            keys: [key_0, key_1],
            index,
            throughput,
            roulette_scale,
            origin,
            direction,
            p,
            n,
            pdf_w,
            environment_pmf,
        } = self;
        for column in [sample, key_0, key_1, index] {
            column[to] = column[from];
        }
        for column in [roulette_scale, pdf_w, environment_pmf] {
            column[to] = column[from];
        }
        for columns in [throughput, origin, direction, p, n] {
            columns.copy(from, to);
        }
    }
}

/// Paths that met nothing.
#[derive(Debug, Default)]
pub(super) struct Escaped {
    /// Where they come from, as in [`Paths`].
    pub(super) paths: Vec<EscapedPath>,
    pub(super) directions: Columns<3>,
    /// Where on the environment they end.
    pub(super) places: EnvironmentColumns,
    /// Only where the scene has discs.
    pub(super) p: Columns<3>,
    pub(super) n: Columns<3>,
}

/// See [`Paths`].
#[derive(Clone, Copy, Debug)]
pub(super) struct EscapedPath {
    pub(super) sample: u32,
    pub(super) throughput: Rgb,
    pub(super) pdf_w: f32,
    pub(super) environment_pmf: f32,
}

/// The vertices at which paths scatter.
#[derive(Debug, Default)]
pub(super) struct Vertices {
    /// Distance and barycentric coordinates of the hits.
    pub(super) hit: Columns<3>,
    /// How far [`super::fetch`] has come.
    pub(super) progress: Progress,
    /// Corners of the triangles by their index in the mesh.
    pub(super) corner_indices: [Column<u32>; 3],
    /// Corners, vertex normals and orientation of the triangles.
    pub(super) corners: [Columns<3>; 3],
    pub(super) normals: [Columns<3>; 3],
    pub(super) orientation: Column<f32>,
    /// The interaction: point, normals on the side of `wo`, way to the curved surface, and rounding of the point.
    pub(super) p: Columns<3>,
    pub(super) ng: Columns<3>,
    pub(super) ns: Columns<3>,
    pub(super) lift: Columns<3>,
    pub(super) p_error: Column<f32>,
    /// 1 if seen from the front, else 0.
    pub(super) front: Column<f32>,
    /// 0 where the triangle needs [`crate::interaction::ShadingTriangle::exact_point`].
    pub(super) is_plain: Column<u32>,
    /// Random numbers.
    pub(super) light_choice: [Column<u32>; 2],
    pub(super) texel_choice: [Column<u32>; 2],
    pub(super) light_position: Columns<2>,
    pub(super) direction: Columns<2>,
    pub(super) roulette: Column<f32>,
    /// Albedo where scattering is diffuse; the others are listed with their lanes.
    pub(super) reflectance: Columns<3>,
    /// Lanes whose albedo comes from a bitmap, the place on it, its tint, and the texels there.
    pub(super) bitmaps: Vec<(u32, TexturePlace, Rgb)>,
    pub(super) bitmap_texels: Vec<Texels>,
    pub(super) others: Vec<(u32, Bsdf, Option<ReliefShadow>)>,
    /// The normal on whose side light counts; zero where both sides do.
    pub(super) light_side: Columns<3>,
    /// The emitter to sample, and the probability of it; the triangle, or the place on the environment.
    pub(super) emitters: Vec<Emitter>,
    pub(super) emitter_pmf: Column<f32>,
    pub(super) environment_pmf: Column<f32>,
    pub(super) area_lights: AreaLightColumns,
    /// Lanes that sample what has no columns: points, light from far away, triangles whose emission varies.
    pub(super) apart: Vec<u32>,
    /// Lanes that sample the environment; texels drawn, and places around them.
    pub(super) sky: Vec<u32>,
    pub(super) texels: Column<u32>,
    pub(super) places: EnvironmentColumns,
    /// The emitter sample: direction, radiance, density (0 if there is none), and where the shadow ray ends, if not at
    /// infinity (finite: 1).
    pub(super) light_wi: Columns<3>,
    pub(super) light_radiance: Columns<3>,
    pub(super) light_pdf_w: Column<f32>,
    pub(super) light_target: Columns<3>,
    pub(super) light_is_finite: Column<f32>,
    /// The shadow ray and what it brings.
    pub(super) shadow_origin: Columns<3>,
    pub(super) shadow_direction: Columns<3>,
    pub(super) shadow_t_max: Column<f32>,
    pub(super) shadow_light: Columns<3>,
    /// 1 where the shadow ray has to be traced; where the path goes on.
    pub(super) is_lit: Column<u32>,
    pub(super) goes_on: Column<u32>,
    /// The bounce: direction in world coordinates, weight, density, square of the index ratio, and side (1: transmitted).
    pub(super) wi: Columns<3>,
    pub(super) weight: Columns<3>,
    pub(super) pdf_w: Column<f32>,
    pub(super) eta_squared: Column<f32>,
    pub(super) transmitted: Column<f32>,
}

impl Vertices {
    /// Forgets what was fetched for other hits.
    pub(super) fn start_fetching(&mut self, is_ahead: bool) {
        self.progress = Progress::new(is_ahead);
        self.bitmaps.clear();
        self.bitmap_texels.clear();
    }

    /// The triangle and the hit on it of lane `i`; the hit's indices are left out.
    #[inline(always)]
    pub(super) fn triangle<const SMOOTH: bool>(&self, i: usize) -> (ShadingTriangle, Hit) {
        let normal = |k: usize| if SMOOTH { self.normals[k].vec3(i) } else { Vec3::ZERO };
        let triangle = ShadingTriangle {
            corners: [0, 1, 2].map(|k| self.corners[k].vec3(i)),
            normals: [0, 1, 2].map(normal),
            orientation: self.orientation[i],
        };
        let [t, u, v] = self.hit.get(i);
        let hit = Hit {
            t,
            u,
            v,
            placement: 0,
            triangle: 0,
        };
        (triangle, hit)
    }

    /// The random bits that choose a texel of the environment in lane `i`.
    #[inline(always)]
    pub(super) fn texel_bits(&self, i: usize) -> u64 {
        let [high, low] = [0, 1].map(|k| self.texel_choice[k][i]);
        u64::from(high) << 32 | u64::from(low)
    }

    #[inline(always)]
    pub(super) fn set_interaction(&mut self, i: usize, si: &SurfaceInteraction) {
        self.p.set(i, si.p);
        self.ng.set(i, si.ng);
        self.ns.set(i, si.frame.n);
        self.lift.set(i, si.lift);
        self.p_error[i] = si.p_error;
        self.front[i] = f32::from(si.front);
    }

    /// The interaction of lane `i` with a ray that came along `direction`.
    #[inline(always)]
    pub(super) fn interaction<const SMOOTH: bool>(&self, i: usize, direction: Vec3) -> SurfaceInteraction {
        SurfaceInteraction {
            p: self.p.vec3(i),
            wo: -direction,
            ng: self.ng.vec3(i),
            frame: Frame::from_normal(self.ns.vec3(i)),
            front: self.front[i] > 0.0,
            p_error: self.p_error[i],
            lift: if SMOOTH { self.lift.vec3(i) } else { Vec3::ZERO },
        }
    }

    #[inline(always)]
    pub(super) fn set_light(&mut self, i: usize, light: Option<LightSample>) {
        let light = light.unwrap_or(LightSample {
            wi: Vec3::Z,
            radiance: Rgb::BLACK,
            pdf_w: 0.0,
            target: None,
        });
        self.light_wi.set(i, light.wi);
        self.light_radiance.set(i, light.radiance);
        self.light_pdf_w[i] = light.pdf_w;
        self.light_target.set(i, light.target.unwrap_or(Vec3::ZERO));
        self.light_is_finite[i] = f32::from(light.target.is_some());
    }

    #[inline(always)]
    pub(super) fn light(&self, i: usize) -> LightSample {
        let target = self.light_target.vec3(i);
        LightSample {
            wi: self.light_wi.vec3(i),
            radiance: self.light_radiance.rgb(i),
            pdf_w: self.light_pdf_w[i],
            target: (self.light_is_finite[i] > 0.0).then_some(target),
        }
    }

    #[inline(always)]
    pub(super) fn set_shadow(&mut self, i: usize, shadow: Option<(Ray, Rgb)>) {
        self.is_lit[i] = u32::from(shadow.is_some());
        let (ray, light) = shadow.unwrap_or((Ray::new(Vec3::ZERO, Vec3::Z), Rgb::BLACK));
        self.shadow_origin.set(i, ray.origin);
        self.shadow_direction.set(i, ray.direction);
        self.shadow_t_max[i] = ray.t_max;
        self.shadow_light.set(i, light);
    }

    #[inline(always)]
    pub(super) fn set_bounce(&mut self, i: usize, frame: &Frame, sample: Option<BsdfSample>) {
        self.goes_on[i] = u32::from(sample.is_some());
        let sample = sample.unwrap_or(BsdfSample {
            wi: Vec3::Z,
            weight: Rgb::BLACK,
            pdf_w: 0.0,
            eta_squared: 1.0,
        });
        self.wi.set(i, frame.to_world(sample.wi));
        self.weight.set(i, sample.weight);
        self.pdf_w[i] = sample.pdf_w;
        self.eta_squared[i] = sample.eta_squared;
        self.transmitted[i] = f32::from(sample.wi.z < 0.0);
    }
}
