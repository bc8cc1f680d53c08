//! What the statistical tests share: scenes built in code, renders on every backend, and the one place that decides
//! whether numbers differ by more than chance.
//!
//! Samples of one seed are correlated (they are stratified), so that their spread says nothing about the error of their
//! mean. Errors are therefore estimated from *replications*: renders of the same scene with other seeds, independent of
//! each other. Every test has a fixed seed and a stated significance; decisions over many pixels or cells split it after
//! Šidák, so that the whole test fails by chance with that probability. Since seeds are fixed, it either always does or
//! never.
#![allow(
    dead_code,
    unused_imports,
    unused_macros,
    reason = "every test binary compiles this module and uses a part of it"
)]

pub(crate) mod exact;
pub(crate) mod program;

use embrace::accel::{Accel, BuildOptions};
use embrace::camera::CameraDesc;
use embrace::film::Rect;
use embrace::image::{Image, display, exr, ldr};
use embrace::integrator::{Kernel, KernelChoice, Settings, kernel_for};
use embrace::light::Emission;
use embrace::material::{Material, Scattering, Spectrum};
use embrace::math::{DAffine3, DMat3, DVec3, Rgb, Vec2, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::render::{ErrorControl, Job, render};
use embrace::scene::{EnvironmentDesc, LoadOptions, ObjectDesc, Scene, SceneDesc, SceneOptions, load};
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// Calls `test` for every case on all cores. On threads of its own: what a thread of rayon's pool prints or panics with is
/// lost when the pool was started by another test.
pub(crate) fn for_each_in_parallel<T: Sync>(cases: &[T], test: impl Fn(&T) + Sync) {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    test(case);
                }
            });
        }
    });
}

/// Instantiates generic tests, `fn name<A: Accel>()`, for each backend of the build and for the brute-force reference;
/// after `but not brute:`, where that would take too long, for the backends alone.
#[allow(unused_macros, reason = "not every test binary has a test per backend")]
macro_rules! for_each_backend {
    (but not brute: $($test:ident)*) => {
        #[cfg(feature = "embree")]
        mod embree {
            $(#[test] fn $test() { super::$test::<embrace::accel::embree::Embree>(); })*
        }
        #[cfg(feature = "obvhs")]
        mod obvhs {
            $(#[test] fn $test() { super::$test::<embrace::accel::obvhs::Obvhs>(); })*
        }
    };
    ($($test:ident)*) => {
        mod and_brute {
            use super::*;
            crate::support::for_each_backend!(but not brute: $($test)*);
            mod brute {
                $(#[test] fn $test() { super::super::$test::<embrace::accel::brute::Brute>(); })*
            }
        }
    };
}
#[allow(unused_imports, reason = "not every test binary has a test per backend")]
pub(crate) use for_each_backend;

/// SplitMix64 (Steele et al. 2014): independent numbers, unlike the renderer's stratified ones.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In [0, 1).
    pub(crate) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    /// From 0 to `n` - 1.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    pub(crate) fn pair(&mut self) -> [f32; 2] {
        [self.unit(), self.unit()]
    }
}

/// A parallelogram, front side where `u × v` points, texture coordinates from (0, 0) at `corner`.
pub(crate) fn quad(corner: Vec3, u: Vec3, v: Vec3) -> TriangleMesh {
    TriangleMesh {
        positions: vec![corner, corner + u, corner + u + v, corner + v],
        uvs: vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    }
}

/// A closed box, its front sides outwards or inwards.
pub(crate) fn cuboid(lo: Vec3, hi: Vec3, inwards: bool) -> TriangleMesh {
    let mut mesh = TriangleMesh {
        positions: (0..8)
            .map(|i| Vec3::select(glam::BVec3::new(i & 1 != 0, i & 2 != 0, i & 4 != 0), hi, lo))
            .collect(),
        ..TriangleMesh::default()
    };
    for [a, b, c, d] in [
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 2, 3, 1],
        [4, 5, 7, 6u32],
    ] {
        mesh.indices.extend([[a, b, c], [a, c, d]]);
    }
    if inwards {
        mesh.indices.iter_mut().for_each(|t| t.swap(1, 2));
    }
    mesh
}

