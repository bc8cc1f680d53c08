//! Every sampling routine against its density, by counts: chi-square tests whose cells integrate the density
//! numerically. Then what makes a density and a value worth having: they agree between sampling and evaluation, are
//! finite for the worst inputs, are reciprocal, and reflect no more than arrives.

mod support;

use embrace::bsdf::{
    Bsdf, CoatTable, CoatedDiffuse, Conductor, Dielectric, Diffuse, Distribution, Plastic, PrincipledBsdf, RoughGlass,
    RoughMetal,
};
use embrace::light::{Emission, EnvSampling, Environment, LightSamplerBuilder, LightSampling};
use embrace::math::{DVec3, Rgb, Vec3};
use embrace::sampling::{Sampler, SamplerKind, warp};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use support::exact::{grey_map, map_direction};
use support::{Random, Significance, assert_chi_square, for_each_in_parallel, integrate};

/// Cells of the unit interval or square that a coordinate in [0, 1) falls into.
fn cell(c: f64, n: usize) -> usize {
    ((c * n as f64) as usize).min(n - 1)
}

/// Draws points that are uniform on the unit square if `point` maps them so, and tests that they are.
fn assert_uniform(name: &str, tests: usize, mut point: impl FnMut(&mut Random) -> [f64; 2]) {
    let (n, side) = (400_000u32, 16);
    let mut random = Random(11);
    let mut counts = vec![0; side * side];
    for _ in 0..n {
        let [x, y] = point(&mut random);
        counts[cell(y, side) * side + cell(x, side)] += 1;
    }
    let expected = vec![f64::from(n) / (side * side) as f64; side * side];
    assert_chi_square(name, &counts, &expected, Significance::TEST.split(tests));
}

fn turn(x: f32, y: f32) -> f64 {
    (f64::from(y).atan2(x.into()) / TAU).rem_euclid(1.0)
}

/// Each distribution's own cumulative functions turn its points back into uniform ones.
#[test]
fn warps_have_the_densities_they_state() {
    assert_uniform("disk", 6, |r| {
        let [x, y] = warp::disk(r.pair());
        [f64::from(x * x + y * y), turn(x, y)]
    });
    assert_uniform("cosine hemisphere", 6, |r| {
        let d = warp::cosine_hemisphere(r.pair());
        [f64::from(d.z * d.z), turn(d.x, d.y)]
    });
    assert_uniform("uniform hemisphere", 6, |r| {
        let d = warp::uniform_hemisphere(r.pair());
        [d.z.into(), turn(d.x, d.y)]
    });
    assert_uniform("uniform sphere", 6, |r| {
        let d = warp::uniform_sphere(r.pair());
        [0.5 * f64::from(d.z) + 0.5, turn(d.x, d.y)]
    });
    assert_uniform("triangle", 6, |r| {
        let [b, c] = warp::triangle(r.pair()).map(f64::from);
        // P(B < b) = 1 - (1 - b)², and c is uniform below 1 - b.
        [1.0 - (1.0 - b).powi(2), c / (1.0 - b)]
    });
    assert_uniform("tent", 6, |r| {
        let [x, y] = r.pair().map(|u| {
            let x = f64::from(warp::tent(u));
            0.5 + x - 0.5 * x * x.abs()
        });
        [x, y]
    });
}

/// Image coordinates of a direction by the documented orientation, in f64.
fn lookup(d: DVec3) -> [f64; 2] {
    [(d.x.atan2(-d.z) / TAU).rem_euclid(1.0), d.x.hypot(d.z).atan2(d.y) / PI]
}

