//! Every backend finds what the brute-force reference finds.
//!
//! A hit agrees when `t` is within 1e-5 of the reference, relative, and the triangle is the same or shares a corner with
//! it. Grazing hits and hits near the start are ill-conditioned along the ray: there it is enough that the hit is as close
//! to the plane of the triangle as the rounding of coordinates lets it be (8 ulps). What does not agree may only be a matter of an edge (one of the two went past a triangle
//! that the other hit within 1e-3 of its border), and is counted: [`disagreements_allowed`].

mod support;

use embrace::accel::brute::Brute;
use embrace::accel::{Accel, BuildOptions, BuildQuality, Geometry, Hit, Intersector, Placement, Ray};
use embrace::math::{DVec3, Vec3};
use embrace::mesh::TriangleMesh;
use glam::{Affine3A, Quat};
use std::sync::Arc;
use support::{Random, for_each_backend};

for_each_backend! { but not brute:
    random_triangle_soups_agree_with_brute
    a_closed_sphere_agrees_with_brute
    boxes_and_flat_boxes_agree_with_brute_for_rays_along_the_axes
    rotated_stretched_and_mirrored_instances_agree_with_brute
    rays_from_far_away_agree_with_brute
    a_small_thing_under_a_huge_dome_agrees_with_brute
    triangles_without_area_are_never_hit_and_hide_nothing
    scenes_of_every_scale_agree_with_brute
    the_company_of_a_ray_does_not_change_whether_it_is_occluded
    every_build_quality_finds_the_same
    there_is_a_list_where_it_is_asked_for_and_the_test_is_robust
}
for_each_backend! {
    occlusion_agrees_with_the_nearest_hit_on_the_same_segment
    a_hit_exactly_at_an_end_of_the_segment_does_not_count
    rays_at_vertices_and_edges_do_not_leave_a_closed_sphere
    rays_along_the_axes_do_not_leave_a_closed_box
    empty_geometry_is_never_hit
    rays_that_are_not_numbers_hit_nothing
}

/// Share of rays on which a backend may disagree with the reference. The obvhs backend has the same triangle test, so
/// that nothing is left to disagree about but the rounding of instance transforms.
fn disagreements_allowed<A: Accel>() -> f64 {
    if A::NAME == "obvhs" { 0.0 } else { 1e-5 }
}

impl Random {
    /// In the cube [-1, 1)³.
    fn point(&mut self) -> Vec3 {
        Vec3::from([(); 3].map(|()| 2.0 * self.unit() - 1.0))
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let p = self.point();
            if (0.01..1.0).contains(&p.length_squared()) {
                return p.normalize();
            }
        }
    }
}

fn towards(origin: Vec3, target: Vec3) -> Ray {
    Ray::new(origin, (target - origin).normalize())
}

/// From around the unit cube to points inside of it.
fn crossing_rays(count: usize, scale: f32, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..count)
        .map(|_| towards(random.point() * 2.0 * scale, random.point() * scale))
        .collect()
}

