//! The estimator's settings and the choice of a kernel by what the scene requires.

use crate::accel::{Accel, Hit, Ray};
use crate::light::{EnvSampling, LightSampling};
use crate::sampling::SamplerKind;
use crate::scene::{Scene, SceneFeatures};

mod batch;
mod fetch;
mod path;
mod roulette;
mod vertex;

pub use batch::{Batch, SampleId};

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

/// Which light is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Lighting {
    /// Direct and indirect: the whole rendering equation.
    #[default]
    Global,
    /// Emission and one scattering event, the article's L_dir.
    Direct,
}

/// How the direction that carries the recursion is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BounceSampling {
    /// By the BSDF.
    #[default]
    Bsdf,
    /// By the cosine over the hemisphere. Delta lobes are still drawn by the BSDF: nothing else finds them.
    Cosine,
    /// Uniformly over the hemisphere, as the article does; delta lobes likewise.
    Uniform,
}

/// How paths end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Roulette {
    /// By the throughput relative to that after the first bounce.
    #[default]
    Throughput,
    /// By the depth limit alone.
    Off,
    /// The article's: survival with this probability in (0, 1) at every bounce.
    Fixed(f32),
}

/// The estimator's settings. All settings but `lighting` and `max_depth` agree in the mean; only the noise differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Largest number of scattering events: 0 is emission seen directly, 1 direct light; `None` no limit.
    pub max_depth: Option<u32>,
    /// Which light is computed.
    pub lighting: Lighting,
    /// How directions towards the environment are drawn. Takes effect when the scene is built.
    pub env_sampling: EnvSampling,
    /// How emitters are chosen. Takes effect when the scene is built.
    pub light_sampling: LightSampling,
    /// How bounces are drawn.
    pub bounce_sampling: BounceSampling,
    /// Whether emitter samples and bounces that hit an emitter are combined by multiple importance sampling. Without it
    /// emitters count through emitter samples alone, except after delta lobes, which only bounces can follow.
    pub mis: bool,
    /// How paths end.
    pub roulette: Roulette,
    /// Which random numbers.
    pub sampler: SamplerKind,
    /// Whether rays from smooth surfaces start on the curve that the vertex normals describe.
    pub smooth_terminator: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            max_depth: None,
            lighting: Lighting::Global,
            env_sampling: EnvSampling::Importance,
            light_sampling: LightSampling::Contribution,
            bounce_sampling: BounceSampling::Bsdf,
            mis: true,
            roulette: Roulette::Throughput,
            sampler: SamplerKind::Sobol,
            smooth_terminator: true,
            seed: 0,
        }
    }
}

impl Settings {
    /// The article's estimator: uniform bounces, no multiple importance sampling, fixed roulette.
    pub fn article() -> Settings {
        Settings {
            bounce_sampling: BounceSampling::Uniform,
            mis: false,
            roulette: Roulette::Fixed(0.8),
            ..Settings::default()
        }
    }

    /// The number of scattering events after which a path ends for certain.
    pub(crate) fn depth_limit(&self) -> u32 {
        let limit = self.max_depth.unwrap_or(u32::MAX);
        match self.lighting {
            Lighting::Global => limit,
            Lighting::Direct => limit.min(1),
        }
    }
}

/// The code that computes samples, compiled for a set of features. It does not depend on the backend: queries are made
/// between its steps.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// What it is compiled for.
    pub features: SceneFeatures,
    /// Whether what vertices need from memory is asked for while rays are traced, as [`kernel_for`] decides by the size of
    /// the scene. The image is the same.
    pub fetches_ahead: bool,
    start: fn(&Scene, &Settings, &mut Batch),
    fetch: fn(&Scene, &Settings, u32, &[Hit], &batch::Paths, &mut batch::Vertices),
    scatter: fn(&Scene, &Settings, u32, &mut Batch),
}

/// Which kernel to take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KernelChoice {
    /// The smallest that has all the scene requires.
    #[default]
    Auto,
    /// The one that has everything, whatever the scene requires; the image is the same.
    General,
}

impl Kernel {
    const fn new<const F: u32>() -> Kernel {
        Kernel {
            features: SceneFeatures(F),
            fetches_ahead: false,
            start: vertex::start::<F>,
            fetch: fetch::step::<F>,
            scatter: vertex::scatter::<F>,
        }
    }

    /// Computes the samples of a batch, and counts the rays they take.
    pub fn trace<A: Accel>(
        &self,
        scene: &Scene,
        accel: &A,
        settings: &Settings,
        batch: &mut Batch,
        counts: &mut RayCounts,
    ) {
        path::trace(self, scene, accel, settings, batch, counts);
    }

    /// Traces the camera rays of a batch and nothing else. Gives the samples that met a surface, with the ray and the hit:
    /// the very ones that [`Kernel::trace`] starts with.
    pub fn first_hits<A: Accel>(
        &self,
        scene: &Scene,
        accel: &A,
        settings: &Settings,
        batch: &mut Batch,
    ) -> impl Iterator<Item = (SampleId, Ray, Hit)> {
        path::first_hits(self, scene, accel, settings, batch)
    }
}

/// From small to large; the last serves every scene.
static KERNELS: [Kernel; 6] = {
    const AREA: SceneFeatures = SceneFeatures::AREA_LIGHTS;
    const ENVIRONMENT: SceneFeatures = SceneFeatures::ENVIRONMENT;
    const SMOOTH: SceneFeatures = SceneFeatures::SMOOTH_NORMALS;
    const SURFACES: SceneFeatures = SMOOTH.union(SceneFeatures::SPECULAR).union(SceneFeatures::TEXTURES);
    [
        Kernel::new::<{ AREA.0 }>(),
        Kernel::new::<{ AREA.union(SMOOTH).0 }>(),
        Kernel::new::<{ ENVIRONMENT.union(SMOOTH).union(SceneFeatures::TEXTURES).0 }>(),
        Kernel::new::<{ AREA.union(SURFACES).0 }>(),
        Kernel::new::<{ ENVIRONMENT.union(AREA).union(SURFACES).0 }>(),
        Kernel::new::<{ SceneFeatures::ALL.0 }>(),
    ]
};

/// The kernel for a scene.
pub fn kernel_for(scene: &Scene, choice: KernelChoice) -> Kernel {
    let serves = |kernel: &&Kernel| match choice {
        KernelChoice::Auto => kernel.features.contains(scene.features),
        KernelChoice::General => kernel.features == SceneFeatures::ALL,
    };
    let kernel = *KERNELS.iter().find(serves).expect("the last kernel has all features");
    Kernel {
        fetches_ahead: fetch::is_ahead(scene),
        ..kernel
    }
}