/// A closed sphere of `rows` rings of `2 rows` quads with shared poles, front side outwards, with or without vertex
/// normals.
pub(crate) fn sphere(centre: Vec3, radius: f32, rows: u32, smooth: bool) -> TriangleMesh {
    let columns = 2 * rows;
    let direction = |row: u32, column: u32| {
        let theta = std::f64::consts::PI * f64::from(row) / f64::from(rows);
        let phi = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
        DVec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin())
    };
    let mut normals = vec![DVec3::Y];
    normals.extend((1..rows).flat_map(|row| (0..columns).map(move |column| direction(row, column))));
    normals.push(DVec3::NEG_Y);
    let index = |row: u32, column: u32| match row {
        0 => 0,
        _ if row == rows => (rows - 1) * columns + 1,
        _ => 1 + (row - 1) * columns + column % columns,
    };
    let mut indices = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [index(row, column), index(row, column + 1)];
            let [c, d] = [index(row + 1, column), index(row + 1, column + 1)];
            if row > 0 {
                indices.push([a, c, b]);
            }
            if row + 1 < rows {
                indices.push([b, c, d]);
            }
        }
    }
    TriangleMesh {
        positions: normals.iter().map(|n| centre + n.as_vec3() * radius).collect(),
        normals: if smooth {
            normals.iter().map(|n| n.as_vec3()).collect()
        } else {
            Vec::new()
        },
        uvs: Vec::new(),
        colors: Vec::new(),
        indices,
    }
}

/// Scattering without cut-outs.
pub(crate) fn opaque(scattering: Scattering) -> Material {
    Material::new(scattering)
}

/// Grey diffuse.
pub(crate) fn diffuse(reflectance: f32) -> Material {
    opaque(Scattering::Diffuse {
        reflectance: Spectrum::Constant(Rgb::splat(reflectance)),
    })
}

/// Grey emission of the front side alone.
pub(crate) fn emission(radiance: f32) -> Emission {
    Emission {
        radiance: Rgb::splat(radiance),
        both_sides: false,
    }
}

/// A view with +Y up (or +Z, for views along Y).
pub(crate) fn camera(position: Vec3, look_at: Vec3, vfov_degrees: f64, resolution: [u32; 2]) -> CameraDesc {
    let along_y = (look_at - position).normalize().y.abs() > 0.99;
    CameraDesc {
        position: position.as_dvec3(),
        look_at: look_at.as_dvec3(),
        up: if along_y { DVec3::Z } else { DVec3::Y },
        vfov_degrees,
        resolution,
        aperture_radius: 0.0,
        focus_distance: None,
        mirrored: false,
    }
}

/// A view of one pixel that sees all but one point.
pub(crate) fn probe(position: Vec3, look_at: Vec3) -> CameraDesc {
    camera(position, look_at, 1e-3, [1, 1])
}

/// A scene under construction.
#[derive(Clone)]
pub(crate) struct Stage(pub(crate) SceneDesc);

impl Stage {
    pub(crate) fn new(camera: CameraDesc) -> Stage {
        Stage(SceneDesc {
            camera,
            crop: None,
            max_depth: None,
            environment: None,
            materials: Vec::new(),
            textures: Vec::new(),
            meshes: Vec::new(),
            objects: Vec::new(),
            lights: Vec::new(),
            hash: String::new(),
            warnings: Vec::new(),
        })
    }

    /// The same scene from elsewhere.
    pub(crate) fn seen_by(&self, camera: CameraDesc) -> Stage {
        let mut stage = self.clone();
        stage.0.camera = camera;
        stage
    }

    pub(crate) fn add(self, mesh: TriangleMesh, material: Material) -> Stage {
        self.add_at(mesh, material, None, &[DAffine3::IDENTITY])
    }

