//! Scenes whose radiance follows from a closed form or from a quadrature in f64 that shares no code with the renderer.

mod support;

use embrace::accel::Accel;
use embrace::bsdf::SMOOTH_ALPHA;
use embrace::image::Image;
use embrace::integrator::{BounceSampling, Settings};
use embrace::light::{Emission, EnvSampling};
use embrace::material::{Material, Scattering, Spectrum};
use embrace::math::{DAffine3, DMat3, DVec3, Rgb, Vec3};
use embrace::scene::{Instancing, SceneOptions};
use embrace::texture::{Encoding, Texture, TextureMap};
use std::f64::consts::{PI, TAU};
use support::exact::{facing, grey_map, integrate_map, map_direction};
use support::{Significance, Stage, assert_mean, assert_same_images};

support::for_each_backend! {
    a_square_light_over_a_plane_gives_the_closed_form_factor
    a_light_shines_from_its_front_or_from_both_sides_as_it_says
    a_diffuse_convex_body_in_a_constant_environment_reflects_its_albedo
    a_hot_texel_lights_a_plane_by_its_interpolated_radiance_in_the_sun_and_in_the_shade
    a_textured_square_shows_its_texels_where_they_belong
    a_wall_of_opacity_three_tenths_passes_seven_tenths_to_cameras_and_to_shadow_rays
    depth_zero_is_emission_one_is_direct_light_and_two_adds_one_bounce
    instances_look_like_copies
}
support::for_each_backend! { but not brute:
    the_terminator_of_a_coarse_smooth_sphere_is_that_of_a_fine_one
    a_closed_smooth_sphere_leaks_no_light
}

fn seeded(seed: u64) -> Settings {
    Settings {
        seed,
        ..Settings::default()
    }
}

/// The plane y = 0, 20 wide, front side up.
fn floor() -> embrace::mesh::TriangleMesh {
    support::quad(Vec3::new(-10.0, 0.0, -10.0), Vec3::Z * 20.0, Vec3::X * 20.0)
}

/// The square |x|, |z| < 1 at height y, front side down or up.
fn ceiling(y: f32, down: bool) -> embrace::mesh::TriangleMesh {
    let (u, v) = (Vec3::X * 2.0, Vec3::Z * 2.0);
    let corner = Vec3::new(-1.0, y, -1.0);
    if down {
        support::quad(corner, u, v)
    } else {
        support::quad(corner, v, u)
    }
}

/// Form factor of the rectangle [x0, x1] x [z0, z1] at height `h`, from a point of a parallel plane at the origin: the
/// sum over corners of Howell's configuration C-11.
fn form_factor(h: f64, x: [f64; 2], z: [f64; 2]) -> f64 {
    let corner = |x: f64, z: f64| {
        let (x, z) = (x / h, z / h);
        let (a, b) = ((1.0 + x * x).sqrt(), (1.0 + z * z).sqrt());
        (x / a * (z / a).atan() + z / b * (x / b).atan()) / TAU
    };
    corner(x[1], z[1]) - corner(x[0], z[1]) - corner(x[1], z[0]) + corner(x[0], z[0])
}

fn a_square_light_over_a_plane_gives_the_closed_form_factor<A: Accel>() {
    let points = [(0.0f32, 0.0f32), (0.5, 0.2), (1.0, 1.0), (3.0, -2.0)];
    for (x, z) in points {
        let (x64, z64) = (f64::from(x), f64::from(z));
        let expected = 3.0 * 0.6 * form_factor(1.5, [-1.0 - x64, 1.0 - x64], [-1.0 - z64, 1.0 - z64]);
        let lit = Stage::new(support::probe(Vec3::new(x + 2.0, 1.0, z), Vec3::new(x, 0.0, z)))
            .add(floor(), support::diffuse(0.6))
            .add_light(ceiling(1.5, true), support::diffuse(0.0), support::emission(3.0))
            .prepare::<A>(&Settings::default());
        for mis in [true, false] {
            let settings = Settings { mis, ..seeded(1) };
            assert_mean(
                &format!("{}: at ({x}, {z}), mis {mis}", A::NAME),
                lit.mean(&settings, 1024, 0..32),
                expected,
                Significance::TEST.split(8),
            );
        }
    }
}

