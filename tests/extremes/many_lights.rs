//! Many emitters, and emitters of very different power side by side.

use crate::irradiance::{ALBEDO, Case, assert_irradiance, irradiance, settings, square_above};
use crate::support::{self, Random, Stage};
use embrace::accel::Accel;
use embrace::light::{LightSamplerBuilder, LightSampling};
use embrace::math::Vec3;
use embrace::mesh::TriangleMesh;
use glam::Quat;
use std::time::Instant;

support::for_each_backend! { but not brute:
    emitters_of_powers_over_twelve_decades_each_light_their_own_cell
    a_hundred_thousand_emitters_give_the_light_of_the_square_they_tile
}

/// Cells side by side, each with a lamp under its ceiling that only it sees, ten times as bright as the one before.
fn emitters_of_powers_over_twelve_decades_each_light_their_own_cell<A: Accel>() {
    let cells = -6..=6;
    let lamp = |cell: i32| {
        let corner = Vec3::new(cell as f32 + 0.05, 0.5, 0.05);
        support::quad(corner, Vec3::X * 0.9, Vec3::Z * 0.9)
    };
    let floor = support::quad(Vec3::new(-6.0, 0.0, 0.0), Vec3::Z, Vec3::X * 13.0);
    let mut stage = Stage::new(support::probe(Vec3::Y, Vec3::ZERO)).add(floor, support::diffuse(ALBEDO));
    for cell in cells.clone() {
        let wall = support::quad(Vec3::X * cell as f32, Vec3::Y * 0.5, Vec3::Z);
        stage = stage.add(wall, support::diffuse(0.0)).add_light(
            lamp(cell),
            support::diffuse(0.0),
            support::emission(10f32.powi(cell)),
        );
    }
    let mut cases = Vec::new();
    for cell in cells {
        let at = Vec3::new(cell as f32 + 0.5, 0.0, 0.5);
        let view = support::probe(at + Vec3::new(0.1, 0.3, 0.1), at);
        // Emitter samples alone find a lamp as often as its share of the power says.
        let strategies: &[bool] = if cell < 5 { &[true] } else { &[true, false] };
        cases.extend(strategies.iter().map(|&mis| Case {
            name: format!("radiance 1e{cell}"),
            stage: stage.seen_by(view.clone()),
            mis,
            spp: 2048,
            irradiance: irradiance(at, Quat::IDENTITY, 10f32.powi(cell), &lamp(cell).positions),
        }));
    }
    assert_irradiance::<A>("cells", &cases);
}

/// From afar all directions and distances are the same, so that shares are those of power.
#[test]
fn emitters_of_powers_over_twelve_decades_are_drawn_by_power_from_afar() {
    let mut random = Random(9);
    let (mut builder, mut areas, mut powers) = (LightSamplerBuilder::default(), Vec::new(), Vec::new());
    for _ in 0..1000 {
        let [side, radiance] = [(); 2].map(|()| 10f32.powf(6.0 * random.unit() - 3.0));
        builder.push(
            [Vec3::ZERO, Vec3::X * side, Vec3::Y * side],
            support::emission(radiance),
        );
        areas.push(0.5 * f64::from(side) * f64::from(side));
        powers.push(0.5 * f64::from(side) * f64::from(side) * f64::from(radiance));
    }
    let lights = builder.build(None, LightSampling::default());
    let total: f64 = powers.iter().sum();
    let (mut worst, mut sum) = (0.0f64, 0.0);
    for (i, (area, power)) in areas.iter().zip(&powers).enumerate() {
        let density = f64::from(lights.area_pdf_w(i as u32, Vec3::Z * 1e9, Vec3::NEG_Z, 1.0, 1.0));
        sum += density * area;
        worst = worst.max((density * area / (power / total) - 1.0).abs());
    }
    println!(
        "powers over {:.1e}: shares off by {worst:.1e}, their sum by {:.1e}",
        total / powers.iter().copied().fold(f64::MAX, f64::min),
        sum - 1.0
    );
    // Each level of the tree compares its children in f32.
    assert!(worst < 5e-6 && (sum - 1.0).abs() < 1e-6, "{worst}, {sum}");
}

/// The square of side 1 at height 1, tiled by twice `n` by `n` emitting triangles.
fn tiled(n: u32) -> (Stage, f64) {
    let (mut stage, irradiance) = square_above(1.0, 1.0, 1.0);
    let at = |i: u32| i as f32 / n as f32 - 0.5;
    let mesh = TriangleMesh {
        positions: (0..=n)
            .flat_map(|j| (0..=n).map(move |i| Vec3::new(at(i), 1.0, at(j))))
            .collect(),
        indices: (0..n)
            .flat_map(|j| (0..n).map(move |i| j * (n + 1) + i))
            .flat_map(|k| [[k, k + 1, k + n + 2], [k, k + n + 2, k + n + 1]])
            .collect(),
        ..TriangleMesh::default()
    };
    stage.0.meshes[1] = mesh.into_f64().into();
    (stage, irradiance)
}

fn emitters_tile_a_square<A: Accel>(n: u32) {
    let (stage, irradiance) = tiled(n);
    let started = Instant::now();
    let triangles = stage.prepare::<A>(&settings(true)).scene.triangles();
    println!("{}: {triangles} triangles, built in {:.1?}", A::NAME, started.elapsed());
    let cases = [true, false].map(|mis| Case {
        name: format!("{triangles} triangles"),
        stage: stage.clone(),
        mis,
        spp: 4096,
        irradiance,
    });
    assert_irradiance::<A>("tiles", &cases);
}

fn a_hundred_thousand_emitters_give_the_light_of_the_square_they_tile<A: Accel>() {
    emitters_tile_a_square::<A>(224);
}

#[cfg(feature = "embree")]
#[test]
#[ignore = "builds a million triangles three times: cargo test --test extremes a_million -- --ignored --nocapture"]
fn a_million_emitters_give_the_light_of_the_square_they_tile_on_embree() {
    emitters_tile_a_square::<embrace::accel::embree::Embree>(708);
}

#[cfg(feature = "obvhs")]
#[test]
#[ignore = "builds a million triangles three times: cargo test --test extremes a_million -- --ignored --nocapture"]
fn a_million_emitters_give_the_light_of_the_square_they_tile_on_obvhs() {
    emitters_tile_a_square::<embrace::accel::obvhs::Obvhs>(708);
}
