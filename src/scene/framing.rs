//! A camera for what comes without one.

use crate::camera::CameraDesc;
use crate::math::DVec3;

/// A camera that sees all of a box, from its front right and a little above.
pub(super) fn framing(low: DVec3, high: DVec3) -> CameraDesc {
    let centre = (low + high) * 0.5;
    // A point still needs a distance to be seen from.
    let radius = ((high - low).length() * 0.5)
        .max(centre.length() * 1e-6)
        .max(f64::from(f32::MIN_POSITIVE));
    let vfov_degrees = 40.0f64;
    let distance = radius / (vfov_degrees.to_radians() * 0.5).sin();
    CameraDesc {
        position: centre + DVec3::new(0.5, 0.4, 1.0).normalize() * distance,
        look_at: centre,
        up: DVec3::Y,
        vfov_degrees,
        resolution: [800, 600],
        aperture_radius: 0.0,
        focus_distance: None,
        mirrored: false,
    }
}
