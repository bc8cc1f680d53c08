//! A ray–triangle test without cracks: Woop, Benthin, Wald 2013, "Watertight Ray/Triangle Intersection", JCGT 2(1).
//!
//! The ray is sheared onto the z axis, so that the test is whether the origin of the plane lies in the projected
//! triangle. A corner projects to the same point whichever triangle it belongs to. The sign of an edge function
//! `a·b − c·d` of such points is exact: rounding is monotone, so that the f32 difference has the right sign or is zero,
//! and where it is zero the products are repeated in f64, which holds them without rounding. Neighbours therefore agree
//! on every edge and vertex, and a ray on an edge hits both.
//!
//! The distance departs from the paper, which interpolates it between the corners: its error is then an ulp of the
//! farthest corner, and a ray that leaves a large triangle at a small angle hits it again. Here it is that of the plane, in
//! f64, and only for triangles that are hit.

use super::Ray;
use crate::math::Vec3;
use glam::{DVec3, Vec3A, Vec3Swizzles};

/// A ray prepared for many triangles.
#[derive(Clone, Copy, Debug)]
pub struct TriangleRay {
    origin: Vec3,
    direction: Vec3,
    /// The axes that become x, y and z, which is the one of the largest component of the direction. Turned, not swapped:
    /// the winding does not matter to a two-sided test.
    axes: [u8; 3],
    /// The origin along these axes.
    start: Vec3,
    /// x and y per unit of z, and 1/z, of the direction along these axes.
    shear: Vec3,
    t_min: f32,
}

/// The corners of a triangle as the test reads them: x of all three, then y, then z, so that an axis is chosen by an index
/// and vector instructions take all corners at once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners([Vec3A; 3]);

impl From<[Vec3; 3]> for Corners {
    #[inline]
    fn from([a, b, c]: [Vec3; 3]) -> Corners {
        Corners([
            Vec3A::new(a.x, b.x, c.x),
            Vec3A::new(a.y, b.y, c.y),
            Vec3A::new(a.z, b.z, c.z),
        ])
    }
}

/// Where a ray meets a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleHit {
    /// Distance in lengths of the direction.
    pub t: f32,
    /// Barycentric weight of the second corner, in [0, 1].
    pub u: f32,
    /// Barycentric weight of the third corner, in [0, 1].
    pub v: f32,
}

impl TriangleRay {
    /// Prepares a ray; the direction need not be a unit vector. `None` if nothing can be hit: the direction is zero, a
    /// component is not finite, or the segment is empty.
    #[inline]
    pub fn new(ray: &Ray) -> Option<TriangleRay> {
        let size = ray.direction.abs();
        if !(ray.origin.is_finite() && ray.direction.is_finite() && size.max_element() > 0.0 && ray.t_min < ray.t_max) {
            return None;
        }
        let axes = if size.x > size.y && size.x > size.z {
            [1, 2, 0]
        } else if size.y > size.z {
            [2, 0, 1]
        } else {
            [0, 1, 2]
        };
        let permute = |v: Vec3| Vec3::from(axes.map(|axis| v[usize::from(axis)]));
        let d = permute(ray.direction);
        Some(TriangleRay {
            origin: ray.origin,
            direction: ray.direction,
            axes,
            start: permute(ray.origin),
            shear: Vec3::new(d.x / d.z, d.y / d.z, 1.0 / d.z),
            t_min: ray.t_min,
        })
    }

    /// The hit in the open interval from the ray's `t_min` to `t_max`, of either side. Triangles seen edge-on and
    /// triangles without area are not hit, nor must those be tried with a corner beyond [`LARGEST_COORDINATE`].
    #[inline]
    pub fn intersect(&self, corners: &Corners, t_max: f32) -> Option<TriangleHit> {
        let along = |i: usize| corners.0[usize::from(self.axes[i])];
        let z = along(2) - self.start.z;
        let x = along(0) - self.start.x - self.shear.x * z;
        let y = along(1) - self.start.y - self.shear.y * z;
        // Twice the signed areas opposite to each corner.
        let weights = x.zxy() * y.yzx() - y.zxy() * x.yzx();
        let (negative, positive) = (weights.cmplt(Vec3A::ZERO), weights.cmpgt(Vec3A::ZERO));
        let (negative, positive) = (negative.bitmask(), positive.bitmask());
        let weights = if negative | positive != 0b111 {
            if weights.is_nan() {
                return None;
            }
            // f64 to the end: the products of a triangle of 1e-23 are below all f32.
            let (x, y) = (x.as_dvec3(), y.as_dvec3());
            let weights = x.zxy() * y.yzx() - y.zxy() * x.yzx();
            if weights.min_element() < 0.0 && weights.max_element() > 0.0 {
                return None;
            }
            weights
        } else if negative != 0 && positive != 0 {
            return None;
        } else {
            weights.as_dvec3()
        };
        // Most triangles that the line meets lie outside of the segment.
        let ends = (z * self.shear.z).to_array();
        let nearest = ends[0].min(ends[1]).min(ends[2]);
        let farthest = ends[0].max(ends[1]).max(ends[2]);
        if nearest >= t_max || farthest <= self.t_min {
            return None;
        }
        let sum = weights.x + weights.y + weights.z;
        if sum == 0.0 || !sum.is_finite() {
            return None;
        }
        // A plane seen edge-on has its distance anywhere, or nowhere (NaN, which `max` drops): between the corners is all
        // that is known. Not `clamp`, which panics where the ends are NaN, as for a direction of 1e-39.
        let t = self.distance_to_plane(corners).max(nearest).min(farthest);
        let scale = 1.0 / sum;
        (t > self.t_min && t < t_max && t.is_finite()).then_some(TriangleHit {
            t,
            u: (weights.y * scale) as f32,
            v: (weights.z * scale) as f32,
        })
    }

