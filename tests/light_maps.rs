//! Emission that varies over a surface, and environment maps that are turned any way.

mod support;

use embrace::accel::Accel;
use embrace::image::Image;
use embrace::integrator::Settings;
use embrace::light::{EnvSampling, Environment, EnvironmentError, LightSampling};
use embrace::material::{Checkerboard, Spectrum};
use embrace::math::{Affine2, DAffine3, DMat3, DVec3, Rgb, Vec2, Vec3};
use embrace::scene::{EnvironmentDesc, Instancing, Scene, SceneOptions};
use embrace::texture::{Encoding, Filter, Texture, TextureMap};
use std::f64::consts::PI;
use support::exact::{facing, grey_map, integrate_map};
use support::{Prepared, Random, Significance, Stage, assert_mean, assert_same_images};

support::for_each_backend! { but not brute:
    a_textured_emitter_is_the_same_as_its_pieces_of_one_radiance
    what_a_camera_sees_of_a_textured_emitter_are_its_texels
    a_mirrored_instance_of_a_textured_emitter_is_a_copy_of_it
    an_environment_turned_any_way_lights_a_plane_as_its_turned_map_says
}

/// Radiance of the texels, rows from the top. Some are black, and one is much brighter than the rest.
const TEXELS: [[u8; 4]; 4] = [[0, 0, 255, 20], [0, 10, 0, 0], [30, 0, 60, 0], [0, 0, 0, 5]];

fn texture() -> Texture {
    let grey = TEXELS.as_flattened().iter().map(|v| [*v, *v / 2, *v]);
    Texture::Rgb8(
        Image {
            width: 4,
            height: 4,
            pixels: grey.collect(),
        },
        Encoding::Linear,
    )
}

fn map() -> Spectrum {
    let nearest = TextureMap {
        filter: Filter::Nearest,
        ..TextureMap::new(0)
    };
    Spectrum::Bitmap(nearest, Rgb::WHITE)
}

