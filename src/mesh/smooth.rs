//! Vertex normals for meshes that have none.

use super::TriangleMesh;
use crate::math::{DVec3, Vec3};
use rayon::prelude::*;

/// No vertex.
const NONE: u32 = u32::MAX;

/// A corner of a triangle: three times the triangle, plus 0, 1 or 2.
type Corner = u32;

impl TriangleMesh<DVec3> {
    /// Gives a mesh without normals those of a smooth surface, except where its faces meet at an edge at `degrees` or more.
    /// There, vertices are doubled. Faces meet where their corners are in the same places, whether these are the same vertices
    /// or not. Faces without area have no part in it.
    ///
    /// A normal is the sum of those of the faces around the vertex up to the next sharp edge, weighted by their angles there
    /// (Thürmer and Wüthrich 1998, "Computing Vertex Normals from Polygonal Facets").
    ///
    /// A mesh with normals, or with more than 2^32 - 1 corners, stays as it is.
    pub fn smooth(&mut self, degrees: f64) {
        if !self.normals.is_empty() || self.indices.len() > (u32::MAX / 3) as usize {
            return;
        }
        let corner_normals = self.smooth_normals(degrees);
        self.part_vertices(&corner_normals);
    }

    /// Gives a mesh without normals one for each vertex: the sum of those of its faces, weighted as [`Self::smooth`] does. Where
    /// vertices are doubled, there is an edge.
    pub fn smooth_by_vertex(&mut self) {
        if !self.normals.is_empty() {
            return;
        }
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for corners in &self.indices {
            let p = corners.map(|i| self.positions[i as usize]);
            let Some(normal) = unit_cross(p[1] - p[0], p[2] - p[0]) else {
                continue;
            };
            for k in 0..3 {
                sums[corners[k] as usize] += normal * angle(p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
            }
        }
        let unit = |sum: &DVec3| sum.try_normalize().map_or(Vec3::ZERO, |n| n.as_vec3());
        self.normals = sums.iter().map(unit).collect();
    }

    /// A normal for each corner of each triangle; zero if there is none.
    fn smooth_normals(&self, degrees: f64) -> Vec<[Vec3; 3]> {
        let place = self.places();
        let face_normals: Vec<DVec3> = self
            .indices
            .par_iter()
            .map(|corners| {
                let [a, b, c] = corners.map(|i| self.positions[i as usize]);
                unit_cross(b - a, c - a).unwrap_or(DVec3::ZERO)
            })
            .collect();
        // The corners at each place, one after the other.
        let mut ends = vec![0u32; self.positions.len()];
        let place_of = |corner: Corner| place[self.indices[corner as usize / 3][corner as usize % 3] as usize];
        let corners = 3 * self.indices.len() as u32;
        for corner in 0..corners {
            ends[place_of(corner) as usize] += 1;
        }
        let mut sum = 0;
        for end in &mut ends {
            sum += *end;
            *end = sum;
        }
        let mut starts = ends.clone();
        let mut at_place = vec![0; corners as usize];
        for corner in (0..corners).rev() {
            let start = &mut starts[place_of(corner) as usize];
            *start -= 1;
            at_place[*start as usize] = corner;
        }
        let around: Vec<&[Corner]> = starts
            .iter()
            .zip(&ends)
            .filter(|(start, end)| start < end)
            .map(|(&start, &end)| &at_place[start as usize..end as usize])
            .collect();
        let cosine = degrees.to_radians().cos();
        let normals: Vec<Vec3> = around
            .par_iter()
            .map_init(Around::default, |state, corners| {
                state.normals(self, &place, &face_normals, cosine, corners)
            })
            .flatten_iter()
            .collect();
        let mut result = vec![[Vec3::ZERO; 3]; self.indices.len()];
        for (&corner, normal) in at_place.iter().zip(normals) {
            result[corner as usize / 3][corner as usize % 3] = normal;
        }
        result
    }

    /// For each vertex, the first one in the same place.
    fn places(&self) -> Vec<u32> {
        // Adding 0 makes one number of 0 and -0.
        let key = |i: u32| (self.positions[i as usize] + 0.0).to_array().map(f64::to_bits);
        let mut order: Vec<u32> = (0..self.positions.len() as u32).collect();
        order.par_sort_unstable_by_key(|&i| (key(i), i));
        let mut place = vec![0; order.len()];
        let mut first = 0;
        for &i in &order {
            if key(i) != key(first) || i == order[0] {
                first = i;
            }
            place[i as usize] = first;
        }
        place
    }

    /// Sets the normals, doubling vertices whose corners have different ones.
    fn part_vertices(&mut self, corner_normals: &[[Vec3; 3]]) {
        let vertices = self.positions.len();
        let mut normals = vec![None; vertices];
        // Of each vertex, another one that was made of the same.
        let mut next = vec![NONE; vertices];
        let mut origin = Vec::new();
        for (corners, corner_normals) in self.indices.iter_mut().zip(corner_normals) {
            for (corner, &normal) in corners.iter_mut().zip(corner_normals) {
                let mut index = *corner as usize;
                loop {
                    match normals[index] {
                        None => normals[index] = Some(normal),
                        Some(other) if other != normal => {
                            if next[index] == NONE && normals.len() < NONE as usize {
                                next[index] = normals.len() as u32;
                                normals.push(None);
                                next.push(NONE);
                                origin.push(*corner as usize);
                            }
                            if next[index] != NONE {
                                index = next[index] as usize;
                                continue;
                            }
                        }
                        Some(_) => {}
                    }
                    break;
                }
                *corner = index as u32;
            }
        }
        fn extend<T: Copy>(values: &mut Vec<T>, origin: &[usize]) {
            if !values.is_empty() {
                values.reserve_exact(origin.len());
                origin.iter().for_each(|&i| values.push(values[i]));
            }
        }
        extend(&mut self.positions, &origin);
        extend(&mut self.uvs, &origin);
        extend(&mut self.colors, &origin);
        self.normals = normals.into_iter().map(|n| n.unwrap_or(Vec3::ZERO)).collect();
    }
}

/// The unit vector along a cross product, for vectors of any length.
fn unit_cross(a: DVec3, b: DVec3) -> Option<DVec3> {
    let scaled = |v: DVec3| v / v.abs().max_element();
    scaled(a).cross(scaled(b)).try_normalize()
}

/// Works on the corners at one place.
#[derive(Default)]
struct Around {
    /// The other end of each side at the place, and which corner it belongs to.
    sides: Vec<(u32, usize)>,
    /// For each corner, another one of the same smooth part, or itself.
    parent: Vec<usize>,
    sums: Vec<DVec3>,
}

impl Around {
    /// The normals of the corners at one place.
    fn normals(
        &mut self,
        mesh: &TriangleMesh<DVec3>,
        place: &[u32],
        face_normals: &[DVec3],
        cosine: f64,
        corners: &[Corner],
    ) -> Vec<Vec3> {
        self.sides.clear();
        self.parent.clear();
        self.parent.extend(0..corners.len());
        self.sums.clear();
        self.sums.resize(corners.len(), DVec3::ZERO);
        let normal = |i: usize| face_normals[corners[i] as usize / 3];
        // The place's own vertex first, then the next ones around the triangle.
        let vertices = |i: usize| {
            let (triangle, corner) = (corners[i] as usize / 3, corners[i] as usize % 3);
            [0, 1, 2].map(|k| mesh.indices[triangle][(corner + k) % 3])
        };
        for i in 0..corners.len() {
            if normal(i) != DVec3::ZERO {
                let [_, b, c] = vertices(i).map(|vertex| place[vertex as usize]);
                self.sides.extend([(b, i), (c, i)]);
            }
        }
        self.sides.sort_unstable();
        for side in 1..self.sides.len() {
            let [(a, i), (b, j)] = [self.sides[side - 1], self.sides[side]];
            if a == b && normal(i).dot(normal(j)) > cosine {
                let (i, j) = (self.root(i), self.root(j));
                self.parent[i.max(j)] = i.min(j);
            }
        }
        for i in 0..corners.len() {
            let [a, b, c] = vertices(i).map(|vertex| mesh.positions[vertex as usize]);
            let root = self.root(i);
            self.sums[root] += normal(i) * angle(b - a, c - a);
        }
        (0..corners.len())
            .map(|i| {
                // Opposite faces may leave nothing.
                let root = self.root(i);
                self.sums[root].try_normalize().unwrap_or(normal(i)).as_vec3()
            })
            .collect()
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }
}

/// The angle between two vectors of any length, in radians; 0 if one has none.
fn angle(a: DVec3, b: DVec3) -> f64 {
    match (a.try_normalize(), b.try_normalize()) {
        (Some(a), Some(b)) => a.cross(b).length().atan2(a.dot(b)),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec2;

    /// A box of twelve triangles, its eight vertices shared.
    fn cube() -> TriangleMesh<DVec3> {
        let corner = |i: u32| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) - 0.5;
        let faces = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        TriangleMesh {
            positions: (0..8).map(corner).collect(),
            indices: faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
            ..TriangleMesh::default()
        }
    }

    fn face_normal(mesh: &TriangleMesh<DVec3>, triangle: usize) -> Vec3 {
        let [a, b, c] = mesh.indices[triangle].map(|i| mesh.positions[i as usize]);
        (b - a).cross(c - a).normalize().as_vec3()
    }

    #[test]
    fn smoothed_by_vertex_shared_corners_are_round_and_doubled_ones_are_edges() {
        let mut shared = cube();
        shared.smooth_by_vertex();
        for (p, n) in shared.positions.iter().zip(&shared.normals) {
            assert!(n.distance(p.normalize().as_vec3()) < 1e-6, "{n} at {p}");
        }
        let mut doubled = cube();
        doubled.positions = (0..12)
            .flat_map(|i| cube().indices[i])
            .map(|i| cube().positions[i as usize])
            .collect();
        doubled.indices = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        doubled.smooth_by_vertex();
        for (i, &n) in doubled.normals.iter().enumerate() {
            assert!(n.distance(face_normal(&doubled, i / 3)) < 1e-6, "{n} at vertex {i}");
        }
    }

    #[test]
    fn edges_at_the_angle_or_above_are_sharp_and_others_smooth() {
        let mut sharp = cube();
        sharp.smooth(89.0);
        assert_eq!((sharp.positions.len(), sharp.normals.len()), (24, 24));
        for (triangle, corners) in sharp.indices.iter().enumerate() {
            for &i in corners {
                assert_eq!(sharp.normals[i as usize], face_normal(&sharp, triangle));
            }
        }
        let mut smooth = cube();
        smooth.smooth(91.0);
        // Each of the three faces has a right angle at each vertex, however it is cut into triangles.
        for (position, normal) in smooth.positions.iter().zip(&smooth.normals) {
            let radial = position.normalize().as_vec3();
            assert!((*normal - radial).length() < 1e-6, "{normal} {radial}");
        }
        assert_eq!(smooth.positions.len(), 8);
        assert_eq!(smooth.indices, cube().indices);
    }

    #[test]
    fn vertices_in_the_same_place_are_smoothed_together_and_keep_what_else_they_have() {
        let shared = {
            let mut mesh = cube();
            mesh.smooth(180.0);
            mesh
        };
        let mut parted = cube();
        parted.positions = parted
            .indices
            .iter()
            .flatten()
            .map(|&i| parted.positions[i as usize])
            .collect();
        parted.indices = (0..12).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        parted.uvs = (0..36).map(|i| Vec2::splat(i as f32)).collect();
        let uvs = parted.uvs.clone();
        parted.smooth(180.0);
        assert_eq!(parted.uvs, uvs);
        for (corner, &i) in shared.indices.iter().flatten().enumerate() {
            assert_eq!(parted.normals[corner], shared.normals[i as usize]);
        }
        // Doubled vertices have the texture coordinates of what they were.
        let mut sharp = cube();
        sharp.uvs = (0..8).map(|i| Vec2::splat(i as f32)).collect();
        sharp.smooth(10.0);
        for (corner, &i) in sharp.indices.iter().flatten().enumerate() {
            let before = cube().indices[corner / 3][corner % 3];
            assert_eq!(sharp.uvs[i as usize], Vec2::splat(before as f32));
            assert_eq!(sharp.positions[i as usize], cube().positions[before as usize]);
        }
    }

    #[test]
    fn the_normals_of_a_fine_sphere_are_radial() {
        let (rings, columns) = (60, 120u32);
        let vertex = |ring: u32, column: u32| {
            let (theta, phi) = (
                f64::from(ring) / f64::from(rings) * std::f64::consts::PI,
                f64::from(column % columns) / f64::from(columns) * std::f64::consts::TAU,
            );
            // One place for each pole.
            let radius = if ring == rings { 0.0 } else { theta.sin() };
            DVec3::new(radius * phi.cos(), theta.cos(), radius * phi.sin())
        };
        let mut mesh = TriangleMesh::default();
        for ring in 0..rings {
            for column in 0..columns {
                let [a, b, c, d] = [(0, 0), (0, 1), (1, 1), (1, 0)].map(|(r, c)| vertex(ring + r, column + c));
                let first = mesh.positions.len() as u32;
                mesh.positions.extend([a, b, c, d]);
                mesh.indices
                    .extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|i| first + i)));
            }
        }
        mesh.smooth(30.0);
        let mut checked = 0;
        for (position, normal) in mesh.positions.iter().zip(&mesh.normals) {
            // Triangles without area at the poles have none.
            if *normal != Vec3::ZERO {
                assert!(normal.dot(position.as_vec3()) > 0.9995, "{normal} {position}");
                checked += 1;
            }
        }
        assert!(checked > 28_000, "{checked}");
    }

    #[test]
    fn damaged_meshes_get_normals_that_are_units_or_zero() {
        let mut state = 1u64;
        let mut random = |n: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) % n
        };
        for round in 0..300 {
            let scale = [1.0, 1e-38, 1e38][round % 3];
            let mut mesh = TriangleMesh {
                positions: (0..6)
                    .map(|_| DVec3::from([0; 3].map(|_| random(3) as f64 - 1.0)) * scale)
                    .collect(),
                indices: (0..8).map(|_| [0; 3].map(|_| random(6) as u32)).collect(),
                ..TriangleMesh::default()
            };
            mesh.smooth(random(181) as f64);
            assert_eq!(mesh.validate(), Ok(()));
            for n in &mesh.normals {
                let length = n.length();
                assert!(length == 0.0 || (length - 1.0).abs() < 1e-6, "{n}");
            }
        }
    }
}