fn a_light_shines_from_its_front_or_from_both_sides_as_it_says<A: Accel>() {
    let form = 0.6 * form_factor(1.5, [-1.0, 1.0], [-1.0, 1.0]);
    for (down, both_sides, expected) in [
        (true, false, form),
        (false, false, 0.0),
        (true, true, form),
        (false, true, form),
    ] {
        let emission = Emission {
            radiance: Rgb::WHITE,
            both_sides,
        };
        let stage = Stage::new(support::probe(Vec3::new(2.0, 1.0, 0.0), Vec3::ZERO))
            .add(floor(), support::diffuse(0.6))
            .add_light(ceiling(1.5, down), support::diffuse(0.0), emission);
        let name = format!("{}: front down {down}, both sides {both_sides}", A::NAME);
        assert_mean(
            &name,
            stage.prepare::<A>(&seeded(2)).mean(&seeded(2), 1024, 0..32),
            expected,
            Significance::TEST.split(4),
        );
        for (eye, front) in [(0.5, down), (2.5, !down)] {
            let eye = support::probe(Vec3::new(0.1, eye, 0.1), Vec3::new(0.1, 1.5, 0.1));
            let seen = stage.seen_by(eye).prepare::<A>(&seeded(2)).mean(&seeded(2), 4, 0..2);
            let expected = if front || both_sides { 1.0 } else { 0.0 };
            assert_eq!(seen.mean, expected, "{name}: seen directly, from the front: {front}");
        }
    }
}

fn a_diffuse_convex_body_in_a_constant_environment_reflects_its_albedo<A: Accel>() {
    for bounce_sampling in [BounceSampling::Bsdf, BounceSampling::Uniform] {
        for (x, y) in [(0.0, 0.0), (0.5, 0.3), (-0.2, 0.7)] {
            let body = Stage::new(support::probe(Vec3::new(x, y, 5.0), Vec3::new(x, y, 0.0)))
                .add(support::sphere(Vec3::ZERO, 1.0, 6, false), support::diffuse(0.7))
                .lit_by_constant(2.0)
                .prepare::<A>(&Settings::default());
            let settings = Settings {
                bounce_sampling,
                ..seeded(3)
            };
            assert_mean(
                &format!("{}: {bounce_sampling:?} at ({x}, {y})", A::NAME),
                body.mean(&settings, 1024, 0..24),
                1.4,
                Significance::TEST.split(6),
            );
        }
    }
}

fn a_hot_texel_lights_a_plane_by_its_interpolated_radiance_in_the_sun_and_in_the_shade<A: Accel>() {
    // The sun stands in column 20 of 64 (u = 0.32, between +X and +Z), row 10 of 32: 59 degrees from the zenith.
    let (column, row) = (20, 10);
    let sky = grey_map(64, 32, |x, y| if (x, y) == (column, row) { 1e6 } else { 1.0 });
    let sun = map_direction((f64::from(column) + 0.5) / 64.0, (f64::from(row) + 0.5) / 32.0);
    // The blocker is a square before the sun; all of the texel and its neighbours are behind it.
    let centre = sun * 2.0;
    let (side, half) = (sun.cross(DVec3::Y).normalize(), 0.6);
    let up = side.cross(sun);
    let behind = |d: DVec3| {
        let t = 2.0 / d.dot(sun);
        let offset = d * t - centre;
        t > 0.0 && offset.dot(side).abs() < half && offset.dot(up).abs() < half
    };
    let corner = (centre - (side + up) * half).as_vec3();
    let (u, v) = ((side * 2.0 * half).as_vec3(), (up * 2.0 * half).as_vec3());

    // Depth 1: the blocker would else light the plane by what it reflects.
    let settings = Settings {
        max_depth: Some(1),
        ..seeded(4)
    };
    let open = Stage::new(support::probe(Vec3::new(-2.0, 2.0, 0.5), Vec3::ZERO))
        .add(floor(), support::diffuse(0.5))
        .lit_by_map(sky.clone(), 0.0);
    let shaded = open.clone().add(support::quad(corner, u, v), support::diffuse(0.0));
    let up = facing(Vec3::Y);
    for (name, stage, expected) in [
        ("sunlit", &open, integrate_map(&sky, &up)),
        (
            "shaded",
            &shaded,
            integrate_map(&sky, |d| if behind(d) { 0.0 } else { up(d) }),
        ),
    ] {
        // In the shade next to nothing of what is drawn arrives: the same number has to come from the few that do.
        assert_mean(
            &format!("{}: {name}", A::NAME),
            stage.prepare::<A>(&settings).mean(&settings, 4096, 0..32),
            0.5 * expected / PI,
            Significance::TEST.split(4),
        );
        let uniform = Settings {
            env_sampling: EnvSampling::Uniform,
            bounce_sampling: BounceSampling::Cosine,
            ..settings
        };
        assert_mean(
            &format!("{}: {name}, sampled uniformly", A::NAME),
            stage.prepare::<A>(&uniform).mean(&uniform, 4096, 0..32),
            0.5 * expected / PI,
            Significance::TEST.split(4),
        );
    }
}

