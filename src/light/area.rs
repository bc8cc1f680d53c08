//! Emitting triangles.

use crate::interaction::{face_normal, largest_coordinates, offset_point, position_error};
use crate::math::{Rgb, Vec3};
use crate::sampling::warp;

/// Emission of a mesh: constant over its surface and over directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    /// Emitted radiance [W·m⁻²·sr⁻¹].
    pub radiance: Rgb,
    /// Whether the back side emits as well; the front is where the corners are counter-clockwise.
    pub both_sides: bool,
}

impl Emission {
    /// Radiance that leaves the given side.
    #[inline]
    pub fn from_side(&self, front: bool) -> Rgb {
        if front || self.both_sides {
            self.radiance
        } else {
            Rgb::BLACK
        }
    }

    /// Emitted power per area, as luminance [W·m⁻²].
    pub fn exitance(&self) -> f64 {
        let sides = if self.both_sides { 2.0 } else { 1.0 };
        sides * std::f64::consts::PI * f64::from(self.radiance.luminance())
    }
}

/// One emitting triangle, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaLight {
    corner: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
    emission: Emission,
    p_error: f32,
    /// Probability of choosing this triangle over its area [1/m²]: the density of a point on it.
    pub(super) pdf_a: f32,
}

impl AreaLight {
    /// `pdf_a` is set by the light sampler. A triangle without area never emits.
    pub(super) fn new(corners: [Vec3; 3], emission: Emission) -> AreaLight {
        let [a, b, c] = corners;
        let normal = face_normal(corners).unwrap_or(Vec3::ZERO);
        AreaLight {
            corner: a,
            edges: [b - a, c - a],
            normal,
            emission,
            p_error: position_error(largest_coordinates(corners), normal),
            pdf_a: 0.0,
        }
    }

    /// Area in f64, which tiny and huge triangles neither underflow nor overflow.
    pub(super) fn area(&self) -> f64 {
        let [ab, ac] = self.edges.map(|p| p.as_dvec3());
        0.5 * ab.cross(ac).length()
    }

    /// A point on the triangle as seen from `p`: direction, radiance, density per solid angle, and the shadow ray's end.
    /// `None` where the light turns its back or is seen edge-on.
    #[inline(always)]
    pub(super) fn sample(&self, p: Vec3, u: [f32; 2]) -> Option<super::LightSample> {
        let [weight_b, weight_c] = warp::triangle(u);
        let point = self.corner + self.edges[0] * weight_b + self.edges[1] * weight_c;
        let (wi, distance) = (point - p).normalize_and_length();
        let cos = -self.normal.dot(wi);
        let radiance = self.emission.from_side(cos > 0.0);
        let pdf_w = self.pdf_w(distance * distance, cos);
        if radiance.is_black() || !(pdf_w > 0.0 && pdf_w.is_finite()) {
            return None;
        }
        let target = offset_point(point, self.p_error, self.normal * cos.signum());
        Some(super::LightSample {
            wi,
            radiance,
            pdf_w,
            target: Some(target),
        })
    }

    /// Density per solid angle of a point at this squared distance, seen under this cosine [1/sr].
    #[inline]
    pub(super) fn pdf_w(&self, distance_squared: f32, cos: f32) -> f32 {
        self.pdf_a * distance_squared / cos.abs()
    }
}
