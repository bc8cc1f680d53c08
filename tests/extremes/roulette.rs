//! Roulette: the same mean at any probability and down to throughputs of 1e-30, and paths that end.

use crate::paths;
use crate::support::{self, Significance, Stage};
use embrace::accel::Accel;
use embrace::integrator::{Roulette, Settings};
use embrace::material::{Material, Scattering};
use embrace::math::{Rgb, Vec3};
use embrace::sampling::SamplerKind;
use std::process::Command;

support::for_each_backend!(but not brute:
    roulette_of_any_probability_has_the_mean_of_none
    light_of_1e30_behind_five_bounces_of_1e_minus_6_keeps_its_mean
    light_in_nested_glass_keeps_its_mean
    no_path_is_longer_than_its_survival_allows
    paths_end_at_once_where_nothing_is_reflected
);

/// Independent numbers, so that the spread of one render's samples is that of its mean as well.
fn settings(roulette: Roulette, max_depth: Option<u32>, seed: u64) -> Settings {
    Settings {
        roulette,
        max_depth,
        sampler: SamplerKind::Independent,
        seed,
        ..Settings::default()
    }
}

fn mirror(reflectance: f32) -> Material {
    support::opaque(Scattering::Mirror {
        reflectance: Rgb::splat(reflectance),
    })
}

/// A closed box, seen from inside by one pixel.
fn inside_box(material: Material, radiance: f32) -> Stage {
    let eye = Vec3::new(0.2, 0.3, 0.4);
    Stage::new(support::camera(eye, Vec3::new(1.0, 0.1, -0.3), 90.0, [1, 1])).add_light(
        support::cuboid(Vec3::splat(-1.0), Vec3::new(1.0, 2.0, 1.5), true),
        material,
        support::emission(radiance),
    )
}

/// Radiance is the sum of the powers of the albedo up to the depth limit. The limit falls with the probability, so that a
/// thousand paths are left at the end: the mean of fewer is not normal.
fn roulette_of_any_probability_has_the_mean_of_none<A: Accel>() {
    let albedo = 0.7f32;
    let furnace = inside_box(support::diffuse(albedo), 1.0).prepare::<A>(&Settings::default());
    let cases = [
        (Roulette::Off, 8),
        (Roulette::Throughput, 8),
        (Roulette::Throughput, 24),
        (Roulette::Fixed(0.999_999), 8),
        (Roulette::Fixed(0.999), 8),
        (Roulette::Fixed(0.9), 8),
        (Roulette::Fixed(0.5), 6),
        (Roulette::Fixed(0.25), 3),
        (Roulette::Fixed(0.05), 1),
    ];
    for (seed, (roulette, depth)) in (1..).zip(cases) {
        let expected: f64 = (0..=depth).map(|k| f64::from(albedo).powi(k)).sum();
        let settings = settings(roulette, Some(depth as u32), seed);
        let found = furnace.mean(&settings, 1024, 0..32);
        println!(
            "{}: {roulette:?} to depth {depth}: {:.4e} ± {:.1e} off",
            A::NAME,
            found.mean / expected - 1.0,
            found.standard_error / expected
        );
        let name = format!("{}: {roulette:?}, depth {depth}", A::NAME);
        support::assert_mean(&name, found, expected, Significance::TEST.split(cases.len()));
    }
}

/// A ray that zigzags between two dark mirrors and meets a blinding wall after five reflections: 1e-6⁵ · 1e30 = 1.
fn light_of_1e30_behind_five_bounces_of_1e_minus_6_keeps_its_mean<A: Accel>() {
    let (eye, wide) = (Vec3::new(0.0, 0.5, 0.0), Vec3::new(6.0, 0.0, 0.0));
    let corridor = Stage::new(support::probe(eye, eye + Vec3::new(1.0, -1.0, 0.0)))
        .add(
            support::quad(Vec3::new(-0.3, 0.0, -3.0), Vec3::Z * 6.0, wide),
            mirror(1e-6),
        )
        .add(
            support::quad(Vec3::new(-0.3, 1.0, -3.0), Vec3::Z * 6.0, wide),
            mirror(1e-6),
        )
        .add_light(
            support::quad(Vec3::new(5.2, -1.0, -3.0), Vec3::Z * 6.0, Vec3::Y * 3.0),
            support::diffuse(0.0),
            support::emission(1e30),
        )
        .prepare::<A>(&Settings::default());
    let expected = f64::from(1e-6f32).powi(5) * f64::from(1e30f32);
    let cases = [
        (Roulette::Off, 16),
        (Roulette::Throughput, 16_384),
        (Roulette::Fixed(0.25), 16_384),
        (Roulette::Fixed(0.5), 2048),
        (Roulette::Fixed(0.9), 512),
        (Roulette::Fixed(0.999), 512),
    ];
    for (seed, (roulette, spp)) in (1..).zip(cases) {
        let found = corridor.mean(&settings(roulette, Some(8), seed), spp, 0..16);
        println!(
            "{}: {roulette:?}: {:.5} ± {:.1e}",
            A::NAME,
            found.mean,
            found.standard_error
        );
        let name = format!("{}: 1e30 behind five bounces, {roulette:?}", A::NAME);
        support::assert_mean(&name, found, expected, Significance::TEST.split(cases.len()));
        assert!(found.standard_error < 0.1 * expected, "{name}: {found:?} shows nothing");
    }
}