    pub(crate) fn add_light(self, mesh: TriangleMesh, material: Material, emission: Emission) -> Stage {
        self.add_at(mesh, material, Some(emission), &[DAffine3::IDENTITY])
    }

    /// One mesh in several places.
    pub(crate) fn add_at(
        mut self,
        mesh: TriangleMesh,
        material: Material,
        emission: Option<Emission>,
        places: &[DAffine3],
    ) -> Stage {
        let mesh = mesh.into_f64();
        mesh.validate().expect("the mesh of a test is valid");
        let desc = &mut self.0;
        desc.meshes.push(Arc::new(mesh));
        desc.materials
            .push((format!("material {}", desc.materials.len()), material));
        for to_world in places {
            desc.objects.push(ObjectDesc {
                name: format!("object {}", desc.objects.len()),
                mesh: desc.meshes.len() - 1,
                material: desc.materials.len() - 1,
                to_world: *to_world,
                emission,
                emission_map: None,
            });
        }
        self
    }

    pub(crate) fn lit_by_constant(mut self, radiance: f32) -> Stage {
        self.0.environment = Some(EnvironmentDesc::Constant(Rgb::splat(radiance)));
        self
    }

    pub(crate) fn lit_by_map(mut self, image: Image<Rgb>, rotation_degrees: f64) -> Stage {
        self.0.environment = Some(EnvironmentDesc::Map {
            image: Arc::new(image),
            scale: 1.0,
            rotation_degrees,
            to_world: DMat3::IDENTITY,
        });
        self
    }

    pub(crate) fn build<A: Accel>(&self, options: SceneOptions) -> Prepared<A> {
        Prepared::new(self.0.clone(), options)
    }

    /// With the options that the settings ask for.
    pub(crate) fn prepare<A: Accel>(&self, settings: &Settings) -> Prepared<A> {
        self.build(SceneOptions {
            env_sampling: settings.env_sampling,
            light_sampling: settings.light_sampling,
            mis: settings.mis,
            ..SceneOptions::default()
        })
    }
}

/// A scene on one backend, ready to be rendered.
pub(crate) struct Prepared<A> {
    pub(crate) scene: Scene,
    pub(crate) accel: A,
    pub(crate) kernel: Kernel,
}

impl<A: Accel> Prepared<A> {
    pub(crate) fn new(desc: SceneDesc, options: SceneOptions) -> Prepared<A> {
        let scene = Scene::build(desc, options).expect("the scene of a test can be built");
        let accel = A::build(&scene.geometry, BuildOptions::default()).expect("the backend can be built");
        let kernel = kernel_for(&scene, KernelChoice::Auto);
        Prepared { scene, accel, kernel }
    }

    /// The kernel that serves every scene instead of the smallest.
    pub(crate) fn with_general_kernel(mut self) -> Self {
        self.kernel = kernel_for(&self.scene, KernelChoice::General);
        self
    }

    /// The mean of `spp` samples with the seed of `settings`. Panics if a sample is not finite.
    pub(crate) fn image(&self, settings: &Settings, spp: u32) -> Image<Rgb> {
        let [x1, y1] = self.scene.camera.resolution();
        let job = Job {
            crop: Rect { x0: 0, y0: 0, x1, y1 },
            spp,
            error: ErrorControl::Ignored,
            split_direct: false,
            settings: *settings,
        };
        let (film, report) = render(&self.scene, &self.accel, self.kernel, &job);
        assert_eq!(
            report.dropped.count,
            0,
            "{}: samples that are not finite, first {:?}, seed {}",
            A::NAME,
            report.dropped.first,
            settings.seed
        );
        film.develop()
    }

