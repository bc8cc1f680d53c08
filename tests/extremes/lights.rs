//! Emitting triangles of any size, shape and strength, from afar and from close by, against closed forms.

use crate::irradiance::{Case, assert_irradiance, irradiance, lit_plane, plane, settings, square_above};
use crate::support::{self, Random};
use embrace::accel::Accel;
use embrace::light::{Emission, LightSamplerBuilder, LightSampling};
use embrace::math::Vec3;
use embrace::mesh::TriangleMesh;
use embrace::sampling::{Sampler, SamplerKind};
use glam::{EulerRot, Quat};
use std::f64::consts::PI;

support::for_each_backend! { but not brute:
    a_square_of_any_area_gives_the_closed_form_factor
    a_small_lamp_does_not_stand_in_its_own_light_from_afar
    needles_emit_what_their_area_says
    a_point_on_the_plane_of_an_emitter_gets_nothing_from_it
    a_point_on_an_emitter_shows_its_emission_alone
    a_point_next_to_an_emitter_gets_all_that_it_sends
    only_the_sides_that_emit_give_light
    triangles_without_area_do_not_disturb_an_emitter
}

fn both_sides(radiance: f32) -> Emission {
    Emission {
        both_sides: true,
        ..support::emission(radiance)
    }
}

/// Turns off the axes, where planes and edges are exact, and none.
fn turns() -> [Quat; 3] {
    [0.0, 0.4, 2.1].map(|angle| Quat::from_euler(EulerRot::XYZ, angle, 1.3 * angle, 0.7 * angle))
}

fn a_square_of_any_area_gives_the_closed_form_factor<A: Accel>() {
    let mut cases = Vec::new();
    let mut add = |name: String, side: f32, height: f32, radiance: f32, strategies: &[bool]| {
        let (stage, irradiance) = square_above(side, height, radiance);
        cases.extend(strategies.iter().map(|&mis| Case {
            name: name.clone(),
            stage: stage.clone(),
            mis,
            spp: 512,
            irradiance,
        }));
    };
    for exponent in [-6, -3, 0, 3, 6] {
        let side = 10f32.powi(exponent);
        for height in [1.0, 10.0] {
            let name = format!("side {side:e} from {height} sides");
            add(name, side, height * side, 3.0, &[true, false]);
        }
        // Emitter samples alone of what fills the sky are as bad as 1 / cos⁴.
        add(
            format!("side {side:e} from 1e-4 sides"),
            side,
            1e-4 * side,
            3.0,
            &[true],
        );
    }
    for side in [1e-6, 1e-4, 1e-2] {
        add(
            format!("side {side:e} from 1"),
            side,
            1.0,
            1.0 / (side * side),
            &[true, false],
        );
    }
    for side in [1e2, 1e4, 1e6] {
        add(format!("side {side:e} from 1"), side, 1.0, 1.0, &[true]);
    }
    for radiance in [1e-30, 1e30] {
        add(format!("radiance {radiance:e}"), 1.0, 1.0, radiance, &[true, false]);
    }
    assert_irradiance::<A>("squares", &cases);
}

/// Coordinates near a lamp that stands at the origin are far finer than those at the other end of a shadow ray.
fn a_small_lamp_does_not_stand_in_its_own_light_from_afar<A: Accel>() {
    let mut cases = Vec::new();
    for turn in turns() {
        for side in [1.0, 0.25, 0.0625, 1e-3, 1e-6f32] {
            let lamp = plane(Vec3::ZERO, turn, 0.5 * side);
            let at = turn * Vec3::new(1.3, -2.0, 0.7);
            let radiance = 1.0 / (side * side);
            cases.push(Case {
                name: format!("side {side:e}, {turn}"),
                irradiance: irradiance(at, turn, radiance, &lamp.positions),
                stage: lit_plane(at, turn, 1.0).add_light(lamp, support::diffuse(0.0), both_sides(radiance)),
                mis: false,
                spp: 512,
            });
        }
    }
    assert_irradiance::<A>("lamps at the origin", &cases);
}

