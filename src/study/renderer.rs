//! Scenes that are ready to render, whatever the backend.

use super::setting::Setting;
use crate::accel::{Accel, BuildOptions, BuildQuality, Intersector};
use crate::film::{Film, Rect};
use crate::integrator::{Batch, Kernel, KernelChoice, RayCounts, SampleId, Settings, kernel_for};
use crate::math::Rgb;
use crate::render::{ErrorControl, Job, RenderReport, Watch, render_watched};
use crate::scene::{Instancing, Scene, SceneDesc, SceneOptions};
use std::time::Instant;

/// Called from all threads between tiles; true ends the render.
pub type Stop<'a> = &'a (dyn Fn() -> bool + Sync);

/// What can trace the rays of a study.
#[derive(Clone, Copy)]
pub struct Backend {
    /// The name on the command line.
    pub name: &'static str,
    /// The name of the setting that differs from the default by this backend.
    pub setting: &'static str,
    /// Whether the command line takes it without being told.
    pub is_default: bool,
    /// What there is to choose from.
    pub intersectors: &'static [Intersector],
    /// Version of the library.
    pub version: fn() -> String,
    build: fn(Scene, BuildOptions) -> Result<Box<dyn Renderer>, String>,
}

impl Backend {
    #[cfg(any(feature = "embree", feature = "obvhs"))]
    fn of<A: Accel + 'static>(setting: &'static str, is_default: bool) -> Backend {
        Backend {
            name: A::NAME,
            setting,
            is_default,
            intersectors: A::INTERSECTORS,
            version: A::version,
            build: |scene, options| {
                let accel = A::build(&scene.geometry, options).map_err(|e| e.to_string())?;
                let kernel = kernel_for(&scene, KernelChoice::Auto);
                Ok(Box::new(Ready { scene, accel, kernel }))
            },
        }
    }
}

/// The backends of this build, the default one first.
pub fn backends() -> Vec<Backend> {
    vec![
        #[cfg(feature = "embree")]
        Backend::of::<crate::accel::embree::Embree>("backend-embree", true),
        #[cfg(feature = "obvhs")]
        Backend::of::<crate::accel::obvhs::Obvhs>("backend-obvhs", cfg!(not(feature = "embree"))),
    ]
}

/// A scene with its tree and kernel. Called once per image, so that dispatch costs nothing.
pub trait Renderer: Sync {
    /// The scene.
    fn scene(&self) -> &Scene;
    /// Renders the whole image; what is done when `stop` says yes.
    fn render(&self, spp: u32, settings: &Settings, stop: Stop<'_>) -> (Film, RenderReport);
    /// Computes samples one by one on this thread, in their order: for what a film hides.
    fn samples(&self, settings: &Settings, ids: &mut dyn Iterator<Item = SampleId>, take: &mut dyn FnMut(Rgb));
}

struct Ready<A> {
    scene: Scene,
    accel: A,
    kernel: Kernel,
}

impl<A: Accel> Renderer for Ready<A> {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn render(&self, spp: u32, settings: &Settings, stop: Stop<'_>) -> (Film, RenderReport) {
        let [width, height] = self.scene.camera.resolution();
        let job = Job {
            crop: Rect {
                x0: 0,
                y0: 0,
                x1: width,
                y1: height,
            },
            spp,
            error: ErrorControl::Ignored,
            split_direct: false,
            settings: *settings,
        };
        let watch = Watch {
            stop,
            progress: &|_, _| (),
            after_pass: &mut |_| (),
        };
        render_watched(&self.scene, &self.accel, self.kernel, &job, watch)
    }

    fn samples(&self, settings: &Settings, mut ids: &mut dyn Iterator<Item = SampleId>, take: &mut dyn FnMut(Rgb)) {
        let (mut batch, mut counts) = (Batch::default(), RayCounts::default());
        while batch.fill(&mut ids) {
            self.kernel
                .trace(&self.scene, &self.accel, settings, &mut batch, &mut counts);
            batch.results().for_each(|(_, radiance, _)| take(radiance));
        }
    }
}

/// What a setting has built; kept for as long as the next render needs the same.
pub struct Workshop<'a> {
    desc: &'a SceneDesc,
    backends: &'a [Backend],
    current: Option<Built>,
}

struct Built {
    key: (usize, SceneOptions, BuildOptions),
    renderer: Box<dyn Renderer>,
    seconds: f64,
}

impl<'a> Workshop<'a> {
    /// For a scene; `desc.camera.resolution` is the study's.
    pub fn new(desc: &'a SceneDesc, backends: &'a [Backend]) -> Workshop<'a> {
        Workshop {
            desc,
            backends,
            current: None,
        }
    }

    /// What renders `spp` samples with a setting, and how many seconds building it took. Trees are built as `embrace
    /// render` does for that many samples.
    ///
    /// # Errors
    /// If the scene or the tree cannot be built, as a sentence.
    pub fn renderer(&mut self, setting: &Setting, spp: u32) -> Result<(&dyn Renderer, f64), String> {
        let options = SceneOptions {
            env_sampling: setting.settings.env_sampling,
            light_sampling: setting.settings.light_sampling,
            mis: setting.settings.mis,
            instancing: Instancing::Auto,
        };
        let [width, height] = self.desc.camera.resolution;
        let paths = u64::from(width) * u64::from(height) * u64::from(spp);
        let triangles = self
            .desc
            .objects
            .iter()
            .map(|object| self.desc.meshes[object.mesh].indices.len() as u64);
        let quality = setting
            .quality
            .unwrap_or_else(|| BuildQuality::for_paths(paths, triangles.sum(), setting.intersector));
        let build_options = BuildOptions {
            intersector: setting.intersector,
            quality,
        };
        let key = (setting.backend, options, build_options);
        let built = match self.current.take() {
            Some(built) if built.key == key => built,
            // Dropped first: two large scenes may not fit beside each other.
            _ => {
                let start = Instant::now();
                let scene = Scene::build(self.desc.clone(), options).map_err(|e| e.to_string())?;
                let renderer = (self.backends[setting.backend].build)(scene, build_options)?;
                let seconds = start.elapsed().as_secs_f64();
                Built { key, renderer, seconds }
            }
        };
        let built = self.current.insert(built);
        Ok((&*built.renderer, built.seconds))
    }
}
