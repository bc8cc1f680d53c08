//! Rays neither hit what they leave, nor miss what is near, nor slip through closed meshes.

use crate::support::{Random, cuboid, for_each_backend, quad, sphere};
use embrace::accel::{Accel, BuildOptions, Geometry, Hit, Intersector, Placement, Ray};
use embrace::interaction::SurfaceInteraction;
use embrace::math::{DVec3, Vec3};
use embrace::mesh::TriangleMesh;
use glam::{Affine3A, Quat};
use std::f32::consts::TAU;
use std::sync::Arc;

for_each_backend! { but not brute:
    no_ray_hits_the_triangle_it_leaves_at_any_size_and_place
    no_ray_hits_the_instance_of_a_triangle_it_leaves
    a_sheet_is_not_skipped_from_twice_the_offset_on
    a_floor_however_wide_is_left_as_a_small_one
    closed_meshes_do_not_leak
    both_of_two_shells_close_together_are_hit
}

fn geometry(mesh: TriangleMesh, places: Vec<Option<Affine3A>>) -> Geometry {
    Geometry {
        meshes: vec![Arc::new(mesh)],
        placements: places
            .into_iter()
            .map(|to_world| Placement { mesh: 0, to_world })
            .collect(),
    }
}

fn build<A: Accel>(geometry: &Geometry) -> A {
    A::build(geometry, BuildOptions::default()).expect("the backend builds")
}

impl Random {
    /// ±10^U(-8, 8) on each axis.
    fn point_of_any_size(&mut self) -> Vec3 {
        Vec3::from([(); 3].map(|()| {
            let size = 10f32.powf(16.0 * self.unit() - 8.0);
            if self.unit() < 0.5 { -size } else { size }
        }))
    }

    fn unit_vector(&mut self) -> Vec3 {
        let (z, phi) = (2.0 * self.unit() - 1.0, TAU * self.unit());
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    }

    /// A point on a triangle, off its border.
    fn inside(&mut self, corners: [Vec3; 3]) -> Vec3 {
        let [u, v] = self.pair().map(|x| 0.01 + 0.48 * x);
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        (a + (b - a) * f64::from(u) + (c - a) * f64::from(v)).as_vec3()
    }
}

fn towards(origin: Vec3, target: Vec3) -> Option<Ray> {
    let direction = (target.as_dvec3() - origin.as_dvec3()).try_normalize()?.as_vec3();
    Some(Ray::new(origin, direction))
}

fn triangle_soup(count: u32, random: &mut Random) -> TriangleMesh {
    TriangleMesh {
        positions: (0..3 * count).map(|_| random.point_of_any_size()).collect(),
        indices: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        ..TriangleMesh::default()
    }
}

/// Of the rays that leave hits of `rays` to both sides, those that hit the same triangle again: a plane is left once.
fn false_hits<A: Accel>(
    geometry: &Geometry,
    backend: &A,
    rays: impl Iterator<Item = Ray>,
    random: &mut Random,
) -> [usize; 2] {
    let (mut left, mut again) = (0, 0);
    for ray in rays {
        let Some(hit) = backend.intersect(&ray) else { continue };
        let Some(si) = SurfaceInteraction::new::<false>(geometry, &ray, &hit, false) else {
            continue;
        };
        for transmitted in [false, true] {
            let side = if transmitted { -si.ng } else { si.ng };
            let any = random.unit_vector();
            let outwards = any * any.dot(side).signum();
            // Down to a thousandth above the horizon.
            let height = 10f32.powf(-3.0 * random.unit());
            let Some(direction) = (outwards - side * outwards.dot(side) * (1.0 - height)).try_normalize() else {
                continue;
            };
            left += 1;
            let same = |next: Hit| (next.placement, next.triangle) == (hit.placement, hit.triangle);
            again += usize::from(
                backend
                    .intersect(&si.spawn_ray(direction, transmitted))
                    .is_some_and(same),
            );
        }
    }
    [left, again]
}

const HITS: usize = 1_000_000;

