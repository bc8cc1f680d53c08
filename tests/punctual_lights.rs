//! Light from points and from far away against closed forms, and the choice of it among other emitters.

mod support;

use embrace::accel::Accel;
use embrace::integrator::{BounceSampling, Settings};
use embrace::light::{
    Chosen, DistantLight, Emission, Emitter, EnvSampling, Environment, LightSampler, LightSamplerBuilder,
    LightSampling, PunctualLight,
};
use embrace::material::{Checkerboard, Scattering, Spectrum};
use embrace::math::{Affine2, DVec3, Rgb, Vec2, Vec3};
use embrace::scene::{Falloff, LightDesc, Scene, SceneError, SceneOptions, SlideDesc};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use support::exact::grey_map;
use support::{Estimate, Random, Significance, Stage, assert_chi_square, assert_mean, assert_same_images};

support::for_each_backend! {
    points_and_spots_light_a_plane_by_the_inverse_square_law
    a_spot_casts_its_slide_from_edge_to_edge_of_its_cone
    parallel_light_brings_its_irradiance_times_the_cosine
    a_disc_lights_a_plane_as_quadrature_says_and_a_small_one_as_parallel_light
    a_camera_and_a_mirror_see_the_disc_and_nothing_beside_it
    lights_that_bring_nothing_or_stand_at_extreme_places_leave_samples_finite
    lights_stand_where_they_are_told_to_when_the_scene_is_far_away
}
support::for_each_backend! { but not brute:
    all_ways_of_sampling_agree_among_all_kinds_of_lights
}

const ALBEDO: f64 = 0.5;

fn point(position: DVec3, intensity: f32) -> LightDesc {
    LightDesc::Point {
        position,
        intensity: Rgb::splat(intensity),
    }
}

fn spot(position: DVec3, direction: DVec3, angles: [f64; 2], falloff: Falloff) -> LightDesc {
    LightDesc::Spot {
        slide: None,
        position,
        direction,
        intensity: Rgb::splat(5.0),
        angles: angles.map(f64::to_radians),
        falloff,
    }
}

/// The same spot with a slide.
fn casting(mut light: LightDesc, cast: SlideDesc) -> LightDesc {
    match &mut light {
        LightDesc::Spot { slide, .. } => *slide = Some(cast),
        other => panic!("{other:?} is no spot"),
    }
    light
}

fn distant(direction: DVec3, irradiance: f32, radius: f64) -> LightDesc {
    LightDesc::Distant {
        direction,
        irradiance: Rgb::splat(irradiance),
        radius,
    }
}

/// The plane y = 0, 20 wide, at `at`, and a view of its middle.
fn plane_at(at: DVec3) -> Stage {
    let mut stage = Stage::new(support::probe(Vec3::new(2.0, 1.0, 0.5), Vec3::ZERO)).add_at(
        support::quad(Vec3::new(-10.0, 0.0, -10.0), Vec3::Z * 20.0, Vec3::X * 20.0),
        support::diffuse(ALBEDO as f32),
        None,
        &[embrace::math::DAffine3::from_translation(at)],
    );
    stage.0.camera.position += at;
    stage.0.camera.look_at += at;
    stage
}

fn lit(lights: &[LightDesc]) -> Stage {
    let mut stage = plane_at(DVec3::ZERO);
    stage.0.lights.extend_from_slice(lights);
    stage
}

fn settings(mis: bool) -> Settings {
    Settings {
        mis,
        max_depth: Some(1),
        seed: 7,
        ..Settings::default()
    }
}

/// Irradiance at the middle of the plane, by what it reflects.
fn irradiance<A: Accel>(stage: &Stage, settings: &Settings, spp: u32) -> Estimate {
    let reflected = stage.prepare::<A>(settings).mean(settings, spp, 0..16);
    Estimate {
        mean: reflected.mean * PI / ALBEDO,
        standard_error: reflected.standard_error * PI / ALBEDO,
        ..reflected
    }
}

/// What does not depend on chance must be right to rounding.
#[track_caller]
fn assert_close(name: &str, estimate: Estimate, expected: f64) {
    let error = (estimate.mean / expected - 1.0).abs();
    assert!(
        error < 2e-5,
        "{name}: {} for {expected}, off by {error:.1e}",
        estimate.mean
    );
}

