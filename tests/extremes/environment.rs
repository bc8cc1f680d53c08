//! Environment maps: a sun of any strength anywhere, maps of any shape and range, and what the sun does not reach.
//! Expected values are quadratures in f64 of the very same bilinear interpolation.

use crate::irradiance::{ALBEDO, Case, assert_irradiance, lit_plane, settings};
use crate::support::exact::{facing, grey_map, integrate_map, map_direction};
use crate::support::{self, Significance, Stage, assert_mean, for_each_in_parallel};
use embrace::accel::Accel;
use embrace::accel::brute::Brute;
use embrace::image::{self, Image};
use embrace::light::{EnvSampling, Environment};
use embrace::math::{DVec3, Rgb, Vec3};
use embrace::sampling::AliasTable;
use exr::prelude::{Image as ExrImage, SpecificChannels, WritableImage, f16};
use glam::Quat;
use std::f64::consts::{PI, TAU};
use std::io::Cursor;
use std::path::Path;
use std::sync::LazyLock;
use std::time::Instant;

support::for_each_backend! { but not brute:
    a_hot_texel_of_any_strength_lights_planes_wherever_it_stands
    maps_of_any_shape_and_range_light_planes
    a_plane_in_the_shade_does_not_brighten_however_hot_the_hidden_texel_is
    a_constant_environment_of_any_radiance_lights_planes_without_a_table
}

/// Normals of planes that face up, down and sideways, towards the seam of a map.
const NORMALS: [Vec3; 3] = [Vec3::Y, Vec3::NEG_Y, Vec3::NEG_Z];

/// Hot texels of a map of 64 x 32, by where they stand.
const PLACES: [(&str, [u32; 2]); 5] = [
    ("north pole", [5, 0]),
    ("south pole", [40, 31]),
    ("first column", [0, 13]),
    ("last column", [63, 18]),
    ("middle", [20, 10]),
];

fn one_texel(width: u32, height: u32, [x, y]: [u32; 2], hot: f32, rest: f32) -> Image<Rgb> {
    grey_map(width, height, |i, j| if [i, j] == [x, y] { hot } else { rest })
}

/// A plane through the origin.
fn plane(normal: Vec3) -> Stage {
    lit_plane(Vec3::ZERO, Quat::from_rotation_arc(Vec3::Y, normal), 1.0)
}

fn a_hot_texel_of_any_strength_lights_planes_wherever_it_stands<A: Accel>() {
    let mut cases = Vec::new();
    for (place, texel) in PLACES {
        for normal in NORMALS {
            let of_texel = integrate_map(&one_texel(64, 32, texel, 1.0, 0.0), facing(normal));
            // A sun of 1e3 is not all of the light: the noisiest.
            for (hot, spp) in [(1e3, 8192), (1e6, 1024), (1e9, 256), (1e12, 256)] {
                // Emitter samples alone tell next to nothing of a sky whose sun is behind the plane.
                let strategies: &[bool] = if of_texel > 1e-4 { &[true, false] } else { &[true] };
                cases.extend(strategies.iter().map(|&mis| Case {
                    name: format!("{hot:e} at the {place}, facing {normal}"),
                    stage: plane(normal).lit_by_map(one_texel(64, 32, texel, hot, 1.0), 0.0),
                    mis,
                    spp,
                    irradiance: PI + (f64::from(hot) - 1.0) * of_texel,
                }));
            }
        }
    }
    let error = assert_irradiance::<A>("hot texels", &cases);
    assert!(error < 2.5e-3, "too much noise to tell: {error}");
}

/// A map of extremes and the irradiance on each plane.
struct Lit {
    name: String,
    map: Image<Rgb>,
    irradiance: [f64; 3],
}

/// Maps by name, but black ones.
fn extreme_maps() -> Vec<(String, Image<Rgb>)> {
    let mut random = support::Random(7);
    let mut decades = |width: u32, height: u32| {
        let values: Vec<f32> = (0..width * height)
            .map(|_| 10f32.powf(60.0 * random.unit() - 30.0))
            .collect();
        grey_map(width, height, |x, y| values[(y * width + x) as usize])
    };
    let mut maps = vec![
        ("sixty decades".to_owned(), decades(16, 8)),
        ("1 x 1".to_owned(), grey_map(1, 1, |_, _| 2.0)),
        ("2 x 1".to_owned(), grey_map(2, 1, |x, _| 1.0 + 1e3 * x as f32)),
        ("2 x 1, one black".to_owned(), grey_map(2, 1, |x, _| x as f32)),
        ("1 x 2".to_owned(), grey_map(1, 2, |_, y| 1.0 + 1e3 * y as f32)),
        ("4096 x 2".to_owned(), one_texel(4096, 2, [4000, 0], 1e6, 1.0)),
        ("2 x 2048".to_owned(), one_texel(2, 2048, [1, 300], 1e6, 1.0)),
        ("16384 x 4".to_owned(), one_texel(16384, 4, [16001, 1], 1e6, 0.0)),
        ("1e30 everywhere".to_owned(), grey_map(8, 4, |_, _| 1e30)),
        ("1e30 over 1e-30".to_owned(), one_texel(64, 32, [0, 13], 1e30, 1e-30)),
        ("half floats".to_owned(), half_floats()),
    ];
    maps.extend(PLACES.map(|(place, texel)| {
        let name = format!("black but at the {place}");
        (name, one_texel(64, 32, texel, 1.0, 0.0))
    }));
    maps
}

