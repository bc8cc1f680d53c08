//! Input without area, without extent, without sense: a defined image or a clear error.

use crate::support::{
    Estimate, Random, Significance, Stage, assert_same_mean, camera, cuboid, diffuse, emission, for_each_backend, quad,
    sphere,
};
use embrace::accel::brute::Brute;
use embrace::accel::{Accel, BuildOptions, Geometry, Placement, Ray};
use embrace::camera::CameraDesc;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::light::Emission;
use embrace::math::{DAffine3, Rgb, Vec2, Vec3};
use embrace::mesh::TriangleMesh;
use glam::Quat;
use std::ops::Range;
use std::sync::Arc;

for_each_backend! {
    triangles_without_area_and_duplicates_do_not_change_an_image
    triangles_of_1e_30_do_not_change_an_image
    a_floor_of_1e17_gives_the_image_of_one_of_1e6
    triangles_beyond_the_largest_coordinate_do_not_change_an_image
    normals_that_are_none_give_the_image_without_normals
    flipped_windings_do_not_change_an_image
    every_angle_of_view_and_image_size_sees_a_room_of_light
    a_camera_on_a_surface_sees_the_room_beyond
}
for_each_backend! { but not brute:
    of_two_surfaces_in_the_same_place_one_is_hit
}

/// A box on a floor under a lamp and a sky.
fn stage(floor: TriangleMesh, block: TriangleMesh) -> Stage {
    let lamp = quad(Vec3::new(-0.5, 3.0, -0.5), Vec3::X, Vec3::Z);
    Stage::new(camera(
        Vec3::new(1.5, 2.0, 3.0),
        Vec3::new(0.0, 0.4, 0.0),
        35.0,
        [24, 18],
    ))
    .add(floor, diffuse(0.6))
    .add(block, diffuse(0.4))
    .add_light(lamp, diffuse(0.0), emission(5.0))
    .lit_by_constant(0.5)
}

fn floor(size: f32) -> TriangleMesh {
    quad(Vec3::new(-size, 0.0, -size), Vec3::Z * 2.0 * size, Vec3::X * 2.0 * size)
}

fn block() -> TriangleMesh {
    cuboid(Vec3::new(-0.4, 0.0, -0.3), Vec3::new(0.5, 0.7, 0.4), false)
}

fn settings() -> Settings {
    Settings {
        max_depth: Some(4),
        ..Settings::default()
    }
}

fn image<A: Accel>(stage: &Stage) -> Image<Rgb> {
    stage.prepare::<A>(&settings()).image(&settings(), 16)
}

fn mean_of<A: Accel>(stage: &Stage, seeds: Range<u64>) -> Estimate {
    stage.prepare::<A>(&settings()).mean(&settings(), 64, seeds)
}

fn add_triangle(mesh: &mut TriangleMesh, corners: [Vec3; 3]) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(corners);
    if !mesh.uvs.is_empty() {
        mesh.uvs.extend([Vec2::ZERO; 3]);
    }
    mesh.indices.push([first, first + 1, first + 2]);
}

fn triangles_without_area_and_duplicates_do_not_change_an_image<A: Accel>() {
    let expected = image::<A>(&stage(floor(5.0), block()));
    let (mut floor, mut block) = (floor(5.0), block());
    for mesh in [&mut floor, &mut block] {
        mesh.indices.extend(mesh.indices.clone());
        let [a, b, _] = mesh.triangle(0);
        add_triangle(mesh, [a; 3]);
        add_triangle(mesh, [a, b, a.lerp(b, 0.5)]);
        add_triangle(mesh, [a, b + Vec3::Y, b + Vec3::Y]);
    }
    assert_eq!(image::<A>(&stage(floor, block)).pixels, expected.pixels, "{}", A::NAME);
}

fn triangles_of_1e_30_do_not_change_an_image<A: Accel>() {
    let expected = image::<A>(&stage(floor(5.0), block()));
    let mut block = block();
    add_triangle(&mut block, [Vec3::ZERO, Vec3::X * 1e-30, Vec3::Y * 1e-30]);
    add_triangle(
        &mut block,
        [Vec3::Y, Vec3::Y + Vec3::X * 1e-30, Vec3::Y + Vec3::Z * 1e-30],
    );
    assert_eq!(
        image::<A>(&stage(floor(5.0), block)).pixels,
        expected.pixels,
        "{}",
        A::NAME
    );
}

fn triangles_beyond_the_largest_coordinate_do_not_change_an_image<A: Accel>() {
    let mut far = block();
    add_triangle(&mut far, [Vec3::NEG_X * 1e30, Vec3::X * 1e30, Vec3::Y * 1e30]);
    add_triangle(&mut far, [Vec3::NEG_X * 3e38, Vec3::X * 3e38, Vec3::Y * 3e38]);
    // The environment's share of the light samples goes by the size of the scene, so that noise differs.
    let [expected, found] = [block(), far].map(|block| mean_of::<A>(&stage(floor(5.0), block), 0..8));
    assert_same_mean(A::NAME, found, expected, Significance::TEST.split(3));
}

fn a_floor_of_1e17_gives_the_image_of_one_of_1e6<A: Accel>() {
    let [small, large] =
        [(1e6, 0..8), (1e17, 8..16)].map(|(size, seeds)| mean_of::<A>(&stage(floor(size), block()), seeds));
    assert_same_mean(A::NAME, large, small, Significance::TEST.split(3));
}