fn points_and_spots_light_a_plane_by_the_inverse_square_law<A: Accel>() {
    let position = DVec3::new(1.0, 2.0, -0.5);
    let inverse_square = 5.0 * position.y / position.length().powi(3);
    let share = |t: f64, falloff| if falloff == Falloff::Angle { t } else { t * t };
    let mut cases = vec![("point".to_owned(), point(position, 5.0), inverse_square)];
    // The axis passes the middle of the plane at these angles.
    for off in [0.0f64, 12.0, 25.0, 33.0, 70.0, 120.0] {
        let down = -position.normalize();
        let axis = down * off.to_radians().cos() + down.any_orthonormal_vector() * off.to_radians().sin();
        for angles in [[0.0f64, 40.0], [20.0, 30.0], [60.0, 90.0], [100.0, 179.0]] {
            for falloff in [Falloff::Angle, Falloff::Cosine] {
                let [beam, edge, here] = match falloff {
                    Falloff::Angle => [angles[0], angles[1], off],
                    Falloff::Cosine => [angles[0], angles[1], off].map(|angle| -angle.to_radians().cos()),
                };
                let t = ((edge - here) / (edge - beam)).clamp(0.0, 1.0);
                cases.push((
                    format!("spot {angles:?} {falloff:?}, {off} off"),
                    spot(position, axis * 3.0, angles, falloff),
                    inverse_square * share(t, falloff),
                ));
            }
        }
    }
    let (mut dark, mut partly) = (0, 0);
    for (name, light, expected) in &cases {
        for mis in [true, false] {
            let found = irradiance::<A>(&lit(std::slice::from_ref(light)), &settings(mis), 4);
            if *expected == 0.0 {
                assert_eq!(found.mean, 0.0, "{name}");
                dark += 1;
            } else {
                assert_close(&format!("{}: {name}, mis {mis}", A::NAME), found, *expected);
                partly += usize::from(*expected < inverse_square);
            }
        }
    }
    assert!(dark > 20 && partly > 20, "{dark} dark, {partly} partly lit");
}

fn a_spot_casts_its_slide_from_edge_to_edge_of_its_cone<A: Accel>() {
    const EDGE: f64 = 45.0;
    let colors = [0.25f32, 2.0];
    // A pattern of three fields along u and one along v.
    let pattern = Checkerboard {
        to_uv: Affine2::from_scale(Vec2::new(1.5, 0.5)),
        colors: colors.map(Rgb::splat),
    };
    // Any length does for the axes.
    let slide = SlideDesc {
        factor: Spectrum::Checkerboard(pattern),
        axes: [DVec3::Z * 3.0, DVec3::NEG_X * 0.5],
    };
    for (x, z) in [(0.5, 0.2), (-0.5, 0.9), (0.4, -0.9), (-0.6, -0.3), (0.1, 1.2)] {
        let position = DVec3::new(x, 2.0, z);
        let plain = spot(position, DVec3::NEG_Y * 0.1, [44.0, EDGE], Falloff::Angle);
        let found = irradiance::<A>(&lit(&[casting(plain.clone(), slide)]), &settings(true), 4);
        // The middle of the plane is seen from the light at −x and −z; the slide reaches to 2 on both sides there.
        let [u, v] = [-z, x].map(|c: f64| 0.5 + 0.5 * c / 2.0);
        let second_half = |c: f64| c.rem_euclid(1.0) > 0.5;
        let color = colors[usize::from(second_half(1.5 * u) != second_half(0.5 * v))];
        let inverse_square = 5.0 * position.y / position.length().powi(3);
        assert_close(
            &format!("{}: ({x}, {z})", A::NAME),
            found,
            inverse_square * f64::from(color),
        );
        let plain = irradiance::<A>(&lit(&[plain]), &settings(true), 4);
        assert_close("without", plain, inverse_square);
    }
    let wide = spot(DVec3::Y, DVec3::NEG_Y, [20.0, 90.0], Falloff::Angle);
    let stage = lit(&[casting(wide, slide)]);
    let error = Scene::build(stage.0, SceneOptions::default()).unwrap_err();
    assert!(error.to_string().contains("slide"), "{error}");
}

fn parallel_light_brings_its_irradiance_times_the_cosine<A: Accel>() {
    for direction in [DVec3::NEG_Y, DVec3::new(1.0, -2.0, 0.0), DVec3::new(-3.0, -0.2, 4.0)] {
        let expected = 3.0 * -direction.normalize().y;
        for bounce_sampling in [BounceSampling::Bsdf, BounceSampling::Uniform] {
            let settings = Settings {
                bounce_sampling,
                ..settings(true)
            };
            let found = irradiance::<A>(&lit(&[distant(direction, 3.0, 0.0)]), &settings, 4);
            assert_close(&format!("{}: along {direction}", A::NAME), found, expected);
        }
    }
    let from_below = irradiance::<A>(&lit(&[distant(DVec3::Y, 3.0, 0.0)]), &settings(true), 4);
    assert_eq!(from_below.mean, 0.0);
}

