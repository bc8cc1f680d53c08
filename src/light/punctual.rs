//! Light from points: the same in all directions, or a cone.

use super::tree::Profile;
use super::{LightSample, delta_sample};
use crate::math::{DVec3, Rgb, Vec3, atan2_turns};
use std::f32::consts::FRAC_PI_3;
use std::f64::consts::{PI, TAU};

/// How a spot's intensity falls from its beam to its edge.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Falloff {
    /// Linear in the angle.
    #[default]
    Angle,
    /// The square of what is linear in the cosine.
    Cosine,
}

/// A shadow ray ends this much of its length before the light, so that a surface that the light lies in does not hide it
/// from one of its sides by rounding.
const END: f32 = 1.0 / 262_144.0;

/// The same for rounding of the light's own place, per coordinate: eight ulps.
const ROUNDING: f32 = 1.0 / 1_048_576.0;

/// Half angle of a cone from which on it is taken for a sphere: the cosine to its axis would be too small at its edge.
const WIDE: f32 = FRAC_PI_3;

/// Light from a point, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PunctualLight {
    position: Vec3,
    /// Unit vector; any for light in all directions.
    axis: Vec3,
    /// Along the axis [W·sr⁻¹].
    intensity: Rgb,
    cone: Option<Cone>,
}

/// How intensity falls off the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Cone {
    falloff: Falloff,
    /// Half angles in radians.
    angles: [f32; 2],
    /// What is 0 from here on, by the measure of [`Cone::distance`], and how much it grows towards the axis.
    edge: f32,
    slope: f32,
}

impl Cone {
    fn new(angles: [f64; 2], falloff: Falloff) -> Cone {
        let [beam, edge] = angles.map(|angle| match falloff {
            Falloff::Angle => angle / TAU,
            Falloff::Cosine => (0.5 * angle).sin().powi(2),
        });
        Cone {
            falloff,
            angles: angles.map(|angle| angle as f32),
            edge: edge as f32,
            slope: ((edge - beam).recip() as f32).min(f32::MAX),
        }
    }

    /// How far a unit direction is from the axis: the angle in turns; or half of 1 − its cosine, without the cancellation.
    fn distance(&self, axis: Vec3, direction: Vec3) -> f32 {
        match self.falloff {
            Falloff::Angle => atan2_turns(axis.cross(direction).length(), axis.dot(direction)),
            Falloff::Cosine => 0.25 * (direction - axis).length_squared(),
        }
    }

    /// The share of the intensity in a unit direction.
    fn share(&self, axis: Vec3, direction: Vec3) -> f32 {
        let t = ((self.edge - self.distance(axis, direction)) * self.slope).clamp(0.0, 1.0);
        match self.falloff {
            Falloff::Angle => t,
            Falloff::Cosine => t * t,
        }
    }

    /// The integral of the share over all directions [sr].
    fn solid_angle(&self) -> f64 {
        let [beam, edge] = self.angles.map(f64::from);
        TAU * match self.falloff {
            Falloff::Angle => 1.0 - (edge.sin() - beam.sin()) / (edge - beam),
            Falloff::Cosine => 1.0 - beam.cos() + (beam.cos() - edge.cos()) / 3.0,
        }
    }
}

impl PunctualLight {
    /// The same intensity [W·sr⁻¹] in all directions.
    pub fn point(position: Vec3, intensity: Rgb) -> PunctualLight {
        PunctualLight {
            position,
            axis: Vec3::Y,
            intensity,
            cone: None,
        }
    }

    /// A cone around `direction` (any length above 0), whose intensity is all of `intensity` up to the first and none from
    /// the second of two angles in radians, in [0, π], the second above the first.
    pub fn spot(position: Vec3, direction: DVec3, intensity: Rgb, angles: [f64; 2], falloff: Falloff) -> PunctualLight {
        PunctualLight {
            position,
            axis: direction.normalize().as_vec3(),
            intensity,
            cone: Some(Cone::new(angles, falloff)),
        }
    }

    /// Emitted power as luminance, in watts.
    pub fn power(&self) -> f64 {
        let solid_angle = self.cone.map_or(4.0 * PI, |cone| cone.solid_angle());
        solid_angle * f64::from(self.intensity.luminance())
    }

    pub(super) fn position(&self) -> Vec3 {
        self.position
    }

    pub(super) fn axis(&self) -> Vec3 {
        self.axis
    }

    pub(super) fn profile(&self) -> Profile {
        match self.cone {
            None => Profile::Sphere,
            Some(Cone { angles: [_, edge], .. }) if edge < WIDE => Profile::Narrow(edge),
            Some(Cone { angles: [_, edge], .. }) => Profile::Wide(edge),
        }
    }

    /// The mass that makes the tree's estimate of irradiance that of this light: on the axis for a narrow cone.
    pub(super) fn mass(&self) -> f64 {
        let intensity = f64::from(self.intensity.luminance());
        match self.profile() {
            Profile::Narrow(_) => intensity,
            // Half of the root of the mean squared cosine, 1/3, is what the tree takes for the mean cosine.
            _ => 2.0 * 3f64.sqrt() * intensity,
        }
    }

    /// The light at `p`, the emitter being drawn with probability `pmf`. `None` outside the cone, and at the very point.
    #[inline]
    pub fn sample(&self, pmf: f32, p: Vec3) -> Option<LightSample> {
        let (wi, distance) = (self.position - p).normalize_and_length();
        if !(distance > 0.0 && distance.is_finite() && pmf > 0.0) {
            return None;
        }
        let share = self.cone.map_or(1.0, |cone| cone.share(self.axis, -wi));
        let irradiance = self.intensity * (share / (distance * distance).max(f32::MIN_POSITIVE));
        let rounding = self.position.abs().max_element() * ROUNDING;
        let target = self.position - wi * (distance * END).max(rounding).min(0.5 * distance);
        delta_sample(wi, irradiance, pmf, Some(target))
    }
}
