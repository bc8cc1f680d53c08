//! The ladder: which settings a study compares.

use crate::accel::{BuildQuality, Intersector};
use crate::integrator::{BounceSampling, Lighting, Roulette, Settings};
use crate::light::{EnvSampling, LightSampling};
use crate::sampling::SamplerKind;
use crate::scene::{EnvironmentDesc, SceneDesc};
use serde::Serialize;

use super::renderer::Backend;

/// Depth limit of the setting without roulette, where the scene has none that is lower.
const DEPTH_WITHOUT_ROULETTE: u32 = 8;

/// The question that a setting answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Group {
    /// What every group is compared with.
    Default,
    /// The article's results as an experiment.
    Article,
    /// How directions towards the environment are drawn.
    Environment,
    /// How bounces are drawn, and combined with emitter samples.
    Bounces,
    /// How paths end.
    Roulette,
    /// Which random numbers, and how emitters are chosen.
    Sampling,
    /// Knobs that trade accuracy of arithmetic and trees for time.
    Precision,
}

impl Group {
    /// All but the default, in the order of the report.
    pub const ALL: [Group; 6] = [
        Group::Article,
        Group::Environment,
        Group::Bounces,
        Group::Roulette,
        Group::Sampling,
        Group::Precision,
    ];

    /// A heading.
    pub fn title(self) -> &'static str {
        match self {
            Group::Default => "Default",
            Group::Article => "The article's estimator",
            Group::Environment => "Environment: uniform or by importance",
            Group::Bounces => "Bounces: uniform, cosine, BSDF, and multiple importance sampling",
            Group::Roulette => "Roulette: what it costs and saves",
            Group::Sampling => "Random numbers and the choice of emitters",
            Group::Precision => "Knobs of precision",
        }
    }
}

/// One way to render the scene.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Short name, also of files.
    pub id: &'static str,
    /// For people.
    pub title: String,
    /// What it is compared for.
    pub group: Group,
    /// What to give `embrace render` for it.
    pub arguments: String,
    /// The estimator, but for the seed.
    pub settings: Settings,
    /// How closely the backend looks.
    pub intersector: Intersector,
    /// How well the tree is built; `None`: by the length of the render.
    pub quality: Option<BuildQuality>,
    /// What traces the rays: an index into the backends of the study.
    pub backend: usize,
}