/// Irradiance on a plane that faces +Y from a disc of uniform radiance, parts of which may be below the horizon.
fn by_quadrature(towards: DVec3, facing: f64, radius: f64) -> f64 {
    let radiance = facing / (PI * radius.sin().powi(2));
    let n = towards.normalize();
    let (u, v) = n.any_orthonormal_pair();
    let integrand = |theta: f64, phi: f64| {
        let wi = n * theta.cos() + (u * phi.cos() + v * phi.sin()) * theta.sin();
        radiance * wi.y.max(0.0) * theta.sin()
    };
    support::integrate(&integrand, [0.0, radius], [0.0, TAU], 1e-7 * facing)
}

fn a_disc_lights_a_plane_as_quadrature_says_and_a_small_one_as_parallel_light<A: Accel>() {
    let directions = [DVec3::NEG_Y, DVec3::new(1.0, -2.0, 0.5), DVec3::new(-3.0, -0.4, 1.0)];
    let radii = [1e-5, 0.00465, 0.1, 0.5, 1.2];
    for direction in directions {
        for radius in radii {
            let expected = by_quadrature(-direction, 3.0, radius);
            for mis in [true, false] {
                let found = irradiance::<A>(&lit(&[distant(direction, 3.0, radius)]), &settings(mis), 512);
                let name = format!("{}: radius {radius} along {direction}, mis {mis}", A::NAME);
                assert_mean(&name, found, expected, Significance::TEST.split(30));
                if radius < 0.01 {
                    let parallel = 3.0 * -direction.normalize().y;
                    assert!(
                        (found.mean / parallel - 1.0).abs() < 1e-3,
                        "{name}: {found:?} for {parallel}"
                    );
                }
            }
        }
    }
}

fn a_camera_and_a_mirror_see_the_disc_and_nothing_beside_it<A: Accel>() {
    let (direction, radius) = (DVec3::new(0.3, -1.0, 0.2), 0.1f64);
    let radiance = 3.0 / (PI * radius.sin().powi(2));
    let towards = -direction.normalize();
    let aside = towards.any_orthonormal_vector();
    for (off, expected) in [(0.0f64, radiance), (0.095, radiance), (0.105, 0.0), (2.0, 0.0)] {
        let wi = towards * off.cos() + aside * off.sin();
        for (name, mirror) in [("camera", false), ("mirror", true)] {
            if mirror && wi.y < 0.1 {
                continue;
            }
            let mut stage = if mirror {
                let eye = DVec3::new(-wi.x, wi.y, -wi.z).as_vec3();
                Stage::new(support::probe(eye, Vec3::ZERO))
            } else {
                Stage::new(support::probe(Vec3::ZERO, wi.as_vec3()))
            };
            let mirror_below = support::quad(Vec3::new(-5.0, -0.01, -5.0), Vec3::Z * 10.0, Vec3::X * 10.0);
            stage = stage.add(
                mirror_below,
                support::opaque(Scattering::Mirror {
                    reflectance: Rgb::WHITE,
                }),
            );
            stage.0.lights.push(distant(direction, 3.0, radius));
            for mis in [true, false] {
                let seen = stage.prepare::<A>(&settings(mis)).mean(&settings(mis), 4, 0..2);
                let error = (seen.mean - expected).abs();
                assert!(
                    error <= 1e-5 * expected,
                    "{}: {name}, {off} off: {seen:?} for {expected}",
                    A::NAME
                );
            }
        }
    }
}

fn lights_that_bring_nothing_or_stand_at_extreme_places_leave_samples_finite<A: Accel>() {
    let at = |y: f64| point(DVec3::new(0.0, y, 0.0), 1.0);
    let cases = [
        ("at the surface", at(0.0), None),
        ("just above", at(1e-30), None),
        ("1e-6 above", at(1e-6), None),
        ("1e8 above", at(1e8), Some(1e-16)),
        ("1e25 above", at(1e25), None),
        ("behind", at(-1.0), Some(0.0)),
        ("black", point(DVec3::Y, 0.0), Some(0.0)),
        ("dim", point(DVec3::Y, 1e-35), Some(1e-35)),
        ("bright", point(DVec3::Y, 1e30), None),
        (
            "a spot at the surface",
            spot(DVec3::ZERO, DVec3::NEG_Y, [1.0, 2.0], Falloff::Angle),
            None,
        ),
        (
            "a needle of a spot",
            spot(DVec3::Y, DVec3::NEG_Y, [0.0, 1e-4], Falloff::Cosine),
            None,
        ),
        ("a faint sun", distant(DVec3::NEG_Y, 1e-30, 0.004), None),
        ("a bright sun", distant(DVec3::NEG_Y, 1e30, 0.004), None),
    ];
    for (name, light, expected) in cases {
        // A second light makes it a choice.
        for others in [
            vec![],
            vec![point(DVec3::new(3.0, 1.0, 0.0), 0.0)],
            vec![point(DVec3::new(0.0, -3.0, 0.0), 1.0)],
        ] {
            let lights: Vec<LightDesc> = [light.clone()].into_iter().chain(others).collect();
            // Samples that are not finite panic.
            let found = irradiance::<A>(&lit(&lights), &settings(true), 16);
            assert!(found.mean >= 0.0, "{}: {name}", A::NAME);
            if let Some(expected) = expected {
                assert!(
                    (found.mean - expected).abs() <= 1e-4 * expected,
                    "{}: {name}: {found:?}",
                    A::NAME
                );
            }
        }
    }
}

