//! The choice of an emitter: that it is made with the probability it states, whatever the emitters and the receiver; that
//! nothing is left out; and that estimates with it have the right mean.

mod support;

use embrace::light::{
    Chosen, Emission, Emitter, EnvSampling, Environment, LightSampler, LightSamplerBuilder, LightSampling,
};
use embrace::math::{DVec3, Rgb, Vec3};
use rayon::ThreadPoolBuilder;
use std::f64::consts::PI;
use support::exact::{form_factor, grey_map};
use support::{Estimate, Random, Significance, assert_chi_square, assert_mean};

type Triangle = ([Vec3; 3], Emission);

fn direction(random: &mut Random) -> Vec3 {
    loop {
        let v = Vec3::from_array([(); 3].map(|()| 2.0 * random.unit() - 1.0));
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

fn within(random: &mut Random, size: f32) -> Vec3 {
    direction(random) * (size * random.unit())
}

/// How emitters lie about.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// A few of any size, some of which cut each other.
    Few,
    /// Closed balls of equal triangles: half of the triangles face away from anywhere.
    Balls,
    /// Clusters within clusters, powers over twelve decades, some emitting to both sides.
    Clusters,
    /// All in one plane, in one direction.
    Plane,
}

const KINDS: [Kind; 4] = [Kind::Few, Kind::Balls, Kind::Clusters, Kind::Plane];

fn triangles(kind: Kind, random: &mut Random) -> Vec<Triangle> {
    let emission = |radiance: f32, both_sides: bool| Emission {
        radiance: Rgb::splat(radiance),
        both_sides,
    };
    let mut all = Vec::new();
    match kind {
        Kind::Few => {
            for _ in 0..1 + random.below(12) {
                let a = within(random, 1.0);
                let corners = [a, a + within(random, 1.0), a + within(random, 1.0)];
                all.push((corners, emission(random.unit() + 0.01, random.below(3) == 0)));
            }
        }
        Kind::Balls => {
            for _ in 0..3 {
                let (centre, radius) = (within(random, 2.0), 0.05 + 0.3 * random.unit());
                let radiance = 10f32.powf(2.0 * random.unit());
                let mesh = support::sphere(centre, radius, 6, false);
                for t in 0..mesh.indices.len() {
                    all.push((mesh.triangle(t), emission(radiance, false)));
                }
            }
        }
        Kind::Clusters => {
            for _ in 0..12 {
                let (centre, size) = (within(random, 3.0), 10f32.powf(-3.0 * random.unit()));
                for _ in 0..20 {
                    let a = centre + within(random, size);
                    let side = 0.2 * size * random.unit() + 1e-3 * size;
                    let corners = [a, a + direction(random) * side, a + direction(random) * side];
                    all.push((
                        corners,
                        emission(10f32.powf(12.0 * random.unit() - 6.0), random.below(2) == 0),
                    ));
                }
            }
        }
        Kind::Plane => {
            let (n, height) = (direction(random), random.unit());
            let (u, v) = n.any_orthonormal_pair();
            for i in 0..100 {
                let a = n * height + u * (i % 10) as f32 + v * (i / 10) as f32;
                all.push(([a, a + u * 0.5, a + v * 0.5], emission(1.0, false)));
            }
        }
    }
    all
}

fn build(triangles: &[Triangle], environment: Option<Environment>) -> LightSampler {
    let mut builder = LightSamplerBuilder::default();
    for (corners, emission) in triangles {
        builder.push(*corners, *emission);
    }
    builder.build(environment, LightSampling::Contribution)
}

/// A sky with a sun.
fn sky() -> Environment {
    let map = grey_map(32, 16, |x, y| {
        if (x, y) == (9, 5) {
            300.0
        } else {
            0.2 + 0.1 * (y % 3) as f32
        }
    });
    Environment::from_map(&map, 1.0, 20.0, EnvSampling::Importance).expect("a valid map")
}

/// Receivers near, among, on and far from triangles; every third takes light from both sides.
fn receivers(triangles: &[Triangle], count: usize, random: &mut Random) -> Vec<(Vec3, Vec3)> {
    (0..count)
        .map(|i| {
            let [a, b, c] = triangles[random.below(triangles.len())].0;
            let p = match i % 5 {
                0 => within(random, 4.0),
                1 => (a + b + c) / 3.0,
                2 => a + (b - a) * 0.3 + (b - a).cross(c - a) * 1e-3,
                3 => a + within(random, 0.2),
                _ => direction(random) * 10f32.powf(12.0 * random.unit()),
            };
            let n = if i % 3 == 0 { Vec3::ZERO } else { direction(random) };
            (p, n)
        })
        .collect()
}

/// The share of the samples that draw nothing, by probabilities.
fn rest(lights: &LightSampler, count: usize, p: Vec3, n: Vec3) -> (Vec<f64>, f64) {
    let mut pmf: Vec<f64> = (0..count).map(|i| f64::from(lights.area_pmf(i as u32, p, n))).collect();
    pmf.push(f64::from(lights.environment_pmf(p, n)));
    let sum = pmf.iter().sum::<f64>();
    (pmf, 1.0 - sum)
}

#[test]
fn emitters_are_drawn_as_often_as_their_probabilities_say() {
    let draws = 40_000;
    let mut random = Random(1);
    let cases = KINDS.len() * 2 * 10;
    for kind in KINDS {
        for environment in [None, Some(sky())] {
            let triangles = triangles(kind, &mut random);
            let lights = build(&triangles, environment);
            for (p, n) in receivers(&triangles, 10, &mut random) {
                let (mut expected, none) = rest(&lights, triangles.len(), p, n);
                expected.push(none.max(0.0));
                let mut counts = vec![0; expected.len()];
                for _ in 0..draws {
                    let Chosen { emitter, pmf, .. } = lights.choose::<true, true>(p, n, random.bits());
                    let (cell, stated) = match emitter {
                        Emitter::Area(light) => (light as usize, lights.area_pmf(light, p, n)),
                        Emitter::Environment => (triangles.len(), lights.environment_pmf(p, n)),
                        Emitter::None => (triangles.len() + 1, 0.0),
                        Emitter::Punctual(_) | Emitter::Distant(_) => panic!("{emitter:?} of none"),
                    };
                    assert_eq!(pmf.to_bits(), stated.to_bits(), "{kind:?}: {emitter:?} from {p}, {n}");
                    counts[cell] += 1;
                }
                expected.iter_mut().for_each(|e| *e *= f64::from(draws));
                let name = format!("{kind:?} from {p}, {n}");
                assert_chi_square(&name, &counts, &expected, Significance::TEST.split(cases));
            }
        }
    }
}

#[test]
fn probabilities_sum_to_one_where_everything_can_contribute() {
    let mut random = Random(2);
    let mut worst = 0.0f64;
    for kind in KINDS {
        for environment in [None, Some(sky()), Some(Environment::Constant(Rgb::WHITE))] {
            let mut triangles = triangles(kind, &mut random);
            triangles
                .iter_mut()
                .for_each(|(_, emission)| emission.both_sides = true);
            let lights = build(&triangles, environment);
            for (p, _) in receivers(&triangles, 50, &mut random) {
                let (pmf, none) = rest(&lights, triangles.len(), p, Vec3::ZERO);
                worst = worst.max(none.abs());
                let zero = pmf[..triangles.len()].iter().position(|pmf| *pmf <= 0.0);
                assert_eq!(zero, None, "{kind:?}: {pmf:?}");
            }
        }
    }
    println!("sums off by {worst:.1e}");
    assert!(worst < 1e-6, "{worst}");
}

/// Light that arrives at `p` from the points of a triangle that are on the sides that count, by more than rounding.
fn contributes((corners, emission): &Triangle, p: Vec3, n: Vec3) -> bool {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    let normal = (b - a).cross(c - a).normalize();
    (0..66).any(|k| {
        let (i, j) = (k % 11, k / 11);
        let (u, v) = (f64::from(i) * 0.1, f64::from(j) * 0.1);
        let v = v.min(1.0 - u);
        let to = a + (b - a) * u + (c - a) * v - p.as_dvec3();
        let distance = to.length();
        let at_light = -to.dot(normal) / distance;
        let at_receiver = to.dot(n.as_dvec3()) / distance;
        (at_light > 1e-6 || emission.both_sides && at_light < -1e-6) && (at_receiver > 1e-6 || n == Vec3::ZERO)
    })
}

#[test]
fn every_emitter_that_can_contribute_may_be_drawn_and_most_others_are_not() {
    let mut random = Random(3);
    let (mut useful, mut useless, mut wasted) = (0, 0, 0.0);
    let mut receivers_seen = 0;
    for kind in KINDS {
        for _ in 0..5 {
            let triangles = triangles(kind, &mut random);
            let lights = build(&triangles, None);
            for (p, n) in receivers(&triangles, 50, &mut random) {
                receivers_seen += 1;
                for (i, triangle) in triangles.iter().enumerate() {
                    let pmf = lights.area_pmf(i as u32, p, n);
                    if contributes(triangle, p, n) {
                        useful += 1;
                        assert!(pmf > 0.0, "{kind:?}: triangle {i}, {triangle:?} from {p}, {n}");
                    } else {
                        useless += 1;
                        wasted += f64::from(pmf);
                    }
                }
            }
        }
    }
    println!(
        "{useful} useful, {useless} useless triangles; {:.4} of the samples wasted",
        wasted / f64::from(receivers_seen)
    );
    assert!(useful > 10_000 && useless > 10_000);
    assert!(wasted < 0.15 * f64::from(receivers_seen), "{wasted}");
}

/// What is left of a triangle above the plane through `p` with the normal `n`.
fn clipped(corners: &[Vec3; 3], p: Vec3, n: Vec3) -> Vec<Vec3> {
    let height = |c: &Vec3| (c.as_dvec3() - p.as_dvec3()).dot(n.as_dvec3());
    let mut polygon = Vec::new();
    for i in 0..3 {
        let (a, b) = (corners[i], corners[(i + 1) % 3]);
        let (ha, hb) = (height(&a), height(&b));
        if ha >= 0.0 {
            polygon.push(a);
        }
        if ha * hb < 0.0 {
            polygon.push((a.as_dvec3() + (b - a).as_dvec3() * (ha / (ha - hb))).as_vec3());
        }
    }
    polygon
}

/// Irradiance from the triangles without occlusion, by Lambert's formula.
fn irradiance(triangles: &[Triangle], p: Vec3, n: Vec3) -> f64 {
    let of = |(corners, emission): &Triangle| {
        let [a, b, c] = corners.map(|c| c.as_dvec3());
        let front = (p.as_dvec3() - a).dot((b - a).cross(c - a)) > 0.0;
        let polygon = clipped(corners, p, n);
        if polygon.len() < 3 || !(front || emission.both_sides) {
            return 0.0;
        }
        PI * f64::from(emission.radiance.r) * form_factor(p.as_dvec3(), n.as_dvec3(), &polygon)
    };
    triangles.iter().map(of).sum()
}

#[test]
fn the_mean_of_light_from_chosen_emitters_is_the_sum_over_all_of_them() {
    let mut random = Random(4);
    let replications = 64;
    let mut cases = Vec::new();
    for kind in KINDS {
        for _ in 0..4 {
            let triangles = triangles(kind, &mut random);
            let lights = build(&triangles, None);
            for _ in 0..4 {
                let (p, n) = (within(&mut random, 4.0), direction(&mut random));
                // A point nearly on an emitter gets its light from next to nothing of it; one that turns away, from the
                // tips that are above its horizon.
                let nearest = triangles
                    .iter()
                    .flat_map(|t| t.0)
                    .map(|c| c.distance(p))
                    .fold(f32::MAX, f32::min);
                let exact = irradiance(&triangles, p, n);
                if nearest < 0.1 || exact <= 0.05 * irradiance(&triangles, p, -n) {
                    continue;
                }
                let mean = |random: &mut Random| {
                    let draws = 2000;
                    let sum: f64 = (0..draws)
                        .map(|_| {
                            let Chosen { emitter, pmf, .. } = lights.choose::<true, false>(p, n, random.bits());
                            let Emitter::Area(light) = emitter else { return 0.0 };
                            lights
                                .sample_area(light, pmf, p, random.pair())
                                .map_or(0.0, |s| f64::from(s.radiance.r * s.wi.dot(n).max(0.0) / s.pdf_w))
                        })
                        .sum();
                    sum / f64::from(draws)
                };
                let means: Vec<f64> = (0..replications).map(|_| mean(&mut random)).collect();
                cases.push((format!("{kind:?} from {p}, {n}"), Estimate::of(&means), exact));
            }
        }
    }
    assert!(cases.len() > 30, "{}", cases.len());
    let mut error = 0.0f64;
    for (name, estimate, exact) in &cases {
        error = error.max(estimate.standard_error / exact);
        assert_mean(name, *estimate, *exact, Significance::TEST.split(cases.len()));
    }
    println!("{} cases, standard errors up to {error:.1e}", cases.len());
    assert!(error < 0.02, "{error}");
}

#[test]
fn scaling_everything_by_a_power_of_two_changes_no_bit_of_any_probability() {
    let mut random = Random(5);
    for kind in KINDS {
        let triangles = triangles(kind, &mut random);
        let lights = build(&triangles, None);
        for exponent in [-26, -3, 10, 26] {
            let scale = (exponent as f32).exp2();
            let scaled: Vec<Triangle> = triangles.iter().map(|(c, e)| (c.map(|c| c * scale), *e)).collect();
            let scaled = build(&scaled, None);
            for (p, n) in receivers(&triangles, 20, &mut random) {
                for i in 0..triangles.len() as u32 {
                    let pmf = lights.area_pmf(i, p, n);
                    assert_eq!(
                        pmf.to_bits(),
                        scaled.area_pmf(i, p * scale, n).to_bits(),
                        "{kind:?}, 2^{exponent}"
                    );
                }
            }
        }
    }
}

#[test]
fn the_environment_is_drawn_more_often_where_it_brings_more() {
    // A lamp overhead; the sun beside it. A surface that faces down gets neither lamp nor sun.
    let lamp = support::quad(Vec3::new(-0.5, 2.0, -0.5), Vec3::X, Vec3::Z);
    let triangles: Vec<Triangle> = (0..2).map(|t| (lamp.triangle(t), support::emission(20.0))).collect();
    let lights = build(&triangles, Some(sky()));
    let pmf = |y: f32, n: Vec3| f64::from(lights.environment_pmf(Vec3::Y * y, n));
    assert_eq!(pmf(0.0, Vec3::NEG_Y), 1.0, "nothing of the lamp is above this horizon");
    assert!(pmf(-20.0, Vec3::Y) > pmf(0.0, Vec3::Y) && pmf(0.0, Vec3::Y) > pmf(1.5, Vec3::Y));
    for n in [Vec3::Y, Vec3::X, Vec3::ZERO] {
        let pmf = pmf(1.5, n);
        assert!((0.05..=0.95).contains(&pmf), "{n}: {pmf}");
    }
    let none = build(&triangles, Some(Environment::Constant(Rgb::BLACK)));
    assert_eq!(none.environment_pmf(Vec3::ZERO, Vec3::Y), 0.0);
    let alone = build(&[], Some(sky()));
    assert_eq!(alone.environment_pmf(Vec3::ZERO, Vec3::Y), 1.0);
}

/// A ball of `n` small triangles that face any direction.
fn cloud(n: usize) -> Vec<Triangle> {
    let mut random = Random(6);
    (0..n)
        .map(|_| {
            let a = within(&mut random, 1.0);
            let corners = [a, a + within(&mut random, 1e-3), a + within(&mut random, 1e-3)];
            (corners, support::emission(random.unit()))
        })
        .collect()
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let triangles = cloud(30_000);
    let trees = [1, 2, 5].map(|threads| {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a thread pool");
        pool.install(|| build(&triangles, Some(sky())))
    });
    let mut random = Random(7);
    for (p, n) in receivers(&triangles, 8, &mut random) {
        for i in 0..triangles.len() as u32 {
            let [one, two, five] = [0, 1, 2].map(|k| trees[k].area_pmf(i, p, n).to_bits());
            assert!(one == two && one == five, "triangle {i}");
        }
    }
}

#[test]
fn a_million_emitters_make_a_tree_of_few_bytes_each() {
    let n = 1_000_000;
    let triangles = cloud(n);
    let started = std::time::Instant::now();
    let lights = build(&triangles, None);
    let bytes = lights.memory_bytes() as f64 / n as f64;
    println!("built in {:.2?}, {bytes:.1} bytes an emitter", started.elapsed());
    assert!(bytes < 160.0, "{bytes}");
    let mut random = Random(8);
    let (p, n) = (DVec3::new(0.3, 0.1, -0.2).as_vec3(), Vec3::Y);
    for _ in 0..1000 {
        let Chosen { emitter, pmf, .. } = lights.choose::<true, true>(p, n, random.bits());
        let Emitter::Area(light) = emitter else { continue };
        assert!(pmf > 0.0 && pmf.to_bits() == lights.area_pmf(light, p, n).to_bits());
    }
}
