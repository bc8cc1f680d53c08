//! Triangles in a list, each of which is tried by 16 rays at a time.
//!
//! For scenes of a few triangles a tree is a detour: a ray takes some unpredictable branches to leave out what 16 rays
//! together could have tried. The test is that of [`TriangleRay`], with the same operations in the same order, so that it finds
//! the same to the last bit; but a corner is projected once for all triangles that have it, and what needs f64 to tell on
//! which side of an edge a ray passes is left to [`TriangleRay`].

#![allow(
    clippy::needless_range_loop,
    reason = "a lane is read and written in many columns at once"
)]

use super::triangle::{self, Corners, TriangleHit, TriangleRay};
use super::{BuildOptions, BuildQuality, Geometry, Hit, Intersector, Ray};
use crate::math::{DVec3, Vec3};
use pulp::{Arch, Simd, WithSimd};
use std::hint::select_unpredictable;

/// Rays that are traced together.
const WIDTH: usize = 16;

/// Most vertices of a [`Block`].
const BLOCK: usize = 64;

/// In place of an index: nothing was hit.
const NOTHING: u32 = u32::MAX;

type Row<T> = [T; WIDTH];

/// The corners of triangles as rays see them: across and along, by vertex.
type Projected = [[Row<f32>; 3]; BLOCK];

/// Triangles in world coordinates.
#[derive(Clone, Debug, Default)]
pub struct TriangleList {
    triangles: Vec<ListedTriangle>,
    blocks: Vec<Block>,
}

/// A triangle of a [`TriangleList`].
#[derive(Clone, Copy, Debug)]
pub(super) struct ListedTriangle {
    pub(super) corners: Corners,
    pub(super) placement: u32,
    pub(super) triangle: u32,
    /// The corners as indices into the vertices of its block.
    vertices: [u8; 3],
    /// The first corner, and the normal, of any length.
    first: DVec3,
    normal: DVec3,
}

/// Neighbours in the list.
#[derive(Clone, Debug, Default)]
struct Block {
    /// Each position once, at most [`BLOCK`].
    vertices: Vec<Vec3>,
    /// How many triangles.
    len: usize,
}

impl TriangleList {
    /// All triangles that can be hit.
    pub fn new(geometry: &Geometry) -> TriangleList {
        let mut list = TriangleList::default();
        for (placement, mesh) in geometry.placements.iter().map(|p| p.mesh).enumerate() {
            for triangle in 0..geometry.meshes[mesh as usize].indices.len() {
                let (placement, triangle) = (placement as u32, triangle as u32);
                let corners = geometry.world_triangle(placement, triangle);
                if triangle::can_be_hit(&corners) {
                    list.push(corners, placement, triangle);
                }
            }
        }
        list
    }

    /// The list for these options, if there is to be one.
    pub(super) fn if_wanted(geometry: &Geometry, options: BuildOptions) -> Option<TriangleList> {
        let is_wanted = options.quality == BuildQuality::List && options.intersector == Intersector::Robust;
        is_wanted.then(|| TriangleList::new(geometry))
    }

    fn push(&mut self, corners: [Vec3; 3], placement: u32, triangle: u32) {
        if self.blocks.last().is_none_or(|block| block.vertices.len() + 3 > BLOCK) {
            self.blocks.push(Block::default());
        }
        let block = self.blocks.last_mut().expect("there is one now");
        let vertices = corners.map(|p| block.vertex(p));
        block.len += 1;
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        self.triangles.push(ListedTriangle {
            corners: corners.into(),
            placement,
            triangle,
            vertices,
            first: a,
            normal: (b - a).cross(c - a),
        });
    }

    /// The triangles in their order: of several at the same distance, the first is hit.
    pub(super) fn triangles(&self) -> &[ListedTriangle] {
        &self.triangles
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        let vertices = self.blocks.iter().map(|block| size_of_val(&*block.vertices));
        size_of_val(&*self.triangles) + size_of_val(&*self.blocks) + vertices.sum::<usize>()
    }

    /// Appends the nearest hit of each ray.
    pub fn intersect(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        Arch::new().dispatch(Intersect(self, rays, hits));
    }

