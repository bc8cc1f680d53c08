//! Maps from the unit square to the shapes that paths are sampled on, and their densities.

use crate::math::{Vec3, sin_cos_eighth, sin_cos_turns};
use std::f32::consts::{FRAC_1_PI, TAU};

/// A point of the unit disk, uniform by area, from the concentric map of Shirley and Chiu 1997.
#[inline(always)]
pub fn disk([u, v]: [f32; 2]) -> [f32; 2] {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    // Which side of the diagonal a point is on cannot be predicted: blend by weights of 0 and 1, which is exact, rather
    // than branch.
    let steep = f32::from(b.abs() >= a.abs());
    let select = |yes: f32, no: f32| yes * steep + no * (1.0 - steep);
    let (r, other) = (select(b, a), select(a, b));
    let ratio = if r == 0.0 { 0.0 } else { other / r };
    let (sin, cos) = sin_cos_eighth(0.125 * ratio);
    [r * select(sin, cos), r * select(cos, sin)]
}

/// A unit direction around +z with density cos θ / π.
#[inline(always)]
pub fn cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let [x, y] = disk(u);
    // The rim of the disk would give a direction in the surface, whose density is zero: stay a little above.
    let z = (1.0 - x * x - y * y).max(1e-12).sqrt();
    Vec3::new(x, y, z)
}

/// Density of [`cosine_hemisphere`] [1/sr].
#[inline(always)]
pub fn cosine_hemisphere_pdf_w(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// A unit direction of the upper hemisphere, uniform by solid angle.
#[inline(always)]
pub fn uniform_hemisphere([u, v]: [f32; 2]) -> Vec3 {
    direction(1.0 - u, v)
}

/// Density of [`uniform_hemisphere`] [1/sr].
pub const UNIFORM_HEMISPHERE_PDF_W: f32 = 1.0 / TAU;

/// A unit direction, uniform over the sphere.
#[inline(always)]
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    direction(1.0 - 2.0 * u, v)
}

/// Density of [`uniform_sphere`] [1/sr].
pub const UNIFORM_SPHERE_PDF_W: f32 = 1.0 / (2.0 * TAU);

#[inline(always)]
fn direction(cos_theta: f32, v: f32) -> Vec3 {
    let r = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(v);
    Vec3::new(r * cos, r * sin, cos_theta)
}

/// Barycentric weights (of the second and the third corner) of a point uniform on a triangle, by the map of low
/// distortion of Heitz 2019, "A low-distortion map between triangle and square".
#[inline(always)]
pub fn triangle([u, v]: [f32; 2]) -> [f32; 2] {
    let half = u.min(v) * 0.5;
    [u - half, v - half]
}

/// A number in (-1, 1) with the tent density 1 − |x|.
#[inline(always)]
pub fn tent(u: f32) -> f32 {
    (1.0 - (2.0 * u).min(2.0 - 2.0 * u).sqrt()).copysign(u - 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

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
