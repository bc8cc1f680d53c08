//! Shading data at a hit, computed from our own vertices whatever the backend, and the only ray-offset code.
//!
//! **Offsets.** A point computed from barycentric coordinates is off its triangle by rounding: on each axis by at most a few
//! ulps of the largest corner coordinate (after pbrt's error bounds; of the corners, not the point, because backends
//! compute with the corners), which counts as much as the normal points along that axis. A floor however wide is thus left
//! by no more than its own height and the point's place ask for. Rays start that far off the plane along the geometric
//! normal. The bound is relative to the coordinates, so there is no length that suits one scene and breaks another:
//! scaling a scene by a power of two scales every origin exactly.
//!
//! **Large triangles.** Interpolating between corners that are far away leaves a point as inexact as they are. Where they
//! are much farther off than the ray has come, the point is that of the ray on the triangle's plane instead.
//!
//! **Smooth normals.** Interpolated normals disagree with the flat triangle in three ways:
//! - Where `wo` lies below the shading normal's horizon, the normal is bent towards `wo` until it does not, so that
//!   silhouettes neither go black nor reflect from behind.
//! - Rays start on the side of the *geometric* normal that the lobe scatters to. A reflected direction below the true
//!   horizon then meets the surface itself: nothing leaks through.
//! - Triangles that face away from a light which their vertex normals still see would end in a hard, faceted shadow. Rays
//!   on the bulging side therefore start from a point lifted onto the curved surface that the vertex normals describe
//!   (Hanika 2021, "Hacking the Shadow Terminator"). The lift is zero on flat and hollow parts and shrinks with the
//!   square of the triangle size.

use crate::accel::{Geometry, Hit, Ray};
use crate::material::SurfacePoint;
use crate::math::{Frame, Rgb, Vec2, Vec3};
use glam::Affine3A;

/// Bound on the rounding of a coordinate, relative to the largest that it is computed from: 2⁻²⁰, eight ulps. Interpolation
/// takes three roundings; instance transforms and the backends' own arithmetic the rest.
const POSITION_ERROR: f32 = 1.0 / 1_048_576.0;

/// Corners this many times farther off than the way of a ray make a triangle a large one: four of 24 bits are lost.
const LARGE: f32 = 16.0;

/// What shading needs to know about a hit.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    /// The point on the triangle.
    pub p: Vec3,
    /// Unit direction to where the ray came from.
    pub wo: Vec3,
    /// Unit normal of the triangle, on the side of `wo`.
    pub ng: Vec3,
    /// Local frame around the unit shading normal, on the side of `wo`.
    pub frame: Frame,
    /// Whether `wo` is on the front side: corners counter-clockwise.
    pub front: bool,
    /// How far `p` may be off the triangle because of rounding between its corners.
    pub p_error: f32,
    /// From `p` to the curved surface on the side of `wo`; zero without smooth normals.
    pub lift: Vec3,
}

/// Square of the sine between two edges below which a triangle is a needle: rounding in f32 would tilt its normal by
/// more than 1e-5.
const NEEDLE: f32 = 1e-4;

/// The unit normal of a triangle by its winding; `None` if it has none.
#[inline]
pub fn face_normal(corners: [Vec3; 3]) -> Option<Vec3> {
    let (normal, is_plain) = plain_face_normal(corners);
    if is_plain {
        return Some(normal);
    }
    extreme_face_normal(corners)
}

/// The same in f32, and whether that is exact enough.
#[inline(always)]
fn plain_face_normal([a, b, c]: [Vec3; 3]) -> (Vec3, bool) {
    let edges = [b - a, c - a];
    let cross = edges[0].cross(edges[1]);
    let length_squared = cross.length_squared();
    let is_wide = length_squared > NEEDLE * edges[0].length_squared() * edges[1].length_squared();
    let is_plain = is_wide & (length_squared > 1e-30) & (length_squared < 1e30);
    (cross * (1.0 / length_squared.sqrt()), is_plain)
}