    /// Appends whether anything is hit, for each ray.
    pub fn occluded(&self, rays: &[Ray], occluded: &mut Vec<bool>) {
        Arch::new().dispatch(Occluded(self, rays, occluded));
    }

    /// Traces a packet; with `ANY`, any hit ends a ray.
    #[inline(always)]
    fn trace<const ANY: bool>(&self, packet: &mut Packet, projected: &mut Projected) {
        let mut first = 0;
        for block in &self.blocks {
            packet.project(&block.vertices, projected);
            packet.intersect::<ANY>(&self.triangles[first..first + block.len], first as u32, projected);
            first += block.len;
        }
    }
}

impl Block {
    /// The index of a vertex, which may be a new one. Zeros of different sign are one.
    fn vertex(&mut self, p: Vec3) -> u8 {
        let known = self.vertices.iter().position(|vertex| *vertex == p);
        known.unwrap_or_else(|| {
            self.vertices.push(p);
            self.vertices.len() - 1
        }) as u8
    }
}

/// [`TriangleList::intersect`], compiled for each instruction set.
struct Intersect<'a>(&'a TriangleList, &'a [Ray], &'a mut Vec<Option<Hit>>);

impl WithSimd for Intersect<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Intersect(list, rays, hits) = self;
        let mut projected = [[[0.0; WIDTH]; 3]; BLOCK];
        for rays in rays.chunks(WIDTH) {
            let mut packet = Packet::new(rays);
            list.trace::<false>(&mut packet, &mut projected);
            let coordinates = packet.coordinates();
            hits.extend((0..rays.len()).map(|i| {
                let triangle = list.triangles.get(packet.nearest[i] as usize)?;
                Some(Hit {
                    t: packet.t_max[i],
                    placement: triangle.placement,
                    triangle: triangle.triangle,
                    u: coordinates[0][i],
                    v: coordinates[1][i],
                })
            }));
        }
    }
}

/// [`TriangleList::occluded`], compiled for each instruction set.
struct Occluded<'a>(&'a TriangleList, &'a [Ray], &'a mut Vec<bool>);

impl WithSimd for Occluded<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Occluded(list, rays, occluded) = self;
        let mut projected = [[[0.0; WIDTH]; 3]; BLOCK];
        for rays in rays.chunks(WIDTH) {
            let mut packet = Packet::new(rays);
            list.trace::<true>(&mut packet, &mut projected);
            occluded.extend((0..rays.len()).map(|i| packet.nearest[i] != NOTHING));
        }
    }
}

/// Rays, column by column, and what they have met. Names as in [`TriangleRay`].
#[repr(align(64))]
struct Packet {
    /// The axis that becomes z.
    axis: Row<u32>,
    origin: [Row<f32>; 3],
    direction: [Row<f32>; 3],
    start: [Row<f32>; 3],
    shear: [Row<f32>; 3],
    t_min: Row<f32>,
    /// The end of the ray, thus the distance to the nearest hit; minus infinity where no more hits count.
    t_max: Row<f32>,
    /// The index of the triangle that was hit, and the weights of its corners, up to a factor.
    nearest: Row<u32>,
    weights: [Row<f32>; 3],
}