fn lights_stand_where_they_are_told_to_when_the_scene_is_far_away<A: Accel>() {
    let at = DVec3::new(3e7 + 0.3, -4e7, 0.7);
    let mut stage = plane_at(at);
    let position = DVec3::new(1.0, 2.0, -0.5);
    stage.0.lights.push(point(at + position, 5.0));
    let found = irradiance::<A>(&stage, &settings(true), 4);
    let error = found.mean / (5.0 * position.y / position.length().powi(3)) - 1.0;
    // In f64 these places are exact to 4e-9.
    assert!(error.abs() < 1e-4, "{}: off by {error:.1e}", A::NAME);
}

/// A room of everything: lamp, sky, points, spots, suns, a ball and a mirror.
fn everything() -> Stage {
    let mut stage = Stage::new(support::camera(
        Vec3::new(0.5, 2.0, 5.0),
        Vec3::new(0.0, 0.6, 0.0),
        40.0,
        [12, 8],
    ))
    .add(
        support::quad(Vec3::new(-2.0, 0.0, -2.0), Vec3::Z * 4.0, Vec3::X * 4.0),
        support::diffuse(0.5),
    )
    .add(
        support::sphere(Vec3::new(-0.6, 0.6, 0.0), 0.6, 8, false),
        support::diffuse(0.7),
    )
    .add(
        support::sphere(Vec3::new(0.9, 0.5, -0.3), 0.5, 8, false),
        support::opaque(Scattering::Conductor {
            eta: Rgb::new(0.2, 0.4, 1.4),
            k: Rgb::new(3.4, 2.3, 1.8),
            alpha: 0.3,
        }),
    )
    .add_light(
        support::quad(Vec3::new(-0.5, 2.5, -0.5), Vec3::X, Vec3::Z),
        support::diffuse(0.0),
        support::emission(2.0),
    )
    .lit_by_map(grey_map(16, 8, |x, y| if (x, y) == (3, 2) { 8.0 } else { 0.1 }), 20.0);
    for i in 0..4 {
        let x = f64::from(i) - 1.5;
        stage.0.lights.push(point(DVec3::new(x, 1.5, 1.0), 0.3));
        let down = DVec3::new(0.1 * x, -1.0, 0.0);
        stage
            .0
            .lights
            .push(spot(DVec3::new(x, 2.0, -1.0), down, [10.0, 25.0], Falloff::Cosine));
        stage
            .0
            .lights
            .push(spot(DVec3::new(x, 1.0, 2.0), down, [30.0, 80.0], Falloff::Angle));
    }
    stage.0.lights.push(distant(DVec3::new(1.0, -1.0, -1.0), 0.5, 0.0));
    stage.0.lights.push(distant(DVec3::new(-1.0, -0.6, -1.0), 0.5, 0.3));
    stage
}

fn all_ways_of_sampling_agree_among_all_kinds_of_lights<A: Accel>() {
    let base = Settings {
        max_depth: Some(3),
        seed: 11,
        ..Settings::default()
    };
    let reference = everything().prepare::<A>(&base).replicate(&base, 256, 0..32);
    for (seed, settings) in [
        (
            12,
            Settings {
                light_sampling: LightSampling::Power,
                ..base
            },
        ),
        (13, Settings { mis: false, ..base }),
        (
            14,
            Settings {
                light_sampling: LightSampling::Power,
                mis: false,
                ..base
            },
        ),
        (
            15,
            Settings {
                bounce_sampling: BounceSampling::Uniform,
                ..base
            },
        ),
        (
            16,
            Settings {
                env_sampling: EnvSampling::Uniform,
                ..base
            },
        ),
    ] {
        let settings = Settings { seed, ..settings };
        let found = everything().prepare::<A>(&settings).replicate(&settings, 256, 0..32);
        let name = format!(
            "{}: lights, {:?}, mis {}, {seed}",
            A::NAME,
            settings.light_sampling,
            settings.mis
        );
        assert_same_images(&name, &found, &reference, Significance::TEST.split(5));
    }
}

