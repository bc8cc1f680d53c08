//! Embree and obvhs on the project's scenes: the same hits for every kind of ray, and the same images.
#![cfg(all(feature = "embree", feature = "obvhs"))]

mod support;

use embrace::accel::embree::Embree;
use embrace::accel::obvhs::Obvhs;
use embrace::accel::{Accel, BuildOptions, Hit, Ray};
use embrace::integrator::Settings;
use embrace::interaction::SurfaceInteraction;
use embrace::math::Frame;
use embrace::sampling::{Sampler, SamplerKind, warp};
use embrace::scene::{self, LoadOptions, Scene, SceneOptions};
use std::path::Path;
use support::{Estimate, Prepared, Random, Significance, assert_mean};

const SCENES: [&str; 6] = ["spheres", "cornell", "veach-mis", "glass", "furnace", "many-lights"];

/// Rays of each kind and scene.
const RAYS: usize = 1_000_000;

/// Largest share of rays on which the backends may disagree: rays through vertices and along edges, where Embree's
/// robust mode leaks and rounding decides. Found: docs/performance.md.
const BOUND: f64 = 2e-5;

fn load(name: &str) -> scene::SceneDesc {
    let file = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("scenes")
        .join(name)
        .join(format!("{name}.toml"));
    scene::load(
        &file,
        LoadOptions {
            strict: true,
            ..LoadOptions::default()
        },
    )
    .expect("the scenes have no faults")
}

/// The same point: the same triangle, or one at the same distance.
fn same_hit(a: Option<Hit>, b: Option<Hit>) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            (a.placement, a.triangle) == (b.placement, b.triangle) && (a.t - b.t).abs() <= 1e-4 * a.t
                || (a.t - b.t).abs() <= 1e-5 * a.t
        }
        _ => false,
    }
}

/// A point that a camera ray or a bounce from there has hit.
fn surface(scene: &Scene, embree: &Embree, ray: &Ray) -> Option<SurfaceInteraction> {
    SurfaceInteraction::new::<true>(&scene.geometry, ray, &embree.intersect(ray)?, true)
}

#[test]
fn camera_shadow_and_bounce_rays_hit_the_same_on_both_backends_in_every_scene() {
    for name in SCENES {
        let scene = Scene::build(load(name), SceneOptions::default()).expect("the scenes can be built");
        let embree = Embree::build(&scene.geometry, BuildOptions::default()).unwrap();
        let obvhs = Obvhs::build(&scene.geometry, BuildOptions::default()).unwrap();
        let [width, height] = scene.camera.resolution();
        let mut random = Random(7);
        let mut disagree = [0usize; 3];
        for i in 0..RAYS {
            let pixel = |n: u32, u: f32| ((u * n as f32) as u32).min(n - 1);
            let (x, y) = (pixel(width, random.unit()), pixel(height, random.unit()));
            let camera = scene.camera.ray(x, y, random.pair(), random.pair());
            disagree[0] += usize::from(!same_hit(embree.intersect(&camera), obvhs.intersect(&camera)));

            let Some(si) = surface(&scene, &embree, &camera) else {
                continue;
            };
            let direction = Frame::from_normal(si.ng).to_world(warp::cosine_hemisphere(random.pair()));
            let bounce = si.spawn_ray(direction, false);
            disagree[1] += usize::from(!same_hit(embree.intersect(&bounce), obvhs.intersect(&bounce)));

            // Shadow rays from where the bounce arrives, so that they start all over the scene.
            let Some(si) = surface(&scene, &embree, &bounce) else {
                continue;
            };
            let sampler = Sampler::new(SamplerKind::Independent, 3, x, y, i as u32);
            let Some(light) = scene.lights.sample(si.p, si.frame.n, &sampler) else {
                continue;
            };
            let shadow = match light.target {
                Some(target) => si.spawn_ray_to(target, light.wi.dot(si.ng) < 0.0),
                None => Some(si.spawn_ray(light.wi, light.wi.dot(si.ng) < 0.0)),
            };
            let Some(shadow) = shadow else { continue };
            disagree[2] += usize::from(embree.occluded(&shadow) != obvhs.occluded(&shadow));
            // A closest hit is the stricter question.
            disagree[2] += usize::from(embree.intersect(&shadow).is_some() != obvhs.intersect(&shadow).is_some());
        }
        println!("{name}: {disagree:?} of {RAYS} camera, bounce and shadow rays disagree");
        for (kind, count) in ["camera", "bounce", "shadow"].iter().zip(disagree) {
            assert!(
                count as f64 <= BOUND * RAYS as f64,
                "{name}: {count} of {RAYS} {kind} rays disagree"
            );
        }
    }
}

/// Paired: both backends draw the same numbers, so that a difference of their means is not hidden by noise.
#[test]
fn images_of_both_backends_have_the_same_mean_sample_by_sample() {
    for name in SCENES {
        let mut desc = load(name);
        let [width, height] = desc.camera.resolution;
        desc.camera.resolution = [96, 96 * height / width];
        let settings = Settings {
            max_depth: desc.max_depth,
            ..Settings::default()
        };
        let a = Prepared::<Embree>::new(desc.clone(), SceneOptions::default());
        let b = Prepared::<Obvhs>::new(desc, SceneOptions::default());
        let mut differing = 0;
        let differences: Vec<f64> = (0..16)
            .map(|seed| {
                let settings = Settings { seed, ..settings };
                let (a, b) = (a.image(&settings, 4), b.image(&settings, 4));
                differing += a.pixels.iter().zip(&b.pixels).filter(|(a, b)| a != b).count();
                let sum = |pixels: &[embrace::math::Rgb]| pixels.iter().map(|p| f64::from(p.luminance())).sum::<f64>();
                (sum(&b.pixels) - sum(&a.pixels)) / sum(&a.pixels)
            })
            .collect();
        let estimate = Estimate::of(&differences);
        println!(
            "{name}: relative difference {:.1e} ± {:.1e}",
            estimate.mean, estimate.standard_error
        );
        // Added to one, because a mean of zero has no relative rounding.
        let shifted = Estimate {
            mean: 1.0 + estimate.mean,
            ..estimate
        };
        assert_mean(
            &format!("{name}: obvhs over Embree"),
            shifted,
            1.0,
            Significance::TEST.split(SCENES.len()),
        );
        assert!(
            estimate.mean.abs() < 1e-3,
            "{name}: {estimate:?}, {differing} pixels differ"
        );
    }
}