impl Packet {
    #[inline(always)]
    fn new(rays: &[Ray]) -> Packet {
        let mut packet = Packet {
            axis: [0; WIDTH],
            origin: [[0.0; WIDTH]; 3],
            direction: [[1.0; WIDTH]; 3],
            start: [[0.0; WIDTH]; 3],
            shear: [[0.0; WIDTH]; 3],
            t_min: [0.0; WIDTH],
            t_max: [f32::NEG_INFINITY; WIDTH],
            nearest: [NOTHING; WIDTH],
            weights: [[1.0; WIDTH]; 3],
        };
        for (i, ray) in rays.iter().enumerate() {
            let (origin, direction) = (ray.origin.to_array(), ray.direction.to_array());
            for k in 0..3 {
                packet.origin[k][i] = origin[k];
                packet.direction[k][i] = direction[k];
            }
            packet.t_min[i] = ray.t_min;
            packet.t_max[i] = ray.t_max;
        }
        for i in 0..WIDTH {
            let origin = [0, 1, 2].map(|k| packet.origin[k][i]);
            let direction = [0, 1, 2].map(|k| packet.direction[k][i]);
            let size = direction.map(f32::abs);
            let by_x = (size[0] > size[1]) & (size[0] > size[2]);
            let axis = if by_x {
                0
            } else if size[1] > size[2] {
                1
            } else {
                2
            };
            let (start, d) = (turned(axis, origin), turned(axis, direction));
            let shear = [d[0] / d[2], d[1] / d[2], 1.0 / d[2]];
            let all_finite = |v: [f32; 3]| v[0].is_finite() & v[1].is_finite() & v[2].is_finite();
            let is_ray =
                all_finite(origin) & all_finite(direction) & (d[2] != 0.0) & (packet.t_min[i] < packet.t_max[i]);
            packet.axis[i] = axis;
            for k in 0..3 {
                packet.start[k][i] = start[k];
                packet.shear[k][i] = shear[k];
            }
            packet.t_max[i] = if is_ray { packet.t_max[i] } else { f32::NEG_INFINITY };
        }
        packet
    }

    /// Where the rays see these vertices.
    #[inline(always)]
    fn project(&self, vertices: &[Vec3], projected: &mut Projected) {
        for (vertex, projected) in vertices.iter().zip(projected) {
            let vertex = vertex.to_array();
            for i in 0..WIDTH {
                let p = turned(self.axis[i], vertex);
                let z = p[2] - self.start[2][i];
                projected[0][i] = p[0] - self.start[0][i] - self.shear[0][i] * z;
                projected[1][i] = p[1] - self.start[1][i] - self.shear[1][i] * z;
                projected[2][i] = z;
            }
        }
    }

    /// Tries triangles, of which the first has the index `first`.
    #[inline(always)]
    fn intersect<const ANY: bool>(&mut self, triangles: &[ListedTriangle], first: u32, projected: &Projected) {
        for (index, triangle) in (first..).zip(triangles) {
            // The remainder changes nothing, but no index needs a check.
            let [a, b, c] = triangle.vertices.map(|vertex| &projected[usize::from(vertex) % BLOCK]);
            let mut weights = [[0.0; WIDTH]; 3];
            let (mut low, mut high) = ([0.0; WIDTH], [0.0; WIDTH]);
            let mut any = false;
            for i in 0..WIDTH {
                let (x, y) = ([a[0][i], b[0][i], c[0][i]], [a[1][i], b[1][i], c[1][i]]);
                weights[0][i] = x[2] * y[1] - y[2] * x[1];
                weights[1][i] = x[0] * y[2] - y[0] * x[2];
                weights[2][i] = x[1] * y[0] - y[1] * x[0];
                low[i] = min(min(weights[0][i], weights[1][i]), weights[2][i]);
                high[i] = max(max(weights[0][i], weights[1][i]), weights[2][i]);
                any |= !((low[i] < 0.0) & (high[i] > 0.0));
            }
            if !any {
                continue;
            }
            // Most triangles that the line meets lie outside of the segment.
            let (mut nearest, mut farthest) = ([0.0; WIDTH], [0.0; WIDTH]);
            let mut is_candidate = [0u32; WIDTH];
            let (mut any, mut any_unsure) = (false, false);
            for i in 0..WIDTH {
                let ends = [a[2][i], b[2][i], c[2][i]].map(|z| z * self.shear[2][i]);
                nearest[i] = min(min(ends[0], ends[1]), ends[2]);
                farthest[i] = max(max(ends[0], ends[1]), ends[2]);
                let is_met = !((low[i] < 0.0) & (high[i] > 0.0));
                let may_be_hit = is_met & (nearest[i] < self.t_max[i]) & (farthest[i] > self.t_min[i]);
                // Products beyond f32 tell nothing.
                let sum = weights[0][i] + weights[1][i] + weights[2][i];
                let is_sure = (low[i] != 0.0) & (high[i] != 0.0) & sum.is_finite();
                is_candidate[i] = u32::from(may_be_hit & is_sure);
                any |= may_be_hit & is_sure;
                any_unsure |= may_be_hit & !is_sure;
            }
            if any {
                let (corner, n) = (triangle.first.to_array(), triangle.normal.to_array());
                for i in 0..WIDTH {
                    let t = min(max(self.distance_to_plane(i, corner, n), nearest[i]), farthest[i]);
                    let is_hit = (is_candidate[i] != 0) & (t > self.t_min[i]) & (t < self.t_max[i]);
                    let end = if ANY { f32::NEG_INFINITY } else { t };
                    // Not `if`, which becomes a branch around the stores, and the loop one lane after the other.
                    self.t_max[i] = select_unpredictable(is_hit, end, self.t_max[i]);
                    self.nearest[i] = select_unpredictable(is_hit, index, self.nearest[i]);
                    for k in 0..3 {
                        self.weights[k][i] = select_unpredictable(is_hit, weights[k][i], self.weights[k][i]);
                    }
                }
            }
            if any_unsure {
                self.intersect_alone::<ANY>(triangle, index, [&low, &high]);
            }
            if ANY && self.t_max.iter().fold(true, |all, t| all & (*t == f32::NEG_INFINITY)) {
                return;
            }
        }
    }