fn normals_that_are_none_give_the_image_without_normals<A: Accel>() {
    let expected = image::<A>(&stage(floor(5.0), block()));
    for bad in [Vec3::ZERO, Vec3::NAN, Vec3::INFINITY] {
        let mut mesh = block().into_f64();
        mesh.normals = vec![bad; mesh.positions.len()];
        assert_eq!(mesh.repair_normals(), mesh.positions.len());
        let block = mesh.into_f32(&DAffine3::IDENTITY);
        assert_eq!(
            image::<A>(&stage(floor(5.0), block)).pixels,
            expected.pixels,
            "{}: {bad}",
            A::NAME
        );
    }
}

fn flipped_windings_do_not_change_an_image<A: Accel>() {
    let expected = mean_of::<A>(&stage(floor(5.0), block()), 0..8);
    let mut block = block();
    block.indices.iter_mut().step_by(2).for_each(|t| t.swap(1, 2));
    let found = mean_of::<A>(&stage(floor(5.0), block), 8..16);
    assert_same_mean(A::NAME, found, expected, Significance::TEST.split(3));
}

/// Inside of a black ball that glows with radiance 1: whatever the view, every pixel is 1.
fn room_of_light<A: Accel>(view: CameraDesc) -> Vec<Rgb> {
    let glow = Emission {
        radiance: Rgb::WHITE,
        both_sides: true,
    };
    let stage = Stage::new(view)
        .add_light(sphere(Vec3::ZERO, 10.0, 8, false), diffuse(0.0), glow)
        .add(
            quad(Vec3::new(-1.0, -2.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0),
            diffuse(0.0),
        );
    image::<A>(&stage).pixels
}

fn every_angle_of_view_and_image_size_sees_a_room_of_light<A: Accel>() {
    for vfov in [1e-3, 1.0, 90.0, 179.9, 179.999] {
        for resolution in [[1, 1], [1, 7], [7, 1], [5, 3]] {
            let view = camera(Vec3::new(0.3, -1.0, 0.2), Vec3::new(0.4, 5.0, 1.0), vfov, resolution);
            // A wide view has the black square in it; the room is above.
            for (i, pixel) in room_of_light::<A>(view).iter().enumerate() {
                let upper = vfov < 100.0 || i < resolution[0] as usize && resolution[1] > 1;
                assert!(
                    !upper || *pixel == Rgb::WHITE,
                    "{}: {pixel:?} at {vfov} degrees, {resolution:?}",
                    A::NAME
                );
                assert!(pixel.is_finite() && pixel.r >= 0.0 && pixel.r <= 1.0);
            }
        }
    }
}

fn a_camera_on_a_surface_sees_the_room_beyond<A: Accel>() {
    for position in [
        Vec3::new(0.1, -2.0, 0.2),
        Vec3::new(0.0, -2.0, 0.0),
        Vec3::new(-1.0, -2.0, -1.0),
    ] {
        for look_at in [Vec3::new(0.1, 5.0, 0.3), Vec3::new(5.0, -1.0, 0.2)] {
            let pixels = room_of_light::<A>(camera(position, look_at, 10.0, [5, 5]));
            assert!(
                pixels.iter().all(|p| *p == Rgb::WHITE),
                "{}: {position} {look_at}: {pixels:?}",
                A::NAME
            );
        }
    }
}

/// Which of two surfaces in one plane is hit: the first in the scene where both are at the same distance to the bit, else
/// the nearer by rounding. Embree takes whichever it comes to first, so that it may differ; how often is printed.
fn of_two_surfaces_in_the_same_place_one_is_hit<A: Accel>() {
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, 0.7, -0.3);
    let square = |turn: Quat, spin: f32| TriangleMesh {
        positions: [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(x, y)| turn * Quat::from_rotation_z(spin) * Vec3::new(x, y, 0.0))
            .to_vec(),
        indices: vec![[0, 1, 2], [0, 2, 3]],
        ..TriangleMesh::default()
    };
    for (name, turn, spin) in [
        ("the same triangles", turn, 0.0),
        ("other triangles of a plane across the axes", turn, 0.5),
        ("other triangles of a plane along the axes", Quat::IDENTITY, 0.5),
    ] {
        let geometry = Geometry {
            meshes: [square(turn, 0.0), square(turn, spin)].map(Arc::new).to_vec(),
            placements: [0, 1].map(|mesh| Placement { mesh, to_world: None }).to_vec(),
        };
        let (backend, reference) = (
            A::build(&geometry, BuildOptions::default()).expect("the backend builds"),
            Brute::build(&geometry, BuildOptions::default()).expect("the reference builds"),
        );
        let mut random = Random(1);
        let (mut first, mut different) = (0, 0);
        const RAYS: usize = 100_000;
        for _ in 0..RAYS {
            let target = turn * Vec3::new(random.unit() - 0.5, random.unit() - 0.5, 0.0);
            let origin = Vec3::new(random.unit() - 0.5, random.unit() - 0.5, 4.0);
            let ray = Ray::new(origin, (target - origin).normalize());
            let (found, expected) = (
                backend.intersect(&ray).expect("a hit"),
                reference.intersect(&ray).expect("a hit"),
            );
            first += usize::from(found.placement == 0);
            different += usize::from(found.placement != expected.placement);
            assert!(
                (found.t - expected.t).abs() <= 4.0 * f32::EPSILON * expected.t,
                "{}: {name}",
                A::NAME
            );
        }
        let share = |n: usize| n as f64 / RAYS as f64;
        println!(
            "{} {name}: {:.3} hit the first, {:.3} another than the reference",
            A::NAME,
            share(first),
            share(different)
        );
        if A::NAME != "embree" {
            assert_eq!(different, 0, "{}: {name}", A::NAME);
        }
    }
}