#[test]
fn lights_that_cannot_be_are_refused_by_number() {
    let nan = f64::NAN;
    for (light, problem) in [
        (point(DVec3::Y, -1.0), "strength"),
        (point(DVec3::Y, f32::NAN), "strength"),
        (point(DVec3::new(1e39, 0.0, 0.0), 1.0), "32-bit"),
        (spot(DVec3::Y, DVec3::ZERO, [1.0, 2.0], Falloff::Angle), "direction"),
        (
            spot(DVec3::Y, DVec3::new(nan, 1.0, 0.0), [1.0, 2.0], Falloff::Angle),
            "direction",
        ),
        (spot(DVec3::Y, DVec3::Y, [2.0, 2.0], Falloff::Angle), "angles"),
        (spot(DVec3::Y, DVec3::Y, [nan, 2.0], Falloff::Angle), "angles"),
        (distant(DVec3::Y, 1.0, FRAC_PI_2), "radius"),
        (distant(DVec3::Y, 1.0, nan), "radius"),
    ] {
        let stage = lit(&[point(DVec3::Y, 1.0), light]);
        let error = Scene::build(stage.0, SceneOptions::default()).expect_err(problem);
        assert!(matches!(error, SceneError::Light { index: 1, .. }), "{error}");
        assert!(error.to_string().contains(problem), "{error}");
    }
}

#[test]
fn the_number_of_lights_counts_those_that_shine() {
    let stage = everything();
    let scene = Scene::build(stage.0, SceneOptions::default()).expect("a valid scene");
    assert_eq!(scene.lights.len(), 2 + 1 + 12 + 2);
    assert!(scene.features.names().contains(&"punctual-lights"));
    let black = lit(&[point(DVec3::Y, 0.0)]);
    let scene = Scene::build(black.0, SceneOptions::default()).expect("a valid scene");
    assert_eq!((scene.lights.len(), scene.features.names().len()), (0, 0));
}

fn direction(random: &mut Random) -> Vec3 {
    loop {
        let v = Vec3::from_array([(); 3].map(|()| 2.0 * random.unit() - 1.0));
        if (0.01..1.0).contains(&v.length_squared()) {
            return v.normalize();
        }
    }
}

/// Points and spots of any width, power and place within `size`.
fn punctual(count: usize, size: f32, random: &mut Random) -> Vec<(Vec3, PunctualLight)> {
    (0..count)
        .map(|_| {
            let position = direction(random) * (size * random.unit());
            let intensity = Rgb::splat(10f32.powf(4.0 * random.unit() - 2.0));
            let beam = 1.5 * f64::from(random.unit());
            let angles = [beam, beam + 0.01 + 1.6 * f64::from(random.unit()).powi(3)];
            let axis = direction(random).as_dvec3();
            let light = match random.below(3) {
                0 => PunctualLight::point(position, intensity),
                1 => PunctualLight::spot(position, axis, intensity, angles, Falloff::Angle),
                _ => PunctualLight::spot(position, axis, intensity, angles.map(|a| 0.3 * a), Falloff::Cosine),
            };
            (position, light)
        })
        .collect()
}

#[derive(Clone, Copy, Debug)]
struct Mix {
    triangles: usize,
    points: usize,
    suns: usize,
    sky: bool,
    sampling: LightSampling,
}

fn build(mix: Mix, random: &mut Random) -> LightSampler {
    let mut builder = LightSamplerBuilder::default();
    for _ in 0..mix.triangles {
        let a = direction(random) * 2.0;
        let emission = Emission {
            radiance: Rgb::splat(random.unit() + 0.1),
            both_sides: random.below(2) == 0,
        };
        builder.push([a, a + direction(random) * 0.3, a + direction(random) * 0.3], emission);
    }
    for (_, light) in punctual(mix.points, 2.0, random) {
        builder.push_punctual(light);
    }
    for i in 0..mix.suns {
        let radius = if i % 2 == 0 {
            0.0
        } else {
            0.3 * f64::from(random.unit())
        };
        builder.push_distant(DistantLight::new(
            direction(random).as_dvec3(),
            Rgb::splat(0.1 + random.unit()),
            radius,
        ));
    }
    let sky = grey_map(8, 4, |x, y| if (x, y) == (2, 1) { 30.0 } else { 0.2 });
    let environment = mix
        .sky
        .then(|| Environment::from_map(&sky, 1.0, 0.0, EnvSampling::Importance).expect("a valid map"));
    builder.build(environment, mix.sampling)
}