/// The normal of a needle, in f64, and of a triangle so small or large that squares leave the f32 range: a power of two
/// brings it back to a size near 1, so that its normal has the digits of the same triangle at any other size.
#[cold]
fn extreme_face_normal(corners: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let size = (b - a).abs().max((c - a).abs()).max_element();
    if size == 0.0 {
        return None;
    }
    let scale = size.log2().floor().exp2().recip();
    let edges = [(b - a) * scale, (c - a) * scale];
    let rounded = edges.map(|edge| edge.as_vec3());
    let cross = rounded[0].cross(rounded[1]);
    let length_squared = cross.length_squared();
    if length_squared > NEEDLE * rounded[0].length_squared() * rounded[1].length_squared() {
        return Some(cross * (1.0 / length_squared.sqrt()));
    }
    let cross = edges[0].cross(edges[1]);
    cross.try_normalize().map(|normal| normal.as_vec3())
}

/// The largest coordinate of the corners on each axis.
#[inline(always)]
pub fn largest_coordinates([a, b, c]: [Vec3; 3]) -> Vec3 {
    a.abs().max(b.abs()).max(c.abs())
}

/// How far a point of a triangle of these [`largest_coordinates`] and the unit normal `n` may be off it because of rounding
/// between its corners.
#[inline(always)]
pub fn position_error(largest: Vec3, n: Vec3) -> f32 {
    largest.dot(n.abs()) * POSITION_ERROR
}

/// Moves a point off its triangle to the side that the unit vector `n` (plus or minus its normal) points to: by the
/// triangle's `p_error`, but at least by what the point's own coordinates resolve, since backends differ on hits at
/// distance 0. Rounding the sum takes back at most a tenth of the offset.
#[inline(always)]
pub fn offset_point(p: Vec3, p_error: f32, n: Vec3) -> Vec3 {
    p + n * p_error.max(p.abs().max_element() * POSITION_ERROR)
}

/// Where a ray meets the plane of a triangle, if it does not go along it.
#[cold]
fn point_on_plane(ray: &Ray, corners: [Vec3; 3]) -> Option<Vec3> {
    let [a, b, c] = corners.map(|p| p.as_dvec3());
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a - origin) / normal.dot(direction);
    let p = (origin + direction * t).as_vec3();
    p.is_finite().then_some(p)
}

/// Texture coordinates at a hit; the barycentric ones where the mesh has none.
#[inline(always)]
pub fn texture_coordinates(geometry: &Geometry, hit: &Hit) -> Vec2 {
    texture_coordinates_between(geometry, hit, || geometry.corners(hit))
}

/// The same, given the [`Geometry::corners`] of the hit.
#[inline(always)]
pub fn texture_coordinates_between(geometry: &Geometry, hit: &Hit, corners: impl FnOnce() -> [u32; 3]) -> Vec2 {
    let mesh = &*geometry.meshes[geometry.placements[hit.placement as usize].mesh as usize];
    if mesh.uvs.is_empty() {
        return Vec2::new(hit.u, hit.v);
    }
    let [a, b, c] = corners().map(|i| mesh.uvs[i as usize]);
    a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
}

/// Texture coordinates and vertex colour at a hit.
#[inline(always)]
pub fn surface_point(geometry: &Geometry, hit: &Hit) -> SurfacePoint {
    let mesh = &*geometry.meshes[geometry.placements[hit.placement as usize].mesh as usize];
    let color = if mesh.colors.is_empty() {
        Rgb::WHITE
    } else {
        let [a, b, c] = mesh.indices[hit.triangle as usize].map(|i| mesh.colors[i as usize]);
        a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
    };
    SurfacePoint {
        uv: texture_coordinates(geometry, hit),
        color,
    }
}

/// The directions in world coordinates along which the two texture coordinates grow at a hit, as fast as 1 for each unit of
/// them; `None` where the mesh has no texture coordinates, or the triangle no area in them.
pub fn texture_directions(geometry: &Geometry, hit: &Hit) -> Option<[Vec3; 2]> {
    let mesh = &*geometry.meshes[geometry.placements[hit.placement as usize].mesh as usize];
    if mesh.uvs.is_empty() {
        return None;
    }
    let [a, b, c] = geometry
        .world_triangle(hit.placement, hit.triangle)
        .map(|p| p.as_dvec3());
    let [uv_a, uv_b, uv_c] = mesh.indices[hit.triangle as usize].map(|i| mesh.uvs[i as usize].as_dvec2());
    let (edge_b, edge_c) = (uv_b - uv_a, uv_c - uv_a);
    let determinant = edge_b.perp_dot(edge_c);
    let dp_du = ((b - a) * edge_c.y - (c - a) * edge_b.y) / determinant;
    let dp_dv = ((c - a) * edge_b.x - (b - a) * edge_c.x) / determinant;
    let directions = [dp_du.as_vec3(), dp_dv.as_vec3()];
    directions
        .iter()
        .all(|d| d.is_finite() && *d != Vec3::ZERO)
        .then_some(directions)
}