    /// One image per seed. The seeds are those of the range, offset by that of `settings` times a large odd number.
    pub(crate) fn replicate(&self, settings: &Settings, spp: u32, seeds: Range<u64>) -> Summary {
        let images: Vec<Image<Rgb>> = seeds
            .into_par_iter()
            .map(|seed| {
                let seed = settings.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(seed);
                self.image(&Settings { seed, ..*settings }, spp)
            })
            .collect();
        Summary::of(&images)
    }

    /// The mean over all pixels and channels, from that of every seed.
    pub(crate) fn mean(&self, settings: &Settings, spp: u32, seeds: Range<u64>) -> Estimate {
        self.replicate(settings, spp, seeds).overall
    }
}

/// A scene of the repository.
pub(crate) fn load_scene(name: &str) -> SceneDesc {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenes/{name}/{name}.toml"));
    load(
        &path,
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .expect("the scenes have no faults")
}

/// The same at this size, to be rendered with multiple importance sampling.
pub(crate) fn scene_of_repository<A: Accel>(name: &str, resolution: [u32; 2]) -> Prepared<A> {
    let mut desc = load_scene(name);
    desc.camera.resolution = resolution;
    let options = SceneOptions {
        mis: true,
        ..SceneOptions::default()
    };
    Prepared::new(desc, options)
}

/// The probability with which a test may fail although nothing is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Significance(pub(crate) f64);

impl Significance {
    /// What a test takes unless it says otherwise.
    pub(crate) const TEST: Significance = Significance(1e-3);

    /// The significance of each of `n` decisions that together have this one (Šidák 1967).
    pub(crate) fn split(self, n: usize) -> Significance {
        Significance(-((-self.0).ln_1p() / n.max(1) as f64).exp_m1())
    }
}

/// Relative difference that is put down to f32 arithmetic along a path and never held against a mean.
pub(crate) const ROUNDING: f64 = 2e-5;

/// A mean of independent replications.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) mean: f64,
    /// Of the mean.
    pub(crate) standard_error: f64,
    pub(crate) replications: usize,
}

impl Estimate {
    pub(crate) fn of(values: &[f64]) -> Estimate {
        assert!(values.len() > 1, "a standard error needs two replications");
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Estimate {
            mean,
            standard_error: (variance / n).sqrt(),
            replications: values.len(),
        }
    }

    /// A number known exactly.
    pub(crate) fn exact(mean: f64) -> Estimate {
        Estimate {
            mean,
            standard_error: 0.0,
            replications: usize::MAX,
        }
    }

    /// Two-sided probability of a difference this large or larger if the true means are equal (Welch 1947: Student's t
    /// with the degrees of freedom that the two errors leave). Differences within [`ROUNDING`] do not count.
    pub(crate) fn p_value(&self, other: &Estimate) -> f64 {
        let rounding = ROUNDING * self.mean.abs().max(other.mean.abs());
        let difference = ((self.mean - other.mean).abs() - rounding).max(0.0);
        if !(self.mean - other.mean).is_finite() {
            return 0.0;
        }
        if difference == 0.0 {
            return 1.0;
        }
        let [a, b] = [self, other].map(|e| e.standard_error.powi(2));
        if a + b == 0.0 {
            return 0.0;
        }
        let dof =
            (a + b).powi(2) / (a * a / (self.replications as f64 - 1.0) + b * b / (other.replications as f64 - 1.0));
        let t = difference / (a + b).sqrt();
        if dof < 1e4 {
            2.0 * StudentsT::new(0.0, 1.0, dof).expect("degrees of freedom").sf(t)
        } else {
            2.0 * Normal::standard().sf(t)
        }
    }
}

/// Panics, with numbers, if an estimate differs from a value by more than chance.
#[track_caller]
pub(crate) fn assert_mean(name: &str, estimate: Estimate, expected: f64, significance: Significance) {
    assert_same_mean(name, estimate, Estimate::exact(expected), significance);
}