fn mixes() -> Vec<Mix> {
    let mut mixes = Vec::new();
    for sampling in [LightSampling::Contribution, LightSampling::Power] {
        for (triangles, points, suns) in [
            (0, 1, 0),
            (0, 30, 0),
            (10, 20, 0),
            (0, 0, 3),
            (0, 0, 40),
            (5, 15, 3),
            (3, 9, 40),
        ] {
            for sky in [false, true] {
                mixes.push(Mix {
                    triangles,
                    points,
                    suns,
                    sky,
                    sampling,
                });
            }
        }
    }
    mixes
}

#[test]
fn all_kinds_of_emitters_are_drawn_as_often_as_their_probabilities_say() {
    let (draws, receivers) = (20_000, 6);
    let mut random = Random(1);
    let mixes = mixes();
    for mix in &mixes {
        let lights = build(*mix, &mut random);
        for k in 0..receivers {
            let p = direction(&mut random) * (3.0 * random.unit());
            let n = if k % 3 == 0 { Vec3::ZERO } else { direction(&mut random) };
            let emitters: Vec<Emitter> = (0..mix.triangles as u32)
                .map(Emitter::Area)
                .chain((0..mix.points as u32).map(Emitter::Punctual))
                .chain((0..mix.suns as u32).map(Emitter::Distant))
                .chain([Emitter::Environment])
                .collect();
            let mut expected: Vec<f64> = emitters.iter().map(|e| f64::from(lights.pmf(*e, p, n))).collect();
            let none = 1.0 - expected.iter().sum::<f64>();
            assert!(none > -1e-6, "{mix:?}: probabilities sum to {}", 1.0 - none);
            // Of light from both sides, something always arrives, but for cones.
            expected.push(if none < 1e-6 { 0.0 } else { none });
            let mut counts = vec![0; expected.len()];
            for _ in 0..draws {
                let Chosen {
                    emitter,
                    pmf,
                    environment_pmf,
                } = lights.choose_any(p, n, random.bits());
                let cell = emitters.iter().position(|e| *e == emitter).unwrap_or(emitters.len());
                assert_eq!(
                    pmf.to_bits(),
                    lights.pmf(emitter, p, n).to_bits(),
                    "{mix:?}: {emitter:?}"
                );
                assert_eq!(
                    environment_pmf.to_bits(),
                    lights.environment_pmf(p, n).to_bits(),
                    "{mix:?}"
                );
                counts[cell] += 1;
            }
            expected.iter_mut().for_each(|e| *e *= f64::from(draws));
            let name = format!("{mix:?} from {p}, {n}");
            assert_chi_square(
                &name,
                &counts,
                &expected,
                Significance::TEST.split(mixes.len() * receivers),
            );
        }
    }
}

#[test]
fn every_point_that_lights_a_receiver_may_be_drawn_and_most_others_are_not() {
    let mut random = Random(2);
    let (mut useful, mut useless, mut wasted, mut seen) = (0, 0, 0.0, 0usize);
    for size in [1e-3f32, 1.0, 1e3] {
        for count in [1, 2, 8, 9, 200] {
            for round in 0..40 {
                let points = punctual(count, size, &mut random);
                let mut builder = LightSamplerBuilder::default();
                builder.set_scene_radius(f64::from(size) * [1e-3, 1.0, 1e3][round % 3]);
                points.iter().for_each(|(_, light)| builder.push_punctual(*light));
                let lights = builder.build(None, LightSampling::Contribution);
                for k in 0..20 {
                    // Down to next to a light, and far from all.
                    let near = points[random.below(count)].0;
                    let distance = 10f32.powf(10.0 * random.unit() - 8.0);
                    let p = near + direction(&mut random) * (size * distance);
                    let n = if k % 4 == 0 { Vec3::ZERO } else { direction(&mut random) };
                    // So close to a light that rounding leaves its direction open, nothing is gained by leaving it out.
                    let is_resolved = distance > 1e-3;
                    seen += usize::from(is_resolved);
                    for (i, (position, light)) in points.iter().enumerate() {
                        let pmf = lights.pmf(Emitter::Punctual(i as u32), p, n);
                        let cos = (*position - p).normalize_or_zero().dot(n);
                        let arrives = light.sample(1.0, p).is_some() && (n == Vec3::ZERO || cos > 1e-6);
                        if arrives {
                            useful += 1;
                            assert!(pmf > 0.0, "light {i} of {count}, {light:?} from {p}, {n}");
                        } else if is_resolved {
                            useless += 1;
                            wasted += f64::from(pmf);
                        }
                    }
                }
            }
        }
    }
    let wasted = wasted / seen as f64;
    println!("{useful} useful, {useless} useless lights; {wasted:.4} of the samples wasted");
    assert!(useful > 10_000 && useless > 10_000 && wasted < 0.1, "{wasted}");
}