fn soup(triangles: usize, size: f32, scale: f32, seed: u64) -> TriangleMesh {
    let mut random = Random(seed);
    let mut mesh = TriangleMesh::default();
    for i in 0..triangles as u32 {
        let centre = random.point();
        mesh.positions
            .extend([(); 3].map(|()| (centre + random.direction() * size) * scale));
        mesh.indices.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

/// A closed sphere with `rows` rings of `2 * rows` quads; the poles are shared vertices.
fn sphere(rows: u32, radius: f64) -> TriangleMesh {
    use std::f64::consts::PI;
    let columns = 2 * rows;
    let mut mesh = TriangleMesh::default();
    mesh.positions.push((DVec3::Y * radius).as_vec3());
    for row in 1..rows {
        for column in 0..columns {
            let (theta, phi) = (
                PI * f64::from(row) / f64::from(rows),
                PI * f64::from(column) / f64::from(rows),
            );
            let p = DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            mesh.positions.push((p * radius).as_vec3());
        }
    }
    let south = mesh.positions.len() as u32;
    mesh.positions.push((DVec3::NEG_Y * radius).as_vec3());
    let vertex = |row: u32, column: u32| 1 + (row - 1) * columns + column % columns;
    for column in 0..columns {
        mesh.indices.push([0, vertex(1, column + 1), vertex(1, column)]);
        for row in 1..rows - 1 {
            let (a, b) = (vertex(row, column), vertex(row, column + 1));
            let (c, d) = (vertex(row + 1, column), vertex(row + 1, column + 1));
            mesh.indices.extend([[a, b, c], [b, d, c]]);
        }
        mesh.indices
            .push([south, vertex(rows - 1, column), vertex(rows - 1, column + 1)]);
    }
    mesh
}

/// An axis-aligned box; flat where `low` and `high` agree.
fn add_box(mesh: &mut TriangleMesh, low: Vec3, high: Vec3) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend((0..8).map(|i| {
        let side = |bit: i32, low: f32, high: f32| if i & bit == 0 { low } else { high };
        Vec3::new(side(1, low.x, high.x), side(2, low.y, high.y), side(4, low.z, high.z))
    }));
    for [a, b, c, d] in [
        [0, 2, 1, 3],
        [4, 5, 6, 7],
        [0, 1, 4, 5],
        [2, 6, 3, 7],
        [0, 4, 2, 6],
        [1, 3, 5, 7],
    ] {
        mesh.indices
            .extend([[a, b, c], [b, d, c]].map(|t| t.map(|i| first + i)));
    }
}

fn in_place(meshes: impl IntoIterator<Item = TriangleMesh>) -> Geometry {
    let meshes: Vec<_> = meshes.into_iter().map(Arc::new).collect();
    let placements = (0..meshes.len() as u32).map(|mesh| Placement { mesh, to_world: None });
    Geometry {
        placements: placements.collect(),
        meshes,
    }
}

fn build<A: Accel>(geometry: &Geometry) -> A {
    A::build(geometry, BuildOptions::default()).expect("the backend builds")
}

fn border_distance(hit: &Hit) -> f32 {
    hit.u.min(hit.v).min(1.0 - hit.u - hit.v)
}

/// Compares on every ray, traced alone and with its neighbours, and returns how many disagree. Panics on what is more than a matter of an edge.
fn disagreements<A: Accel>(geometry: &Geometry, rays: &[Ray]) -> usize {
    let (backend, reference) = (build::<A>(geometry), build::<Brute>(geometry));
    let (mut hits, mut count) = (0, 0);
    let mut together = Vec::new();
    for rays in rays.chunks(16) {
        backend.intersect_coherent(rays, &mut together);
    }
    assert_eq!(together.len(), rays.len());
    assert_list_finds_the_same(&reference, rays);
    for (ray, found_together) in rays.iter().zip(together) {
        let expected = reference.intersect(ray);
        hits += usize::from(expected.is_some());
        let disagrees = |found: Option<Hit>| {
            if found == expected || agree(geometry, ray, found.as_ref(), expected.as_ref()) {
                return false;
            }
            let nearer = found.iter().chain(&expected).min_by(|a, b| a.t.total_cmp(&b.t));
            let border = nearer.map_or(f32::NAN, border_distance);
            assert!(border < 1e-3, "{ray:?}: found {found:?}, expected {expected:?}");
            true
        };
        count += usize::from(disagrees(backend.intersect(ray)) || disagrees(found_together));
    }
    assert!(
        hits * 20 > rays.len(),
        "only {hits} of {} rays hit anything",
        rays.len()
    );
    println!("{}: {count} disagreements on {} rays, {hits} hits", A::NAME, rays.len());
    count
}

/// Compares 16 rays at a time with one, to the last bit.
#[track_caller]
fn assert_list_finds_the_same(reference: &Brute, rays: &[Ray]) {
    let list = reference.list().expect("brute force has a list");
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    list.intersect(rays, &mut hits);
    list.occluded(rays, &mut occluded);
    assert_eq!((hits.len(), occluded.len()), (rays.len(), rays.len()));
    for ((ray, found), occluded) in rays.iter().zip(hits).zip(occluded) {
        assert_eq!(found, reference.intersect(ray), "{ray:?}");
        assert_eq!(occluded, found.is_some(), "{ray:?}");
    }
}

fn agree(geometry: &Geometry, ray: &Ray, found: Option<&Hit>, expected: Option<&Hit>) -> bool {
    let (Some(found), Some(expected)) = (found, expected) else {
        return found.is_none() && expected.is_none();
    };
    let [a, b, c] = geometry.world_triangle(expected.placement, expected.triangle);
    let normal = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize();
    let cosine = normal.dot(ray.direction.as_dvec3()).abs() as f32;
    let magnitude = [a, b, c, ray.origin]
        .iter()
        .fold(expected.t, |m, p| m.max(p.abs().max_element()));
    let difference = (found.t - expected.t).abs();
    if difference > 1e-5 * expected.t && difference * cosine > 8.0 * f32::EPSILON * magnitude {
        return false;
    }
    let corners = geometry.world_triangle(found.placement, found.triangle);
    let shares_a_corner = corners.iter().any(|p| [a, b, c].contains(p));
    // Triangles of a soup may also cross where the ray hits them.
    shares_a_corner || difference <= 1e-6 * expected.t
}

#[track_caller]
fn assert_agreement<A: Accel>(geometry: &Geometry, rays: &[Ray]) {
    let allowed = disagreements_allowed::<A>() * rays.len() as f64;
    let count = disagreements::<A>(geometry, rays);
    assert!(count as f64 <= allowed, "{count} disagreements on {} rays", rays.len());
}

fn random_triangle_soups_agree_with_brute<A: Accel>() {
    assert_agreement::<A>(&in_place([soup(40, 0.5, 1.0, 1)]), &crossing_rays(1_000_000, 1.0, 2));
    let two = in_place([soup(700, 0.1, 1.0, 3), soup(300, 0.2, 1.0, 4)]);
    assert_agreement::<A>(&two, &crossing_rays(200_000, 1.0, 5));
}

fn a_closed_sphere_agrees_with_brute<A: Accel>() {
    assert_agreement::<A>(&in_place([sphere(12, 1.0)]), &crossing_rays(500_000, 1.0, 6));
}

/// Rays with one component other than zero, of either sign of zero, half of them on a lattice that the boxes lie on.
fn axis_rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random(seed);
    (0..count)
        .map(|i| {
            let mut direction = [(); 3].map(|()| if random.below(2) == 0 { 0.0 } else { -0.0 });
            direction[random.below(3)] = if random.below(2) == 0 { 1.0 } else { -1.0 };
            let origin = random.point() * 2.0;
            let origin = if i % 2 == 0 {
                (origin * 4.0).round() / 4.0
            } else {
                origin
            };
            Ray::new(origin, Vec3::from(direction))
        })
        .collect()
}

