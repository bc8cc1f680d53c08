//! What tests of light share: the irradiance that the renderer finds at a point of a plane, against the true one.

use crate::support::exact::form_factor;
use crate::support::{self, Significance, Stage};
use embrace::accel::Accel;
use embrace::integrator::Settings;
use embrace::math::Vec3;
use embrace::mesh::TriangleMesh;
use glam::Quat;
use std::f64::consts::PI;

pub(crate) const ALBEDO: f32 = 0.5;

/// Direct light alone: what surfaces send each other is not asked for.
pub(crate) fn settings(mis: bool) -> Settings {
    Settings {
        mis,
        max_depth: Some(1),
        seed: 5,
        ..Settings::default()
    }
}

/// A square about `at` that faces `turn` times +Y.
pub(crate) fn plane(at: Vec3, turn: Quat, half: f32) -> TriangleMesh {
    let (u, v) = (turn * Vec3::Z * half, turn * Vec3::X * half);
    support::quad(at - u - v, u * 2.0, v * 2.0)
}

/// That square, and a camera that looks at its middle from a corner of it.
pub(crate) fn lit_plane(at: Vec3, turn: Quat, half: f32) -> Stage {
    let eye = at + turn * Vec3::new(0.5, 0.5, 0.3) * half;
    Stage::new(support::probe(eye, at)).add(plane(at, turn, half), support::diffuse(ALBEDO))
}

/// Irradiance at a point whose normal is `turn` times +Y, from a polygon in full view.
pub(crate) fn irradiance(at: Vec3, turn: Quat, radiance: f32, polygon: &[Vec3]) -> f64 {
    let normal = (turn * Vec3::Y).as_dvec3();
    PI * f64::from(radiance) * form_factor(at.as_dvec3(), normal, polygon)
}

/// A square of this side about (0, height, 0), front side down, over a point of a plane at the origin.
pub(crate) fn square_above(side: f32, height: f32, radiance: f32) -> (Stage, f64) {
    let lamp = plane(
        Vec3::Y * height,
        Quat::from_rotation_x(std::f32::consts::PI),
        0.5 * side,
    );
    let irradiance = irradiance(Vec3::ZERO, Quat::IDENTITY, radiance, &lamp.positions);
    let stage = lit_plane(Vec3::ZERO, Quat::IDENTITY, height).add_light(
        lamp,
        support::diffuse(0.0),
        support::emission(radiance),
    );
    (stage, irradiance)
}

/// A stage whose camera sees a point of albedo [`ALBEDO`] where the irradiance is known.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) stage: Stage,
    pub(crate) mis: bool,
    /// Of each of 16 replications.
    pub(crate) spp: u32,
    pub(crate) irradiance: f64,
}

/// Tests all cases together, prints the largest relative deviation, and returns the largest relative standard error.
pub(crate) fn assert_irradiance<A: Accel>(what: &str, cases: &[Case]) -> f64 {
    let significance = Significance::TEST.split(cases.len());
    let (mut deviation, mut error) = ((0.0, 0.0), 0.0f64);
    for case in cases {
        let name = format!("{}: {}, mis {}", A::NAME, case.name, case.mis);
        let settings = settings(case.mis);
        let seen = case.stage.prepare::<A>(&settings).mean(&settings, case.spp, 0..16);
        let expected = f64::from(ALBEDO) * case.irradiance / PI;
        support::assert_mean(&name, seen, expected, significance);
        if expected > 0.0 {
            let relative = [(seen.mean / expected - 1.0).abs(), seen.standard_error / expected];
            error = error.max(relative[1]);
            if relative[0] > deviation.0 {
                deviation = (relative[0], relative[1]);
            }
        }
    }
    println!(
        "{}: {what}, {} cases: off by {:.1e} ± {:.1e} at most",
        A::NAME,
        cases.len(),
        deviation.0,
        deviation.1
    );
    error
}