/// Panics, with numbers, if two estimates differ by more than chance.
#[track_caller]
pub(crate) fn assert_same_mean(name: &str, estimate: Estimate, expected: Estimate, significance: Significance) {
    let p = estimate.p_value(&expected);
    assert!(
        p >= significance.0,
        "{name}: {:.7} ± {:.1e} for {:.7} ± {:.1e} (ratio {:.6}): p = {p:.2e} < {:.2e}",
        estimate.mean,
        estimate.standard_error,
        expected.mean,
        expected.standard_error,
        estimate.mean / expected.mean,
        significance.0,
    );
}

/// Replicated images: mean and standard error per pixel and channel, and of the whole.
#[derive(Clone, Debug)]
pub(crate) struct Summary {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) pixels: Vec<[Estimate; 3]>,
    /// Over all pixels, by channel.
    pub(crate) channels: [Estimate; 3],
    /// Over all pixels and channels.
    pub(crate) overall: Estimate,
}

impl Summary {
    pub(crate) fn of(images: &[Image<Rgb>]) -> Summary {
        let (width, height) = (images[0].width, images[0].height);
        let count = images[0].pixels.len();
        let mean_of = |image: &Image<Rgb>, channel: usize| {
            image.pixels.iter().map(|p| f64::from(p[channel])).sum::<f64>() / count as f64
        };
        let channel_means: Vec<[f64; 3]> = images
            .iter()
            .map(|image| std::array::from_fn(|c| mean_of(image, c)))
            .collect();
        let over = |value: &dyn Fn(usize) -> f64| Estimate::of(&(0..images.len()).map(value).collect::<Vec<_>>());
        Summary {
            width,
            height,
            pixels: (0..count)
                .map(|i| std::array::from_fn(|c| over(&|k| f64::from(images[k].pixels[i][c]))))
                .collect(),
            channels: std::array::from_fn(|c| over(&|k| channel_means[k][c])),
            overall: over(&|k| channel_means[k].iter().sum::<f64>() / 3.0),
        }
    }

    /// From a stored mean image, the image of the variances *of that mean*, and the number of replications behind them.
    /// The variance of the whole follows if pixels are independent, which they are in this renderer.
    pub(crate) fn from_images(mean: &Image<Rgb>, variance_of_mean: &Image<Rgb>, replications: usize) -> Summary {
        let n = mean.pixels.len() as f64;
        let estimate = |mean: f64, variance: f64| Estimate {
            mean,
            standard_error: variance.max(0.0).sqrt(),
            replications,
        };
        let sum = |image: &Image<Rgb>, c: usize| image.pixels.iter().map(|p| f64::from(p[c])).sum::<f64>();
        let channels: [Estimate; 3] =
            std::array::from_fn(|c| estimate(sum(mean, c) / n, sum(variance_of_mean, c) / (n * n)));
        // Channels share their paths: the error of their mean is at most the mean of their errors.
        let error = channels.iter().map(|c| c.standard_error).sum::<f64>() / 3.0;
        Summary {
            width: mean.width,
            height: mean.height,
            pixels: mean
                .pixels
                .iter()
                .zip(&variance_of_mean.pixels)
                .map(|(m, v)| std::array::from_fn(|c| estimate(m[c].into(), v[c].into())))
                .collect(),
            channels,
            overall: estimate(channels.iter().map(|c| c.mean).sum::<f64>() / 3.0, error * error),
        }
    }

    pub(crate) fn mean_image(&self) -> Image<Rgb> {
        self.image_of(|e| e.mean)
    }

    pub(crate) fn variance_of_mean_image(&self) -> Image<Rgb> {
        self.image_of(|e| e.standard_error * e.standard_error)
    }

    fn image_of(&self, value: impl Fn(&Estimate) -> f64) -> Image<Rgb> {
        Image {
            width: self.width,
            height: self.height,
            pixels: self
                .pixels
                .iter()
                .map(|p| Rgb::from([0, 1, 2].map(|c| value(&p[c]))))
                .collect(),
        }
    }
}