fn boxes_and_flat_boxes_agree_with_brute_for_rays_along_the_axes<A: Accel>() {
    let mut random = Random(7);
    let mut mesh = TriangleMesh::default();
    for i in 0..40 {
        let low = (random.point() * 4.0).round() / 4.0;
        let mut size = Vec3::from([(); 3].map(|()| (1 + random.below(3)) as f32 / 4.0));
        if i % 2 == 0 {
            size[random.below(3)] = 0.0;
        }
        add_box(&mut mesh, low, low + size);
    }
    let geometry = in_place([mesh]);
    let (backend, reference) = (build::<A>(&geometry), build::<Brute>(&geometry));
    let rays = axis_rays(400_000, 8);
    let mut counts = [0, 0];
    for (i, ray) in rays.iter().enumerate() {
        // Faces of different boxes lie on each other here, so that only the distance can be compared.
        let (found, expected) = (backend.intersect(ray), reference.intersect(ray));
        let agree = match (found, expected) {
            (Some(found), Some(expected)) => (found.t - expected.t).abs() <= 1e-5 * expected.t,
            (found, expected) => found.is_none() && expected.is_none(),
        };
        if !agree {
            let nearer = found.iter().chain(&expected).min_by(|a, b| a.t.total_cmp(&b.t));
            let border = nearer.map_or(f32::NAN, border_distance);
            assert!(border < 1e-5, "{ray:?}: found {found:?}, expected {expected:?}");
            counts[i % 2] += 1;
        }
    }
    let [on_lattice, off_lattice] = counts;
    println!(
        "{}: {on_lattice} disagreements on the lattice, {off_lattice} off it",
        A::NAME
    );
    assert_eq!(off_lattice, 0);
    // Many rays of the lattice run along the very edge of a box, which the reference hits and Embree may pass.
    let allowed = if A::NAME == "embree" { rays.len() / 20 } else { 0 };
    assert!(on_lattice <= allowed, "{on_lattice} disagreements on the lattice");
}