    /// Distance to the plane of a triangle. Differences and products of f32 are exact in f64 but for a last rounding.
    #[inline]
    fn distance_to_plane(&self, corners: &Corners) -> f32 {
        let [x, y, z] = corners.0.map(|row| row.as_dvec3());
        let a = DVec3::new(x.x, y.x, z.x);
        let (ab, ac) = (DVec3::new(x.y, y.y, z.y) - a, DVec3::new(x.z, y.z, z.z) - a);
        let normal = ab.cross(ac);
        (normal.dot(a - self.origin.as_dvec3()) / normal.dot(self.direction.as_dvec3())) as f32
    }
}

/// Triangles with a corner beyond this are never hit: products of edges leave the f32 range. It is Embree's own limit.
pub const LARGEST_COORDINATE: f32 = 1.8e18;

/// Whether a triangle can be hit: its corners must not lie on a line, which has no normal, nor too far off.
pub(super) fn can_be_hit(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let is_near = |p: &Vec3| p.abs().max_element() <= LARGEST_COORDINATE;
    (b - a).cross(c - a) != DVec3::ZERO && corners.iter().all(is_near)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hit(ray: &Ray, corners: &[Vec3; 3]) -> Option<TriangleHit> {
        TriangleRay::new(ray).and_then(|prepared| prepared.intersect(&Corners::from(*corners), ray.t_max))
    }

    /// Uniform in [-1, 1), from the upper bits of a 64-bit congruential generator.
    fn random(state: &mut u64) -> f32 {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    fn random_point(state: &mut u64) -> Vec3 {
        Vec3::new(random(state), random(state), random(state))
    }

    /// A closed surface with irregular triangles: an octahedron split three times, its vertices moved in and out.
    fn crumpled_ball(scale: f32) -> Vec<[Vec3; 3]> {
        let mut triangles: Vec<[Vec3; 3]> = (0..8)
            .map(|i| {
                let sign = |bit: i32| if i & bit == 0 { 1.0 } else { -1.0 };
                [Vec3::X * sign(1), Vec3::Y * sign(2), Vec3::Z * sign(4)]
            })
            .collect();
        for _ in 0..3 {
            triangles = triangles
                .iter()
                .flat_map(|&[a, b, c]| {
                    // Sums of the same two numbers, so that neighbours get the same midpoint.
                    let (ab, bc, ca) = (a + b, b + c, c + a);
                    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]].map(|t| t.map(Vec3::normalize))
                })
                .collect();
        }
        let crumple = |p: Vec3| p * (1.0 + 0.2 * (7.0 * p.x + 11.0 * p.y + 13.0 * p.z).sin()) * scale;
        triangles.iter().map(|t| t.map(crumple)).collect()
    }

    #[test]
    fn rays_aimed_at_the_edges_and_vertices_of_a_closed_mesh_never_leak() {
        let mut state = 1;
        for exponent in -6..=6 {
            let scale = 10f32.powi(exponent);
            let triangles = crumpled_ball(scale);
            for i in 0..4000 {
                let [a, b, _] = triangles[i % triangles.len()];
                let target = match i / triangles.len() % 2 {
                    0 => a,
                    _ => a.lerp(b, random(&mut state).abs()),
                };
                let origin = random_point(&mut state) * 0.3 * scale;
                let ray = Ray::new(origin, (target - origin).normalize());
                let prepared = TriangleRay::new(&ray).unwrap();
                let hits = triangles
                    .iter()
                    .filter_map(|t| prepared.intersect(&Corners::from(*t), f32::INFINITY));
                assert!(hits.count() > 0, "{ray:?} leaves the mesh at scale {scale}");
            }
        }
    }

    #[test]
    fn a_ray_through_an_edge_hits_both_neighbours_at_the_same_distance() {
        let (a, b) = (Vec3::new(-1.0, 0.0, 2.0), Vec3::new(1.0, 0.0, 2.0));
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        let upper = hit(&ray, &[a, b, Vec3::new(0.0, 1.0, 3.0)]).unwrap();
        let lower = hit(&ray, &[b, a, Vec3::new(0.0, -1.0, 3.0)]).unwrap();
        assert_eq!(upper.t, 2.0);
        assert_eq!(lower.t, 2.0);
    }

    #[test]
    fn the_weights_and_the_distance_give_the_same_point() {
        let mut state = 2;
        let mut hits = 0;
        for _ in 0..100_000 {
            let corners = [(); 3].map(|()| random_point(&mut state));
            let direction = random_point(&mut state).normalize();
            let ray = Ray::new(random_point(&mut state) * 3.0, direction);
            if let Some(TriangleHit { t, u, v }) = hit(&ray, &corners) {
                hits += 1;
                assert!(u >= 0.0 && v >= 0.0 && u + v <= 1.0 + f32::EPSILON, "{u} {v}");
                let by_weights = corners[0] * (1.0 - u - v) + corners[1] * u + corners[2] * v;
                let along_ray = ray.origin + ray.direction * t;
                assert!(
                    (by_weights - along_ray).length() < 2e-6 * (1.0 + t),
                    "{ray:?} {corners:?}"
                );
            }
        }
        assert!(hits > 300, "{hits}");
    }

    #[test]
    fn both_ends_of_the_segment_are_excluded() {
        let corners = [
            Vec3::new(-1.0, -1.0, 4.0),
            Vec3::new(3.0, -1.0, 4.0),
            Vec3::new(-1.0, 3.0, 4.0),
        ];
        let segment = |t_min: f32, t_max: f32| Ray {
            t_min,
            t_max,
            ..Ray::new(Vec3::ZERO, Vec3::Z)
        };
        assert!(hit(&segment(0.0, 4.0), &corners).is_none());
        assert!(hit(&segment(4.0, 9.0), &corners).is_none());
        assert!(hit(&segment(4f32.next_down(), 4f32.next_up()), &corners).is_some());
    }

    #[test]
    fn triangles_without_area_or_seen_edge_on_are_not_hit() {
        let ray = Ray::new(Vec3::ZERO, Vec3::Z);
        assert!(hit(&ray, &[Vec3::Z; 3]).is_none());
        assert!(hit(&ray, &[-Vec3::X + Vec3::Z, Vec3::X + Vec3::Z, Vec3::Z]).is_none());
        assert!(hit(&ray, &[Vec3::Z, 2.0 * Vec3::Z, Vec3::X + Vec3::Z]).is_none());
        assert!(!can_be_hit(&[-Vec3::X, Vec3::ZERO, Vec3::X]));
        assert!(can_be_hit(&[Vec3::ZERO, Vec3::X * 1e-20, Vec3::Y * 1e-20]));
        assert!(can_be_hit(&[Vec3::ZERO, Vec3::X * 1e18, Vec3::Y * 1e18]));
        assert!(!can_be_hit(&[Vec3::ZERO, Vec3::X * 2e18, Vec3::Y]));
    }

    /// Products of coordinates below 1e-23 are no f32, those of coordinates above 1e19 none either.
    #[test]
    fn triangles_are_hit_where_products_vanish_and_not_where_they_overflow() {
        let scaled = |scale: f32| {
            let corners = [
                Vec3::new(-1.0, -1.0, 2.0),
                Vec3::new(1.0, -1.0, 2.0),
                Vec3::new(0.0, 1.0, 2.0),
            ];
            hit(&Ray::new(Vec3::ZERO, Vec3::Z), &corners.map(|p| p * scale))
        };
        for scale in [1e-30, 1e-23, 1e-19, 1.0, 1e18] {
            let TriangleHit { t, u, v } = scaled(scale).unwrap();
            assert_eq!((t, u, v), (2.0 * scale, 0.25, 0.5), "{scale:e}");
        }
        assert_eq!(scaled(1e20), None);
    }

    #[test]
    fn rays_that_are_not_numbers_or_have_no_direction_are_refused() {
        for bad in [f32::NAN, f32::INFINITY] {
            assert!(TriangleRay::new(&Ray::new(Vec3::splat(bad), Vec3::Z)).is_none());
            assert!(TriangleRay::new(&Ray::new(Vec3::ZERO, Vec3::new(0.0, bad, 1.0))).is_none());
        }
        assert!(TriangleRay::new(&Ray::new(Vec3::ZERO, Vec3::ZERO)).is_none());
        assert!(
            TriangleRay::new(&Ray {
                t_max: f32::NAN,
                ..Ray::new(Vec3::ZERO, Vec3::Z)
            })
            .is_none()
        );
    }
}