/// The largest and the smallest half float side by side, by way of a file.
fn half_floats() -> Image<Rgb> {
    let texel = |x: usize, y: usize| {
        if (x, y) == (9, 1) {
            f16::MAX
        } else {
            f16::MIN_POSITIVE_SUBNORMAL
        }
    };
    let mut bytes = Cursor::new(Vec::new());
    ExrImage::from_channels(
        (16, 8),
        SpecificChannels::rgb(|at: exr::math::Vec2<usize>| {
            let value = texel(at.0, at.1);
            (value, value, value)
        }),
    )
    .write()
    .to_buffered(&mut bytes)
    .expect("an EXR in memory");
    image::read_rgb(Path::new("half.exr"), bytes.get_ref()).expect("an EXR that was just written")
}

static LIT: LazyLock<Vec<Lit>> = LazyLock::new(|| {
    let black = ("black".to_owned(), grey_map(4, 2, |_, _| 0.0));
    let maps = extreme_maps().into_iter().chain([black]);
    maps.map(|(name, map)| Lit {
        name,
        irradiance: NORMALS.map(|normal| integrate_map(&map, facing(normal))),
        map,
    })
    .collect()
});

fn maps_of_any_shape_and_range_light_planes<A: Accel>() {
    let mut cases = Vec::new();
    for lit in &*LIT {
        cases.extend(
            NORMALS
                .into_iter()
                .zip(lit.irradiance)
                .map(|(normal, irradiance)| Case {
                    name: format!("{}, facing {normal}", lit.name),
                    stage: plane(normal).lit_by_map(lit.map.clone(), 0.0),
                    mis: true,
                    spp: 2048,
                    irradiance,
                }),
        );
    }
    let error = assert_irradiance::<A>("maps", &cases);
    assert!(error < 5e-3, "too much noise to tell: {error}");
}

#[test]
fn half_floats_are_read_exactly() {
    let map = half_floats();
    assert_eq!(map.at(9, 1), &Rgb::splat(65504.0));
    assert_eq!(map.at(8, 1), &Rgb::splat(2f32.powi(-24)));
}

#[test]
fn the_density_of_an_extreme_map_integrates_to_one() {
    for_each_in_parallel(&extreme_maps(), |(name, map)| {
        let environment = Environment::from_map(map, 1.0, 0.0, EnvSampling::Importance).expect("a valid map");
        // Of a map of ones, the density is the integrand.
        let ones = grey_map(map.width, map.height, |_, _| 1.0);
        let total = integrate_map(&ones, |d| environment.eval(d.as_vec3()).1.into());
        println!("{name}: the density integrates to 1 + {:.1e}", total - 1.0);
        // Directions are rounded to 6e-8, which is up to 2e-4 of a column: at random, over thousands of points.
        assert!((total - 1.0).abs() < 1e-5, "{name}: {total}");
    });
}

/// The table of the textbook, in f32 throughout (after Vose 1991, in the order of the usual stacks): its probabilities.
fn pmf_of_f32_table(weights: &[f64]) -> Vec<f64> {
    let n = weights.len();
    let sum = weights.iter().sum::<f64>() as f32;
    let mut residual: Vec<f32> = weights.iter().map(|w| *w as f32 / sum * n as f32).collect();
    let (mut under, mut over): (Vec<usize>, Vec<usize>) = (0..n).partition(|i| residual[*i] < 1.0);
    let mut slots: Vec<(f32, usize)> = (0..n).map(|i| (1.0, i)).collect();
    while let (Some(a), Some(b)) = (under.pop(), over.pop()) {
        slots[a] = (residual[a], b);
        residual[b] = residual[a] + residual[b] - 1.0;
        if residual[b] < 1.0 { under.push(b) } else { over.push(b) }
    }
    let mut pmf = vec![0.0; n];
    for (k, (keep, alias)) in slots.into_iter().enumerate() {
        pmf[k] += f64::from(keep) / n as f64;
        pmf[alias] += (1.0 - f64::from(keep)) / n as f64;
    }
    pmf
}