#[test]
fn environment_maps_are_sampled_with_the_density_they_state_and_it_integrates_to_one() {
    let random: Vec<f32> = {
        let mut r = Random(3);
        (0..128).map(|_| r.unit()).collect()
    };
    let one_hot =
        |x: u32, y: u32, hot: f32, rest: f32| grey_map(16, 8, move |i, j| if (i, j) == (x, y) { hot } else { rest });
    let maps = [
        (
            "smooth",
            grey_map(16, 8, |x, y| 2.0 + (x as f32 * 0.39).sin() + (y as f32 * 0.7).cos()),
            0.0,
        ),
        ("random", grey_map(16, 8, |x, y| random[(y * 16 + x) as usize]), 0.0),
        ("hot texel", one_hot(5, 3, 1e6, 1.0), 0.0),
        ("one texel", grey_map(1, 1, |_, _| 2.0), 0.0),
        ("two texels", grey_map(2, 1, |x, _| 1.0 + x as f32), 0.0),
        ("black but for one texel", one_hot(15, 4, 1.0, 0.0), 0.0),
        ("north pole", one_hot(2, 0, 1e3, 1.0), 0.0),
        ("south pole", one_hot(9, 7, 1.0, 0.0), 0.0),
        ("rotated", grey_map(16, 8, |x, y| random[(y * 16 + x) as usize]), 33.0),
    ];
    let tests = 3 * maps.len();
    for_each_in_parallel(&maps, |(name, image, rotation)| {
        for sampling in [EnvSampling::Importance, EnvSampling::Compensated, EnvSampling::Uniform] {
            let name = format!("{name}, {sampling:?}");
            let environment = Environment::from_map(image, 1.0, *rotation, sampling).expect("a valid map");
            // Half texels of a 16 x 8 map: the density has its kinks on their borders, unless rotated.
            let (columns, rows, n) = (32usize, 16usize, 500_000u32);
            let density = |u: f64, v: f64| {
                let (_, pdf_w) = environment.eval(map_direction(u, v).as_vec3());
                f64::from(pdf_w) * 2.0 * PI * PI * (PI * v).sin()
            };
            let expected: Vec<f64> = (0..columns * rows)
                .map(|k| {
                    let [x, y] = [(k % columns) as f64, (k / columns) as f64];
                    let [w, h] = [columns as f64, rows as f64];
                    f64::from(n) * integrate(&density, [x / w, (x + 1.0) / w], [y / h, (y + 1.0) / h], 1e-8)
                })
                .collect();
            let total = expected.iter().sum::<f64>() / f64::from(n);
            assert!((total - 1.0).abs() < 1e-4, "{name}: the density integrates to {total}");
            let mut random = Random(21);
            let mut counts = vec![0; columns * rows];
            let (mut pairs, mut pairs_of_radiance) = (Vec::new(), Vec::new());
            for _ in 0..n {
                let point = environment.sample(environment.choose_texel(random.bits()), random.pair());
                let (wi, (radiance, pdf_w)) = (point.wi, environment.lookup(&point));
                assert!((wi.length() - 1.0).abs() < 1e-5 && pdf_w > 0.0, "{name}: {wi} {pdf_w}");
                let (seen, seen_pdf_w) = environment.eval(wi);
                // Both interpolate between texels; the place differs by the rounding of two angles.
                let sin_theta = wi.x.hypot(wi.z);
                pairs.push([pdf_w * sin_theta, seen_pdf_w * sin_theta]);
                pairs_of_radiance.push([radiance.g, seen.g]);
                let [u, v] = lookup(wi.as_dvec3());
                counts[cell(v, rows) * columns + cell(u, columns)] += 1;
            }
            assert_chi_square(&name, &counts, &pool_ridges(&expected), Significance::TEST.split(tests));
            assert_equal_but_for_rounding(&format!("{name}, density"), &pairs);
            assert_equal_but_for_rounding(&format!("{name}, radiance"), &pairs_of_radiance);
        }
    });
}

#[test]
fn a_compensated_map_draws_what_is_brighter_than_the_mean_and_nothing_else() {
    // Luminance 1 below the horizon, 3 above: the mean is 2.
    let map = grey_map(16, 8, |_, y| if y < 4 { 3.0 } else { 1.0 });
    let environment = Environment::from_map(&map, 1.0, 0.0, EnvSampling::Compensated).expect("a valid map");
    let pdf_w = |v: f64| environment.eval(map_direction(0.3, v).as_vec3()).1;
    // Between the middles of the two rows at the horizon, the density falls as radiance does.
    assert!((1..=7).all(|k| pdf_w(f64::from(k) / 16.0) > 0.0));
    assert!((9..=15).all(|k| pdf_w(f64::from(k) / 16.0) == 0.0));
    let flat = grey_map(16, 8, |_, _| 2.0);
    let [compensated, plain] = [EnvSampling::Compensated, EnvSampling::Importance].map(|sampling| {
        let environment = Environment::from_map(&flat, 1.0, 0.0, sampling).expect("a valid map");
        environment.eval(Vec3::X).1
    });
    assert_eq!(compensated, plain, "of one colour, nothing is left to bounces");
}

/// Panics if the two numbers of a pair differ by more than 1e-3 of the larger and 1e-4 of the largest of all.
fn assert_equal_but_for_rounding(name: &str, pairs: &[[f32; 2]]) {
    let largest = pairs.iter().flatten().copied().fold(0.0, f32::max);
    for [a, b] in pairs {
        assert!(
            (a - b).abs() <= 1e-3 * a.max(*b) + 1e-4 * largest,
            "{name}: {a} and {b} of at most {largest}"
        );
    }
}

/// Rounding moves a point by 1e-7 across the border of a support: cells that expect nothing get a trace, which the chi
/// square test pools.
fn pool_ridges(expected: &[f64]) -> Vec<f64> {
    expected.iter().map(|e| e.max(1e-4)).collect()
}

