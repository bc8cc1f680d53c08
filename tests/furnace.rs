//! Closed scenes whose radiance is known without integration.

mod support;

use embrace::accel::Accel;
use embrace::bsdf::{CoatTable, Distribution};
use embrace::integrator::{Roulette, Settings};
use embrace::material::{General, Material, Principled, Scalar, Scattering, Spectrum};
use embrace::math::{DVec3, Rgb, Vec3};
use support::{Estimate, Prepared, Significance, Stage};

support::for_each_backend! {
    a_white_surface_in_a_white_world_disappears
    rough_metal_loses_what_single_scattering_loses_and_more_the_rougher_it_is
    rough_glass_and_plastic_never_add_light
    imported_white_disappears_where_smooth_and_never_adds_light
    radiance_in_a_closed_box_is_the_geometric_series_of_its_albedo
    a_depth_limit_truncates_the_series_in_a_closed_box
}

/// A closed sphere of a material in a constant environment of radiance 1, seen as a disk in the middle of 16 x 16 pixels.
fn sphere_in_white<A: Accel>(material: Material, rows: u32, smooth: bool) -> Prepared<A> {
    Stage::new(support::camera(Vec3::new(0.3, 1.0, 4.0), Vec3::ZERO, 25.0, [16, 16]))
        .add(support::sphere(Vec3::ZERO, 1.0, rows, smooth), material)
        .lit_by_constant(1.0)
        .prepare(&Settings::default())
}

fn a_white_surface_in_a_white_world_disappears<A: Accel>() {
    let mirror = Scattering::Mirror {
        reflectance: Rgb::WHITE,
    };
    let glass = Scattering::Dielectric { ior: 1.5, alpha: 0.0 };
    // A metal without real index reflects everything.
    let metal = Scattering::Conductor {
        eta: Rgb::splat(1e-6),
        k: Rgb::splat(1e3),
        alpha: 0.0,
    };
    for (name, material) in [
        ("diffuse", support::diffuse(1.0)),
        ("mirror", support::opaque(mirror)),
        ("smooth glass", support::opaque(glass)),
        ("smooth metal", support::opaque(metal)),
    ] {
        let furnace = sphere_in_white::<A>(material, 4, false);
        let settings = Settings {
            seed: 1,
            ..Settings::default()
        };
        let summary = furnace.replicate(&settings, 64, 0..16);
        let white = support::Summary {
            pixels: vec![[Estimate::exact(1.0); 3]; summary.pixels.len()],
            channels: [Estimate::exact(1.0); 3],
            ..summary.clone()
        };
        support::assert_same_images(
            &format!("{}: {name} in a white furnace", A::NAME),
            &summary,
            &white,
            Significance::TEST.split(4),
        );
    }
}

/// The share of light that a white rough metal reflects at cos θo: the integral of D G2 / (4 cos θo) in f64, over half
/// vectors whose density is D cos θh, which leaves G2 wo·h / (cos θo cos θh).
fn metal_albedo(alpha: f64, cos: f64) -> f64 {
    let lambda = |cos: f64| 0.5 * ((1.0 + alpha * alpha * (1.0 / (cos * cos) - 1.0)).sqrt() - 1.0);
    let wo = DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos);
    let integrand = |a: f64, b: f64| {
        let (sin_phi, cos_phi) = (std::f64::consts::TAU * b).sin_cos();
        let tan = alpha * (a / (1.0 - a)).sqrt();
        let h = DVec3::new(tan * cos_phi, tan * sin_phi, 1.0).normalize();
        let wi = h * (2.0 * wo.dot(h)) - wo;
        if wi.z <= 0.0 || wo.dot(h) <= 0.0 {
            return 0.0;
        }
        wo.dot(h) / ((1.0 + lambda(cos) + lambda(wi.z)) * cos * h.z)
    };
    support::integrate(&integrand, [0.0, 1.0], [0.0, 1.0], 1e-5)
}

fn rough_metal_loses_what_single_scattering_loses_and_more_the_rougher_it_is<A: Accel>() {
    let mut last = 1.0 + 1e-3;
    for alpha in [0.01f32, 0.3, 1.0] {
        let metal = Scattering::Conductor {
            eta: Rgb::splat(1e-6),
            k: Rgb::splat(1e3),
            alpha,
        };
        // cos θo = 0.8.
        let eye = Vec3::new(0.6, 0.8, 0.0) * 3.0;
        let floor = Stage::new(support::probe(eye, Vec3::ZERO))
            .add(
                support::quad(Vec3::new(-1.0, 0.0, -1.0), Vec3::Z * 2.0, Vec3::X * 2.0),
                support::opaque(metal),
            )
            .lit_by_constant(1.0)
            .prepare::<A>(&Settings::default());
        let reflected = floor.mean(&Settings::default(), 4096, 0..32);
        let expected = metal_albedo(alpha.into(), 0.8);
        assert!(
            (reflected.mean - expected).abs() < 5e-4 + 4.0 * reflected.standard_error,
            "{}: alpha {alpha}: {reflected:?} for {expected}",
            A::NAME
        );
        assert!(expected <= last, "alpha {alpha}: {expected} after {last}");
        last = expected;
    }
    // A rough surface loses most of what it should reflect: the energy that a second scattering would return.
    assert!((0.3..0.4).contains(&last), "alpha 1 reflects {last}");
}