/// Nine triangles 1 long, 3 apart, each in a direction of its own, whose third corner is `height` off the longest edge.
fn needles(height: f32) -> TriangleMesh {
    let mut random = Random(3);
    let mut mesh = TriangleMesh::default();
    for i in 0..9 {
        let centre = Vec3::new(3.0 * (i % 3) as f32 - 3.0, 2.0, 3.0 * (i / 3) as f32 - 3.0);
        let along = Vec3::from_array([(); 3].map(|()| random.unit() - 0.5)).normalize();
        let a = centre - along * 0.5;
        let corners = [a, a + along, a + along * 0.4 + along.any_orthonormal_vector() * height];
        mesh.positions.extend(corners);
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// Their area is what is left when nearly all of it cancels, and backends know little of the plane that they are in.
fn needles_emit_what_their_area_says<A: Accel>() {
    let mut cases = Vec::new();
    for height in [1e-1, 1e-3, 1e-4, 1e-5, 1e-6f32] {
        let mesh = needles(height);
        let radiance = 1.0 / height;
        let irradiance = mesh
            .positions
            .chunks(3)
            .map(|corners| irradiance(Vec3::ZERO, Quat::IDENTITY, radiance, corners))
            .sum();
        let stage =
            lit_plane(Vec3::ZERO, Quat::IDENTITY, 1.0).add_light(mesh, support::diffuse(0.0), both_sides(radiance));
        cases.extend([true, false].map(|mis| Case {
            name: format!("needles 1 : {height:e}"),
            stage: stage.clone(),
            mis,
            spp: 1024,
            irradiance,
        }));
    }
    assert_irradiance::<A>("needles", &cases);
}

#[test]
fn the_density_on_a_needle_is_that_of_its_area_and_its_true_normal() {
    for height in [1e-2, 1e-4, 1e-6f32] {
        let mesh = needles(height);
        let mut worst = 0.0f64;
        for triangle in 0..mesh.indices.len() {
            let corners = mesh.triangle(triangle);
            let mut builder = LightSamplerBuilder::default();
            builder.push(corners, both_sides(1.0));
            let lights = builder.build(None, LightSampling::default());
            let [a, b, c] = corners.map(|c| c.as_dvec3());
            let cross = (b - a).cross(c - a);
            for index in 0..64 {
                let numbers = Sampler::new(SamplerKind::Sobol, 1, 0, 0, index);
                let light = lights
                    .sample(Vec3::ZERO, Vec3::ZERO, &numbers)
                    .expect("the needle is seen");
                let wi = light.wi.as_dvec3();
                // Where the direction meets the plane that the needle is in.
                let distance = a.dot(cross) / wi.dot(cross);
                let expected = distance * distance / (0.5 * cross.length() * wi.dot(cross.normalize()).abs());
                let error = (f64::from(light.pdf_w) / expected - 1.0).abs();
                // The direction is rounded to 6e-8, the cosine with it; the distance goes with its square.
                worst = worst.max(error * wi.dot(cross.normalize()).abs());
            }
        }
        println!("needles 1 : {height:e}: density off by {worst:.1e} / cos");
        assert!(worst < 1e-6, "needles 1 : {height:e}: {worst}");
    }
}

fn a_point_on_the_plane_of_an_emitter_gets_nothing_from_it<A: Accel>() {
    let mut worst = 0.0f64;
    for turn in turns() {
        // Beside the lamp in one plane; and where the lamp's plane cuts the floor at a right angle. Rounding puts the point
        // up to 2^-20 off a plane: that is the cosine per distance, or both of them; 1.1 and 0.1 are the shortest distances.
        let beside = plane(turn * Vec3::X * 2.0, turn, 0.9);
        let above = plane(
            turn * Vec3::Y,
            turn * Quat::from_rotation_z(0.5 * std::f32::consts::PI),
            0.9,
        );
        for (name, lamp, bound) in [("beside", beside, 1e-12), ("above", above, 2.5e-6)] {
            for (emission, mis) in [
                (support::emission(1.0), true),
                (both_sides(1.0), true),
                (both_sides(1.0), false),
            ] {
                let mut stage =
                    lit_plane(Vec3::ZERO, turn, 0.9).add_light(lamp.clone(), support::diffuse(0.5), emission);
                stage.0.camera.vfov_degrees = 1e-6;
                let seen = stage.prepare::<A>(&settings(mis)).mean(&settings(mis), 256, 0..4).mean;
                worst = worst.max(seen);
                assert!(
                    (0.0..bound).contains(&seen),
                    "{}: {name}, {turn}, mis {mis}: {seen}",
                    A::NAME
                );
            }
        }
    }
    println!("{}: on the plane {worst:.1e} at most", A::NAME);
}

fn a_point_on_an_emitter_shows_its_emission_alone<A: Accel>() {
    for turn in turns() {
        for radiance in [1e-30, 1.0, 1e30f32] {
            let mut stage = lit_plane(turn * Vec3::new(3.0, 2.0, 1.0), turn, 0.9);
            stage.0.objects[0].emission = Some(both_sides(radiance));
            for mis in [true, false] {
                let seen = stage.prepare::<A>(&settings(mis)).mean(&settings(mis), 256, 0..4).mean;
                assert_eq!(seen, f64::from(radiance), "{}: {turn}, mis {mis}", A::NAME);
            }
        }
    }
}

fn a_point_next_to_an_emitter_gets_all_that_it_sends<A: Accel>() {
    let distance = 1e-7;
    // Coordinates of 0.01 have 1e5 steps in that distance.
    let half = 0.01;
    let facing = plane(Vec3::Y * distance, Quat::from_rotation_x(std::f32::consts::PI), half);
    let upright = support::quad(Vec3::new(distance, 0.0, -half), Vec3::Z * 2.0 * half, Vec3::Y * half);
    let mut cases = Vec::new();
    for (name, lamp, eye) in [
        ("facing", facing, Vec3::new(0.0, 0.5 * distance, 0.0)),
        ("upright", upright, Vec3::new(-0.5 * half, 0.5 * half, 0.1 * half)),
    ] {
        let irradiance = irradiance(Vec3::ZERO, Quat::IDENTITY, 1.0, &lamp.positions);
        cases.push(Case {
            name: name.to_owned(),
            stage: lit_plane(Vec3::ZERO, Quat::IDENTITY, half)
                .seen_by(support::camera(eye, Vec3::ZERO, 1e-6, [1, 1]))
                .add_light(lamp, support::diffuse(0.0), support::emission(1.0)),
            mis: true,
            spp: 2048,
            irradiance,
        });
    }
    assert!((cases[0].irradiance / PI - 1.0).abs() < 1e-6 && (cases[1].irradiance / PI - 0.5).abs() < 1e-4);
    assert_irradiance::<A>("at 1e-7", &cases);
}

fn only_the_sides_that_emit_give_light<A: Accel>() {
    let mut cases = Vec::new();
    for radiance in [1e-30, 1.0, 1e30] {
        for inwards in [true, false] {
            for emission in [support::emission(radiance), both_sides(radiance)] {
                let lamp = support::cuboid(Vec3::new(-0.5, 1.0, -0.5), Vec3::new(0.5, 2.0, 0.5), inwards);
                // Of the box, a point below sees the bottom alone.
                let bottom = plane(Vec3::Y, Quat::IDENTITY, 0.5);
                let light = irradiance(Vec3::ZERO, Quat::IDENTITY, radiance, &bottom.positions);
                let irradiance = if inwards && !emission.both_sides { 0.0 } else { light };
                cases.extend([true, false].map(|mis| Case {
                    name: format!("{emission:?}, inwards {inwards}"),
                    stage: lit_plane(Vec3::ZERO, Quat::IDENTITY, 0.9).add_light(
                        lamp.clone(),
                        support::diffuse(0.0),
                        emission,
                    ),
                    mis,
                    spp: 1024,
                    irradiance,
                }));
            }
        }
    }
    assert_irradiance::<A>("sides", &cases);
}

fn triangles_without_area_do_not_disturb_an_emitter<A: Accel>() {
    let mut cases = Vec::new();
    let (square, irradiance) = square_above(1.0, 1.0, 3.0);
    let add = |positions: &[Vec3], indices: &[[u32; 3]], alone: bool| {
        let mut stage = square.clone();
        let mut mesh = (*stage.0.meshes[1]).clone();
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(positions.iter().map(|p| p.as_dvec3()));
        mesh.uvs.resize(mesh.positions.len(), glam::Vec2::ZERO);
        if alone {
            mesh.indices.clear();
        }
        mesh.indices.extend(indices.iter().map(|t| t.map(|i| first + i)));
        stage.0.meshes[1] = mesh.into();
        stage
    };
    // A point, an edge walked twice, three corners in line, and an area that an f32 cannot hold.
    let positions = [
        Vec3::new(0.1, 1.0, 0.1),
        Vec3::new(0.3, 1.0, 0.1),
        Vec3::new(0.2, 1.0, 0.1),
        Vec3::X * 1e-30,
        Vec3::Y * 1e-30,
        Vec3::Z * 1e-30,
    ];
    let indices = [[0, 0, 0], [0, 1, 0], [0, 1, 2], [3, 4, 5]];
    for alone in [false, true] {
        cases.extend([true, false].map(|mis| Case {
            name: format!("alone {alone}"),
            stage: add(&positions, &indices, alone),
            mis,
            spp: 1024,
            irradiance: if alone { 0.0 } else { irradiance },
        }));
    }
    assert_irradiance::<A>("degenerate", &cases);
}