fn rotated_stretched_and_mirrored_instances_agree_with_brute<A: Accel>() {
    let mut random = Random(9);
    let mut geometry = in_place([soup(20, 0.4, 1.0, 10)]);
    geometry.meshes.push(Arc::new(sphere(6, 1.0)));
    for i in 0..24 {
        let mut scale = Vec3::splat(0.1) + random.point().abs() * 0.5;
        if i % 3 == 0 {
            scale.x = -scale.x;
        }
        let rotation = Quat::from_axis_angle(random.direction(), 6.0 * random.unit());
        geometry.placements.push(Placement {
            mesh: i % 2,
            to_world: Some(Affine3A::from_scale_rotation_translation(
                scale,
                rotation,
                random.point(),
            )),
        });
    }
    let rays = crossing_rays(200_000, 1.0, 11);
    let count = disagreements::<A>(&geometry, &rays);
    // The reference transforms the vertices, the backends the rays: both round, and differ at edges.
    assert!(count <= 10, "{count} disagreements on {} rays", rays.len());
}

fn rays_from_far_away_agree_with_brute<A: Accel>() {
    let geometry = in_place([soup(200, 0.2, 1.0, 12), sphere(8, 0.5)]);
    let mut random = Random(13);
    for distance in [1e2, 1e4, 1e6] {
        let rays: Vec<_> = (0..100_000)
            .map(|_| towards(random.direction() * distance, random.point()))
            .collect();
        let count = disagreements_far::<A>(&geometry, &rays);
        // Embree's edge tests round in proportion to the distance of the triangle; from 1e6 away that is a third of its size.
        let rate = if A::NAME == "embree" {
            3e-7 * f64::from(distance)
        } else {
            0.0
        };
        assert!(
            count as f64 <= rate * rays.len() as f64,
            "{count} disagreements from {distance} away"
        );
    }
}

/// From afar, the rounding of the origin's distance is not small against the triangles: only hit or miss is compared.
fn disagreements_far<A: Accel>(geometry: &Geometry, rays: &[Ray]) -> usize {
    let (backend, reference) = (build::<A>(geometry), build::<Brute>(geometry));
    let differs = |ray: &&Ray| backend.intersect(ray).is_some() != reference.intersect(ray).is_some();
    let count = rays.iter().filter(differs).count();
    println!("{}: {count} disagreements on {} rays from afar", A::NAME, rays.len());
    count
}

fn a_small_thing_under_a_huge_dome_agrees_with_brute<A: Accel>() {
    let geometry = in_place([sphere(8, 1e6), sphere(12, 1e-3)]);
    let mut random = Random(14);
    let rays: Vec<_> = (0..200_000)
        .map(|_| towards(random.point() * 3e-3, random.point() * 1e-3))
        .collect();
    assert_agreement::<A>(&geometry, &rays);
}

fn triangles_without_area_are_never_hit_and_hide_nothing<A: Accel>() {
    let mut mesh = soup(60, 0.4, 1.0, 15);
    let mut random = Random(16);
    for i in (0..60).step_by(3) {
        let [a, b, c] = mesh.indices[i];
        // A point, a doubled edge, and a midpoint that is exact because the coordinates are short.
        match random.below(3) {
            0 => mesh.indices[i] = [a, a, a],
            1 => mesh.indices[i] = [a, b, a],
            _ => {
                let short = |p: Vec3| (p * 64.0).round() / 64.0;
                let (p, q) = (short(mesh.positions[a as usize]), short(mesh.positions[b as usize]));
                mesh.positions[a as usize] = p;
                mesh.positions[b as usize] = q;
                mesh.positions[c as usize] = (p + q) / 2.0;
            }
        }
    }
    let geometry = in_place([mesh]);
    let rays = crossing_rays(300_000, 1.0, 17);
    assert_agreement::<A>(&geometry, &rays);
    let backend = build::<A>(&geometry);
    for hit in rays.iter().filter_map(|ray| backend.intersect(ray)) {
        assert_ne!(hit.triangle % 3, 0, "a triangle without area was hit");
    }
}