#[test]
fn the_mean_sample_of_a_hot_texel_is_its_lookup_centre() {
    for (x, y) in [(5u32, 3u32), (0, 4), (31, 8)] {
        let image = grey_map(32, 16, |i, j| if (i, j) == (x, y) { 1.0 } else { 0.0 });
        let environment = Environment::from_map(&image, 1.0, 0.0, EnvSampling::Importance).expect("a valid map");
        let centre = [(f64::from(x) + 0.5) / 32.0, (f64::from(y) + 0.5) / 16.0];
        let (at_centre, _) = environment.eval(map_direction(centre[0], centre[1]).as_vec3());
        assert!(
            (at_centre.r - 1.0).abs() < 1e-4,
            "texel ({x}, {y}): {at_centre:?} at its centre"
        );
        let mut random = Random(4);
        let n = 100_000;
        let mut sum = [0.0; 2];
        for _ in 0..n {
            let wi = environment
                .sample(environment.choose_texel(random.bits()), random.pair())
                .wi;
            let [u, v] = lookup(wi.as_dvec3());
            sum[0] += (u - centre[0] + 0.5).rem_euclid(1.0) - 0.5;
            sum[1] += v - centre[1];
        }
        // In texels; a tent has variance 1/6. Six standard errors are allowed.
        let bound = 6.0 * (1.0f64 / 6.0 / f64::from(n)).sqrt();
        let shift = [sum[0] * 32.0 / f64::from(n), sum[1] * 16.0 / f64::from(n)];
        assert!(
            shift.iter().all(|s| s.abs() < bound),
            "texel ({x}, {y}): {shift:?} texels, bound {bound}"
        );
    }
}

#[test]
fn environment_maps_are_oriented_as_documented() {
    // Four columns, centred at u = 1/8, 3/8, 5/8, 7/8; the top row is brighter by 10.
    let image = grey_map(4, 2, |x, y| (x + 1) as f32 + if y == 0 { 10.0 } else { 0.0 });
    let at = |rotation: f64, d: Vec3| {
        let environment = Environment::from_map(&image, 1.0, rotation, EnvSampling::Importance).expect("a valid map");
        environment.eval(d).0.r
    };
    let s = std::f32::consts::FRAC_1_SQRT_2;
    // Looking down a little: the middle of the bottom row is at v = 3/4.
    let towards = |x: f32, z: f32| Vec3::new(x * s, -s, z * s);
    // u = 0 is -Z, between the last and the first column; u = 1/4 is +X; then +Z and -X.
    for (d, expected) in [
        (towards(0.0, -1.0), 2.5),
        (towards(1.0, 0.0), 1.5),
        (towards(0.0, 1.0), 2.5),
        (towards(-1.0, 0.0), 3.5),
        (towards(s, -s), 1.0),
        (towards(s, s), 2.0),
        (towards(-s, s), 3.0),
        (towards(-s, -s), 4.0),
    ] {
        assert!(
            (at(0.0, d) - expected).abs() < 1e-4,
            "{d}: {} for {expected}",
            at(0.0, d)
        );
        // A right-handed turn about +Y takes +X to -Z.
        let turned = Vec3::new(d.z, d.y, -d.x);
        assert!(
            (at(90.0, turned) - expected).abs() < 1e-4,
            "{turned}, turned: {}",
            at(90.0, turned)
        );
    }
    assert!(at(0.0, Vec3::Y) > 10.0 && at(0.0, Vec3::NEG_Y) < 5.0, "row 0 is not up");
}

