//! Curved and flat shapes as triangles, in their own coordinates.
//!
//! Normals are exact at the vertices. A sphere of [`AROUND`] by half as many facets has its area exactly, and lies within
//! 1.1e-4 of its radius of the true one; cylinders and discs are scaled for their areas as well and lie within 2e-5.

use crate::math::{DVec3, Vec2};
use crate::mesh::TriangleMesh;
use std::f64::consts::{PI, TAU};

/// Facets around a sphere.
const AROUND: u32 = 256;

/// Facets around a cylinder or disc.
const AROUND_FLAT: u32 = 512;

#[derive(Default)]
struct Builder(TriangleMesh<DVec3>);

impl Builder {
    fn vertex(&mut self, position: DVec3, normal: DVec3, uv: [f64; 2]) -> u32 {
        self.0.positions.push(position);
        self.0.normals.push(normal.as_vec3());
        self.0.uvs.push(Vec2::new(uv[0] as f32, uv[1] as f32));
        self.0.positions.len() as u32 - 1
    }
}

/// The square from -1 to 1 in x and y, facing +Z.
pub(super) fn rectangle() -> TriangleMesh<DVec3> {
    let mut mesh = Builder::default();
    for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        mesh.vertex(DVec3::new(2.0 * x - 1.0, 2.0 * y - 1.0, 0.0), DVec3::Z, [x, y]);
    }
    mesh.0.indices = vec![[1, 2, 0], [1, 3, 2]];
    mesh.0
}

/// The cube from -1 to 1, facing outwards.
pub(super) fn cube() -> TriangleMesh<DVec3> {
    // For each side the normal, and the directions of growing u and falling v.
    let sides = [
        (DVec3::NEG_Y, DVec3::Z, DVec3::NEG_X),
        (DVec3::Y, DVec3::NEG_X, DVec3::Z),
        (DVec3::X, DVec3::Y, DVec3::Z),
        (DVec3::Z, DVec3::Y, DVec3::NEG_X),
        (DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z),
        (DVec3::NEG_Z, DVec3::NEG_Y, DVec3::NEG_X),
    ];
    let mut mesh = Builder::default();
    for (n, u, v) in sides {
        let first = mesh.0.positions.len() as u32;
        for [s, t] in [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]] {
            mesh.vertex(n + u * (2.0 * s - 1.0) + v * (1.0 - 2.0 * t), n, [s, t]);
        }
        mesh.0.indices.push([first, first + 1, first + 2]);
        mesh.0.indices.push([first + 3, first, first + 2]);
    }
    mesh.0
}

/// The unit sphere, facing outwards: u is the angle around +Z from +X, v that from +Z.
pub(super) fn sphere() -> TriangleMesh<DVec3> {
    let (columns, rows) = (AROUND, AROUND / 2);
    let mut mesh = Builder::default();
    for row in 0..=rows {
        let is_pole = row == 0 || row == rows;
        let v = f64::from(row) / f64::from(rows);
        let (sin_theta, cos_theta) = (PI * v).sin_cos();
        for column in 0..=columns {
            // A pole belongs to the middle of each triangle that ends there.
            let u = (f64::from(column) + if is_pole { 0.5 } else { 0.0 }) / f64::from(columns);
            let (sin_phi, cos_phi) = (TAU * u).sin_cos();
            let n = if is_pole {
                DVec3::Z * cos_theta.signum()
            } else {
                DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
            };
            mesh.vertex(n, n, [u, v]);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let upper = row * (columns + 1) + column;
            let lower = upper + columns + 1;
            if row > 0 {
                mesh.0.indices.push([upper, lower, upper + 1]);
            }
            if row + 1 < rows {
                mesh.0.indices.push([upper + 1, lower, lower + 1]);
            }
        }
    }
    scaled_to_area(mesh.0, 4.0 * PI, DVec3::ONE)
}

/// The side of the cylinder around +Z from z = 0 to 1, of radius 1, facing outwards: u is the angle from +X, v is z.
pub(super) fn cylinder() -> TriangleMesh<DVec3> {
    let mut mesh = Builder::default();
    for column in 0..=AROUND_FLAT {
        let u = f64::from(column) / f64::from(AROUND_FLAT);
        let (sin, cos) = (TAU * u).sin_cos();
        let n = DVec3::new(cos, sin, 0.0);
        for z in [0.0, 1.0] {
            mesh.vertex(n + DVec3::Z * z, n, [u, z]);
        }
    }
    for column in 0..AROUND_FLAT {
        let low = 2 * column;
        mesh.0.indices.push([low, low + 2, low + 1]);
        mesh.0.indices.push([low + 1, low + 2, low + 3]);
    }
    scaled_to_area(mesh.0, TAU, DVec3::new(1.0, 1.0, 0.0))
}

/// The unit disc in the plane z = 0, facing +Z: u is the distance from the middle, v the angle from +X.
pub(super) fn disk() -> TriangleMesh<DVec3> {
    let mut mesh = Builder::default();
    for column in 0..AROUND_FLAT {
        let at = |offset: f64| (f64::from(column) + offset) / f64::from(AROUND_FLAT);
        let first = mesh.vertex(DVec3::ZERO, DVec3::Z, [0.0, at(0.5)]);
        for v in [at(0.0), at(1.0)] {
            let (sin, cos) = (TAU * v).sin_cos();
            mesh.vertex(DVec3::new(cos, sin, 0.0), DVec3::Z, [1.0, v]);
        }
        mesh.0.indices.push([first, first + 1, first + 2]);
    }
    scaled_to_area(mesh.0, PI, DVec3::ONE)
}

/// Moves what is inscribed outwards along `axes`, so that its area is the true one.
fn scaled_to_area(mut mesh: TriangleMesh<DVec3>, area: f64, axes: DVec3) -> TriangleMesh<DVec3> {
    let of_triangle = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
        0.5 * (b - a).cross(c - a).length()
    };
    let ratio = area / mesh.indices.iter().map(of_triangle).sum::<f64>();
    // A cylinder's area is proportional to its radius, others' to the square.
    let factor = if axes.z == 0.0 { ratio } else { ratio.sqrt() };
    let scale = DVec3::select(axes.cmpgt(DVec3::ZERO), DVec3::splat(factor), DVec3::ONE);
    mesh.positions.iter_mut().for_each(|p| *p *= scale);
    mesh
}

/// Turns the mesh inside out.
pub(super) fn flip(mesh: &mut TriangleMesh<DVec3>) {
    mesh.indices.iter_mut().for_each(|corners| corners.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
}