fn scenes_of_every_scale_agree_with_brute<A: Accel>() {
    for exponent in -6..=6 {
        let scale = 10f32.powi(exponent);
        let geometry = in_place([soup(60, 0.3, scale, 18), sphere(6, f64::from(scale) * 0.6)]);
        assert_agreement::<A>(&geometry, &crossing_rays(100_000, scale, 19));
    }
}

/// A sample must not depend on which others are computed beside it. Rays aimed at edges and corners, where a backend has
/// the most to decide.
fn the_company_of_a_ray_does_not_change_whether_it_is_occluded<A: Accel>() {
    let soup = soup(2000, 0.1, 1.0, 30);
    let mut random = Random(31);
    let rays: Vec<Ray> = (0..1_000_000)
        .map(|i| {
            let corners = soup.triangle(random.below(soup.indices.len()));
            let along = if i % 4 == 0 { 0.0 } else { random.unit() };
            let target = corners[0] + (corners[1] - corners[0]) * along;
            // Neighbours in the list start together, as shadow rays from one pixel do.
            let origin = Vec3::new(0.1 * (i / 64 % 50) as f32 - 2.5, 2.0, 1.0 + 1e-3 * (i % 64) as f32);
            towards(origin, target)
        })
        .collect();
    let backend = build::<A>(&in_place([soup]));
    let trace = |rays: &[Ray]| {
        let mut occluded = Vec::new();
        backend.occluded_many(rays, &mut occluded);
        occluded
    };
    let together = trace(&rays);
    let (mut start, mut differences) = (0, 0);
    while start < rays.len() {
        let end = rays.len().min(start + 1 + random.below(40));
        let apart = trace(&rays[start..end]);
        differences += apart.iter().zip(&together[start..end]).filter(|(a, b)| a != b).count();
        start = end;
    }
    let alone = rays.iter().map(|ray| backend.occluded(ray));
    let from_single = alone.zip(&together).filter(|(a, b)| a != *b).count();
    println!("{}: {differences} in other company, {from_single} alone", A::NAME);
    assert_eq!(differences, 0);
}

/// Rays that meet edges and corners exactly, of any length of direction, and those that can hit nothing.
#[test]
fn a_list_finds_what_its_triangles_find_alone_for_any_ray_and_number_of_rays() {
    let mut mesh = TriangleMesh::default();
    add_box(&mut mesh, Vec3::splat(-1.0), Vec3::ONE);
    add_box(&mut mesh, Vec3::new(-0.5, -0.5, 0.0), Vec3::new(0.5, 0.5, 0.0));
    let reference = build::<Brute>(&in_place([mesh]));
    let mut random = Random(81);
    let grid = |random: &mut Random| Vec3::from([(); 3].map(|()| random.below(9) as f32 * 0.25 - 1.0));
    let odd = [0.0, -0.0, 1e-39, 1e-20, 1e20, f32::MAX, f32::INFINITY, f32::NAN];
    let mut rays = Vec::new();
    for i in 0..100_000 {
        let origin = grid(&mut random) * 1.5;
        let mut ray = Ray::new(origin, grid(&mut random) - origin);
        ray.t_min = [0.0, 0.25, 1.0][random.below(3)];
        ray.t_max = [0.5, 1.0, 2.0, f32::INFINITY][random.below(4)];
        let value = odd[random.below(odd.len())];
        match i % 8 {
            0 => ray.direction[random.below(3)] = value,
            1 => ray.origin[random.below(3)] = value,
            2 => ray.t_max = value,
            3 => ray.direction *= value,
            _ => {}
        }
        rays.push(ray);
    }
    let hits = rays.iter().filter(|ray| reference.intersect(ray).is_some()).count();
    assert!(hits > rays.len() / 4, "{hits}");
    assert_list_finds_the_same(&reference, &rays);
    for count in 0..=33 {
        assert_list_finds_the_same(&reference, &rays[..count]);
    }
}