fn no_ray_hits_the_triangle_it_leaves_at_any_size_and_place<A: Accel>() {
    // In small groups: most triangles reach through the whole scene, and each would be tested for each ray.
    const GROUPS: usize = 50;
    let mut random = Random(1);
    let (mut left, mut again) = (0, 0);
    for _ in 0..GROUPS {
        let mesh = triangle_soup(40, &mut random);
        let geometry = geometry(mesh.clone(), vec![None]);
        let backend = build::<A>(&geometry);
        let mut aim = Random(random.bits());
        let rays = (0..HITS / GROUPS).filter_map(|_| {
            let triangle = aim.below(mesh.indices.len());
            let target = aim.inside(mesh.triangle(triangle));
            towards(aim.point_of_any_size(), target)
        });
        let counts = false_hits(&geometry, &backend, rays, &mut random);
        left += counts[0];
        again += counts[1];
    }
    println!("{}: {again} of {left} rays hit the triangle they leave", A::NAME);
    assert!(left > HITS);
    assert_eq!(again, 0);
}

fn no_ray_hits_the_instance_of_a_triangle_it_leaves<A: Accel>() {
    let mut random = Random(3);
    let mesh = TriangleMesh {
        positions: (0..30).map(|_| random.unit_vector()).collect(),
        indices: (0..10).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
        ..TriangleMesh::default()
    };
    let places: Vec<_> = (0..300)
        .map(|_| {
            let turn = Quat::from_axis_angle(random.unit_vector(), TAU * random.unit());
            let scale = Vec3::from([(); 3].map(|()| 10f32.powf(2.0 * random.unit() - 1.0)));
            let size = 10f32.powf(8.0 * random.unit() - 4.0);
            let place = random.unit_vector() * size * 10f32.powf(3.0 * random.unit());
            Some(Affine3A::from_scale_rotation_translation(scale * size, turn, place))
        })
        .collect();
    let geometry = geometry(mesh, places);
    let backend = build::<A>(&geometry);
    let mut aim = Random(4);
    let rays = (0..HITS / 4).filter_map(|_| {
        let (placement, triangle) = (aim.below(300) as u32, aim.below(10) as u32);
        let target = aim.inside(geometry.world_triangle(placement, triangle));
        towards(target + aim.unit_vector() * 10f32.powf(8.0 * aim.unit() - 4.0), target)
    });
    let [left, again] = false_hits(&geometry, &backend, rays, &mut random);
    println!("{}: {again} of {left} rays hit the instance they leave", A::NAME);
    assert!(left > HITS / 8);
    assert_eq!(again, 0);
}

/// The offset is 2⁻²⁰ of the largest coordinate of a triangle, so that what is at least twice as far is found.
fn a_sheet_is_not_skipped_from_twice_the_offset_on<A: Accel>() {
    const GAP: f64 = 2.0 / 1_048_576.0;
    let mut random = Random(5);
    let lower = triangle_soup(2000, &mut random);
    let (mut skipped, mut tried) = (0, 0);
    // Pairs by themselves: others would stop the ray as well.
    for i in 0..lower.indices.len() {
        let corners = lower.triangle(i);
        let magnitude = corners.iter().fold(0f32, |m, p| m.max(p.abs().max_element()));
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        let lift = normal * (GAP * f64::from(magnitude));
        let upper = corners.map(|p| (p.as_dvec3() + lift).as_vec3());
        // Rounding of the corners of a needle may tilt it by more than the gap: such a pair is none.
        let heights = upper.map(|p| [a, b, c].map(|q| (p.as_dvec3() - q).dot(normal)));
        let [wide, thick] = [
            (b - a).cross(c - a).length(),
            (b - a).length().max((c - a).length()).powi(2),
        ];
        if wide < 1e-2 * thick || heights.iter().flatten().any(|h| *h < 0.9 * lift.length()) {
            continue;
        }
        let mesh = TriangleMesh {
            positions: [corners, upper].concat(),
            indices: vec![[0, 1, 2], [3, 4, 5]],
            ..TriangleMesh::default()
        };
        let geometry = geometry(mesh, vec![None]);
        let backend = build::<A>(&geometry);
        for _ in 0..20 {
            let (u, v) = (0.1 + 0.4 * random.unit(), 0.1 + 0.4 * random.unit());
            let hit = Hit {
                t: 1.0,
                placement: 0,
                triangle: 0,
                u,
                v,
            };
            let from = Ray::new(corners[0] + normal.as_vec3() * magnitude, -normal.as_vec3());
            let si = SurfaceInteraction::new::<false>(&geometry, &from, &hit, false).expect("it has an area");
            tried += 1;
            skipped += usize::from(backend.intersect(&si.spawn_ray(si.ng, false)).is_none());
        }
    }
    println!("{}: {skipped} of {tried} sheets skipped", A::NAME);
    assert!(tried > 5000);
    assert_eq!(skipped, 0);
}