#[test]
fn area_lights_are_drawn_as_often_as_they_say_and_with_the_density_they_state() {
    let lights = [
        // Small and bright; large and dim, both sides, seen from behind; one that turns its back.
        ([[0.0, 2.0, 0.0], [0.2, 2.0, 0.0], [0.0, 2.0, 0.3]], 50.0, false),
        ([[2.0, -1.0, -1.0], [2.0, 2.0, -1.0], [2.5, -1.0, 2.0]], 0.7, true),
        ([[-2.0, -1.0, -1.0], [-2.0, -1.0, 1.0], [-2.0, 1.0, 0.0]], 2.0, false),
        ([[-1.0, -1.0, -3.0], [1.0, -1.0, -3.0], [0.0, 1.0, -3.0]], 1.0, false),
    ];
    let lights = lights.map(|(corners, radiance, both_sides): ([[f32; 3]; 3], f32, bool)| {
        let emission = Emission {
            radiance: Rgb::splat(radiance),
            both_sides,
        };
        (corners.map(Vec3::from), emission)
    });
    let mut builder = LightSamplerBuilder::default();
    lights
        .iter()
        .for_each(|(corners, emission)| builder.push(*corners, *emission));
    let sampler = builder.build(None, LightSampling::Contribution);
    let area = |c: &[Vec3; 3]| 0.5 * (c[1] - c[0]).as_dvec3().cross((c[2] - c[0]).as_dvec3()).length();
    let p = Vec3::new(0.1, 0.2, 0.3);
    let pmf: Vec<f64> = (0..4).map(|i| f64::from(sampler.area_pmf(i, p, Vec3::ZERO))).collect();
    assert!((pmf.iter().sum::<f64>() - 1.0).abs() < 1e-6, "{pmf:?}");

    // Cells: the triangles, each in 8 x 8 cells of equal area, then what gives no sample.
    let (n, side) = (400_000u32, 8usize);
    let mut counts = vec![0; lights.len() * side * side + 1];
    let mut expected = vec![0.0; counts.len()];
    let mut visible = [false; 4];
    for (i, (c, emission)) in lights.iter().enumerate() {
        let front = (c[1] - c[0]).cross(c[2] - c[0]).dot(p - c[0]) > 0.0;
        visible[i] = front || emission.both_sides;
        let mass = f64::from(n) * pmf[i];
        if visible[i] {
            expected[i * side * side..(i + 1) * side * side].fill(mass / (side * side) as f64);
        } else {
            assert_eq!(pmf[i], 0.0, "a triangle that turns its back cannot contribute");
        }
    }
    assert_eq!(visible.iter().filter(|v| **v).count(), 3, "{visible:?}");
    for sample in 0..n {
        let numbers = Sampler::new(SamplerKind::Independent, 8, 0, 0, sample);
        let Some(light) = sampler.sample(p, Vec3::ZERO, &numbers) else {
            *counts.last_mut().expect("not empty") += 1;
            continue;
        };
        let point = light.target.expect("an area light has a place").as_dvec3();
        assert!(((point - p.as_dvec3()).normalize().as_vec3() - light.wi).length() < 1e-4);
        let (i, [b, c]) = (0..lights.len())
            .filter_map(|i| Some((i, barycentric(lights[i].0, point)?)))
            .next()
            .expect("the point is on a triangle");
        let x = cell(1.0 - (1.0 - b).powi(2), side);
        let y = cell(c / (1.0 - b), side);
        counts[(i * side + y) * side + x] += 1;

        let corners = lights[i].0;
        let normal = (corners[1] - corners[0])
            .as_dvec3()
            .cross((corners[2] - corners[0]).as_dvec3())
            .normalize();
        let (d2, cos) = ((point - p.as_dvec3()).length_squared(), normal.dot(light.wi.as_dvec3()));
        let by_hand = pmf[i] / area(&corners) * d2 / cos.abs();
        let stated = f64::from(sampler.area_pdf_w(i as u32, p, Vec3::ZERO, d2 as f32, cos as f32));
        for (what, pdf) in [("stated", stated), ("sampled", f64::from(light.pdf_w))] {
            assert!(
                (pdf / by_hand - 1.0).abs() < 1e-3,
                "triangle {i}: {what} {pdf} for {by_hand}"
            );
        }
        assert_eq!(light.radiance, lights[i].1.radiance);
    }
    assert_chi_square("area lights", &counts, &expected, Significance::TEST);
}

/// Weights of the second and third corner if the point is on the triangle, up to shadow-ray offsets.
fn barycentric(corners: [Vec3; 3], p: DVec3) -> Option<[f64; 2]> {
    let [a, b, c] = corners.map(|c| c.as_dvec3());
    let cross = (b - a).cross(c - a);
    let n = cross / cross.length_squared();
    if (p - a).dot(cross.normalize()).abs() > 1e-4 {
        return None;
    }
    let (v, w) = ((p - a).cross(c - a).dot(n), (b - a).cross(p - a).dot(n));
    (v > -1e-4 && w > -1e-4 && v + w < 1.0 + 1e-4).then_some([v.clamp(0.0, 1.0 - 1e-9), w.max(0.0)])
}

/// A unit vector of that cosine, off the axes, so that x and y cannot be confused.
fn direction_to_eye(cos: f32) -> Vec3 {
    let (sin_phi, cos_phi) = 0.7f32.sin_cos();
    let sin = (1.0 - cos * cos).sqrt();
    Vec3::new(sin * cos_phi, sin * sin_phi, cos)
}

const COSINES: [f32; 4] = [1.0, 0.7, 0.1, 0.01];