fn there_is_a_list_where_it_is_asked_for_and_the_test_is_robust<A: Accel>() {
    let geometry = in_place([sphere(3, 1.0)]);
    for (quality, has_list) in [
        (BuildQuality::List, true),
        (BuildQuality::Low, false),
        (BuildQuality::Medium, false),
    ] {
        for &intersector in A::INTERSECTORS {
            let options = BuildOptions { intersector, quality };
            let backend = A::build(&geometry, options).expect("the backend builds");
            let has_list = has_list && intersector == Intersector::Robust;
            assert_eq!(backend.list().is_some(), has_list, "{options:?}");
            assert!(backend.intersect(&Ray::new(Vec3::ZERO, Vec3::X)).is_some());
        }
    }
    let quality = |triangles, intersector| BuildQuality::for_paths(1 << 20, triangles, intersector);
    assert_eq!(quality(48, Intersector::Robust), BuildQuality::List);
    assert_eq!(quality(48, Intersector::Fast), BuildQuality::Medium);
    assert_eq!(quality(480, Intersector::Robust), BuildQuality::Medium);
}

/// Rays in general position, so that no two triangles are at the same distance.
fn every_build_quality_finds_the_same<A: Accel>() {
    let instances = |mesh: TriangleMesh| Geometry {
        meshes: vec![Arc::new(mesh)],
        placements: [0.0, 0.7]
            .map(|x| Placement {
                mesh: 0,
                to_world: Some(Affine3A::from_translation(Vec3::X * x)),
            })
            .to_vec(),
    };
    let soup = || soup(3000, 0.1, 1.0, 71);
    for geometry in [
        in_place([soup(), sphere(20, 0.8)]),
        in_place([sphere(40, 1.0)]),
        instances(soup()),
    ] {
        let [medium, low, high] = [BuildQuality::Medium, BuildQuality::Low, BuildQuality::High].map(|quality| {
            let options = BuildOptions {
                quality,
                ..BuildOptions::default()
            };
            A::build(&geometry, options).expect("the backend builds")
        });
        let mut hits = 0;
        for ray in crossing_rays(20_000, 1.0, 72) {
            let hit = medium.intersect(&ray);
            hits += usize::from(hit.is_some());
            for other in [&low, &high] {
                assert_eq!(other.intersect(&ray), hit, "{ray:?}");
                assert_eq!(other.occluded(&ray), hit.is_some(), "{ray:?}");
            }
        }
        assert!(hits > 10_000, "{hits}");
    }
}

fn occlusion_agrees_with_the_nearest_hit_on_the_same_segment<A: Accel>() {
    let geometry = in_place([soup(60, 0.3, 1.0, 20)]);
    let backend = build::<A>(&geometry);
    let mut random = Random(21);
    let mut rays = crossing_rays(300_000, 1.0, 22);
    for ray in &mut rays {
        ray.t_min = random.unit();
        ray.t_max = if random.below(4) == 0 {
            f32::INFINITY
        } else {
            4.0 * random.unit()
        };
    }
    let mut together = Vec::new();
    backend.occluded_many(&rays, &mut together);
    assert_eq!(together.len(), rays.len());
    let differs = |(ray, together): &(&Ray, &bool)| {
        let expected = backend.intersect(ray).is_some();
        backend.occluded(ray) != expected || **together != expected
    };
    let count = rays.iter().zip(&together).filter(differs).count();
    println!("{}: {count} disagreements on {} segments", A::NAME, rays.len());
    assert_eq!(count, 0);
}