/// Which settings make sense for a scene, the default first. `backends[0]` is the one that all but one setting use.
pub fn ladder(desc: &SceneDesc, max_depth: Option<u32>, backends: &[Backend]) -> Vec<Setting> {
    let base = Settings {
        max_depth,
        ..Settings::default()
    };
    let article = Settings {
        max_depth,
        ..Settings::article()
    };
    let depth = max_depth.map_or(DEPTH_WITHOUT_ROULETTE, |depth| depth.min(DEPTH_WITHOUT_ROULETTE));
    let has_map = matches!(desc.environment, Some(EnvironmentDesc::Map { .. }));

    let mut ladder = Ladder::new(backends);
    ladder.add("default", "default", Group::Default, "", base);

    let direct = |env_sampling| Settings {
        lighting: Lighting::Direct,
        env_sampling,
        ..base
    };
    let uniform = EnvSampling::Uniform;
    if has_map {
        let (title, arguments) = (
            "direct light only, environment uniform",
            "--lighting direct --env-sampling uniform",
        );
        ladder.add("direct-uniform", title, Group::Article, arguments, direct(uniform));
    }
    let settings = direct(EnvSampling::Importance);
    ladder.add(
        "direct",
        "direct light only",
        Group::Article,
        "--lighting direct",
        settings,
    );
    if has_map {
        let (title, arguments) = (
            "article, environment uniform",
            "--preset article --env-sampling uniform",
        );
        let settings = Settings {
            env_sampling: uniform,
            ..article
        };
        ladder.add("article-uniform", title, Group::Article, arguments, settings);
    }
    ladder.add("article", "article", Group::Article, "--preset article", article);

    if has_map {
        let settings = Settings {
            env_sampling: uniform,
            ..base
        };
        let title = "environment uniform";
        ladder.add(
            "env-uniform",
            title,
            Group::Environment,
            "--env-sampling uniform",
            settings,
        );
    }

    for (id, title, arguments, bounce_sampling) in [
        (
            "bounce-cosine",
            "cosine bounces",
            "--bounce-sampling cosine",
            BounceSampling::Cosine,
        ),
        (
            "bounce-uniform",
            "uniform bounces",
            "--bounce-sampling uniform",
            BounceSampling::Uniform,
        ),
    ] {
        let settings = Settings {
            bounce_sampling,
            ..base
        };
        ladder.add(id, title, Group::Bounces, arguments, settings);
    }
    let (title, settings) = ("no multiple importance sampling", Settings { mis: false, ..base });
    ladder.add("mis-off", title, Group::Bounces, "--mis off", settings);

    let roulette = |roulette, max_depth| Settings {
        roulette,
        max_depth,
        ..base
    };
    let settings = roulette(Roulette::Fixed(0.8), max_depth);
    let title = "roulette with survival 0.8";
    ladder.add("roulette-fixed", title, Group::Roulette, "--roulette 0.8", settings);
    let title = format!("no roulette, at most {depth} scattering events");
    let arguments = format!("--roulette off --max-depth {depth}");
    let settings = roulette(Roulette::Off, Some(depth));
    ladder.add("roulette-off", &title, Group::Roulette, &arguments, settings);

    for (id, title, arguments, sampler) in [
        (
            "sampler-whole",
            "one Sobol sequence",
            "--sampler sobol-whole",
            SamplerKind::SobolWhole,
        ),
        (
            "sampler-independent",
            "independent random numbers",
            "--sampler independent",
            SamplerKind::Independent,
        ),
    ] {
        let settings = Settings { sampler, ..base };
        ladder.add(id, title, Group::Sampling, arguments, settings);
    }
    if has_choice_of_emitters(desc) {
        let settings = Settings {
            light_sampling: LightSampling::Power,
            ..base
        };
        let (title, arguments) = ("emitters by power", "--light-sampling power");
        ladder.add("lights-power", title, Group::Sampling, arguments, settings);
    }

    if backends[0].intersectors.contains(&Intersector::Fast) {
        let (title, arguments) = ("fast intersector", "--intersector fast");
        let setting = ladder.add("intersector-fast", title, Group::Precision, arguments, base);
        setting.intersector = Intersector::Fast;
    }
    for (id, name, quality) in [
        ("build-low", "low", BuildQuality::Low),
        ("build-medium", "medium", BuildQuality::Medium),
        ("build-high", "high", BuildQuality::High),
    ] {
        let (title, arguments) = (format!("tree of {name} quality"), format!("--build-quality {name}"));
        let setting = ladder.add(id, &title, Group::Precision, &arguments, base);
        setting.quality = Some(quality);
    }
    for (index, backend) in backends.iter().enumerate().skip(1) {
        ladder.common.clear();
        let (title, arguments) = (
            format!("backend {}", backend.name),
            format!("--backend {}", backend.name),
        );
        let setting = ladder.add(backend.setting, &title, Group::Precision, &arguments, base);
        setting.backend = index;
    }
    ladder.settings
}

/// Whether there are emitters besides the environment, and more than one to choose from.
fn has_choice_of_emitters(desc: &SceneDesc) -> bool {
    let lamps = || desc.objects.iter().filter(|object| object.emission.is_some());
    let triangles: usize = lamps().map(|object| desc.meshes[object.mesh].indices.len()).sum();
    let lights = triangles + desc.lights.len();
    lights > 0 && lights + usize::from(desc.environment.is_some()) > 1
}

struct Ladder {
    /// Arguments of every setting.
    common: String,
    settings: Vec<Setting>,
}

impl Ladder {
    fn new(backends: &[Backend]) -> Ladder {
        // Nothing to say where the study's backend is what `embrace render` takes anyway.
        let common = if backends[0].is_default {
            String::new()
        } else {
            format!("--backend {}", backends[0].name)
        };
        Ladder {
            common,
            settings: Vec::new(),
        }
    }

    fn add(
        &mut self,
        id: &'static str,
        title: &str,
        group: Group,
        arguments: &str,
        settings: Settings,
    ) -> &mut Setting {
        self.settings.push(Setting {
            id,
            title: title.into(),
            group,
            arguments: format!("{} {arguments}", self.common).trim().into(),
            settings,
            intersector: Intersector::Robust,
            quality: None,
            backend: 0,
        });
        self.settings.last_mut().expect("one was just added")
    }
}