/// Every scattering function without delta lobes, by name, with the width of its lobe.
fn bsdfs() -> Vec<(String, Bsdf, f64)> {
    let mut all = vec![(
        "diffuse".to_owned(),
        Bsdf::Diffuse(Diffuse {
            reflectance: Rgb::new(0.2, 0.5, 0.9),
        }),
        1.0,
    )];
    for alpha in [1e-3f32, 0.01, 0.1, 0.5, 1.0] {
        let conductor = Conductor {
            eta: Rgb::new(0.2, 0.9, 1.1),
            k: Rgb::new(3.9, 2.4, 2.2),
            alpha,
        };
        all.push((format!("conductor {alpha}"), Bsdf::Conductor(conductor), alpha.into()));
    }
    for alpha in [0.05f32, 0.2, 0.5, 1.0] {
        for eta in [1.5f32, 1.0 / 1.5] {
            let name = format!("dielectric {alpha}, eta {eta:.3}");
            all.push((name, Bsdf::Dielectric(Dielectric { eta, alpha }), alpha.into()));
        }
    }
    for alpha in [1e-3f32, 0.1, 0.6] {
        let plastic = Plastic {
            reflectance: Rgb::new(0.7, 0.4, 0.1),
            specular: Rgb::splat(0.05),
            alpha,
        };
        all.push((format!("plastic {alpha}"), Bsdf::Plastic(plastic), alpha.into()));
    }
    all.extend(imported_bsdfs());
    all
}

/// Those that other renderers' scenes ask for.
fn imported_bsdfs() -> Vec<(String, Bsdf, f64)> {
    use Distribution::{Beckmann, Ggx};
    let mut all = Vec::new();
    let tangent = [0.8, 0.6];
    for (distribution, alpha) in [
        (Ggx, [0.1, 0.5]),
        (Ggx, [1.0, 1.0]),
        (Beckmann, [0.05, 0.05]),
        (Beckmann, [0.6, 0.15]),
        (Beckmann, [1.0, 1.0]),
    ] {
        let metal = RoughMetal {
            eta: Rgb::new(0.2, 0.9, 1.1),
            k: Rgb::new(3.9, 2.4, 2.2),
            reflectance: Rgb::new(1.0, 0.9, 0.8),
            alpha,
            distribution,
            tangent,
        };
        let width = f64::from(alpha[0].min(alpha[1]));
        all.push((
            format!("rough metal {distribution:?} {alpha:?}"),
            Bsdf::RoughMetal(metal),
            width,
        ));
        for eta in [1.5f32, 1.0 / 1.5] {
            let glass = RoughGlass {
                eta,
                reflectance: Rgb::new(1.0, 0.9, 0.8),
                transmittance: Rgb::new(0.6, 0.8, 1.0),
                alpha,
                distribution,
                tangent,
            };
            let name = format!("rough glass {distribution:?} {alpha:?}, eta {eta:.3}");
            all.push((name, Bsdf::RoughGlass(glass), width));
        }
    }
    for (distribution, alpha, nonlinear) in [(Ggx, 0.1, false), (Beckmann, 0.4, true)] {
        let coated = CoatedDiffuse {
            reflectance: Rgb::new(0.7, 0.4, 0.1),
            specular: Rgb::new(1.0, 0.9, 0.8),
            coat: CoatTable::of(1.5, alpha, distribution),
            nonlinear,
        };
        let name = format!("coated {distribution:?} {alpha}");
        all.push((name, Bsdf::CoatedDiffuse(coated), alpha.into()));
    }
    for (name, metallic, spec_trans, clearcoat, eta, thin) in [
        ("opaque", 0.0, 0.0, 0.0, 1.5f32, false),
        ("metal", 1.0, 0.0, 0.0, 1.5, false),
        ("metal under Burley's coat", 1.0, 0.0, 0.5, 1.5, false),
        ("glass", 0.0, 1.0, 0.0, 1.5, false),
        ("glass from inside", 0.0, 1.0, 0.5, 1.0 / 1.5, false),
        ("thin wall", 0.0, 1.0, 0.5, 1.5, true),
        ("all", 0.3, 0.5, 1.0, 1.5, false),
        ("all from inside", 0.3, 0.5, 1.0, 1.0 / 1.5, false),
        ("all of a thin wall", 0.3, 0.5, 1.0, 1.5, true),
    ] {
        let principled = PrincipledBsdf {
            base_color: Rgb::new(0.6, 0.4, 0.1),
            roughness: 0.5,
            anisotropic: 0.7,
            metallic,
            spec_trans,
            eta,
            spec_tint: 0.3,
            specular: if thin { 0.8 } else { 1.0 },
            specular_color: if thin { Rgb::new(1.0, 0.5, 0.2) } else { Rgb::WHITE },
            sheen: 0.4,
            sheen_tint: 0.5,
            flatness: 0.3,
            clearcoat,
            coat_alpha: 0.08,
            conserves: spec_trans > 0.0,
            thin,
            front: eta > 1.0,
            tangent,
        };
        let alpha = principled.coat_alpha.into();
        all.push((format!("principled {name}"), Bsdf::Principled(principled), alpha));
    }
    all
}

fn ior(bsdf: &Bsdf) -> f64 {
    match bsdf {
        Bsdf::Dielectric(d) => d.eta.into(),
        Bsdf::RoughGlass(g) => g.eta.into(),
        Bsdf::Principled(p) if bsdf.transmits() && !p.thin => p.eta.into(),
        _ => 1.0,
    }
}