/// The triangle of a hit, in world coordinates, with what shading takes from its mesh: all that has to be fetched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingTriangle {
    /// Corners.
    pub corners: [Vec3; 3],
    /// Unit vertex normals; zero where the mesh has none to shade with.
    pub normals: [Vec3; 3],
    /// 1, or -1 where a transform mirrors: which way the winding goes.
    pub orientation: f32,
}

impl ShadingTriangle {
    /// The triangle of `hit`. `SMOOTH` allows vertex normals.
    #[inline(always)]
    pub fn new<const SMOOTH: bool>(geometry: &Geometry, hit: &Hit) -> ShadingTriangle {
        ShadingTriangle::of_corners::<SMOOTH>(geometry, hit.placement, geometry.corners(hit))
    }

    /// The triangle of these corners of a placement. `SMOOTH` allows vertex normals.
    #[inline(always)]
    pub fn of_corners<const SMOOTH: bool>(geometry: &Geometry, placement: u32, corners: [u32; 3]) -> ShadingTriangle {
        let placement = &geometry.placements[placement as usize];
        let mesh = &*geometry.meshes[placement.mesh as usize];
        let [a, b, c] = corners;
        let (a, b, c) = (a as usize, b as usize, c as usize);
        let mut triangle = ShadingTriangle {
            corners: [mesh.positions[a], mesh.positions[b], mesh.positions[c]],
            normals: [Vec3::ZERO; 3],
            orientation: 1.0,
        };
        if SMOOTH && !mesh.normals.is_empty() {
            triangle.normals = [mesh.normals[a], mesh.normals[b], mesh.normals[c]];
        }
        if let Some(to_world) = &placement.to_world {
            triangle.place::<SMOOTH>(to_world);
        }
        // A normal that could not be repaired is zero: the face normal serves for its whole triangle.
        if SMOOTH && triangle.normals.contains(&Vec3::ZERO) {
            triangle.normals = [Vec3::ZERO; 3];
        }
        triangle
    }

    fn place<const SMOOTH: bool>(&mut self, to_world: &Affine3A) {
        self.corners = self.corners.map(|p| to_world.transform_point3(p));
        let m = to_world.matrix3;
        self.orientation = m.determinant().signum();
        if SMOOTH {
            // The cofactor matrix: the inverse transpose up to a positive factor and the sign of a mirroring.
            let cofactor = |n: Vec3| {
                let v = Vec3::from(m.y_axis.cross(m.z_axis)) * n.x
                    + Vec3::from(m.z_axis.cross(m.x_axis)) * n.y
                    + Vec3::from(m.x_axis.cross(m.y_axis)) * n.z;
                (v * self.orientation).try_normalize().unwrap_or(Vec3::ZERO)
            };
            self.normals = self.normals.map(cofactor);
        }
    }

    /// The point and the normal by the winding of a hit, in f32, and whether that is exact enough: not for
    /// [`ShadingTriangle::exact_point`]. Without branches, for loops over many hits.
    #[inline(always)]
    pub fn plain_point(&self, ray: &Ray, hit: &Hit) -> (Vec3, Vec3, bool) {
        let way = ray.origin.abs().max_element() + hit.t;
        let is_small = largest_coordinates(self.corners).max_element() <= LARGE * way;
        let (winding, is_plain) = plain_face_normal(self.corners);
        (self.interpolate(hit), winding, is_small & is_plain)
    }

    /// The same for triangles that are large, or needles, or of extreme size. `None` for one without area, which has no
    /// normal to shade with.
    #[cold]
    pub fn exact_point(&self, ray: &Ray, hit: &Hit) -> Option<(Vec3, Vec3)> {
        let way = ray.origin.abs().max_element() + hit.t;
        let mut p = self.interpolate(hit);
        if largest_coordinates(self.corners).max_element() > LARGE * way {
            p = point_on_plane(ray, self.corners).unwrap_or(p);
        }
        Some((p, face_normal(self.corners)?))
    }