/// Radiance inside glass in a world of radiance 1 is the square of its index; inside five boxes in one another, its fifth
/// power, with all that bounces between them.
fn light_in_nested_glass_keeps_its_mean<A: Accel>() {
    let ior = 1.5f32;
    let mut stage =
        Stage::new(support::probe(Vec3::new(0.1, 0.03, 0.0), Vec3::new(1.0, 0.03, 0.0))).lit_by_constant(1.0);
    for i in 1..=5 {
        let corner = Vec3::splat(i as f32);
        let glass = support::opaque(Scattering::Dielectric { ior, alpha: 0.0 });
        stage = stage.add(support::cuboid(-corner, corner, false), glass);
    }
    let nested = stage.prepare::<A>(&Settings::default());
    let expected = f64::from(ior).powi(10);
    // What is left after 64 events is reflected 59 times: 0.04 to that power.
    for (seed, roulette, depth) in [
        (1, Roulette::Off, Some(64)),
        (2, Roulette::Throughput, None),
        (3, Roulette::Fixed(0.9), None),
        (4, Roulette::Fixed(0.7), None),
    ] {
        let found = nested.mean(&settings(roulette, depth, seed), 2048, 0..16);
        println!(
            "{}: {roulette:?}: {:.4e} ± {:.1e} off",
            A::NAME,
            found.mean / expected - 1.0,
            found.standard_error / expected
        );
        let name = format!("{}: five glass boxes, {roulette:?}", A::NAME);
        support::assert_mean(&name, found, expected, Significance::TEST.split(4));
    }
}

/// Bounces of each of `paths` paths.
fn lengths<A: Accel>(stage: &Stage, settings: &Settings, paths: u32) -> Vec<u64> {
    let paths = paths::trace::<A>(stage, settings, paths);
    paths.iter().map(|(rays, _)| rays.bounce).collect()
}

/// Where nothing is lost, a path survives its first three events, then each with probability 0.95: it has more than n
/// bounces with probability 0.95ⁿ⁻².
fn no_path_is_longer_than_its_survival_allows<A: Accel>() {
    const PATHS: u32 = 20_000;
    const SIGNIFICANCE: f64 = 1e-6;
    let n = f64::from(PATHS);
    let longest_allowed = 2.0 + (n / SIGNIFICANCE).ln() / -0.95f64.ln();
    // All of n paths are shorter than m with probability (1 − 0.95ᵐ⁻³)ⁿ.
    let longest_expected = 3.0 + (n / -SIGNIFICANCE.ln()).ln() / -0.95f64.ln();
    let glass = support::opaque(Scattering::Dielectric { ior: 1.5, alpha: 0.0 });
    let white = inside_box(support::diffuse(1.0), 0.0);
    let with_glass = white
        .clone()
        .add(support::sphere(Vec3::new(0.9, 0.1, -0.2), 0.09, 8, false), glass);
    for (seed, name, stage) in [
        (1, "white", white),
        (2, "mirrors", inside_box(mirror(1.0), 0.0)),
        (3, "glass", with_glass),
    ] {
        let lengths = lengths::<A>(&stage, &settings(Roulette::Throughput, None, seed), PATHS);
        let longest = *lengths.iter().max().expect("paths");
        let mean = lengths.iter().sum::<u64>() as f64 / n;
        println!(
            "{}: {name}: mean of {mean:.2} bounces, at most {longest} of {longest_allowed:.0}",
            A::NAME
        );
        assert!(longest as f64 <= longest_allowed, "{}: {name}: {longest}", A::NAME);
        assert!(
            longest as f64 >= longest_expected,
            "{}: {name}: only {longest}",
            A::NAME
        );
        // 3 bounces, and 0.95 / 0.05 more with a variance of 0.95 / 0.05².
        let error = (0.95 / 0.0025 / n).sqrt();
        assert!((mean - 22.0).abs() < 5.0 * error, "{}: {name}: mean of {mean}", A::NAME);
    }
}

fn paths_end_at_once_where_nothing_is_reflected<A: Accel>() {
    // The square of 1e-30 is zero in f32: the second bounce is not made.
    for (name, material, bounces) in [
        ("diffuse", support::diffuse(0.0), 0),
        ("mirror", mirror(0.0), 0),
        ("mirror of 1e-30", mirror(1e-30), 1),
    ] {
        for roulette in [Roulette::Throughput, Roulette::Fixed(0.999), Roulette::Off] {
            let lengths = lengths::<A>(
                &inside_box(material.clone(), 1.0),
                &settings(roulette, Some(1000), 1),
                100,
            );
            assert_eq!(
                lengths.iter().max(),
                Some(&bounces),
                "{}: {name}, {roulette:?}",
                A::NAME
            );
        }
    }
}

/// At the command line alone: in the library any probability is taken for what it is.
#[test]
fn probabilities_that_are_none_are_refused() {
    for p in ["0", "-0.5", "1", "1.5", "nan", "inf", "1e-60", "0.999999999"] {
        let output = Command::new(env!("CARGO_BIN_EXE_embrace"))
            .args(["render", "scene.toml", "-o", "out.exr", &format!("--roulette={p}")])
            .output()
            .expect("the program runs");
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{p}: {message}");
        assert!(message.contains("above 0 and below 1"), "{p}: {message}");
    }
}
