//! Maps from the unit square to the shapes that paths are sampled on, and their densities.

use crate::math::Vec3;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, PI, TAU};

/// A point of the unit disk, uniform by area, from the concentric map of Shirley and Chiu 1997.
#[inline]
pub fn disk([u, v]: [f32; 2]) -> [f32; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    // Selections instead of branches: which side of the diagonal a point is on cannot be predicted.
    let steep = b.abs() >= a.abs();
    let (r, other) = if steep { (b, a) } else { (a, b) };
    let ratio = if r == 0.0 { 0.0 } else { other / r };
    let (sin, cos) = sin_cos_eighth(FRAC_PI_4 * ratio);
    if steep { [r * sin, r * cos] } else { [r * cos, r * sin] }
}

/// Sine and cosine of an angle within an eighth of a turn, by their series up to the ninth power: exact to an ulp there,
/// and in line where the library's would be a call.
#[inline]
fn sin_cos_eighth(x: f32) -> (f32, f32) {
    let x2 = x * x;
    let sin = x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0 - x2 * (1.0 / 362_880.0)))));
    let cos = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40_320.0))));
    (sin, cos)
}

/// A unit direction around +z with density cos θ / π.
#[inline]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let [x, y] = disk(u);
    // The rim of the disk would give a direction in the surface, whose density is zero: stay a little above.
    let z = (1.0 - x * x - y * y).max(1e-12).sqrt();
    Vec3::new(x, y, z)
}

/// Density of [`cosine_hemisphere`] [1/sr].
#[inline]
pub fn cosine_hemisphere_pdf_w(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// A unit direction of the upper hemisphere, uniform by solid angle.
#[inline]
pub fn uniform_hemisphere([u, v]: [f32; 2]) -> Vec3 {
    direction(1.0 - u, v)
}

/// Density of [`uniform_hemisphere`] [1/sr].
pub const UNIFORM_HEMISPHERE_PDF_W: f32 = 1.0 / TAU;

/// A unit direction, uniform over the sphere.
#[inline]
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    direction(1.0 - 2.0 * u, v)
}

/// Density of [`uniform_sphere`] [1/sr].
pub const UNIFORM_SPHERE_PDF_W: f32 = 1.0 / (2.0 * TAU);

fn direction(cos_theta: f32, v: f32) -> Vec3 {
    let r = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    let (sin, cos) = (TAU * v - PI).sin_cos();
    Vec3::new(r * cos, r * sin, cos_theta)
}

/// Barycentric weights (of the second and the third corner) of a point uniform on a triangle, by the map of low
/// distortion of Heitz 2019, "A low-distortion map between triangle and square".
#[inline]
pub fn triangle([u, v]: [f32; 2]) -> [f32; 2] {
    let half = u.min(v) * 0.5;
    [u - half, v - half]
}

/// A number in (-1, 1) with the tent density 1 − |x|.
#[inline]
pub fn tent(u: f32) -> f32 {
    if u < 0.5 {
        (2.0 * u).sqrt() - 1.0
    } else {
        1.0 - (2.0 - 2.0 * u).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_for_sine_and_cosine_are_exact_to_an_ulp_or_two() {
        for i in -1000..=1000 {
            let x = FRAC_PI_4 * i as f32 / 1000.0;
            let (sin, cos) = sin_cos_eighth(x);
            assert!(
                (sin - x.sin()).abs() < 1.5e-7 && (cos - x.cos()).abs() < 1.5e-7,
                "{x}: {sin} {cos}"
            );
        }
    }

    #[test]
    fn the_corners_of_the_unit_square_give_valid_points() {
        let below_one = 1f32.next_down();
        for u in [0.0, 0.5, below_one] {
            for v in [0.0, 0.5, below_one] {
                for d in [
                    cosine_hemisphere([u, v]),
                    uniform_hemisphere([u, v]),
                    uniform_sphere([u, v]),
                ] {
                    assert!((d.length() - 1.0).abs() < 1e-5, "({u}, {v}): {d}");
                }
                assert!(cosine_hemisphere([u, v]).z > 0.0 && uniform_hemisphere([u, v]).z > 0.0);
                let [b, c] = triangle([u, v]);
                assert!(b >= 0.0 && c >= 0.0 && b + c <= 1.0 + 1e-6);
            }
            assert!(tent(u).abs() <= 1.0);
        }
    }
}
