//! Emitting triangles.

use crate::columns::Columns;
use crate::interaction::{face_normal, largest_coordinates, offset_point, position_error};
use crate::math::{DVec3, Rgb, Vec3};
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
    #[inline(always)]
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

/// Bound on how far off its plane a backend finds an emitter, per distance that it is seen from and per slenderness.
/// Corners relative to the origin of a ray, and the ray's direction, are rounded by 2⁻²⁴ of the distance; so is the length
/// of a shadow ray, which would else end behind its own light. Rounding tilts the plane of a triangle that is low over its
/// longest edge, and at the far end of that edge the plane is off by as much more as the edge is longer.
const ERROR_PER_DISTANCE: f64 = 1.0 / 2_097_152.0;

/// What is nearer to the emitter than this, in units of the distance, must still cast its shadow: triangles more slender
/// than 1 : 32,768 may instead be in their own.
const MAX_ERROR_PER_DISTANCE: f64 = 1.0 / 64.0;

/// Emitting triangles by lane.
pub type AreaLightColumns = Columns<19>;

/// One emitting triangle, in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AreaLight {
    corner: Vec3,
    edges: [Vec3; 2],
    normal: Vec3,
    emission: Emission,
    /// How far off its plane a shadow ray ends: this, and so much per distance that it has come.
    p_error: f32,
    error_per_distance: f32,
    /// 1 / area [1/m²].
    inv_area: f32,
}

impl AreaLight {
    /// The light and its area in f64, which tiny, huge and slender triangles neither underflow, overflow nor lose to
    /// cancellation. A triangle without area never emits.
    pub(super) fn new(corners: [Vec3; 3], emission: Emission) -> (AreaLight, f64) {
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let cross = (b - a).cross(c - a);
        let longest_squared = [b - a, c - b, a - c]
            .map(DVec3::length_squared)
            .into_iter()
            .fold(0.0, f64::max);
        let slenderness = longest_squared / cross.length();
        let normal = face_normal(corners).unwrap_or(Vec3::ZERO);
        let light = AreaLight {
            corner: corners[0],
            edges: [(b - a).as_vec3(), (c - a).as_vec3()],
            normal,
            emission,
            p_error: position_error(largest_coordinates(corners), normal),
            error_per_distance: (ERROR_PER_DISTANCE * slenderness).min(MAX_ERROR_PER_DISTANCE) as f32,
            inv_area: (2.0 / cross.length()) as f32,
        };
        (light, 0.5 * cross.length())
    }

    /// All numbers, for [`AreaLightColumns`].
    #[inline(always)]
    pub fn to_array(&self) -> [f32; 19] {
        let [corner, edge_b, edge_c, normal] = [self.corner, self.edges[0], self.edges[1], self.normal];
        let Emission { radiance, both_sides } = self.emission;
        [
            corner.x,
            corner.y,
            corner.z,
            edge_b.x,
            edge_b.y,
            edge_b.z,
            edge_c.x,
            edge_c.y,
            edge_c.z,
            normal.x,
            normal.y,
            normal.z,
            radiance.r,
            radiance.g,
            radiance.b,
            f32::from(both_sides),
            self.p_error,
            self.error_per_distance,
            self.inv_area,
        ]
    }

    /// The inverse of [`AreaLight::to_array`].
    #[inline(always)]
    pub fn from_array(numbers: [f32; 19]) -> AreaLight {
        let vec3 = |k: usize| Vec3::new(numbers[k], numbers[k + 1], numbers[k + 2]);
        AreaLight {
            corner: vec3(0),
            edges: [vec3(3), vec3(6)],
            normal: vec3(9),
            emission: Emission {
                radiance: Rgb::new(numbers[12], numbers[13], numbers[14]),
                both_sides: numbers[15] > 0.0,
            },
            p_error: numbers[16],
            error_per_distance: numbers[17],
            inv_area: numbers[18],
        }
    }

    /// The unit normal of the front side; zero for a triangle without area.
    pub(super) fn normal(&self) -> Vec3 {
        self.normal
    }

    /// Whether 1 / area is a number: the area is neither zero nor beyond what f32 can invert.
    pub(super) fn has_density(&self) -> bool {
        self.inv_area > 0.0 && self.inv_area.is_finite()
    }

    /// A point on the triangle, which was drawn with probability `pmf`, as seen from `p`: direction, radiance, density per
    /// solid angle, and the shadow ray's end. `None` where the light turns its back or is seen edge-on.
    #[inline(always)]
    pub fn sample(&self, pmf: f32, p: Vec3, u: [f32; 2]) -> Option<super::LightSample> {
        let [weight_b, weight_c] = warp::triangle(u);
        let point = self.corner + self.edges[0] * weight_b + self.edges[1] * weight_c;
        let (wi, distance) = (point - p).normalize_and_length();
        let cos = -self.normal.dot(wi);
        let radiance = self.emission.from_side(cos > 0.0);
        let pdf_w = self.pdf_w(pmf, distance * distance, cos);
        if radiance.is_black() || !(pdf_w > 0.0 && pdf_w.is_finite()) {
            return None;
        }
        let off_plane = self.p_error + self.error_per_distance * distance;
        let target = offset_point(point, off_plane, self.normal * cos.signum());
        Some(super::LightSample {
            wi,
            radiance,
            pdf_w,
            target: Some(target),
        })
    }

    /// Density per solid angle of a point at this squared distance, seen under this cosine [1/sr]; `pmf` is the probability
    /// of drawing this triangle.
    #[inline(always)]
    pub(super) fn pdf_w(&self, pmf: f32, distance_squared: f32, cos: f32) -> f32 {
        pmf * self.inv_area * distance_squared / cos.abs()
    }
}