    #[inline(always)]
    fn interpolate(&self, hit: &Hit) -> Vec3 {
        let [a, b, c] = self.corners;
        a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v
    }
}

impl SurfaceInteraction {
    /// Shading data of `hit`, which `ray` has found. `SMOOTH` allows vertex normals; `lift` the shadow terminator's remedy.
    /// `None` for a triangle without area, which has no normal to shade with.
    #[inline(always)]
    pub fn new<const SMOOTH: bool>(
        geometry: &Geometry,
        ray: &Ray,
        hit: &Hit,
        lift: bool,
    ) -> Option<SurfaceInteraction> {
        let triangle = ShadingTriangle::new::<SMOOTH>(geometry, hit);
        let (mut p, mut winding, is_exact) = triangle.plain_point(ray, hit);
        if !is_exact {
            (p, winding) = triangle.exact_point(ray, hit)?;
        }
        Some(SurfaceInteraction::at::<SMOOTH>(&triangle, ray, hit, p, winding, lift))
    }

    /// Shading data at the point `p` of a triangle whose unit normal by its winding is `winding`; both for `hit` by `ray`.
    // Always inlined: what a loop does not read, the lift or the frame, is then not computed.
    #[inline(always)]
    pub fn at<const SMOOTH: bool>(
        triangle: &ShadingTriangle,
        ray: &Ray,
        hit: &Hit,
        p: Vec3,
        winding: Vec3,
        lift: bool,
    ) -> SurfaceInteraction {
        let wo = -ray.direction;
        let p_error = position_error(largest_coordinates(triangle.corners), winding);
        let winding = winding * triangle.orientation;
        let front = wo.dot(winding) >= 0.0;
        let side = if front { 1.0 } else { -1.0 };
        let ng = winding * side;
        let mut ns = ng;
        let mut lifted = Vec3::ZERO;
        if SMOOTH {
            let [na, nb, nc] = triangle.normals.map(|n| n * side);
            let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
            let is_smooth = triangle.normals[0].abs().max_element() > 0.0;
            let interpolated = na * weights[0] + nb * weights[1] + nc * weights[2];
            let bent = bend_towards(interpolated.try_normalize().unwrap_or(ng), wo);
            ns = if is_smooth { bent } else { ng };
            if lift {
                // Normals of zero lift nothing.
                let lift =
                    |corner: Vec3, normal: Vec3, weight: f32| normal * ((p - corner).dot(normal).min(0.0) * weight);
                let [a, b, c] = triangle.corners;
                lifted = Vec3::ZERO - lift(a, na, weights[0]) - lift(b, nb, weights[1]) - lift(c, nc, weights[2]);
            }
        }
        SurfaceInteraction {
            p,
            wo,
            ng,
            frame: Frame::from_normal(ns),
            front,
            p_error,
            lift: lifted,
        }
    }

    /// Turns the shading normal to `n`, on the side of `wo`.
    pub fn set_shading_normal(&mut self, n: Vec3) {
        self.frame = Frame::from_normal(bend_towards(n, self.wo));
    }

    /// Bends the shading normal until the mirror direction of `wo` leaves the triangle: below it would meet the surface itself,
    /// and steep relief on smooth metal would go black.
    pub fn lift_reflection(&mut self) {
        /// The cosine to the triangle's normal that is left: enough for the shadow of relief not to take it all.
        const MIN_COS: f32 = 0.1;
        // Low eyes see low reflections in the flat surface, too.
        let least = MIN_COS.min(0.9 * self.wo.dot(self.ng));
        let n = self.frame.n;
        let mirrored = n * (2.0 * n.dot(self.wo)) - self.wo;
        let below = least - mirrored.dot(self.ng);
        if below > 0.0
            && let Some(lifted) = (mirrored + self.ng * below).try_normalize()
            && let Some(bent) = (self.wo + lifted).try_normalize()
        {
            self.frame = Frame::from_normal(bent);
        }
    }