#[test]
fn the_mean_of_light_from_chosen_emitters_is_the_sum_over_all_of_them() {
    let mut random = Random(7);
    let mut cases = Vec::new();
    for sampling in [LightSampling::Contribution, LightSampling::Power] {
        for suns in [0, 3, 40] {
            for _ in 0..6 {
                let points = punctual(12, 1.0, &mut random);
                let mut builder = LightSamplerBuilder::default();
                points.iter().for_each(|(_, light)| builder.push_punctual(*light));
                let mut expected = 0.0;
                // Away from all lights, where none is much stronger by place than by power.
                let p = direction(&mut random) * 3.0;
                let n = (direction(&mut random) - p.normalize()).normalize();
                let brings = |wi: Vec3, light: f32| f64::from(light * wi.dot(n).max(0.0));
                for (_, light) in &points {
                    expected += light
                        .sample(1.0, p)
                        .map_or(0.0, |s| brings(s.wi, s.radiance.r / s.pdf_w));
                }
                for _ in 0..suns {
                    let towards = direction(&mut random);
                    let irradiance = random.unit();
                    builder.push_distant(DistantLight::new(-towards.as_dvec3(), Rgb::splat(irradiance), 0.0));
                    expected += brings(towards, irradiance);
                }
                let lights = builder.build(None, sampling);
                let mean = |random: &mut Random| {
                    let draw = |random: &mut Random| {
                        let Chosen { emitter, pmf, .. } = lights.choose_any(p, n, random.bits());
                        let sample = match emitter {
                            Emitter::Punctual(light) => lights.sample_punctual(light, pmf, p),
                            Emitter::Distant(light) => lights.sample_distant(light, pmf, random.pair()),
                            _ => None,
                        };
                        sample.map_or(0.0, |s| brings(s.wi, s.radiance.r / s.pdf_w))
                    };
                    (0..4000).map(|_| draw(random)).sum::<f64>() / 4000.0
                };
                let means: Vec<f64> = (0..48).map(|_| mean(&mut random)).collect();
                cases.push((
                    format!("{sampling:?}, {suns} suns, {p}"),
                    Estimate::of(&means),
                    expected,
                ));
            }
        }
    }
    let lit = cases.iter().filter(|case| case.2 > 0.0).count();
    assert!(lit > 24, "{lit} of {}", cases.len());
    for (name, estimate, expected) in &cases {
        assert_mean(name, *estimate, *expected, Significance::TEST.split(cases.len()));
    }
}

#[test]
fn the_power_of_a_spot_is_its_intensity_over_all_directions() {
    for angles in [[0.0, 0.5], [0.3, 0.31], [0.7, 1.5], [1.0, PI]] {
        for falloff in [Falloff::Angle, Falloff::Cosine] {
            let light = PunctualLight::spot(Vec3::ZERO, DVec3::Z, Rgb::WHITE, angles, falloff);
            let intensity = |theta: f64, _: f64| {
                let (sin, cos) = theta.sin_cos();
                let sample = light.sample(1.0, Vec3::new(sin as f32, 0.0, cos as f32));
                sample.map_or(0.0, |s| f64::from(s.radiance.r / s.pdf_w)) * sin
            };
            let rest = support::integrate(&intensity, [angles[0], angles[1]], [0.0, TAU], 1e-6);
            let power = TAU * (1.0 - angles[0].cos()) + rest;
            let error = light.power() / power - 1.0;
            assert!(error.abs() < 1e-4, "{angles:?} {falloff:?}: off by {error:.1e}");
        }
    }
}

#[test]
fn directions_to_a_disc_are_drawn_uniformly_and_met_by_rays() {
    let mut random = Random(3);
    for radius in [1e-3f64, 0.1, 1.0, 1.5] {
        let towards = direction(&mut random);
        let mut builder = LightSamplerBuilder::default();
        builder.push_distant(DistantLight::new(-towards.as_dvec3(), Rgb::WHITE, radius));
        let lights = builder.build(None, LightSampling::Contribution);
        let pdf_w = f64::from(lights.disc_pdf_w(0, Vec3::ZERO, Vec3::ZERO));
        let solid_angle = TAU * 2.0 * (0.5 * radius).sin().powi(2);
        assert!((pdf_w * solid_angle - 1.0).abs() < 1e-5, "{radius}: {pdf_w}");
        let draws = 20_000;
        let (u, v) = towards.any_orthonormal_pair();
        let mut counts = [0; 64];
        let mut missed = 0;
        for _ in 0..draws {
            let sample = lights.sample_distant(0, 1.0, random.pair()).expect("light from above");
            missed += usize::from(lights.discs(sample.wi).next().is_none());
            let height = f64::from((sample.wi - towards).length_squared()) * 0.5 / (2.0 * (0.5 * radius).sin().powi(2));
            let phi = f64::from(sample.wi.dot(v).atan2(sample.wi.dot(u))) / TAU;
            let ring = ((height * 8.0) as usize).min(7);
            counts[ring * 8 + ((phi - phi.floor()) * 8.0) as usize % 8] += 1;
        }
        // At the rim, by rounding.
        assert!(missed < draws / 500, "{radius}: {missed} missed");
        let expected = [f64::from(draws as u32) / 64.0; 64];
        assert_chi_square(
            &format!("radius {radius}"),
            &counts,
            &expected,
            Significance::TEST.split(4),
        );
    }
}

