//! The perspective camera, pinhole or thin lens.

use crate::accel::Ray;
use crate::math::{DVec3, Vec3};
use crate::sampling::warp;
use thiserror::Error;

/// A camera as the scene file describes it.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraDesc {
    /// Eye point.
    pub position: DVec3,
    /// The point in the middle of the image.
    pub look_at: DVec3,
    /// A direction that is up in the image; any length, not parallel to the view.
    pub up: DVec3,
    /// Full vertical angle of view in degrees, in (0, 180).
    pub vfov_degrees: f64,
    /// Width and height in pixels, both above 0.
    pub resolution: [u32; 2],
    /// Radius of the lens; 0 is a pinhole.
    pub aperture_radius: f64,
    /// Distance of the plane in focus along the view; absent: the distance of `look_at`.
    pub focus_distance: Option<f64>,
    /// Whether left and right are exchanged in the image.
    pub mirrored: bool,
}

/// Why there is no camera for a description. The text names the key.
#[derive(Debug, Error, PartialEq)]
#[error("camera.{key}: {problem}")]
pub struct CameraError {
    /// Key of the scene file.
    pub key: &'static str,
    /// What is wrong and what to write instead.
    pub problem: String,
}

/// Generates camera rays.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    origin: Vec3,
    /// Image-plane vectors at unit distance: from the middle to the right edge, to the top edge, and forward.
    right: Vec3,
    up: Vec3,
    forward: Vec3,
    unit_right: Vec3,
    unit_up: Vec3,
    resolution: [u32; 2],
    aperture_radius: f32,
    focus_distance: f32,
}

impl Camera {
    /// Checks the description and prepares the frame, in f64.
    ///
    /// # Errors
    /// [`CameraError`] for a view without direction, an up vector along it, an angle or a size out of range.
    pub fn new(desc: &CameraDesc) -> Result<Camera, CameraError> {
        let error = |key, problem: String| Err(CameraError { key, problem });
        let forward = match (desc.look_at - desc.position).try_normalize() {
            Some(forward) => forward,
            None => {
                return error(
                    "look_at",
                    "is the same point as camera.position; give a point in front of it".into(),
                );
            }
        };
        let right = match forward.cross(desc.up.try_normalize().unwrap_or(DVec3::ZERO)) {
            // Below this sine, the direction of the product is rounding error.
            cross if cross.length() > 1e-9 => cross.normalize(),
            _ => {
                return error(
                    "up",
                    format!(
                        "{:?} is zero or parallel to the view; give another direction",
                        desc.up.to_array()
                    ),
                );
            }
        };
        if !(desc.vfov_degrees > 0.0 && desc.vfov_degrees < 180.0) {
            return error(
                "vfov",
                format!("{} is not between 0 and 180 degrees", desc.vfov_degrees),
            );
        }
        if desc.resolution.contains(&0) || desc.resolution.iter().any(|&n| n > MAX_SIDE) {
            return error(
                "resolution",
                format!(
                    "{} x {} is not within 1 to {MAX_SIDE} pixels a side",
                    desc.resolution[0], desc.resolution[1]
                ),
            );
        }
        if !(desc.aperture_radius >= 0.0 && desc.aperture_radius.is_finite()) {
            return error("aperture_radius", format!("{} is not 0 or more", desc.aperture_radius));
        }
        let focus_distance = desc.focus_distance.unwrap_or((desc.look_at - desc.position).length());
        if !(focus_distance > 0.0 && focus_distance.is_finite()) {
            return error("focus_distance", format!("{focus_distance} is not above 0"));
        }
        let up = right.cross(forward);
        let half_height = (desc.vfov_degrees.to_radians() * 0.5).tan();
        let half_width = half_height * f64::from(desc.resolution[0]) / f64::from(desc.resolution[1]);
        let right = if desc.mirrored { -right } else { right };
        Ok(Camera {
            origin: desc.position.as_vec3(),
            right: (right * half_width).as_vec3(),
            up: (up * half_height).as_vec3(),
            forward: forward.as_vec3(),
            unit_right: right.as_vec3(),
            unit_up: up.as_vec3(),
            resolution: desc.resolution,
            aperture_radius: desc.aperture_radius as f32,
            focus_distance: focus_distance as f32,
        })
    }

    /// Width and height of the full image.
    pub fn resolution(&self) -> [u32; 2] {
        self.resolution
    }