fn a_textured_square_shows_its_texels_where_they_belong<A: Accel>() {
    // Rows from the top: red, green; blue, white. Linear, so that bytes are albedos.
    let texture = Texture::Rgb8(
        Image {
            width: 2,
            height: 2,
            pixels: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]],
        },
        Encoding::Linear,
    );
    let map = TextureMap::new(0);
    let material = support::opaque(Scattering::Diffuse {
        reflectance: Spectrum::Bitmap(map, Rgb::splat(0.5)),
    });
    for (u, v, expected) in [
        (0.25, 0.75, [0.5, 0.0, 0.0]),
        (0.75, 0.75, [0.0, 0.5, 0.0]),
        (0.25, 0.25, [0.0, 0.0, 0.5]),
        (0.75, 0.25, [0.5, 0.5, 0.5]),
        (0.5, 0.75, [0.25, 0.25, 0.0]),
    ] {
        // Texture coordinates are the plane's x and y: u to the right, v up.
        let mut stage = Stage::new(support::probe(Vec3::new(u, v, 2.0), Vec3::new(u, v, 0.0)))
            .add(support::quad(Vec3::ZERO, Vec3::X, Vec3::Y), material.clone())
            .lit_by_constant(1.0);
        stage.0.textures.push(texture.clone());
        let summary = stage.prepare::<A>(&seeded(5)).replicate(&seeded(5), 256, 0..16);
        for (c, (seen, expected)) in summary.channels.iter().zip(expected).enumerate() {
            // The pixel is 2e-5 of a texel wide.
            assert!(
                (seen.mean - expected).abs() < 1e-4 + 5.0 * seen.standard_error,
                "{}: channel {c} at ({u}, {v}): {seen:?} for {expected}",
                A::NAME,
            );
        }
    }
}

fn a_wall_of_opacity_three_tenths_passes_seven_tenths_to_cameras_and_to_shadow_rays<A: Accel>() {
    let wall = Material {
        opacity: Some(Spectrum::Constant(Rgb::splat(0.3))),
        ..support::diffuse(0.0)
    };
    // The camera looks up at the light through the wall.
    let looking_up = support::probe(Vec3::new(0.1, 0.2, 0.1), Vec3::new(0.1, 1.5, 0.1));
    let looking_down = support::probe(Vec3::new(2.0, 0.5, 0.0), Vec3::ZERO);
    let stage = Stage::new(looking_up.clone())
        .add(floor(), support::diffuse(0.6))
        .add(
            support::quad(Vec3::new(-10.0, 1.0, -10.0), Vec3::Z * 20.0, Vec3::X * 20.0),
            wall,
        )
        .add_light(ceiling(1.5, true), support::diffuse(0.0), support::emission(2.0));
    let form = form_factor(1.5, [-1.0, 1.0], [-1.0, 1.0]);
    for (name, view, mis, expected) in [
        ("seen through it", &looking_up, true, 2.0 * 0.7),
        ("lit through it", &looking_down, true, 2.0 * 0.6 * form * 0.7),
        (
            "lit through it without mis",
            &looking_down,
            false,
            2.0 * 0.6 * form * 0.7,
        ),
    ] {
        let settings = Settings { mis, ..seeded(6) };
        assert_mean(
            &format!("{}: {name}", A::NAME),
            stage
                .seen_by(view.clone())
                .prepare::<A>(&settings)
                .mean(&settings, 2048, 0..32),
            expected,
            Significance::TEST.split(3),
        );
    }
}