#[test]
fn irradiance_from_a_disc_is_the_same_by_its_own_directions_and_by_those_of_a_bounce() {
    let mut random = Random(4);
    for radius in [0.3, 1.0] {
        let direction = DVec3::new(1.0, -1.2, 0.4);
        let mut builder = LightSamplerBuilder::default();
        builder.push_distant(DistantLight::new(direction, Rgb::splat(2.0), radius));
        let lights = builder.build(None, LightSampling::Contribution);
        let mean = |random: &mut Random, draw: &dyn Fn([f32; 2]) -> f64| {
            let means: Vec<f64> = (0..32)
                .map(|_| (0..4000).map(|_| draw(random.pair())).sum::<f64>() / 4000.0)
                .collect();
            Estimate::of(&means)
        };
        let by_light = mean(&mut random, &|u| {
            let sample = lights.sample_distant(0, 1.0, u).expect("light from above");
            f64::from(sample.radiance.r * sample.wi.y.max(0.0) / sample.pdf_w)
        });
        let by_bounce = mean(&mut random, &|u| {
            let local = embrace::sampling::warp::cosine_hemisphere(u);
            let wi = Vec3::new(local.x, local.z, local.y);
            lights.discs(wi).map(|(_, radiance)| PI * f64::from(radiance.r)).sum()
        });
        let expected = by_quadrature(-direction, 2.0, radius);
        assert_mean("by the disc", by_light, expected, Significance::TEST.split(4));
        assert_mean("by bounces", by_bounce, expected, Significance::TEST.split(4));
    }
}

#[test]
fn scaling_points_by_a_power_of_two_changes_no_bit_of_any_probability() {
    let mut random = Random(5);
    let points: Vec<(Vec3, f32)> = (0..100)
        .map(|_| (direction(&mut random) * random.unit(), random.unit()))
        .collect();
    let build = |scale: f32| {
        let mut builder = LightSamplerBuilder::default();
        builder.set_scene_radius(f64::from(scale));
        for (position, intensity) in &points {
            builder.push_punctual(PunctualLight::point(*position * scale, Rgb::splat(*intensity)));
        }
        builder.build(None, LightSampling::Contribution)
    };
    let lights = build(1.0);
    for exponent in [-26, -3, 10, 26] {
        let scale = (exponent as f32).exp2();
        let scaled = build(scale);
        for _ in 0..20 {
            let (p, n) = (direction(&mut random) * (2.0 * random.unit()), direction(&mut random));
            for i in 0..100 {
                let [a, b] =
                    [(&lights, p), (&scaled, p * scale)].map(|(l, p)| l.pmf(Emitter::Punctual(i), p, n).to_bits());
                assert_eq!(a, b, "2^{exponent}");
            }
        }
    }
}

#[test]
fn a_million_points_make_a_tree_of_few_bytes_each() {
    let n = 1_000_000;
    let mut random = Random(6);
    let mut builder = LightSamplerBuilder::default();
    for (_, light) in punctual(n, 10.0, &mut random) {
        builder.push_punctual(light);
    }
    let started = std::time::Instant::now();
    let lights = builder.build(None, LightSampling::Contribution);
    let bytes = lights.memory_bytes() as f64 / n as f64;
    println!("built in {:.2?}, {bytes:.1} bytes an emitter", started.elapsed());
    assert!(bytes < 200.0, "{bytes}");
    let started = std::time::Instant::now();
    let (draws, mut found) = (100_000, 0);
    for _ in 0..draws {
        let p = direction(&mut random) * (10.0 * random.unit());
        let Chosen { emitter, pmf, .. } = lights.choose_any(p, Vec3::Y, random.bits());
        let Emitter::Punctual(light) = emitter else { continue };
        found += 1;
        if found % 100 == 0 {
            assert!(pmf > 0.0 && pmf.to_bits() == lights.pmf(Emitter::Punctual(light), p, Vec3::Y).to_bits());
        }
    }
    println!(
        "{:.0} ns a draw",
        started.elapsed().as_nanos() as f64 / f64::from(draws)
    );
    assert!(found > draws / 2, "{found}");
}