fn floor_and_ball(camera: embrace::camera::CameraDesc) -> Stage {
    Stage::new(camera)
        .add(
            support::quad(Vec3::new(-5.0, 0.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0),
            support::diffuse(0.5),
        )
        .add(
            support::sphere(Vec3::new(0.3, 0.3, 0.3), 0.3, 6, false),
            support::diffuse(0.7),
        )
}

fn view() -> embrace::camera::CameraDesc {
    support::camera(Vec3::new(0.5, 2.0, 5.0), Vec3::new(0.0, 0.8, 0.0), 45.0, [12, 8])
}

/// The corner and the sides of the square lamp: front side down.
const LAMP: [Vec3; 3] = [
    Vec3::new(-1.0, 1.6, -1.0),
    Vec3::new(2.0, 0.0, 0.0),
    Vec3::new(0.0, 0.0, 2.0),
];

/// Lit by the lamp, as one square, in these places.
fn textured(camera: embrace::camera::CameraDesc, map: Spectrum, places: &[DAffine3]) -> Stage {
    let [corner, u, v] = LAMP;
    let mut stage = floor_and_ball(camera).add_at(
        support::quad(corner, u, v),
        support::diffuse(0.2),
        Some(support::emission(20.0)),
        places,
    );
    for object in &mut stage.0.objects[2..] {
        object.emission_map = Some(map);
    }
    stage.0.textures.push(texture());
    stage
}

/// The same, a square of one radiance for each texel.
fn in_pieces(camera: embrace::camera::CameraDesc) -> Stage {
    let [corner, u, v] = LAMP;
    let mut stage = floor_and_ball(camera);
    for (row, texels) in TEXELS.iter().enumerate() {
        for (column, value) in texels.iter().enumerate() {
            let piece = corner + u * (0.25 * column as f32) + v * (0.25 * (3 - row) as f32);
            let channel = |value: u8| 20.0 * f32::from(value) / 255.0;
            let mut emission = support::emission(1.0);
            emission.radiance = Rgb::new(channel(*value), channel(*value / 2), channel(*value));
            stage = stage.add_light(
                support::quad(piece, u * 0.25, v * 0.25),
                support::diffuse(0.2),
                emission,
            );
        }
    }
    stage
}

fn settings(seed: u64) -> Settings {
    Settings {
        max_depth: Some(3),
        seed,
        ..Settings::default()
    }
}

fn a_textured_emitter_is_the_same_as_its_pieces_of_one_radiance<A: Accel>() {
    let pieces = in_pieces(view())
        .prepare::<A>(&settings(1))
        .replicate(&settings(1), 64, 0..32);
    let whole = textured(view(), map(), &[DAffine3::IDENTITY]);
    for (seed, mis, light_sampling) in [
        (2, true, LightSampling::Contribution),
        (3, false, LightSampling::Contribution),
        (4, true, LightSampling::Power),
    ] {
        let settings = Settings {
            mis,
            light_sampling,
            ..settings(seed)
        };
        let found = whole.prepare::<A>(&settings).replicate(&settings, 64, 0..32);
        let name = format!("{}: textured emitter, mis {mis}, {light_sampling:?}", A::NAME);
        assert_same_images(&name, &found, &pieces, Significance::TEST.split(3));
    }
}

fn what_a_camera_sees_of_a_textured_emitter_are_its_texels<A: Accel>() {
    let [corner, u, v] = LAMP;
    for (row, texels) in TEXELS.iter().enumerate() {
        for (column, value) in texels.iter().enumerate() {
            let at = corner + u * (0.25 * column as f32 + 0.1) + v * (0.25 * (3 - row) as f32 + 0.1);
            let eye = support::probe(at - Vec3::Y * 0.5, at);
            let settings = Settings {
                max_depth: Some(0),
                ..settings(5)
            };
            let seen = textured(eye, map(), &[DAffine3::IDENTITY])
                .prepare::<A>(&settings)
                .mean(&settings, 2, 0..2);
            let expected = 20.0 * (2.0 * f64::from(*value) + f64::from(*value / 2)) / (3.0 * 255.0);
            assert!(
                (seen.mean - expected).abs() <= 1e-5 * expected,
                "{}: row {row}, column {column}: {seen:?} for {expected}",
                A::NAME
            );
        }
    }
}

fn a_mirrored_instance_of_a_textured_emitter_is_a_copy_of_it<A: Accel>() {
    let mirrored = DAffine3 {
        matrix3: DMat3::from_diagonal(DVec3::new(-0.5, 1.0, 0.5)),
        translation: DVec3::new(1.5, 0.2, 0.0),
    };
    let turned = DAffine3::from_rotation_y(0.7) * DAffine3::from_scale(DVec3::splat(0.5));
    let stage = textured(view(), map(), &[mirrored, turned]);
    let render = |instancing, seed| {
        let options = SceneOptions {
            instancing,
            mis: true,
            ..SceneOptions::default()
        };
        let prepared: Prepared<A> = stage.build(options);
        assert_eq!(prepared.scene.instances() > 0, instancing == Instancing::Always);
        prepared.replicate(&settings(seed), 64, 0..24)
    };
    assert_same_images(
        &format!("{}: textured instances and copies", A::NAME),
        &render(Instancing::Always, 6),
        &render(Instancing::Never, 7),
        Significance::TEST,
    );
}

#[test]
fn black_maps_give_no_light_and_detail_between_the_texels_looked_at_is_not_lost() {
    let mut stage = textured(view(), map(), &[DAffine3::IDENTITY]);
    stage.0.textures[0] = Texture::Rgb8(
        Image {
            width: 2,
            height: 2,
            pixels: vec![[0; 3]; 4],
        },
        Encoding::Srgb,
    );
    let scene = Scene::build(stage.0, SceneOptions::default()).expect("a valid scene");
    assert_eq!(scene.lights.len(), 0);
    // One texel of 16 million.
    let mut stage = textured(view(), map(), &[DAffine3::IDENTITY]);
    let mut image = Image {
        width: 4096,
        height: 4096,
        pixels: vec![[0; 3]; 4096 * 4096],
    };
    image.pixels[1234 * 4096 + 777] = [255; 3];
    stage.0.textures[0] = Texture::Rgb8(image, Encoding::Srgb);
    let scene = Scene::build(stage.0, SceneOptions::default()).expect("a valid scene");
    assert_eq!(scene.lights.len(), 2);
    for triangle in 0..2 {
        assert!(scene.lights.area_pmf(triangle, Vec3::ZERO, Vec3::Y) > 0.0);
    }
}

#[test]
fn triangles_are_drawn_by_the_mean_of_their_map() {
    // A checkerboard of four fields; the square is cut along the diagonal of two of the same colour.
    let pattern = |colors: [f32; 2]| {
        Spectrum::Checkerboard(Checkerboard {
            to_uv: Affine2::from_scale(Vec2::splat(1.0)),
            colors: colors.map(Rgb::splat),
        })
    };
    let share = |map: Spectrum, object: usize| {
        let mut stage = textured(view(), map, &[DAffine3::IDENTITY]);
        let [corner, u, v] = LAMP;
        stage = stage.add_light(
            support::quad(corner, u, v),
            support::diffuse(0.0),
            support::emission(20.0),
        );
        let options = SceneOptions {
            light_sampling: LightSampling::Power,
            ..SceneOptions::default()
        };
        let scene = Scene::build(stage.0, options).expect("a valid scene");
        f64::from(scene.lights.area_pmf(object as u32, Vec3::ZERO, Vec3::Y))
    };
    for (colors, mean) in [([1.0, 1.0], 1.0), ([1.0, 0.0], 0.5), ([0.2, 0.6], 0.4)] {
        let ratio = share(pattern(colors), 0) / share(pattern(colors), 2);
        assert!((ratio / mean - 1.0).abs() < 0.1, "{colors:?}: {ratio}");
    }
}

fn turns() -> Vec<DMat3> {
    let turn = DMat3::from_rotation_x(1.1) * DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(2.0);
    vec![
        DMat3::from_rotation_y(0.6),
        turn,
        turn * DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)),
        DMat3::from_rotation_x(-PI / 2.0),
    ]
}