fn depth_zero_is_emission_one_is_direct_light_and_two_adds_one_bounce<A: Accel>() {
    // A floor of albedo 0.6 under a light whose own albedo is 0.5: light that comes back to the floor needs depth 3.
    let stage = Stage::new(support::probe(Vec3::new(2.0, 1.0, 0.0), Vec3::ZERO))
        .add(floor(), support::diffuse(0.6))
        .add_light(ceiling(1.5, true), support::diffuse(0.5), support::emission(1.0));
    let looking_up = support::probe(Vec3::new(0.0, 0.2, 0.0), Vec3::new(0.0, 1.5, 0.0));
    let direct = 0.6 * form_factor(1.5, [-1.0, 1.0], [-1.0, 1.0]);
    // Depth 2 at the light: the floor's direct light, integrated over the hemisphere that the light's centre sees. The
    // floor is cut off at 10, which loses less than F beyond it times the light there.
    let returned = {
        let integrand = |x: f64, z: f64| {
            let d2 = x * x + z * z + 1.5 * 1.5;
            let here = 0.6 * form_factor(1.5, [-1.0 - x, 1.0 - x], [-1.0 - z, 1.0 - z]);
            here * 1.5 * 1.5 / (d2 * d2)
        };
        0.5 * 4.0 * support::integrate(&integrand, [0.0, 10.0], [0.0, 10.0], 1e-6) / PI
    };
    for (name, stage, max_depth, expected) in [
        ("floor", &stage, 0, 0.0),
        ("floor", &stage, 1, direct),
        ("floor", &stage, 2, direct),
        ("light", &stage.seen_by(looking_up.clone()), 0, 1.0),
        ("light", &stage.seen_by(looking_up.clone()), 1, 1.0),
        ("light", &stage.seen_by(looking_up.clone()), 2, 1.0 + returned),
    ] {
        let settings = Settings {
            max_depth: Some(max_depth),
            ..seeded(7)
        };
        assert_mean(
            &format!("{}: {name}, depth {max_depth}", A::NAME),
            stage.prepare::<A>(&settings).mean(&settings, 1024, 0..24),
            expected,
            Significance::TEST.split(6),
        );
    }
}

fn instances_look_like_copies<A: Accel>() {
    let place = |scale: DVec3, angle: f64, translation: DVec3| DAffine3 {
        matrix3: DMat3::from_rotation_y(angle) * DMat3::from_diagonal(scale),
        translation,
    };
    let places = [
        place(DVec3::splat(0.5), 0.3, DVec3::new(-1.0, 0.6, 0.0)),
        place(DVec3::new(0.3, 0.8, 0.5), 1.0, DVec3::new(0.5, 0.9, -0.5)),
        place(DVec3::new(-0.4, 0.4, 0.6), 2.0, DVec3::new(0.9, 0.5, 0.8)),
    ];
    let lamps = [
        DAffine3::from_translation(DVec3::new(0.0, 3.0, 0.0)),
        place(DVec3::new(-0.3, 0.3, 0.3), 0.5, DVec3::new(-2.0, 1.5, 1.0)),
    ];
    let glass = Scattering::Dielectric {
        ior: 1.5,
        alpha: 0.5 * SMOOTH_ALPHA,
    };
    let stage = Stage::new(support::camera(
        Vec3::new(0.5, 2.0, 5.0),
        Vec3::new(0.0, 0.6, 0.0),
        35.0,
        [16, 12],
    ))
    .add(floor(), support::diffuse(0.5))
    .add_at(
        support::sphere(Vec3::ZERO, 1.0, 5, true),
        support::diffuse(0.7),
        None,
        &places,
    )
    .add_at(
        support::sphere(Vec3::ZERO, 1.0, 4, false),
        support::opaque(glass),
        None,
        &[
            place(DVec3::splat(0.3), 0.3, DVec3::new(-0.3, 0.4, 1.2)),
            place(DVec3::new(0.3, -0.3, 0.3), 0.3, DVec3::new(1.6, 0.4, 0.0)),
        ],
    )
    .add_at(
        ceiling(0.0, true),
        support::diffuse(0.0),
        Some(support::emission(4.0)),
        &lamps,
    );
    let render = |instancing, seed| {
        let options = SceneOptions {
            instancing,
            ..SceneOptions::default()
        };
        let prepared = stage.build::<A>(options);
        let instances = if instancing == Instancing::Always { 7 } else { 0 };
        assert_eq!(prepared.scene.instances(), instances);
        let settings = Settings {
            max_depth: Some(4),
            ..seeded(seed)
        };
        prepared.replicate(&settings, 16, 0..24)
    };
    assert_same_images(
        &format!("{}: instances and copies", A::NAME),
        &render(Instancing::Always, 8),
        &render(Instancing::Never, 9),
        Significance::TEST,
    );
}