/// Whether light passes in the directions that it would be reflected in, mirrored.
fn is_thin(bsdf: &Bsdf) -> bool {
    matches!(bsdf, Bsdf::Principled(p) if p.thin)
}

/// The same surface from its other side.
fn turned_over(bsdf: &Bsdf) -> Bsdf {
    match *bsdf {
        Bsdf::Dielectric(d) => Bsdf::Dielectric(Dielectric { eta: 1.0 / d.eta, ..d }),
        Bsdf::RoughGlass(g) => Bsdf::RoughGlass(RoughGlass { eta: 1.0 / g.eta, ..g }),
        Bsdf::Principled(p) if !p.thin => Bsdf::Principled(PrincipledBsdf {
            eta: 1.0 / p.eta,
            front: !p.front,
            ..p
        }),
        other => other,
    }
}

/// The half vector of a pair, in the upper hemisphere: polar angle and azimuth.
fn half_vector(wo: DVec3, wi: DVec3, eta: f64) -> (f64, f64) {
    let h = if wi.z > 0.0 { wo + wi } else { wo + wi * eta };
    let h = if h.z < 0.0 { -h } else { h };
    (h.x.hypot(h.y).atan2(h.z), h.y.atan2(h.x).rem_euclid(TAU))
}

/// The direction that belongs to a half vector, and the solid angle of directions per solid angle of half vectors
/// (Walter et al. 2007, equations 14 and 17). `None` if there is none on that side.
fn from_half_vector(wo: DVec3, theta: f64, phi: f64, eta: f64, transmitted: bool) -> Option<(DVec3, f64)> {
    let h = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
    let cos = wo.dot(h);
    if cos <= 0.0 {
        return None;
    }
    if !transmitted {
        let wi = h * (2.0 * cos) - wo;
        return (wi.z > 0.0).then_some((wi, 4.0 * cos));
    }
    let cos2_t = 1.0 - (1.0 - cos * cos) / (eta * eta);
    if cos2_t <= 0.0 {
        return None;
    }
    let cos_t = cos2_t.sqrt();
    let wi = h * (cos / eta - cos_t) - wo / eta;
    // |dh / dwi| = eta² |wi·h| / (wo·h + eta wi·h)², with wi·h = −cos θt.
    (wi.z < 0.0).then_some((wi, (cos - eta * cos_t).powi(2) / (eta * eta * cos_t)))
}

/// Polar cells of half vectors: quantiles of the distribution of width `alpha`, so that narrow lobes are resolved, then
/// steps to the horizon for what is wide beside them.
fn polar_cells(alpha: f64) -> Vec<f64> {
    const QUANTILES: usize = 12;
    let mut edges: Vec<f64> = (0..QUANTILES)
        .map(|i| i as f64 / QUANTILES as f64)
        .map(|a| (alpha * (a / (1.0 - a)).sqrt()).atan())
        .collect();
    let last = edges[QUANTILES - 1];
    const STEPS: i32 = 8;
    // Geometric while the lobe is narrow, nearly even when it is wide.
    edges.extend((1..=STEPS).map(|i| last * (FRAC_PI_2 / last).powf(f64::from(i) / f64::from(STEPS))));
    edges
}

const AZIMUTHS: usize = 12;

/// The integral of `f(wi)` over directions by cells of half vectors, reflected ones first.
fn integrate_cells(wo: Vec3, alpha: f64, bsdf: &Bsdf, tolerance: f64, f: impl Fn(Vec3) -> f64) -> Vec<f64> {
    let (edges, eta) = (polar_cells(alpha), ior(bsdf));
    let sides: &[bool] = if bsdf.transmits() { &[false, true] } else { &[false] };
    let mut cells = Vec::new();
    for &transmitted in sides {
        let integrand = |theta: f64, phi: f64| {
            let mirrors = transmitted && is_thin(bsdf);
            from_half_vector(wo.as_dvec3(), theta, phi, eta, transmitted && !mirrors)
                .map(|(wi, jacobian)| (if mirrors { wi.with_z(-wi.z) } else { wi }, jacobian))
                .map_or(0.0, |(wi, jacobian)| f(wi.as_vec3()) * jacobian * theta.sin())
        };
        for polar in edges.windows(2) {
            for j in 0..AZIMUTHS {
                let azimuth = [j, j + 1].map(|j| TAU * j as f64 / AZIMUTHS as f64);
                cells.push(integrate(&integrand, [polar[0], polar[1]], azimuth, tolerance));
            }
        }
    }
    cells
}

