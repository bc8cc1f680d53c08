//! Closed spheres whose walls shine and reflect everything, followed for 10,000 bounces: what a bounce loses or gains by
//! rounding adds up.

use crate::paths;
use crate::support::{self, Estimate, Stage};
use embrace::accel::Accel;
use embrace::bsdf::{Bsdf, Dielectric};
use embrace::integrator::{Roulette, Settings};
use embrace::light::{Emission, LightSampling};
use embrace::material::{Material, Scattering};
use embrace::math::{Rgb, Vec3};

support::for_each_backend!(but not brute:
    ten_thousand_bounces_off_white_walls_keep_their_energy
    ten_thousand_bounces_off_rough_metal_gain_none
);

const BOUNCES: u32 = 10_000;

/// What is asked: relative change of energy over all bounces.
const DRIFT: f64 = 1e-4;

fn shining_sphere(material: Material, radiance: f32) -> Stage {
    let emission = Emission {
        radiance: Rgb::splat(radiance),
        both_sides: true,
    };
    let eye = Vec3::new(0.2, -0.1, 0.3);
    Stage::new(support::camera(eye, Vec3::new(1.0, 0.1, -0.3), 90.0, [1, 1])).add_light(
        support::sphere(Vec3::ZERO, 1.0, 64, false),
        material,
        emission,
    )
}

fn metal(alpha: f32) -> Material {
    // A metal without real index reflects everything.
    support::opaque(Scattering::Conductor {
        eta: Rgb::splat(1e-6),
        k: Rgb::splat(1e3),
        alpha,
    })
}

/// The light of `paths` paths of [`BOUNCES`] bounces over what it is if nothing is lost, (n + 1) times the emission; and how
/// many paths were shorter. The emission is one whose f32 sums would be off by 1.5e-4, more than that of any other multiple of 0.001 below 3.
fn energy<A: Accel>(name: &str, material: Material, paths: u32) -> (Estimate, usize) {
    const RADIANCE: f32 = 0.823;
    let settings = Settings {
        max_depth: Some(BOUNCES),
        roulette: Roulette::Off,
        light_sampling: LightSampling::Power,
        seed: 4,
        ..Settings::default()
    };
    let traced = paths::trace::<A>(&shining_sphere(material, RADIANCE), &settings, paths);
    let whole = f64::from(RADIANCE) * f64::from(BOUNCES + 1);
    let energy: Vec<f64> = traced.iter().map(|(_, light)| f64::from(light.g) / whole).collect();
    let estimate = Estimate::of(&energy);
    let ended = traced
        .iter()
        .filter(|(rays, _)| rays.bounce != u64::from(BOUNCES))
        .count();
    println!(
        "{}: {name}: energy drifts by {:.2e} ± {:.1e}, {ended} of {paths} paths ended early",
        A::NAME,
        estimate.mean - 1.0,
        estimate.standard_error
    );
    (estimate, ended)
}

fn ten_thousand_bounces_off_white_walls_keep_their_energy<A: Accel>() {
    let mirror = support::opaque(Scattering::Mirror {
        reflectance: Rgb::WHITE,
    });
    // In a sphere, emitter samples by power and bounces have the same density: half of the light comes from each, without noise but
    // for that of the facets.
    for (name, material, paths) in [
        ("diffuse", support::diffuse(1.0), 64),
        ("mirror", mirror, 4),
        ("smooth metal", metal(0.0), 4),
    ] {
        let (energy, ended) = energy::<A>(name, material, paths);
        assert_eq!(ended, 0, "{}: {name}: paths that found a way out", A::NAME);
        assert!((energy.mean - 1.0).abs() < DRIFT, "{}: {name}: {energy:?}", A::NAME);
        assert!(energy.standard_error < 0.4 * DRIFT, "{}: {name}: {energy:?}", A::NAME);
    }
}

/// Rough metal loses what a second scattering would return, and ends paths that leave below the horizon.
fn ten_thousand_bounces_off_rough_metal_gain_none<A: Accel>() {
    for (name, alpha) in [("metal of 1e-4", 1e-4), ("metal of 0.3", 0.3)] {
        let (energy, _) = energy::<A>(name, metal(alpha), 8);
        assert!(energy.mean < 1.0 + DRIFT, "{}: {name}: {energy:?}", A::NAME);
    }
}

/// The factors on radiance of entering and leaving glass cancel: not in every pair of f32 numbers, but to an ulp. Over
/// 5,000 pairs that is 6e-4 at most, if rounding never once evens it out.
#[test]
fn radiance_through_ten_thousand_smooth_interfaces_keeps_its_value() {
    let factor = |eta: f32| {
        let glass = Bsdf::Dielectric(Dielectric { eta, alpha: 0.0 });
        let sample = glass.sample(Vec3::Z, 1f32.next_down(), [0.5; 2]).expect("transmission");
        assert!(sample.wi.z < 0.0);
        sample.weight.g
    };
    let (mut worst, mut above, mut all) = (0.0f64, 0, 0);
    for i in 1..4000 {
        let index = 1.0 + 1e-3 * i as f32;
        for ior in [index, 1.0 / index] {
            let factors = [factor(ior), factor(1.0 / ior)];
            for start in [1.0f32, 0.37, 0.911] {
                let mut throughput = start;
                for _ in 0..BOUNCES / 2 {
                    throughput = throughput * factors[0] * factors[1];
                }
                let drift = f64::from(throughput / start - 1.0).abs();
                worst = worst.max(drift);
                above += u32::from(drift > DRIFT);
                all += 1;
            }
        }
    }
    println!("drift through 10,000 interfaces: at most {worst:.1e}; above {DRIFT:e} for {above} of {all} indices");
    assert!(worst < 6e-4, "{worst}");
    assert!(f64::from(above) < 1e-3 * f64::from(all), "{above} of {all}");
}
