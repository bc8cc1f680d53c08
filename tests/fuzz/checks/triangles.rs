//! Rays and triangles of any 32 bits per coordinate: origin, direction, both ends of the ray, then nine numbers a
//! triangle, all little-endian.

use embrace::accel::brute::Brute;
#[cfg(feature = "embree")]
use embrace::accel::embree::Embree;
#[cfg(feature = "obvhs")]
use embrace::accel::obvhs::Obvhs;
use embrace::accel::triangle::{Corners, TriangleRay};
use embrace::accel::{Accel, BuildOptions, Geometry, Hit, Placement, Ray};
use embrace::math::Vec3;
use embrace::mesh::TriangleMesh;
use std::sync::Arc;

/// Enough for two levels of a hierarchy.
const MOST: usize = 40;

/// Whether boxes are sure to be found: beyond 1e15 obvhs has none, and in one thinner than 1e-22 of its distance a ray
/// along an axis is lost. Coordinates of this range differ by 1e-13 or not at all.
#[cfg(feature = "obvhs")]
fn is_ordinary(p: &Vec3) -> bool {
    p.to_array()
        .iter()
        .all(|c| *c == 0.0 || (1e-6..=1e6).contains(&c.abs()))
}

pub(crate) fn check(data: &[u8]) {
    let numbers: Vec<f32> = data.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
    let (Some(&ray), triangles) = (numbers.first_chunk::<8>(), numbers.get(8..).unwrap_or_default()) else {
        return;
    };
    let given = Ray {
        origin: Vec3::new(ray[0], ray[1], ray[2]),
        direction: Vec3::new(ray[3], ray[4], ray[5]),
        t_min: ray[6],
        t_max: ray[7],
    };
    let triangles: Vec<[Vec3; 3]> = triangles
        .as_chunks::<9>()
        .0
        .iter()
        .take(MOST)
        .map(|t| [0, 3, 6].map(|i| Vec3::new(t[i], t[i + 1], t[i + 2])))
        .collect();
    let rays = aimed(given, &triangles);
    for ray in &rays {
        triangles.iter().for_each(|corners| check_triangle(ray, corners));
    }

    // Backends take validated meshes, and rays of unit length that do not start behind their origin.
    let finite: Vec<[Vec3; 3]> = triangles
        .into_iter()
        .filter(|t| t.iter().all(|p| p.is_finite()))
        .collect();
    let rays: Vec<Ray> = rays.into_iter().filter_map(for_backends).collect();
    let geometry = geometry_of(&finite);
    let brute = build::<Brute>(&geometry);
    let expected: Vec<Option<Hit>> = rays.iter().map(|ray| brute.intersect(ray)).collect();
    for (ray, hit) in rays.iter().zip(&expected) {
        check_hit(Brute::NAME, ray, hit, finite.len());
        assert_eq!(brute.occluded(ray), hit.is_some(), "brute: {ray:?}");
    }
    #[cfg(feature = "obvhs")]
    {
        let obvhs = build::<Obvhs>(&geometry);
        let are_ordinary = finite.as_flattened().iter().all(is_ordinary);
        for (ray, expected) in rays.iter().zip(&expected) {
            let hit = obvhs.intersect(ray);
            check_hit(Obvhs::NAME, ray, &hit, finite.len());
            assert_eq!(obvhs.occluded(ray), hit.is_some(), "obvhs: {ray:?}");
            // The same test of the same triangles.
            if are_ordinary && is_ordinary(&ray.origin) {
                assert_eq!(hit, *expected, "{ray:?}");
            }
        }
    }
    #[cfg(feature = "embree")]
    {
        let embree = build::<Embree>(&geometry);
        let (mut hits, mut occluded) = (Vec::new(), Vec::new());
        for rays in rays.chunks(16) {
            embree.intersect_coherent(rays, &mut hits);
            embree.occluded_many(rays, &mut occluded);
        }
        assert_eq!((hits.len(), occluded.len()), (rays.len(), rays.len()));
        // Its weights may be below 0 or above 1 by a rounding.
        for (ray, packed) in rays.iter().zip(&hits) {
            for hit in [*packed, embree.intersect(ray)].into_iter().flatten() {
                check_target(Embree::NAME, &hit, finite.len());
                check_distance(Embree::NAME, ray, hit.t);
                assert!(hit.u.is_finite() && hit.v.is_finite(), "embree: {hit:?}: {ray:?}");
            }
            embree.occluded(ray);
        }
    }
}

/// The ray as it is, and turned to the corners, the middles of the edges and the middle of the first triangles: raw bits
/// seldom hit.
fn aimed(given: Ray, triangles: &[[Vec3; 3]]) -> Vec<Ray> {
    let mut rays = vec![given];
    for &[a, b, c] in triangles.iter().take(3) {
        for target in [a, b, c, (a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5, (a + b + c) / 3.0] {
            rays.push(Ray {
                direction: target - given.origin,
                ..given
            });
        }
    }
    rays
}

fn for_backends(ray: Ray) -> Option<Ray> {
    Some(Ray {
        direction: ray.direction.as_dvec3().try_normalize()?.as_vec3(),
        t_min: ray.t_min.max(0.0),
        ..ray
    })
}

fn check_triangle(ray: &Ray, corners: &[Vec3; 3]) {
    let hit = TriangleRay::new(ray).and_then(|prepared| prepared.intersect(&Corners::from(*corners), ray.t_max));
    if let Some(hit) = hit {
        check_distance("triangle", ray, hit.t);
        check_weights("triangle", ray, hit.u, hit.v);
    }
}

fn check_hit(backend: &str, ray: &Ray, hit: &Option<Hit>, triangles: usize) {
    if let Some(hit) = hit {
        check_target(backend, hit, triangles);
        check_distance(backend, ray, hit.t);
        check_weights(backend, ray, hit.u, hit.v);
    }
}

fn check_target(backend: &str, hit: &Hit, triangles: usize) {
    assert!(
        hit.placement == 0 && (hit.triangle as usize) < triangles,
        "{backend}: {hit:?}"
    );
}

fn check_distance(who: &str, ray: &Ray, t: f32) {
    assert!(
        t.is_finite() && t > ray.t_min && t < ray.t_max,
        "{who}: t = {t}: {ray:?}"
    );
}

fn check_weights(who: &str, ray: &Ray, u: f32, v: f32) {
    let unit = 0.0..=1.0;
    assert!(
        unit.contains(&u) && unit.contains(&v),
        "{who}: u = {u}, v = {v}: {ray:?}"
    );
    // Each of the two is rounded, and their sum.
    assert!(u + v <= 1.0 + f32::EPSILON, "{who}: u + v = {}: {ray:?}", u + v);
}

fn geometry_of(triangles: &[[Vec3; 3]]) -> Geometry {
    if triangles.is_empty() {
        return Geometry::default();
    }
    Geometry {
        meshes: vec![Arc::new(TriangleMesh {
            positions: triangles.as_flattened().to_vec(),
            indices: (0..triangles.len() as u32)
                .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                .collect(),
            ..TriangleMesh::default()
        })],
        placements: vec![Placement {
            mesh: 0,
            to_world: None,
        }],
    }
}

fn build<A: Accel>(geometry: &Geometry) -> A {
    A::build(geometry, BuildOptions::default()).unwrap_or_else(|error| panic!("{}: {error}", A::NAME))
}