/// Panics if two sets of images differ by more than chance: in the mean of a channel (half of the significance) or in any
/// pixel (the other half). Failures leave result, reference and p-values under `target/`.
#[track_caller]
pub(crate) fn assert_same_images(name: &str, result: &Summary, reference: &Summary, significance: Significance) {
    assert_eq!(
        (result.width, result.height),
        (reference.width, reference.height),
        "{name}"
    );
    let half = significance.split(2);
    let per_channel = half.split(3);
    let per_pixel = half.split(3 * result.pixels.len());
    let mut problems = Vec::new();
    for c in 0..3 {
        let (a, b) = (result.channels[c], reference.channels[c]);
        let p = a.p_value(&b);
        if p < per_channel.0 {
            problems.push(format!(
                "mean of channel {c}: {:.6} ± {:.1e} for {:.6} ± {:.1e}, p = {p:.2e} < {:.2e}",
                a.mean, a.standard_error, b.mean, b.standard_error, per_channel.0
            ));
        }
    }
    let p_values: Vec<[f64; 3]> = result
        .pixels
        .iter()
        .zip(&reference.pixels)
        .map(|(a, b)| std::array::from_fn(|c| a[c].p_value(&b[c])))
        .collect();
    let rejected = p_values.iter().flatten().filter(|p| **p < per_pixel.0).count();
    if rejected > 0 {
        let (i, c) = (0..p_values.len())
            .flat_map(|i| [(i, 0), (i, 1), (i, 2)])
            .min_by(|&(i, c), &(j, d)| p_values[i][c].total_cmp(&p_values[j][d]))
            .expect("there are pixels");
        let (a, b) = (result.pixels[i][c], reference.pixels[i][c]);
        problems.push(format!(
            "{rejected} of {} pixel values, the worst at column {}, row {}, channel {c}: {:.6} ± {:.1e} for {:.6} ± \
             {:.1e}, p = {:.2e} < {:.2e}",
            3 * p_values.len(),
            i % result.width as usize,
            i / result.width as usize,
            a.mean,
            a.standard_error,
            b.mean,
            b.standard_error,
            p_values[i][c],
            per_pixel.0
        ));
    }
    if !problems.is_empty() {
        let p_image = Image {
            width: result.width,
            height: result.height,
            pixels: p_values.iter().map(|p| Rgb::from(*p)).collect(),
        };
        let folder = write_failure(
            name,
            &[
                ("result", &result.mean_image()),
                ("reference", &reference.mean_image()),
                ("p-value", &p_image),
            ],
        );
        panic!("{name}: {}; images in {}", problems.join("; "), folder.display());
    }
}

/// Writes images of a failed test, as EXR and PNG, into a folder of its own under `target/`.
pub(crate) fn write_failure(name: &str, images: &[(&str, &Image<Rgb>)]) -> PathBuf {
    let safe: String = name
        .chars()
        .map(|c| if c.is_alphanumeric() { c } else { '-' })
        .collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("failures").join(safe);
    std::fs::create_dir_all(&folder).expect("a folder for the images of a failed test");
    for (what, image) in images {
        let (exr_path, png_path) = (folder.join(format!("{what}.exr")), folder.join(format!("{what}.png")));
        let mut bytes = Vec::new();
        exr::write(&mut bytes, image, &exr::ExrMetadata::default(), &exr_path).expect("an EXR in memory");
        std::fs::write(&exr_path, &bytes).expect("the image of a failed test");
        bytes.clear();
        ldr::write_png(&mut bytes, &display::to_srgb8(image, 0.0), &png_path).expect("a PNG in memory");
        std::fs::write(&png_path, &bytes).expect("the image of a failed test");
    }
    folder
}