#[test]
fn the_sampling_table_keeps_its_probabilities_in_the_shade_where_one_in_f32_does_not() {
    let (width, height, hot_texel) = (512, 256, 60 * 512 + 200);
    // What emitter samples bring where the hot texel is hidden, over the truth, if their density is that of the weights.
    let brightening = |pmf: &[f64], weights: &[f64]| {
        let rest = |values: &[f64]| values[..hot_texel].iter().chain(&values[hot_texel + 1..]).sum::<f64>();
        rest(pmf) / (rest(weights) / weights.iter().sum::<f64>())
    };
    let in_f32 = [1e6, 1e7, 1e8, 1e9, 1e12].map(|hot| {
        let weights: Vec<f64> = (0..width * height)
            .map(|k| {
                let sin = (PI * ((k / width) as f64 + 0.5) / f64::from(height as u32)).sin();
                sin * if k == hot_texel { hot } else { 1.0 }
            })
            .collect();
        let table = AliasTable::new(weights.iter().copied()).expect("there are weights");
        let ours = brightening(&table.implied_pmf(), &weights);
        let in_f32 = brightening(&pmf_of_f32_table(&weights), &weights);
        println!("{hot:e}: {:.1e}, in f32 {:.1e}", ours - 1.0, in_f32 - 1.0);
        // What 131,072 roundings of f64 add up to.
        assert!((ours - 1.0).abs() < 1e-10, "{hot:e}: {ours}");
        in_f32
    });
    // By the same measure f32 serves up to 1e6, and then no more.
    assert!((in_f32[0] - 1.0).abs() < 1e-3, "{in_f32:?}");
    assert!(in_f32[1] > 1.02 && in_f32[2] > 1.8 && in_f32[3] > 1.9, "{in_f32:?}");
}

fn a_plane_in_the_shade_does_not_brighten_however_hot_the_hidden_texel_is<A: Accel>() {
    let mut cases = Vec::new();
    for (place, texel) in [("middle", [20, 10]), ("north pole", [5, 0]), ("last column", [63, 8])] {
        let [u, v] = texel.map(|i| f64::from(i) + 0.5);
        let sun = map_direction(u / 64.0, v / 32.0);
        // A square before the sun, 0.29 in slope to each side: its texel and the neighbours are behind it.
        let (side, half) = (sun.any_orthonormal_vector(), 0.58);
        let across = side.cross(sun);
        let hidden = |d: DVec3| {
            let offset = d * (2.0 / d.dot(sun)) - sun * 2.0;
            d.dot(sun) > 0.0 && offset.dot(side).abs() < half && offset.dot(across).abs() < half
        };
        let up = facing(Vec3::Y);
        let irradiance = integrate_map(
            &one_texel(64, 32, texel, 0.0, 1.0),
            |d| if hidden(d) { 0.0 } else { up(d) },
        );
        let corner = sun * 2.0 - (side + across) * half;
        let edges = [side, across].map(|edge| (edge * 2.0 * half).as_vec3());
        let blocker = support::quad(corner.as_vec3(), edges[0], edges[1]);
        for hot in [1e6, 1e7, 1e8, 1e9, 1e12] {
            cases.push(Case {
                name: format!("{hot:e} hidden at the {place}"),
                stage: plane(Vec3::Y)
                    .add(blocker.clone(), support::diffuse(0.0))
                    .lit_by_map(one_texel(64, 32, texel, hot, 1.0), 0.0),
                mis: true,
                spp: 4096,
                irradiance,
            });
        }
    }
    let error = assert_irradiance::<A>("shade", &cases);
    assert!(error < 3e-4, "too much noise to tell: {error}");
}

fn a_constant_environment_of_any_radiance_lights_planes_without_a_table<A: Accel>() {
    for radiance in [1e-30, 65504.0, 1e30f32] {
        for normal in NORMALS {
            let lit = plane(normal).lit_by_constant(radiance).prepare::<A>(&settings(true));
            let parts = lit.scene.memory_by_part();
            assert!(parts.contains(&("environment", 0)) && parts.contains(&("environment_table", 0)));
            assert_mean(
                &format!("{}: {radiance:e}", A::NAME),
                lit.mean(&settings(true), 1024, 0..16),
                f64::from(ALBEDO) * f64::from(radiance),
                Significance::TEST.split(9),
            );
        }
    }
}

