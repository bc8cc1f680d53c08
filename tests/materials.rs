//! Materials whose parts vary, mix, or differ by side: each against what it is made of.

mod support;

use embrace::accel::Accel;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::material::{Back, Checkerboard, General, Material, Principled, Relief, Scalar, Scattering, Spectrum};
use embrace::math::{Affine2, DVec3, Rgb, Vec2, Vec3};
use embrace::mesh::TriangleMesh;
use embrace::texture::{Texture, TextureMap};
use std::f64::consts::PI;
use support::exact::{facing, grey_map, integrate_map};
use support::{Stage, diffuse, for_each_backend, opaque, probe, quad};

for_each_backend! {
    a_mixture_scatters_the_weighted_mean_of_its_parts
    a_mixture_of_mixtures_takes_each_part_by_the_product_of_its_weights
    the_back_is_black_or_another_material_where_that_is_said
    the_principled_model_looks_alike_from_both_sides_unless_it_is_glass
    vertex_colours_are_interpolated_and_multiply_tint_and_bitmap
    a_checkerboard_shows_its_colours_in_turn
    a_map_of_straight_normals_changes_nothing
    a_tilted_normal_is_lit_as_a_tilted_surface_is
    the_relief_of_a_mixture_is_that_of_its_parts
    steep_relief_on_smooth_metal_is_not_black
}

fn settings() -> Settings {
    Settings {
        seed: 11,
        ..Settings::default()
    }
}

/// Radiance of the unit square at (`x`, `y`) under light of radiance 1 from everywhere, seen from the front or the back;
/// with five standard errors.
fn seen<A: Accel>(stage: &Stage, x: f32, y: f32, from_front: bool) -> [(f64, f64); 3] {
    let eye = Vec3::new(x, y, if from_front { 2.0 } else { -2.0 });
    let stage = stage.seen_by(probe(eye, Vec3::new(x, y, 0.0)));
    let summary = stage.prepare::<A>(&settings()).replicate(&settings(), 256, 0..16);
    summary.channels.map(|c| (c.mean, 1e-4 + 5.0 * c.standard_error))
}

fn assert_seen<A: Accel>(stage: &Stage, x: f32, y: f32, from_front: bool, expected: [f64; 3]) {
    let seen = seen::<A>(stage, x, y, from_front);
    for ((mean, bound), expected) in seen.into_iter().zip(expected) {
        assert!(
            (mean - expected).abs() < bound,
            "{}: {seen:?} for {expected} at ({x}, {y})",
            A::NAME
        );
    }
}

fn square(material: Material) -> Stage {
    Stage::new(probe(Vec3::Z, Vec3::ZERO))
        .add(quad(Vec3::ZERO, Vec3::X, Vec3::Y), material)
        .lit_by_constant(1.0)
}

fn blend(weight: f32, materials: [u32; 2]) -> Material {
    opaque(Scattering::General(General::Blend {
        weight: Scalar::Constant(weight),
        materials,
    }))
}

fn named(mut stage: Stage, material: Material) -> Stage {
    stage.0.materials.push(("part".into(), material));
    stage
}

fn colored(r: f32, g: f32, b: f32) -> Material {
    opaque(Scattering::Diffuse {
        reflectance: Spectrum::Constant(Rgb::new(r, g, b)),
    })
}

fn a_mixture_scatters_the_weighted_mean_of_its_parts<A: Accel>() {
    let stage = named(square(blend(0.25, [1, 2])), colored(0.8, 0.0, 0.4));
    let stage = named(stage, colored(0.0, 0.8, 0.4));
    assert_seen::<A>(&stage, 0.4, 0.3, true, [0.6, 0.2, 0.4]);
}

fn a_mixture_of_mixtures_takes_each_part_by_the_product_of_its_weights<A: Accel>() {
    let stage = named(square(blend(0.5, [1, 2])), colored(0.8, 0.0, 0.0));
    let stage = named(stage, blend(0.25, [1, 3]));
    let stage = named(stage, colored(0.0, 0.8, 0.0));
    assert_seen::<A>(&stage, 0.4, 0.3, true, [0.7, 0.1, 0.0]);
}

fn the_back_is_black_or_another_material_where_that_is_said<A: Accel>() {
    let black = Material {
        back: Back::Black,
        ..diffuse(0.5)
    };
    let stage = square(black);
    assert_seen::<A>(&stage, 0.4, 0.3, true, [0.5; 3]);
    assert_seen::<A>(&stage, 0.4, 0.3, false, [0.0; 3]);
    let pair = Material {
        back: Back::Material(1),
        ..diffuse(0.5)
    };
    let stage = named(square(pair), colored(0.1, 0.2, 0.3));
    assert_seen::<A>(&stage, 0.4, 0.3, true, [0.5; 3]);
    assert_seen::<A>(&stage, 0.4, 0.3, false, [0.1, 0.2, 0.3]);
    // The other side of the other side is not asked for.
    let pair = Material {
        back: Back::Material(1),
        ..diffuse(0.5)
    };
    let stage = named(
        square(pair),
        Material {
            back: Back::Black,
            ..colored(0.1, 0.2, 0.3)
        },
    );
    assert_seen::<A>(&stage, 0.4, 0.3, false, [0.1, 0.2, 0.3]);
}