/// Pearson's test of counts against expected counts. Cells that expect fewer than 5 are pooled, smallest first, until the
/// pool expects 5. A count where nothing is expected has probability zero. The counts' sum is given: one degree of
/// freedom is spent.
pub(crate) fn chi_square_p(observed: &[u64], expected: &[f64]) -> f64 {
    assert_eq!(observed.len(), expected.len());
    const LEAST: f64 = 5.0;
    let mut cells: Vec<(f64, u64)> = expected.iter().copied().zip(observed.iter().copied()).collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut pooled) = (0.0, 0usize);
    let (mut e_pool, mut o_pool) = (0.0, 0);
    for (i, &(e, o)) in cells.iter().enumerate() {
        // Quadrature leaves cells beyond a support with rounding error, not with exact zeros.
        if e < 1e-6 && o > 0 {
            return 0.0;
        }
        e_pool += e;
        o_pool += o;
        let rest_is_poor = i + 1 < cells.len() && cells[i + 1..].iter().map(|c| c.0).sum::<f64>() < LEAST;
        if e_pool >= LEAST && !rest_is_poor || i + 1 == cells.len() && e_pool > 0.0 {
            statistic += (o_pool as f64 - e_pool).powi(2) / e_pool;
            pooled += 1;
            (e_pool, o_pool) = (0.0, 0);
        }
    }
    if pooled < 2 {
        return 1.0;
    }
    ChiSquared::new((pooled - 1) as f64)
        .expect("degrees of freedom")
        .sf(statistic)
}

/// Panics, with the worst cells, if counts do not follow their expectations.
#[track_caller]
pub(crate) fn assert_chi_square(name: &str, observed: &[u64], expected: &[f64], significance: Significance) {
    let p = chi_square_p(observed, expected);
    if p >= significance.0 {
        return;
    }
    let mut cells: Vec<(f64, usize)> = observed
        .iter()
        .zip(expected)
        .map(|(&o, &e)| (o as f64 - e).powi(2) / e.max(1e-6))
        .zip(0..)
        .collect();
    cells.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worst: Vec<String> = cells
        .iter()
        .take(5)
        .map(|&(_, i)| format!("cell {i}: {} for {:.2}", observed[i], expected[i]))
        .collect();
    panic!(
        "{name}: chi-square p = {p:.2e} < {:.2e}; {} counts for {:.1}; {}",
        significance.0,
        observed.iter().sum::<u64>(),
        expected.iter().sum::<f64>(),
        worst.join(", ")
    );
}

/// The integral of `f` over a rectangle, by tensor Gauss-Legendre rules on cells that are split until `tolerance`
/// (absolute, shared by area) is met or six splits are done.
pub(crate) fn integrate(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], tolerance: f64) -> f64 {
    split_until(f, x, y, tolerance, gauss(f, x, y), 6)
}

fn split_until(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], tolerance: f64, whole: f64, splits: u32) -> f64 {
    let (mx, my) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
    let parts = [
        ([x[0], mx], [y[0], my]),
        ([mx, x[1]], [y[0], my]),
        ([x[0], mx], [my, y[1]]),
        ([mx, x[1]], [my, y[1]]),
    ];
    let values = parts.map(|(x, y)| gauss(f, x, y));
    let sum: f64 = values.iter().sum();
    if (sum - whole).abs() <= tolerance || splits == 0 {
        return sum;
    }
    parts
        .iter()
        .zip(values)
        .map(|(&(x, y), value)| split_until(f, x, y, 0.25 * tolerance, value, splits - 1))
        .sum()
}

fn gauss(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    /// Nodes and weights of the four-point rule on [-1, 1].
    const RULE: [(f64, f64); 4] = [
        (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
        (-0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.339_981_043_584_856_3, 0.652_145_154_862_546_1),
        (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    ];
    let (cx, hx) = (0.5 * (x[0] + x[1]), 0.5 * (x[1] - x[0]));
    let (cy, hy) = (0.5 * (y[0] + y[1]), 0.5 * (y[1] - y[0]));
    let mut sum = 0.0;
    for (nx, wx) in RULE {
        for (ny, wy) in RULE {
            sum += wx * wy * f(cx + hx * nx, cy + hy * ny);
        }
    }
    sum * hx * hy
}