    /// Likewise, one after the other, for rays that meet an edge or a corner, or a triangle of products below all f32: those
    /// with zero among the smallest and largest weights.
    #[cold]
    #[inline(never)]
    fn intersect_alone<const ANY: bool>(&mut self, triangle: &ListedTriangle, index: u32, [low, high]: [&Row<f32>; 2]) {
        let vector = |rows: &[Row<f32>; 3], i: usize| Vec3::from(rows.map(|row| row[i]));
        for i in (0..WIDTH).filter(|&i| low[i] == 0.0 || high[i] == 0.0) {
            let ray = Ray {
                origin: vector(&self.origin, i),
                direction: vector(&self.direction, i),
                t_min: self.t_min[i],
                t_max: self.t_max[i],
            };
            let hit = TriangleRay::new(&ray).and_then(|prepared| prepared.intersect(&triangle.corners, ray.t_max));
            if let Some(TriangleHit { t, u, v }) = hit {
                self.t_max[i] = if ANY { f32::NEG_INFINITY } else { t };
                self.nearest[i] = index;
                // Zero says that these are coordinates: it cannot be where all weights are sure.
                for (k, weight) in [0.0, u, v].into_iter().enumerate() {
                    self.weights[k][i] = weight;
                }
            }
        }
    }

    /// As that of [`TriangleRay`], by a corner and the normal.
    #[inline(always)]
    fn distance_to_plane(&self, i: usize, corner: [f64; 3], n: [f64; 3]) -> f32 {
        let way = [0, 1, 2].map(|k| corner[k] - f64::from(self.origin[k][i]));
        let direction = [0, 1, 2].map(|k| f64::from(self.direction[k][i]));
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        (dot(n, way) / dot(n, direction)) as f32
    }

    /// Barycentric weights of the second and the third corner.
    #[inline(always)]
    fn coordinates(&self) -> [Row<f32>; 2] {
        let mut coordinates = [[0.0; WIDTH]; 2];
        for i in 0..WIDTH {
            let weights = [0, 1, 2].map(|k| f64::from(self.weights[k][i]));
            let scale = 1.0 / (weights[0] + weights[1] + weights[2]);
            let are_coordinates = weights[0] == 0.0;
            for k in 0..2 {
                let coordinate = (weights[k + 1] * scale) as f32;
                coordinates[k][i] = if are_coordinates {
                    self.weights[k + 1][i]
                } else {
                    coordinate
                };
            }
        }
        coordinates
    }
}

/// The coordinates along the axes that become x, y and z, where the axis that becomes z is this one.
#[inline(always)]
fn turned(axis: u32, [x, y, z]: [f32; 3]) -> [f32; 3] {
    let choose = |by_x, by_y, by_z| {
        if axis == 0 {
            by_x
        } else if axis == 1 {
            by_y
        } else {
            by_z
        }
    };
    [choose(y, z, x), choose(z, x, y), choose(x, y, z)]
}

/// The smaller one; the second where a number is missing, as for the plane of a triangle seen edge-on.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger one, likewise.
#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