fn the_principled_model_looks_alike_from_both_sides_unless_it_is_glass<A: Accel>() {
    let principled = |spec_trans: f32| {
        opaque(Scattering::General(General::Principled(Box::new(Principled {
            roughness: Scalar::Constant(0.4),
            clearcoat: Scalar::Constant(0.5),
            spec_trans: Scalar::Constant(spec_trans),
            ..Principled::new(Spectrum::Constant(Rgb::new(0.8, 0.4, 0.2)))
        }))))
    };
    let opaque = square(principled(0.0));
    let front = seen::<A>(&opaque, 0.4, 0.3, true);
    assert!(front[0].0 > 0.5, "{front:?}");
    assert_seen::<A>(&opaque, 0.4, 0.3, false, front.map(|(mean, _)| mean));
    // From inside, more is reflected at the surface.
    let glass = square(principled(0.9));
    let [outside, inside] = [true, false].map(|front| seen::<A>(&glass, 0.4, 0.3, front)[0]);
    let bound = outside.1 + inside.1;
    assert!((outside.0 - inside.0).abs() > bound, "{outside:?} and {inside:?}");
}

fn vertex_colours_are_interpolated_and_multiply_tint_and_bitmap<A: Accel>() {
    let mesh = TriangleMesh {
        colors: vec![
            Rgb::new(1.0, 0.0, 0.0),
            Rgb::new(0.0, 1.0, 0.0),
            Rgb::new(0.0, 1.0, 1.0),
            Rgb::new(1.0, 0.0, 1.0),
        ],
        ..quad(Vec3::ZERO, Vec3::X, Vec3::Y)
    };
    let bitmap = Texture::Rgb32(Image {
        width: 1,
        height: 1,
        pixels: vec![Rgb::new(0.5, 1.0, 1.0)],
    });
    for (map, factor) in [(None, 1.0), (Some(TextureMap::new(0)), 0.5)] {
        let material = opaque(Scattering::Diffuse {
            reflectance: Spectrum::VertexColor(map, Rgb::splat(0.5)),
        });
        let mut stage = Stage::new(probe(Vec3::Z, Vec3::ZERO))
            .add(mesh.clone(), material)
            .lit_by_constant(1.0);
        stage.0.textures.push(bitmap.clone());
        for (x, y) in [(0.25, 0.125), (0.75, 0.5), (0.125, 0.875)] {
            let (u, v) = (f64::from(x), f64::from(y));
            let expected = [0.5 * factor * (1.0 - u), 0.5 * u, 0.5 * v];
            assert_seen::<A>(&stage, x, y, true, expected);
        }
    }
}

fn a_checkerboard_shows_its_colours_in_turn<A: Accel>() {
    let pattern = Checkerboard {
        to_uv: Affine2::from_scale(Vec2::new(2.0, 1.0)),
        colors: [Rgb::splat(0.2), Rgb::splat(0.7)],
    };
    let stage = square(opaque(Scattering::Diffuse {
        reflectance: Spectrum::Checkerboard(pattern),
    }));
    for (x, y, expected) in [
        (0.1, 0.1, 0.2),
        (0.4, 0.1, 0.7),
        (0.6, 0.1, 0.2),
        (0.1, 0.8, 0.7),
        (0.4, 0.8, 0.2),
    ] {
        assert_seen::<A>(&stage, x, y, true, [expected; 3]);
    }
}

/// A sky that is dark but around +y.
fn window() -> Image<Rgb> {
    grey_map(64, 32, |_, y| if y < 4 { 100.0 } else { 0.0 })
}

/// Light that a square reflects with this normal map everywhere, and its standard error.
fn under_a_window<A: Accel>(normal: Option<Rgb>, mesh: TriangleMesh, from: Vec3) -> (f64, f64) {
    of_under_a_window::<A>(diffuse(0.5), normal, mesh, from)
}

/// The same for a material of which the second may be a part.
fn of_under_a_window<A: Accel>(material: Material, normal: Option<Rgb>, mesh: TriangleMesh, from: Vec3) -> (f64, f64) {
    let material = Material {
        relief: normal.map(|_| Relief::NormalMap {
            map: TextureMap::new(0),
            scale: 1.0,
        }),
        ..material
    };
    let stage = Stage::new(probe(from, Vec3::new(0.3, 0.3, 0.0)))
        .add(mesh, material)
        .lit_by_map(window(), 0.0);
    let mut stage = named(stage, diffuse(0.5));
    stage.0.textures.push(Texture::Rgb32(Image {
        width: 1,
        height: 1,
        pixels: vec![normal.unwrap_or(Rgb::WHITE)],
    }));
    // Direct light alone: the tilted square would light itself.
    let settings = Settings {
        max_depth: Some(1),
        ..settings()
    };
    let summary = stage.prepare::<A>(&settings).replicate(&settings, 512, 0..16);
    (summary.channels[0].mean, summary.channels[0].standard_error)
}