/// Mean brightness of a smooth sphere of so many rows in a band where light from +X comes in at 80 to 89 degrees, seen
/// from +Z. The sphere of 12 rows is turned so that the face from 83.5 to 98.5 degrees looks away from the light.
fn terminator<A: Accel>(rows: u32, smooth_terminator: bool) -> f64 {
    let (width, height) = (24u32, 4u32);
    // The band x = cos 89 to cos 80 degrees, y about 0, on a unit sphere lit by a far small lamp along +X.
    let band = [89.0f64, 80.0].map(|a| a.to_radians().cos() as f32);
    let middle = 0.5 * (band[0] + band[1]);
    let distance = 1000.0;
    let vfov = 2.0
        * f64::from(0.5 * (band[1] - band[0]) / distance * height as f32 / width as f32)
            .atan()
            .to_degrees();
    let lamp = support::quad(Vec3::new(100.0, -1.0, -1.0), Vec3::Z * 2.0, Vec3::Y * 2.0);
    let view = support::camera(
        Vec3::new(middle, 0.03, distance),
        Vec3::new(middle, 0.03, 0.0),
        vfov,
        [width, height],
    );
    let settings = Settings {
        smooth_terminator,
        max_depth: Some(1),
        ..seeded(10)
    };
    Stage::new(view)
        .add_at(
            support::sphere(Vec3::ZERO, 1.0, rows, true),
            support::diffuse(0.8),
            None,
            &[DAffine3::from_rotation_y(6.5f64.to_radians())],
        )
        .add_light(lamp, support::diffuse(0.0), support::emission(1e5))
        .prepare::<A>(&settings)
        .mean(&settings, 64, 0..8)
        .mean
}

fn the_terminator_of_a_coarse_smooth_sphere_is_that_of_a_fine_one<A: Accel>() {
    let fine = terminator::<A>(256, true);
    let lifted = terminator::<A>(12, true) / fine;
    let flat = terminator::<A>(12, false) / fine;
    assert!(
        (lifted - 1.0).abs() < 0.1,
        "{}: {lifted} of the fine sphere's light",
        A::NAME
    );
    assert!(
        flat < lifted - 0.1,
        "{}: {flat} without the lift, {lifted} with it",
        A::NAME
    );
}

fn a_closed_smooth_sphere_leaks_no_light<A: Accel>() {
    // From inside, in a bright environment: every path ends on the inner side.
    let inside = Stage::new(support::camera(Vec3::new(0.1, 0.2, 0.1), Vec3::X, 120.0, [16, 16]))
        .add(support::sphere(Vec3::ZERO, 1.0, 6, true), support::diffuse(0.9))
        .lit_by_constant(1e6)
        .prepare::<A>(&Settings::default());
    for smooth_terminator in [true, false] {
        let settings = Settings {
            smooth_terminator,
            ..seeded(11)
        };
        let image = inside.image(&settings, 64);
        let brightest = image.pixels.iter().map(|p| p.max_component()).fold(0.0, f32::max);
        assert_eq!(brightest, 0.0, "{}: smooth terminator {smooth_terminator}", A::NAME);
    }
}