/// A sheet a hundred-thousandth above a floor is met by rays from the floor, although its corners are far away.
fn a_floor_however_wide_is_left_as_a_small_one<A: Accel>() {
    let mut random = Random(8);
    for (exponent, height) in [1, 3, 5, 7, 12, 17].into_iter().flat_map(|e| [(e, 0.0), (e, 1.0)]) {
        let size = 10f32.powi(exponent);
        let square = |y: f32, size: f32| quad(Vec3::new(-size, y, -size), Vec3::Z * 2.0 * size, Vec3::X * 2.0 * size);
        let mut mesh = square(height, size);
        let sheet = square(height + 1e-5, 1.0);
        mesh.positions.extend(&sheet.positions);
        mesh.uvs.extend(&sheet.uvs);
        mesh.indices.extend(sheet.indices.iter().map(|t| t.map(|i| i + 4)));
        let geometry = geometry(mesh, vec![None]);
        let backend = build::<A>(&geometry);
        for _ in 0..2000 {
            let target = Vec3::new(0.9 * random.unit(), height, 0.9 * random.unit());
            let below = Vec3::new(random.unit(), height - 2.0, random.unit());
            let ray = towards(below, target).expect("a direction");
            let hit = backend.intersect(&ray).expect("the floor is hit");
            let si = SurfaceInteraction::new::<false>(&geometry, &ray, &hit, false).expect("it has an area");
            assert!(
                (si.p - target).length() < 1e-5,
                "{}: {} for {target}, size {size}",
                A::NAME,
                si.p
            );
            let next = backend.intersect(&si.spawn_ray(Vec3::Y, true)).map(|hit| hit.triangle);
            assert!(
                matches!(next, Some(2 | 3)),
                "{}: {next:?} from {:?}, size {size}",
                A::NAME,
                si.p
            );
        }
    }
}

/// A cylinder along x of length 1 whose sides are needles a million times longer than wide.
fn needle_cylinder() -> TriangleMesh {
    const SIDES: u32 = 1000;
    let radius = f64::from(SIDES) * 1e-6 / std::f64::consts::TAU;
    let mut mesh = TriangleMesh::default();
    for i in 0..SIDES {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / f64::from(SIDES)).sin_cos();
        for x in [-0.5, 0.5] {
            mesh.positions.push(DVec3::new(x, radius * cos, radius * sin).as_vec3());
        }
    }
    mesh.positions.extend([Vec3::NEG_X * 0.5, Vec3::X * 0.5]);
    for i in 0..SIDES {
        let (a, b) = (2 * i, 2 * ((i + 1) % SIDES));
        mesh.indices.extend([
            [a, b, a + 1],
            [b, b + 1, a + 1],
            [a, 2 * SIDES, b],
            [a + 1, b + 1, 2 * SIDES + 1],
        ]);
    }
    mesh
}