    /// Where rays to the given side start: that of `wo`, or the opposite one.
    #[inline(always)]
    pub fn origin(&self, transmitted: bool) -> Vec3 {
        let below = offset_point(self.p, self.p_error, -self.ng);
        let above = offset_point(self.p + self.lift, self.p_error, self.ng);
        if transmitted { below } else { above }
    }

    /// An unbounded ray from this point.
    #[inline(always)]
    pub fn spawn_ray(&self, direction: Vec3, transmitted: bool) -> Ray {
        Ray::new(self.origin(transmitted), direction)
    }

    /// The segment from this point to `target`, which must be off its own surface already. `None` if they coincide.
    #[inline(always)]
    pub fn spawn_ray_to(&self, target: Vec3, transmitted: bool) -> Option<Ray> {
        let origin = self.origin(transmitted);
        let (direction, t_max) = (target - origin).normalize_and_length();
        (t_max > 0.0 && t_max.is_finite()).then_some(Ray {
            origin,
            direction,
            t_min: 0.0,
            t_max,
        })
    }
}

/// Turns the unit normal `ns` towards the unit vector `wo` until the angle between them is less than a right one.
#[inline(always)]
fn bend_towards(ns: Vec3, wo: Vec3) -> Vec3 {
    /// The cosine that is left; small enough to move no highlight, large enough that dividing by it is harmless.
    const MIN_COS: f32 = 1e-3;
    let cos = ns.dot(wo);
    let bent = (ns + wo * (MIN_COS - cos)).try_normalize().unwrap_or(wo);
    if cos >= MIN_COS { ns } else { bent }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accel::Placement;
    use crate::mesh::TriangleMesh;
    use glam::Affine3A;
    use std::sync::Arc;

    fn geometry(mesh: TriangleMesh, to_world: Option<Affine3A>) -> Geometry {
        Geometry {
            meshes: vec![Arc::new(mesh)],
            placements: vec![Placement { mesh: 0, to_world }],
        }
    }

    fn bulging_triangle() -> TriangleMesh {
        TriangleMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: [(-0.3, -0.3), (0.5, -0.3), (-0.3, 0.5)]
                .map(|(x, y)| Vec3::new(x, y, 1.0).normalize())
                .to_vec(),
            indices: vec![[0, 1, 2]],
            ..TriangleMesh::default()
        }
    }

    const HIT: Hit = Hit {
        t: 1.0,
        placement: 0,
        triangle: 0,
        u: 0.3,
        v: 0.3,
    };

    /// A ray that finds [`HIT`] or another point near the origin from the direction `wo`.
    fn seen_from(wo: Vec3) -> Ray {
        Ray::new(Vec3::new(0.3, 0.3, 0.0) + wo, -wo)
    }

    #[test]
    fn normals_face_the_viewer_on_both_sides() {
        let geometry = geometry(bulging_triangle(), None);
        for (wo, front) in [(Vec3::Z, true), (Vec3::NEG_Z, false)] {
            let si = SurfaceInteraction::new::<true>(&geometry, &seen_from(wo), &HIT, true).unwrap();
            assert_eq!(si.front, front);
            assert!(si.ng.dot(wo) > 0.0 && si.frame.n.dot(wo) > 0.0);
        }
    }

    #[test]
    fn the_lift_rises_on_the_bulging_side_and_is_zero_on_the_hollow_one() {
        let geometry = geometry(bulging_triangle(), None);
        let lift = |wo, lift| {
            SurfaceInteraction::new::<true>(&geometry, &seen_from(wo), &HIT, lift)
                .unwrap()
                .lift
        };
        assert!(lift(Vec3::Z, true).z > 0.0);
        assert_eq!(lift(Vec3::NEG_Z, true), Vec3::ZERO);
        assert_eq!(lift(Vec3::Z, false), Vec3::ZERO);
    }

    #[test]
    fn the_shading_normal_never_faces_away_from_the_viewer() {
        let geometry = geometry(bulging_triangle(), None);
        for i in 0..100 {
            let angle = i as f32 * 0.0628;
            let wo = Vec3::new(angle.cos(), angle.sin(), 0.01).normalize();
            let si = SurfaceInteraction::new::<true>(&geometry, &seen_from(wo), &HIT, true).unwrap();
            assert!(si.frame.n.dot(wo) > 0.0);
        }
    }

    #[test]
    fn an_instance_shades_as_the_same_mesh_in_world_coordinates() {
        for scale in [Vec3::new(2.0, 0.5, 3.0), Vec3::new(-1.0, 2.0, 0.7)] {
            let to_world = Affine3A::from_scale_rotation_translation(
                scale,
                glam::Quat::from_rotation_x(0.7),
                Vec3::new(1.0, -2.0, 3.0),
            );
            let wide = crate::math::DAffine3::from_mat4(glam::Mat4::from(to_world).as_dmat4());
            let instance = geometry(bulging_triangle(), Some(to_world));
            let baked = geometry(bulging_triangle().into_f64().into_f32(&wide), None);
            // Mirroring swaps the second and the third corner of the baked mesh.
            let baked_hit = if scale.x < 0.0 {
                Hit {
                    u: HIT.v,
                    v: HIT.u,
                    ..HIT
                }
            } else {
                HIT
            };
            let wo = Vec3::new(0.3, 0.8, 0.4).normalize();
            let a = SurfaceInteraction::new::<true>(&instance, &seen_from(wo), &HIT, true).unwrap();
            let b = SurfaceInteraction::new::<true>(&baked, &seen_from(wo), &baked_hit, true).unwrap();
            assert_eq!(a.front, b.front);
            for (x, y) in [(a.p, b.p), (a.ng, b.ng), (a.frame.n, b.frame.n), (a.lift, b.lift)] {
                assert!((x - y).length() < 1e-5, "{x} {y}");
            }
        }
    }

    #[test]
    fn origins_scale_exactly_with_powers_of_two() {
        let si = |scale: f32| {
            let mesh = TriangleMesh {
                positions: [
                    Vec3::new(0.1, 0.2, 0.3),
                    Vec3::new(1.3, -0.2, 0.9),
                    Vec3::new(0.4, 1.1, -0.7),
                ]
                .map(|p| p * scale)
                .to_vec(),
                indices: vec![[0, 1, 2]],
                ..TriangleMesh::default()
            };
            SurfaceInteraction::new::<false>(
                &geometry(mesh, None),
                &Ray::new(Vec3::Z * 2.0 * scale, Vec3::NEG_Z),
                &HIT,
                false,
            )
            .unwrap()
            .origin(false)
        };
        for exponent in [-20, -3, 5, 20] {
            let scale = 2f32.powi(exponent);
            assert_eq!(si(scale), si(1.0) * scale);
        }
    }

    #[test]
    fn a_triangle_without_area_has_no_normal() {
        assert!(face_normal([Vec3::ZERO, Vec3::X, Vec3::X * 2.0]).is_none());
        for scale in [1e-18f32, 1e-9, 1.0, 1e9, 1e18] {
            let normal = face_normal([Vec3::ZERO, Vec3::X * scale, Vec3::Y * scale]).unwrap();
            assert!((normal - Vec3::Z).length() < 1e-6, "{scale}");
        }
    }

    #[test]
    fn lifted_reflections_leave_the_triangle_and_those_that_do_are_left_alone() {
        let geometry = geometry(bulging_triangle(), None);
        for (wo, n) in [
            ((0.0, -0.5), (0.0, 0.8)),
            ((0.9, 0.1), (-0.7, 0.2)),
            ((0.3, 0.2), (0.1, -0.2)),
        ] {
            let upwards = |(x, y): (f32, f32)| Vec3::new(x, y, (1.0 - x * x - y * y).sqrt());
            let (wo, n) = (upwards(wo), upwards(n));
            let mut si = SurfaceInteraction::new::<true>(&geometry, &seen_from(wo), &HIT, true).unwrap();
            si.set_shading_normal(n);
            let before = si.frame.n;
            let ng = si.ng;
            let mirrored = |n: Vec3| (n * (2.0 * n.dot(wo)) - wo).dot(ng);
            si.lift_reflection();
            let after = si.frame.n;
            assert!(after.is_normalized() && after.dot(wo) > 0.0, "{after}");
            if mirrored(before) > 0.1 {
                assert_eq!(after, before);
            } else {
                assert!(mirrored(before) < 0.0, "a case of lifting: {before}");
                assert!(mirrored(after) > 1e-3, "{after} for {before}");
            }
        }
    }
}