fn a_hit_exactly_at_an_end_of_the_segment_does_not_count<A: Accel>() {
    let mut wall = TriangleMesh::default();
    add_box(&mut wall, Vec3::new(-1.0, -1.0, 4.0), Vec3::new(1.0, 1.0, 8.0));
    let backend = build::<A>(&in_place([wall]));
    let segment = |t_min: f32, t_max: f32| Ray {
        t_min,
        t_max,
        ..Ray::new(Vec3::new(0.25, 0.125, 0.0), Vec3::Z)
    };
    for (t_min, t_max, expected) in [
        (0.0, 4.0, None),
        (4.0, 8.0, None),
        (8.0, f32::INFINITY, None),
        (0.0, 4.0001, Some(4.0)),
        (3.9999, 8.0, Some(4.0)),
        (4.0, 8.0001, Some(8.0)),
        (4.0, f32::INFINITY, Some(8.0)),
        (5.0, 5.0, None),
        (6.0, 3.0, None),
    ] {
        let ray = segment(t_min, t_max);
        assert_eq!(backend.intersect(&ray).map(|hit| hit.t), expected, "{t_min} to {t_max}");
        assert_eq!(backend.occluded(&ray), expected.is_some(), "{t_min} to {t_max}");
    }

    // The same at distances that are not round: a segment that ends in its own nearest hit is empty.
    let backend = build::<A>(&in_place([soup(60, 0.3, 1.0, 23)]));
    let mut occluded = 0;
    let mut hits = 0;
    for ray in crossing_rays(200_000, 1.0, 24) {
        if let Some(hit) = backend.intersect(&ray) {
            hits += 1;
            let until = Ray { t_max: hit.t, ..ray };
            assert_eq!(backend.intersect(&until), None, "{until:?}");
            occluded += usize::from(backend.occluded(&until));
            let beyond = Ray { t_min: hit.t, ..ray };
            assert!(
                backend.intersect(&beyond).is_none_or(|next| next.t > hit.t),
                "{beyond:?}"
            );
        }
    }
    println!("{}: {occluded} of {hits} segments occluded by their own end", A::NAME);
    assert_eq!(occluded, 0);
}

/// Rays from inside of a closed sphere that find no triangle, of `count` each aimed at vertices and at edges.
fn leaks<A: Accel>(intersector: Intersector, count: usize) -> [usize; 2] {
    let geometry = in_place([sphere(if A::NAME == "brute" { 6 } else { 40 }, 1.0)]);
    let mesh = &geometry.meshes[0];
    let backend = A::build(
        &geometry,
        BuildOptions {
            intersector,
            ..BuildOptions::default()
        },
    )
    .expect("the backend builds");
    let mut random = Random(25);
    let leaks = [true, false].map(|at_vertex| {
        let leaks = (0..count).filter(|_| {
            let [a, b, _] = mesh.triangle(random.below(mesh.indices.len()));
            let target = if at_vertex { a } else { a.lerp(b, random.unit()) };
            backend.intersect(&towards(random.point() * 0.5, target)).is_none()
        });
        leaks.count()
    });
    let [at_vertices, at_edges] = leaks;
    println!(
        "{}, {intersector:?}: of {count} rays each, {at_vertices} leak at vertices, {at_edges} at edges",
        A::NAME
    );
    leaks
}

fn rays_at_vertices_and_edges_do_not_leave_a_closed_sphere<A: Accel>() {
    let count = if A::NAME == "brute" { 100_000 } else { 1_000_000 };
    let [at_vertices, at_edges] = leaks::<A>(Intersector::Robust, count);
    // Embree's robust mode is not watertight, least of all at vertices.
    let (vertices_allowed, edges_allowed) = if A::NAME == "embree" { (5e-3, 1e-4) } else { (0.0, 0.0) };
    assert!(
        at_vertices as f64 <= vertices_allowed * count as f64,
        "{at_vertices} leaks at vertices"
    );
    assert!(
        at_edges as f64 <= edges_allowed * count as f64,
        "{at_edges} leaks at edges"
    );
}

#[cfg(feature = "embree")]
#[test]
fn the_fast_intersector_is_another_one_than_the_robust() {
    use embrace::accel::embree::Embree;
    // Were the choice ignored, both would leak alike.
    let fast = leaks::<Embree>(Intersector::Fast, 100_000);
    let robust = leaks::<Embree>(Intersector::Robust, 100_000);
    assert!(fast[1] > 100 * (robust[1] + 1), "{fast:?} against {robust:?}");
}