/// Samples of a texel, over a lattice of random numbers: their mean estimate of the light, relative to the truth, how far
/// their mean is off the texel's centre in columns, and the largest deviation of their distribution from a tent.
fn sub_texel(width: u32, texel: [u32; 2]) -> [f64; 3] {
    let map = one_texel(width, 4, texel, 1.0, 0.0);
    let environment = Environment::from_map(&map, 1.0, 0.0, EnvSampling::Importance).expect("a valid map");
    let chosen = environment.choose_texel(0);
    assert_eq!(chosen, texel[1] * width + texel[0]);
    let (columns, rows) = (256, 4096);
    let unit = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(n);
    let (mut light, mut offsets) = (0.0, Vec::new());
    for i in 0..columns {
        for j in 0..rows {
            let point = environment.sample(chosen, [unit(i, columns) as f32, unit(j, rows) as f32]);
            let (radiance, pdf_w) = environment.lookup(&point);
            light += f64::from(radiance.g) / f64::from(pdf_w);
            if j == 0 {
                let wi = point.wi.as_dvec3();
                let turns = wi.x.atan2(-wi.z) / TAU - unit(texel[0], width);
                offsets.push((turns - turns.round()) * f64::from(width));
            }
        }
    }
    offsets.sort_by(f64::total_cmp);
    let cumulative = |x: f64| 0.5 + x - 0.5 * x * x.abs();
    let deviations = (0..columns).map(|i| (cumulative(offsets[i as usize]) - unit(i, columns)).abs());
    [
        light / f64::from(columns * rows) / integrate_map(&map, |_| 1.0) - 1.0,
        offsets.iter().sum::<f64>() / f64::from(columns),
        deviations.fold(0.0, f64::max),
    ]
}

/// Of the 24 bits of an image coordinate, the last columns of 16384 leave 10 for the place in the texel.
#[test]
fn samples_within_a_texel_are_those_of_a_tent_in_a_map_of_16384_columns() {
    for width in [16384, 12000] {
        for texel in [[0, 0], [1, 1], [5000, 2], [8191, 1], [width - 3, 0], [width - 1, 3]] {
            let [light, shift, deviation] = sub_texel(width, texel);
            let found =
                format!("{width} columns, {texel:?}: light {light:.1e}, shift {shift:.1e}, deviation {deviation:.1e}");
            println!("{found}");
            assert!(light.abs() < support::ROUNDING, "{found}");
            // Half a step of 2^-10 for each rounding, of which there are two if dividing by the width is inexact; the
            // mean of 256 is off by a twentieth of that at 1.2 standard deviations, by a fifth at 5.
            let step = 2f64.powi(-11) * if width.is_power_of_two() { 1.0 } else { 2.0 };
            assert!(shift.abs() < 0.2 * step && deviation < step, "{found}");
        }
    }
}

#[test]
#[ignore = "takes 6 GB: cargo test --test extremes the_largest_map -- --ignored --nocapture"]
fn the_largest_map_lights_a_plane() {
    let (width, height, [x, y], hot) = (16384, 8192, [16001, 2500], 1e9f32);
    let map = one_texel(width, height, [x, y], hot, 1.0);
    let peak = || {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let peak = status
            .lines()
            .find(|line| line.starts_with("VmHWM"))
            .unwrap_or("VmHWM: unknown");
        peak.to_owned()
    };
    println!("with the image: {}", peak());
    // Across a texel of 4e-4 both factors are linear, to 1e-7.
    let [u, v] = [(x, width), (y, height)].map(|(i, n)| (f64::from(i) + 0.5) / f64::from(n));
    let solid_angle = 2.0 * PI * PI * (PI * v).sin() / (f64::from(width) * f64::from(height));
    let of_texel = solid_angle * facing(Vec3::Y)(map_direction(u, v));
    let stage = plane(Vec3::Y).lit_by_map(map, 0.0);
    let started = Instant::now();
    let lit = stage.prepare::<Brute>(&settings(true));
    println!(
        "built in {:.1?}, {:?}, {}",
        started.elapsed(),
        lit.scene.memory_by_part(),
        peak()
    );
    for mis in [true, false] {
        let seen = lit.mean(&settings(mis), 4096, 0..16);
        let expected = f64::from(ALBEDO) / PI * (PI + (f64::from(hot) - 1.0) * of_texel);
        println!(
            "mis {mis}: {} ± {:.1e}",
            seen.mean / expected,
            seen.standard_error / expected
        );
        assert_mean(&format!("mis {mis}"), seen, expected, Significance::TEST.split(2));
    }
}
