//! Every setting of the estimator has the same mean; only the noise differs. The two that change the image on purpose,
//! `lighting = direct` and `max_depth`, agree with each other where they say the same.

mod support;

use embrace::accel::Accel;
use embrace::image::Image;
use embrace::integrator::{BounceSampling, Lighting, Roulette, Settings};
use embrace::light::{EnvSampling, LightSampling};
use embrace::math::Rgb;
use embrace::sampling::SamplerKind;
use embrace::scene::{EnvironmentDesc, SceneDesc, SceneOptions};
use std::sync::Arc;
use support::{Estimate, Prepared, Significance, assert_same_mean, load_scene};

/// Same length for all settings, because roulette can be off in some.
const MAX_DEPTH: u32 = 6;
const SPP: u32 = 16;
/// Replications of every setting.
const SEEDS: u64 = 24;

fn load(name: &str) -> SceneDesc {
    let mut desc = load_scene(name);
    let [width, height] = desc.camera.resolution;
    desc.camera.resolution = [48, 48 * height / width];
    desc
}

/// The article's scene with a sun that is only 30 times as bright as the mean of the sky, so that settings which find it
/// by chance alone do find it, and with no lobe narrower than they can hit.
fn spheres_under_a_dim_sun() -> SceneDesc {
    let mut desc = load("spheres");
    let Some(EnvironmentDesc::Map { image, .. }) = &mut desc.environment else {
        panic!("spheres has a map")
    };
    let mean = image.pixels.iter().map(|p| p.luminance()).sum::<f32>() / image.pixels.len() as f32;
    let dimmed = image.pixels.iter().map(|p| p.map(|c| c.min(30.0 * mean))).collect();
    *image = Arc::new(Image {
        width: image.width,
        height: image.height,
        pixels: dimmed,
    });
    for (_, material) in &mut desc.materials {
        if let embrace::material::Scattering::Conductor { alpha, .. } = &mut material.scattering {
            *alpha = alpha.max(0.2);
        }
    }
    desc
}

fn baseline() -> Settings {
    Settings {
        max_depth: Some(MAX_DEPTH),
        seed: 1,
        ..Settings::default()
    }
}

fn variants() -> Vec<(&'static str, Settings)> {
    // Seeds apart from the baseline's: the two estimates are then independent.
    let base = Settings { seed: 2, ..baseline() };
    let article = Settings {
        seed: 2,
        max_depth: Some(MAX_DEPTH),
        ..Settings::article()
    };
    vec![
        (
            "independent sampler",
            Settings {
                sampler: SamplerKind::Independent,
                ..base
            },
        ),
        (
            "uniform environment sampling",
            Settings {
                env_sampling: EnvSampling::Uniform,
                ..base
            },
        ),
        (
            "cosine bounces",
            Settings {
                bounce_sampling: BounceSampling::Cosine,
                ..base
            },
        ),
        (
            "uniform bounces",
            Settings {
                bounce_sampling: BounceSampling::Uniform,
                ..base
            },
        ),
        ("no MIS", Settings { mis: false, ..base }),
        (
            "no MIS, uniform bounces",
            Settings {
                mis: false,
                bounce_sampling: BounceSampling::Uniform,
                ..base
            },
        ),
        (
            "emitters by power",
            Settings {
                light_sampling: LightSampling::Power,
                ..base
            },
        ),
        (
            "no roulette",
            Settings {
                roulette: Roulette::Off,
                ..base
            },
        ),
        (
            "fixed roulette, 0.5",
            Settings {
                roulette: Roulette::Fixed(0.5),
                ..base
            },
        ),
        (
            "fixed roulette, 0.95",
            Settings {
                roulette: Roulette::Fixed(0.95),
                ..base
            },
        ),
        ("the article's preset", article),
        (
            "the article's preset, uniform environment",
            Settings {
                env_sampling: EnvSampling::Uniform,
                ..article
            },
        ),
    ]
}

fn means<A: Accel>(desc: &SceneDesc, settings: &Settings, seeds: u64) -> [Estimate; 3] {
    let options = SceneOptions {
        env_sampling: settings.env_sampling,
        light_sampling: settings.light_sampling,
        mis: settings.mis,
        ..SceneOptions::default()
    };
    Prepared::<A>::new(desc.clone(), options)
        .replicate(settings, SPP, 0..seeds)
        .channels
}

fn assert_settings_agree<A: Accel>(name: &str, desc: &SceneDesc, variants: &[(&str, Settings)]) {
    let expected = means::<A>(desc, &baseline(), SEEDS);
    let significance = Significance::TEST.split(3 * variants.len());
    for (variant, settings) in variants {
        let found = means::<A>(desc, settings, SEEDS);
        for (channel, (found, expected)) in found.into_iter().zip(expected).enumerate() {
            let name = format!("{name}, {variant}, {}, channel {channel}", A::NAME);
            assert_same_mean(&name, found, expected, significance);
        }
    }
}

fn every_setting_has_the_same_mean_in_the_cornell_box<A: Accel>() {
    assert_settings_agree::<A>("cornell", &load("cornell"), &variants());
}

fn every_setting_has_the_same_mean_on_the_spheres<A: Accel>() {
    assert_settings_agree::<A>("spheres under a dim sun", &spheres_under_a_dim_sun(), &variants());
}

/// Under the full sun only the settings that look for it have a variance that so few replications can tell.
fn settings_that_sample_the_sun_have_the_same_mean_under_it<A: Accel>() {
    let kept = ["independent sampler", "no roulette", "fixed roulette, 0.95"];
    let variants: Vec<_> = variants().into_iter().filter(|(name, _)| kept.contains(name)).collect();
    assert_settings_agree::<A>("spheres", &load("spheres"), &variants);
}

fn direct_lighting_is_a_path_of_one_scattering_event<A: Accel>() {
    for name in ["cornell", "spheres"] {
        let prepared = Prepared::<A>::new(load(name), SceneOptions::default());
        let direct = Settings {
            lighting: Lighting::Direct,
            ..baseline()
        };
        let one_event = Settings {
            max_depth: Some(1),
            ..baseline()
        };
        assert_eq!(prepared.image(&direct, 4), prepared.image(&one_event, 4), "{name}");
        let none = prepared.image(
            &Settings {
                max_depth: Some(0),
                ..baseline()
            },
            4,
        );
        assert!(
            none.pixels.iter().filter(|p| **p == Rgb::BLACK).count() > none.pixels.len() / 4,
            "{name}"
        );
    }
}

support::for_each_backend!(but not brute:
    every_setting_has_the_same_mean_in_the_cornell_box
    every_setting_has_the_same_mean_on_the_spheres
    settings_that_sample_the_sun_have_the_same_mean_under_it
    direct_lighting_is_a_path_of_one_scattering_event
);