fn rays_along_the_axes_do_not_leave_a_closed_box<A: Accel>() {
    let mut mesh = TriangleMesh::default();
    add_box(&mut mesh, Vec3::splat(-3.0), Vec3::splat(3.0));
    let backend = build::<A>(&in_place([mesh]));
    for ray in axis_rays(100_000, 26) {
        let hit = backend
            .intersect(&ray)
            .unwrap_or_else(|| panic!("{ray:?} leaves the box"));
        let end = ray.origin + ray.direction * hit.t;
        assert!((end.abs().max_element() - 3.0).abs() < 5e-6, "{ray:?} ends at {end}");
    }
}

fn empty_geometry_is_never_hit<A: Accel>() {
    let no_triangles = TriangleMesh {
        positions: vec![Vec3::ZERO],
        ..TriangleMesh::default()
    };
    let no_area = TriangleMesh {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0],
        indices: vec![[0, 1, 2], [1, 1, 1]],
        ..TriangleMesh::default()
    };
    let instance = |mesh: &TriangleMesh| Geometry {
        meshes: vec![Arc::new(mesh.clone())],
        placements: vec![Placement {
            mesh: 0,
            to_world: Some(Affine3A::from_scale(Vec3::splat(2.0))),
        }],
    };
    for geometry in [
        Geometry::default(),
        instance(&no_triangles),
        instance(&no_area),
        in_place([no_triangles]),
        in_place([no_area]),
    ] {
        let backend = build::<A>(&geometry);
        for ray in crossing_rays(1000, 1.0, 27) {
            assert_eq!(backend.intersect(&ray), None);
            assert!(!backend.occluded(&ray));
        }
        assert!(backend.memory_bytes() < 1 << 30);
    }
}

fn rays_that_are_not_numbers_hit_nothing<A: Accel>() {
    let mut geometry = in_place([sphere(4, 1.0)]);
    geometry.placements.push(Placement {
        mesh: 0,
        to_world: Some(Affine3A::from_scale(Vec3::splat(2.0))),
    });
    let backend = build::<A>(&geometry);
    let good = Ray::new(Vec3::ZERO, Vec3::Z);
    let mut bad_rays = Vec::new();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut origin, mut direction) = (good, good);
            origin.origin[axis] = bad;
            direction.direction[axis] = bad;
            bad_rays.extend([origin, direction]);
        }
    }
    for (t_min, t_max) in [
        (f32::NAN, 1.0),
        (0.0, f32::NAN),
        (f32::INFINITY, f32::INFINITY),
        (0.0, f32::NEG_INFINITY),
    ] {
        bad_rays.push(Ray { t_min, t_max, ..good });
    }
    let (mut hits, mut occluded) = (Vec::new(), Vec::new());
    for ray in &bad_rays {
        assert_eq!(backend.intersect(ray), None, "{ray:?}");
        assert!(!backend.occluded(ray), "{ray:?}");
        // Bad rays leave their neighbours alone.
        let together = [good, *ray, good];
        hits.clear();
        backend.intersect_coherent(&together, &mut hits);
        assert_eq!(
            hits.iter().map(Option::is_some).collect::<Vec<_>>(),
            [true, false, true],
            "{ray:?}"
        );
        occluded.clear();
        backend.occluded_many(&together, &mut occluded);
        assert_eq!(occluded, [true, false, true], "{ray:?}");
    }
}

#[test]
fn every_backend_names_its_version() {
    #[cfg(feature = "embree")]
    {
        let version = embrace::accel::embree::Embree::version();
        assert!(
            version.starts_with(['3', '4']) && version.split('.').count() == 3,
            "{version}"
        );
    }
    #[cfg(feature = "obvhs")]
    {
        let version = embrace::accel::obvhs::Obvhs::version();
        let locked = format!("name = \"obvhs\"\nversion = \"{version}\"");
        assert!(
            include_str!("../Cargo.lock").contains(&locked),
            "not the locked one: {version}"
        );
    }
}