fn sky() -> Image<Rgb> {
    grey_map(16, 8, |x, y| {
        if (x, y) == (3, 2) {
            40.0
        } else {
            0.2 + 0.05 * (x % 4) as f32
        }
    })
}

fn an_environment_turned_any_way_lights_a_plane_as_its_turned_map_says<A: Accel>() {
    let up = facing(Vec3::Y);
    for (k, turn) in turns().into_iter().enumerate() {
        let expected = 0.5 * integrate_map(&sky(), |d| up(turn * d)) / PI;
        for (env_sampling, mis) in [
            (EnvSampling::Importance, true),
            (EnvSampling::Importance, false),
            (EnvSampling::Uniform, false),
        ] {
            let mut stage = Stage::new(support::probe(Vec3::new(1.0, 1.0, 0.5), Vec3::ZERO)).add(
                support::quad(Vec3::new(-5.0, 0.0, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0),
                support::diffuse(0.5),
            );
            stage.0.environment = Some(EnvironmentDesc::Map {
                image: sky().into(),
                scale: 1.0,
                rotation_degrees: 0.0,
                to_world: turn,
            });
            let settings = Settings {
                env_sampling,
                mis,
                max_depth: Some(1),
                ..settings(8)
            };
            assert_mean(
                &format!("{}: turn {k}, {env_sampling:?}, mis {mis}", A::NAME),
                stage.prepare::<A>(&settings).mean(&settings, 1024, 0..24),
                expected,
                Significance::TEST.split(12),
            );
        }
    }
}

#[test]
fn a_turned_map_has_the_radiance_and_the_density_of_the_map_before_the_turn() {
    let mut random = Random(9);
    let map = || Environment::from_map(&sky(), 1.0, 25.0, EnvSampling::Importance).expect("a valid map");
    let plain = map();
    for turn in turns() {
        let turned = map().turned(turn).expect("a rotation");
        assert!((turned.fluence() / plain.fluence() - 1.0).abs() < 1e-12);
        for _ in 0..1000 {
            let texel = plain.choose_texel(random.bits());
            let u = random.pair();
            let (here, there) = (plain.sample(texel, u), turned.sample(texel, u));
            let expected = (turn * here.wi.as_dvec3()).as_vec3();
            assert!(there.wi.distance(expected) < 1e-6);
            let found = turned.eval(there.wi);
            let (radiance, pdf_w) = plain.lookup(&here);
            assert_eq!(turned.lookup(&there), (radiance, pdf_w));
            assert!((found.1 - pdf_w).abs() <= 1e-3 * (1.0 + pdf_w), "{found:?} for {pdf_w}");
            assert!(
                (found.0.r - radiance.r).abs() <= 1e-3 * (1.0 + radiance.r),
                "{found:?} for {radiance:?}"
            );
        }
    }
    assert_eq!(
        map().turned(DMat3::from_diagonal(DVec3::new(1.0, 1.01, 1.0))).err(),
        Some(EnvironmentError::Turn)
    );
    assert_eq!(
        map().turned(DMat3::from_diagonal(DVec3::NAN)).err(),
        Some(EnvironmentError::Turn)
    );
}

#[test]
fn a_turn_about_y_is_that_of_the_angle() {
    let angle = Environment::from_map(&sky(), 1.0, 40.0, EnvSampling::Importance).expect("a valid map");
    let turn = Environment::from_map(&sky(), 1.0, 0.0, EnvSampling::Importance)
        .and_then(|map| map.turned(DMat3::from_rotation_y(40f64.to_radians())))
        .expect("a rotation");
    let mut random = Random(10);
    for _ in 0..1000 {
        let wi = embrace::sampling::warp::uniform_sphere(random.pair());
        let ((a, pdf_a), (b, pdf_b)) = (angle.eval(wi), turn.eval(wi));
        assert!(
            (a.r - b.r).abs() < 1e-3 * (1.0 + a.r) && (pdf_a - pdf_b).abs() < 1e-3 * (1.0 + pdf_a),
            "{wi}"
        );
    }
}