fn rough_glass_and_plastic_never_add_light<A: Accel>() {
    for alpha in [0.05f32, 0.3, 1.0] {
        let plastic = Scattering::Plastic {
            reflectance: Spectrum::Constant(Rgb::WHITE),
            specular: Rgb::splat(0.04),
            alpha,
        };
        for (name, scattering, least) in [
            ("glass", Scattering::Dielectric { ior: 1.5, alpha }, 0.2),
            ("plastic", plastic, 0.4),
        ] {
            let furnace = sphere_in_white::<A>(support::opaque(scattering), 4, false);
            let image = furnace.replicate(&Settings::default(), 64, 0..16);
            for (i, [grey, ..]) in image.pixels.iter().enumerate() {
                assert!(
                    grey.mean < 1.0 + 1e-3 + 6.0 * grey.standard_error && grey.mean > least,
                    "{}: {name} of alpha {alpha}: pixel {i}: {grey:?} is not within {least} to 1",
                    A::NAME
                );
            }
        }
    }
}

fn imported_white_disappears_where_smooth_and_never_adds_light<A: Accel>() {
    let white = Spectrum::Constant(Rgb::WHITE);
    let number = Scalar::Constant;
    let glass = |alpha| General::Glass {
        ior: 1.5,
        reflectance: white,
        transmittance: white,
        alpha: [number(alpha), number(0.5 * alpha)],
        distribution: Distribution::Beckmann,
    };
    let coated = |alpha| General::CoatedDiffuse {
        reflectance: white,
        specular: white,
        coat: CoatTable::of(1.5, alpha, Distribution::Ggx),
        nonlinear: true,
    };
    let thin = General::ThinGlass {
        ior: 1.5,
        reflectance: white,
        transmittance: white,
    };
    let principled = |metallic, spec_trans| {
        General::Principled(Box::new(Principled {
            metallic: number(metallic),
            spec_trans: number(spec_trans),
            roughness: number(0.5),
            anisotropic: number(0.6),
            ..Principled::new(white)
        }))
    };
    // The smooth coat's fit of what is sent back gives 0.12 % too much.
    for (name, general, least, most) in [
        ("smooth glass", glass(0.0), 1.0, 1.0),
        ("thin glass", thin, 1.0, 1.0),
        ("smooth coat", coated(0.0), 1.0, 1.0012),
        ("glass", glass(0.3), 0.5, 1.0),
        ("coat", coated(0.3), 0.5, 1.0),
        ("principled metal", principled(1.0, 0.0), 0.5, 1.0),
        ("principled glass", principled(0.0, 1.0), 0.5, 1.0),
    ] {
        let furnace = sphere_in_white::<A>(support::opaque(Scattering::General(general)), 4, false);
        // Of the whole image: single pixels of thin glass are 1 but for rare long paths, whose spread few renders show.
        let seen = furnace.replicate(&Settings::default(), 64, 0..16).overall;
        let error = 2e-4 + 6.0 * seen.standard_error;
        assert!(
            seen.mean < most + error && seen.mean > least - error,
            "{}: {name}: {seen:?} is not within {least} to {most}",
            A::NAME
        );
    }
}

/// The inside of a closed diffuse box that emits 1 everywhere.
fn box_of_light<A: Accel>(albedo: f32) -> Prepared<A> {
    let eye = Vec3::new(0.2, 0.3, 0.4);
    Stage::new(support::camera(eye, Vec3::new(1.0, 0.1, -0.3), 90.0, [4, 4]))
        .add_light(
            support::cuboid(Vec3::splat(-1.0), Vec3::new(1.0, 2.0, 1.5), true),
            support::diffuse(albedo),
            support::emission(1.0),
        )
        .prepare(&Settings::default())
}

fn radiance_in_a_closed_box_is_the_geometric_series_of_its_albedo<A: Accel>() {
    for albedo in [0.0f32, 0.5, 0.8] {
        for (name, roulette) in [("by throughput", Roulette::Throughput), ("fixed", Roulette::Fixed(0.7))] {
            for mis in [true, false] {
                let settings = Settings {
                    roulette,
                    mis,
                    seed: 2,
                    ..Settings::default()
                };
                let mean = box_of_light::<A>(albedo).mean(&settings, 256, 0..24);
                support::assert_mean(
                    &format!("{}: albedo {albedo}, roulette {name}, mis {mis}", A::NAME),
                    mean,
                    1.0 / (1.0 - f64::from(albedo)),
                    Significance::TEST.split(12),
                );
            }
        }
    }
}

fn a_depth_limit_truncates_the_series_in_a_closed_box<A: Accel>() {
    let albedo = 0.8f32;
    let furnace = box_of_light::<A>(albedo);
    for max_depth in [0u32, 1, 2, 5] {
        for roulette in [Roulette::Off, Roulette::Fixed(0.7)] {
            let settings = Settings {
                max_depth: Some(max_depth),
                roulette,
                seed: 3,
                ..Settings::default()
            };
            let expected: f64 = (0..=max_depth as i32).map(|k| f64::from(albedo).powi(k)).sum();
            support::assert_mean(
                &format!("{}: depth {max_depth}, {roulette:?}", A::NAME),
                furnace.mean(&settings, 256, 0..24),
                expected,
                Significance::TEST.split(8),
            );
        }
    }
}