#[test]
fn scattering_is_sampled_with_the_density_it_states_and_reflects_no_more_than_arrives() {
    let cases: Vec<_> = bsdfs()
        .into_iter()
        .flat_map(|(name, bsdf, alpha)| COSINES.map(|cos| (format!("{name} at cos {cos}"), bsdf, alpha, cos)))
        .collect();
    let significance = Significance::TEST.split(2 * cases.len());
    let n = 100_000u32;
    for_each_in_parallel(&cases, |(name, bsdf, alpha, cos)| {
        let wo = direction_to_eye(*cos);
        let eta = ior(bsdf);
        let edges = polar_cells(*alpha);
        let rows = edges.len() - 1;
        let mass = integrate_cells(wo, *alpha, bsdf, 1e-7, |wi| bsdf.eval(wo, wi).pdf_w.into());
        let total: f64 = mass.iter().sum();
        assert!(total < 1.0 + 1e-3, "{name}: the density integrates to {total}");
        let mut counts = vec![0u64; mass.len() + 1];
        let mut random = Random(31);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let Some(sample) = bsdf.sample(wo, random.unit(), random.pair()) else {
                // What is sampled below the horizon has no density.
                counts[mass.len()] += 1;
                continue;
            };
            let again = bsdf.eval(wo, sample.wi);
            let ratio = sample.pdf_w / again.pdf_w;
            // The sample's density is that of the exact half vector. Rounding a direction turns that of the pair by 2⁻²⁴ / cos.
            let rounding = 1e-3 + 4.0 / 16_777_216.0 / (*alpha as f32 * cos);
            assert!(
                (ratio - 1.0).abs() < rounding,
                "{name}: pdf {} and {}",
                sample.pdf_w,
                again.pdf_w
            );
            for c in 0..3 {
                let (weight, expected) = (sample.weight[c], again.value[c] / again.pdf_w);
                let difference = (weight - expected).abs();
                assert!(difference <= 1e-3 * expected, "{name}: weight {weight} for {expected}");
            }
            let weight = f64::from(sample.weight.g);
            sum += weight;
            squares += weight * weight;
            let mut wi = sample.wi.as_dvec3();
            if is_thin(bsdf) {
                wi.z = wi.z.abs();
            }
            let (theta, phi) = half_vector(wo.as_dvec3(), wi, eta);
            let row = edges[1..rows].partition_point(|&edge| edge <= theta);
            let side = if sample.wi.z < 0.0 { rows } else { 0 };
            counts[(side + row) * AZIMUTHS + cell(phi / TAU, AZIMUTHS)] += 1;
        }
        let mut expected: Vec<f64> = mass.iter().map(|m| m * f64::from(n)).collect();
        expected.push((1.0 - total).max(0.0) * f64::from(n));
        assert_chi_square(name, &counts, &pool_ridges(&expected), significance);

        // Sampling and quadrature agree on the reflectance, and it is at most 1. Refraction scales radiance by 1 / eta².
        let albedo: f64 = integrate_cells(wo, *alpha, bsdf, 1e-6, |wi| bsdf.eval(wo, wi).value.g.into())
            .iter()
            .sum();
        let energy: f64 = integrate_cells(wo, *alpha, bsdf, 1e-6, |wi| {
            f64::from(bsdf.eval(wo, wi).value.max_component()) * if wi.z < 0.0 { eta * eta } else { 1.0 }
        })
        .iter()
        .sum();
        assert!((0.01..1.0 + 1e-3).contains(&energy), "{name}: reflects {energy}");
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean).max(0.0) / f64::from(n)).sqrt();
        assert!(
            (mean - albedo).abs() < 5.0 * error + 1e-3 * albedo,
            "{name}: mean weight {mean} ± {error} for {albedo}"
        );
    });
}

#[test]
fn scattering_is_reciprocal() {
    let mut random = Random(41);
    for (name, bsdf, alpha) in bsdfs() {
        let mut compared = 0;
        for _ in 0..20_000 {
            let wo = warp::cosine_hemisphere(random.pair());
            // Directions that the lobe reaches: narrow ones would never be met by chance.
            let Some(sample) = bsdf.sample(wo, random.unit(), random.pair()) else {
                continue;
            };
            let wi = sample.wi;
            // Half vectors of narrow lobes lose their digits at grazing angles.
            if wo.z < 0.05 || wi.z.abs() < 0.05 || alpha < 0.005 && wo.z < 0.3 {
                continue;
            }
            let there = bsdf.eval(wo, wi).value / wi.z.abs();
            // Seen from the other side the surface is turned over and its index inverted; radiance over the square of
            // the index is what stays.
            let (back, scale) = if wi.z < 0.0 {
                let flip = |w: Vec3| Vec3::new(w.x, w.y, -w.z);
                let eta = ior(&bsdf) as f32;
                (turned_over(&bsdf).eval(flip(wi), flip(wo)).value / wo.z, eta * eta)
            } else {
                (bsdf.eval(wi, wo).value / wo.z, 1.0)
            };
            let (a, b) = (there.g * scale, back.g);
            assert!((a - b).abs() <= 5e-3 * a.max(b), "{name}: {wo} {wi}: {a} and {b}");
            compared += 1;
        }
        assert!(compared > 1000, "{name}: only {compared} pairs");
    }
}