fn a_map_of_straight_normals_changes_nothing<A: Accel>() {
    let mesh = || quad(Vec3::ZERO, Vec3::X, Vec3::Y);
    let from = Vec3::new(0.5, 1.0, 2.0);
    let (plain, _) = under_a_window::<A>(None, mesh(), from);
    let (mapped, error) = under_a_window::<A>(Some(Rgb::new(0.5, 0.5, 1.0)), mesh(), from);
    assert!(plain > 0.5, "{plain}");
    assert!((plain - mapped).abs() < 0.1 * error, "{mapped} for {plain}");
}

fn a_tilted_normal_is_lit_as_a_tilted_surface_is<A: Accel>() {
    let from = Vec3::new(0.5, 1.0, 2.0);
    // Tilted by 30 degrees, upwards and to the right: both sums differ from those of the plain square.
    for tilt in [Vec3::Y, Vec3::new(0.8, 0.6, 0.0)] {
        let normal = (Vec3::Z * 30f32.to_radians().cos() + tilt * 30f32.to_radians().sin()).normalize();
        let map = (normal * 0.5 + 0.5).to_array();
        let (mapped, error) = under_a_window::<A>(Some(Rgb::from(map)), quad(Vec3::ZERO, Vec3::X, Vec3::Y), from);
        // The tilted square sees more of the window than the straight one, whose horizon cuts it in half.
        let turned = glam::Quat::from_rotation_arc(Vec3::Z, normal);
        let corner = Vec3::new(0.3, 0.3, 0.0) - turned * Vec3::new(0.3, 0.3, 0.0);
        let tilted = quad(corner, turned * Vec3::X, turned * Vec3::Y);
        let (whole, whole_error) = under_a_window::<A>(None, tilted, from);
        assert!(mapped < whole, "{mapped} is of a part of {whole}");
        // What the relief takes away where light comes in low.
        let tan_squared = |cos: f64| 1.0 / (cos * cos) - 1.0;
        let alpha_squared = (tan_squared(f64::from(normal.z)) / 8.0).min(1.0);
        let reaches = |d: DVec3| 2.0 / (1.0 + (1.0 + alpha_squared * tan_squared(d.z)).sqrt());
        let above = |d: DVec3| if d.z > 0.0 { facing(normal)(d) * reaches(d) } else { 0.0 };
        let expected = 0.5 / PI * integrate_map(&window(), above);
        assert!(
            (mapped - expected).abs() < 1e-4 + 5.0 * error,
            "{}: {mapped} ± {error} for {expected}; tilted {whole} ± {whole_error}",
            A::NAME
        );
    }
}

fn the_relief_of_a_mixture_is_that_of_its_parts<A: Accel>() {
    let from = Vec3::new(0.5, 1.0, 2.0);
    let mesh = || quad(Vec3::ZERO, Vec3::X, Vec3::Y);
    let tilted = Some(Rgb::from((Vec3::new(0.0, 0.5, 0.75f32.sqrt()) * 0.5 + 0.5).to_array()));
    let (plain, _) = under_a_window::<A>(None, mesh(), from);
    let (relief, error) = under_a_window::<A>(tilted, mesh(), from);
    assert!((relief - plain).abs() > 20.0 * error, "{relief} and {plain}");
    // Twice the same, which has no relief of its own.
    let (mixed, mixed_error) = of_under_a_window::<A>(blend(0.5, [1, 1]), tilted, mesh(), from);
    assert!(
        (mixed - relief).abs() < 5.0 * (error + mixed_error),
        "{}: {mixed} for {relief}",
        A::NAME
    );
}

fn steep_relief_on_smooth_metal_is_not_black<A: Accel>() {
    // Tilted by 50 degrees away from an eye at 30 degrees on the other side: the mirror direction is below the surface.
    let normal = Vec3::new(0.0, 50f32.to_radians().sin(), 50f32.to_radians().cos());
    let mut material = opaque(Scattering::Mirror {
        reflectance: Rgb::WHITE,
    });
    material.relief = Some(Relief::NormalMap {
        map: TextureMap::new(0),
        scale: 1.0,
    });
    let mut stage = square(material);
    stage.0.textures.push(Texture::Rgb32(Image {
        width: 1,
        height: 1,
        pixels: vec![Rgb::from((normal * 0.5 + 0.5).to_array())],
    }));
    let (sin, cos) = 30f32.to_radians().sin_cos();
    let point = Vec3::new(0.4, 0.3, 0.0);
    let stage = stage.seen_by(probe(point + Vec3::new(0.0, -sin, cos), point));
    let summary = stage.prepare::<A>(&settings()).replicate(&settings(), 64, 0..4);
    let mean = summary.channels[0].mean;
    assert!(mean > 0.5, "{}: {mean}", A::NAME);
}