    /// Whether rays need a point on the lens.
    pub fn has_lens(&self) -> bool {
        self.aperture_radius > 0.0
    }

    /// The ray through a point of pixel (`x`, `y`): `jitter` in [0, 1)² from its upper left corner, `lens` in [0, 1)².
    #[inline(always)]
    pub fn ray(&self, x: u32, y: u32, jitter: [f32; 2], lens: [f32; 2]) -> Ray {
        let ndc_x = 2.0 * (x as f32 + jitter[0]) / self.resolution[0] as f32 - 1.0;
        let ndc_y = 1.0 - 2.0 * (y as f32 + jitter[1]) / self.resolution[1] as f32;
        let through = self.forward + self.right * ndc_x + self.up * ndc_y;
        if !self.has_lens() {
            return Ray::new(self.origin, through.normalize());
        }
        let [lens_x, lens_y] = warp::disk(lens).map(|c| c * self.aperture_radius);
        let offset = self.unit_right * lens_x + self.unit_up * lens_y;
        Ray::new(
            self.origin + offset,
            (through * self.focus_distance - offset).normalize(),
        )
    }

    /// How far a point is from the lens along the view.
    pub fn depth(&self, p: Vec3) -> f32 {
        (p - self.origin).dot(self.forward)
    }
}

/// Largest image side: past it, memory and not the format is the limit.
pub const MAX_SIDE: u32 = 65_536;

#[cfg(test)]
mod tests {
    use super::*;

    fn desc() -> CameraDesc {
        CameraDesc {
            position: DVec3::ZERO,
            look_at: DVec3::new(0.0, 0.0, -1.0),
            up: DVec3::Y,
            vfov_degrees: 90.0,
            resolution: [4, 2],
            aperture_radius: 0.0,
            focus_distance: None,
            mirrored: false,
        }
    }

    #[test]
    fn the_image_is_upright_with_right_at_cross_of_forward_and_up() {
        let camera = Camera::new(&desc()).unwrap();
        let middle = camera.ray(2, 1, [0.0, 0.0], [0.0; 2]).direction;
        assert!((middle - Vec3::NEG_Z).length() < 1e-6);
        let corner = camera.ray(0, 0, [0.0, 0.0], [0.0; 2]).direction;
        assert!(
            (corner - Vec3::new(-2.0, 1.0, -1.0).normalize()).length() < 1e-6,
            "{corner}"
        );
    }

    #[test]
    fn rays_through_all_points_of_a_lens_meet_in_the_plane_of_focus() {
        let camera = Camera::new(&CameraDesc {
            aperture_radius: 0.3,
            focus_distance: Some(5.0),
            ..desc()
        })
        .unwrap();
        let pinhole = Camera::new(&desc()).unwrap();
        for lens in [[0.1, 0.2], [0.9, 0.4], [0.5, 0.99]] {
            let ray = camera.ray(1, 0, [0.3, 0.6], lens);
            let sharp = pinhole.ray(1, 0, [0.3, 0.6], lens).direction;
            let at = |origin: Vec3, d: Vec3| origin + d * ((-5.0 - origin.z) / d.z);
            assert!((at(ray.origin, ray.direction) - at(Vec3::ZERO, sharp)).length() < 1e-5);
        }
    }

    #[test]
    fn views_without_direction_and_sizes_without_pixels_are_named() {
        for (key, desc) in [
            (
                "look_at",
                CameraDesc {
                    look_at: DVec3::ZERO,
                    ..desc()
                },
            ),
            ("up", CameraDesc { up: DVec3::Z, ..desc() }),
            (
                "up",
                CameraDesc {
                    up: DVec3::ZERO,
                    ..desc()
                },
            ),
            (
                "vfov",
                CameraDesc {
                    vfov_degrees: 180.0,
                    ..desc()
                },
            ),
            (
                "vfov",
                CameraDesc {
                    vfov_degrees: f64::NAN,
                    ..desc()
                },
            ),
            (
                "resolution",
                CameraDesc {
                    resolution: [0, 5],
                    ..desc()
                },
            ),
            (
                "aperture_radius",
                CameraDesc {
                    aperture_radius: -1.0,
                    ..desc()
                },
            ),
            (
                "focus_distance",
                CameraDesc {
                    focus_distance: Some(0.0),
                    ..desc()
                },
            ),
        ] {
            assert_eq!(Camera::new(&desc).unwrap_err().key, key);
        }
    }
}