#[test]
fn extreme_inputs_give_finite_samples() {
    let below_one = 1f32.next_down();
    let last = 1.0 - 1.0 / 16_777_216.0;
    let numbers = [0.0, f32::MIN_POSITIVE, 1e-7, 0.25, 0.5, 0.75, last, below_one];
    let mut all = bsdfs();
    for alpha in [0.0f32, 1e-4, 1e-3] {
        all.push((
            format!("dielectric {alpha}"),
            Bsdf::Dielectric(Dielectric { eta: 1.5, alpha }),
            1.0,
        ));
        let conductor = Conductor {
            eta: Rgb::splat(0.2),
            k: Rgb::splat(3.0),
            alpha,
        };
        all.push((format!("conductor {alpha}"), Bsdf::Conductor(conductor), 1.0));
    }
    all.push(("mirror".to_owned(), Bsdf::Mirror(Rgb::WHITE), 1.0));
    for (name, bsdf, _) in imported_bsdfs() {
        // As narrow as they get, and between media of one index.
        for (alpha, ior) in [(0.0, 1.5), (1e-4, 1.5), (1e-3, 1.0), (1.0, 1.0)] {
            let extreme = match bsdf {
                Bsdf::RoughMetal(m) => Bsdf::RoughMetal(RoughMetal {
                    alpha: [alpha, 1.0],
                    ..m
                }),
                Bsdf::RoughGlass(g) => Bsdf::RoughGlass(RoughGlass {
                    alpha: [alpha, 1e-4],
                    eta: if g.eta > 1.0 { ior } else { 1.0 / ior },
                    ..g
                }),
                Bsdf::CoatedDiffuse(c) => Bsdf::CoatedDiffuse(CoatedDiffuse {
                    coat: CoatTable::of(ior, alpha, c.coat.distribution),
                    ..c
                }),
                Bsdf::Principled(p) => Bsdf::Principled(PrincipledBsdf {
                    roughness: alpha,
                    anisotropic: 1.0,
                    coat_alpha: if p.conserves { alpha } else { alpha.clamp(1e-3, 0.1) },
                    eta: if p.front { ior } else { 1.0 / ior },
                    ..p
                }),
                other => other,
            };
            all.push((format!("{name}, alpha {alpha}, ior {ior}"), extreme, 1.0));
        }
    }
    let black = PrincipledBsdf {
        base_color: Rgb::BLACK,
        roughness: 0.0,
        anisotropic: 0.0,
        metallic: 1.0,
        spec_trans: 0.0,
        eta: 1.5,
        spec_tint: 0.0,
        specular: 1.0,
        specular_color: Rgb::WHITE,
        sheen: 0.0,
        sheen_tint: 0.0,
        flatness: 0.0,
        clearcoat: 0.0,
        coat_alpha: 0.0,
        conserves: true,
        thin: false,
        front: true,
        tangent: [1.0, 0.0],
    };
    all.push(("black metal".to_owned(), Bsdf::Principled(black), 1.0));
    for (name, bsdf, _) in all {
        for cos in [1e-30f32, 1e-10, 1e-7, 1e-4, 1e-3, 0.5, below_one, 1.0] {
            let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
            for lobe in numbers {
                for (u, v) in numbers.iter().flat_map(|&u| numbers.map(|v| (u, v))) {
                    let context = || format!("{name}: cos {cos:e}, lobe {lobe:e}, u ({u:e}, {v:e})");
                    let mut samples = vec![bsdf.sample(wo, lobe, [u, v])];
                    if !bsdf.has_delta() {
                        samples.push(bsdf.sample_hemisphere(wo, true, lobe, [u, v]));
                        samples.push(bsdf.sample_hemisphere(wo, false, lobe, [u, v]));
                    }
                    for s in samples.into_iter().flatten() {
                        let weight = s.weight.to_array();
                        assert!((s.wi.length() - 1.0).abs() < 1e-4, "{}: {}", context(), s.wi);
                        assert!(s.pdf_w > 0.0, "{}: {}", context(), s.pdf_w);
                        assert!(
                            weight.iter().all(|w| w.is_finite() && *w >= 0.0),
                            "{}: {weight:?}",
                            context()
                        );
                        let back = bsdf.eval(wo, s.wi);
                        assert!(
                            back.value.is_finite() && back.pdf_w.is_finite(),
                            "{}: {back:?}",
                            context()
                        );
                    }
                }
            }
        }
    }
}