/// Origins inside of a closed mesh, targets on it: points of triangles, of edges, and vertices.
fn leaks<A: Accel>(mesh: &TriangleMesh, inside: Vec3, intersector: Intersector, count: usize) -> [usize; 3] {
    let geometry = geometry(mesh.clone(), vec![None]);
    let backend = A::build(
        &geometry,
        BuildOptions {
            intersector,
            ..BuildOptions::default()
        },
    )
    .expect("the backend builds");
    let mut random = Random(6);
    [0, 1, 2].map(|kind| {
        (0..count)
            .filter(|_| {
                let corners = mesh.triangle(random.below(mesh.indices.len()));
                let target = match kind {
                    0 => random.inside(corners),
                    1 => corners[0].lerp(corners[1], random.unit()),
                    _ => corners[0],
                };
                let origin = random.unit_vector() * inside;
                towards(origin, target).is_some_and(|ray| backend.intersect(&ray).is_none())
            })
            .count()
    })
}

fn closed_meshes_do_not_leak<A: Accel>() {
    const RAYS: usize = 300_000;
    let meshes = [
        ("sphere", sphere(Vec3::ZERO, 1.0, 60, false), Vec3::splat(0.5)),
        ("box", cuboid(Vec3::splat(-1.0), Vec3::ONE, false), Vec3::splat(0.9)),
        ("needle cylinder", needle_cylinder(), Vec3::new(0.49, 1e-4, 1e-4)),
    ];
    for (name, mesh, inside) in meshes {
        let robust = leaks::<A>(&mesh, inside, Intersector::Robust, RAYS);
        let rates = robust.map(|n| n as f64 / RAYS as f64);
        println!("{} {name}: leaks at points, edges, vertices {rates:?}", A::NAME);
        if A::INTERSECTORS.contains(&Intersector::Fast) {
            let fast = leaks::<A>(&mesh, inside, Intersector::Fast, RAYS).map(|n| n as f64 / RAYS as f64);
            println!("{} {name}, fast: leaks at points, edges, vertices {fast:?}", A::NAME);
        }
        // Embree's own test of its robust mode allows 2e-5 of random rays; at vertices it is not watertight.
        let allowed = if A::NAME == "embree" {
            [2e-5, 1e-4, 5e-3]
        } else {
            [0.0; 3]
        };
        for (rate, allowed) in rates.iter().zip(allowed) {
            assert!(*rate <= allowed, "{} {name}: {rates:?}", A::NAME);
        }
    }
}

/// Spheres whose radii differ by 1e-5: the ray through the inner one meets the outer one.
fn both_of_two_shells_close_together_are_hit<A: Accel>() {
    const RAYS: usize = 300_000;
    let mut mesh = sphere(Vec3::ZERO, 1.0, 60, false);
    let inner = mesh.indices.len() as u32;
    let outer = sphere(Vec3::ZERO, 1.0 + 1e-5, 60, false);
    let base = mesh.positions.len() as u32;
    mesh.positions.extend(&outer.positions);
    mesh.indices.extend(outer.indices.iter().map(|t| t.map(|i| i + base)));
    let geometry = geometry(mesh.clone(), vec![None]);
    let backend = build::<A>(&geometry);
    let mut random = Random(7);
    let (mut skipped, mut escaped) = (0, 0);
    for i in 0..RAYS {
        let corners = mesh.triangle(random.below(inner as usize));
        let target = if i % 2 == 0 {
            random.inside(corners)
        } else {
            corners[0].lerp(corners[1], random.unit())
        };
        let Some(ray) = towards(random.unit_vector() * 0.5, target) else {
            continue;
        };
        let Some(hit) = backend.intersect(&ray) else {
            escaped += 1;
            continue;
        };
        if hit.triangle >= inner {
            skipped += 1;
            continue;
        }
        let si = SurfaceInteraction::new::<false>(&geometry, &ray, &hit, false).expect("it has an area");
        let next = backend.intersect(&si.spawn_ray(ray.direction, true));
        escaped += usize::from(next.is_none());
        skipped += usize::from(next.is_some_and(|next| next.triangle < inner));
    }
    println!("{}: of {RAYS} rays, {skipped} skip a shell, {escaped} leave", A::NAME);
    let allowed = if A::NAME == "embree" { 1e-4 } else { 0.0 };
    assert!((skipped + escaped) as f64 <= allowed * RAYS as f64);
}
