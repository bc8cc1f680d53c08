//! The pure-Rust backend: hierarchies built by the crate `obvhs`, traversed with tests of our own.
//!
//! Untransformed placements are merged into one tree. Placements with a transform share one tree per mesh, under a tree
//! over their world-space boxes; the ray is taken to the mesh with the scale of its direction, so that `t` means the same
//! everywhere.
//!
//! The crate's eight-wide compressed tree (Ylitie, Karras, Laine 2017, "Efficient incoherent ray traversal on GPUs
//! through compressed wide BVHs") is traversed by its own macro, but with `children_hit` in place of its node test,
//! which drops boxes that the ray leaves before an absolute distance of 1e-4 and lets rounding drop others.

mod build;

use super::list::TriangleList;
use super::triangle::{self, Corners, TriangleHit, TriangleRay};
use super::{Accel, AccelError, BuildOptions, BuildQuality, Geometry, Hit, Intersector, Ray};
use crate::math::Vec3;
use glam::{DAffine3, UVec2, Vec3A, Vec4};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::node::CwBvhNode;
use rayon::prelude::*;

/// Rounding of the node test, relative to the distance of the far side of the node: some ten roundings of 2^-24, and the
/// crate's logarithm that chooses the grid of a node, off by up to 7e-7. Far below the 1/255 of the grid itself.
const ROUNDING: f32 = 2e-6;

/// Boxes are wider than this, in sizes of the tree, so that areas do not vanish in f32.
const SMALLEST: f32 = 1e-15;

/// Stands for the reciprocal of a zero, so that no product with a zero distance is undefined. In sizes of the tree: from up
/// to 1e8 of them away, no product is infinite.
const LARGEST_RECIPROCAL: f32 = 1e30;

/// A ray prepared for the boxes of a tree: distances along it are its own, positions those of the tree's frame.
struct BoxRay {
    origin: Vec3A,
    direction: Vec3A,
    reciprocal: Vec3A,
    t_min: f32,
}

impl BoxRay {
    #[inline]
    fn new(ray: &Ray, scale: f32) -> BoxRay {
        let direction = Vec3A::from(ray.direction);
        BoxRay {
            origin: Vec3A::from(ray.origin) * scale,
            direction,
            reciprocal: Vec3A::from((direction * scale).to_array().map(|d| {
                if d.abs() < 1.0 / LARGEST_RECIPROCAL {
                    LARGEST_RECIPROCAL.copysign(d)
                } else {
                    1.0 / d
                }
            })),
            t_min: ray.t_min,
        }
    }
}

/// Which children of a node the segment may touch, in the encoding of the `traverse!` macro: internal nodes in the
/// upper eight bits, by traversal order; triangles below.
///
/// Each slab is widened by the rounding that computing it can have, so that a box is never lost, whatever its thickness
/// and however far away the ray starts.
#[inline(always)]
fn children_hit(node: &CwBvhNode, ray: &BoxRay, t_max: f32, octant: u32) -> u32 {
    let step = node.compute_extent() * ray.reciprocal;
    let start = (Vec3A::from(node.p) - ray.origin) * ray.reciprocal;
    let slack = (start.abs() + step.abs() * 256.0) * ROUNDING;
    let (first, last) = (start - slack, start + slack);

    let pick = |low, high, backwards: bool| if backwards { (high, low) } else { (low, high) };
    let (x_in, x_out) = pick(&node.child_min_x, &node.child_max_x, ray.reciprocal.x < 0.0);
    let (y_in, y_out) = pick(&node.child_min_y, &node.child_max_y, ray.reciprocal.y < 0.0);
    let (z_in, z_out) = pick(&node.child_min_z, &node.child_max_z, ray.reciprocal.z < 0.0);
    let (bits, shifts) = node.get_child_and_index_bits(octant);
    let mut mask = 0;
    for half in [0, 4] {
        let planes = |q: &[u8; 8], step: f32, start: f32| {
            Vec4::from([q[half], q[half + 1], q[half + 2], q[half + 3]].map(f32::from)) * step + start
        };
        let near = planes(x_in, step.x, first.x)
            .max(planes(y_in, step.y, first.y))
            .max(planes(z_in, step.z, first.z))
            .max(Vec4::splat(ray.t_min));
        let far = planes(x_out, step.x, last.x)
            .min(planes(y_out, step.y, last.y))
            .min(planes(z_out, step.z, last.z))
            .min(Vec4::splat(t_max));
        let mut hits = near.cmple(far).bitmask();
        while hits != 0 {
            let byte = 8 * (half as u32 + hits.trailing_zeros());
            hits &= hits - 1;
            mask |= ((bits >> byte) as u32 & 0xff) << ((shifts >> byte) as u32 & 0xff);
        }
    }
    mask
}

/// A tree over boxes, in a frame where the largest coordinate is between 1 and 2: the crate multiplies areas by numbers of
/// triangles, which leaves f32 from coordinates of 1e15 on, and the tree is wrong.
#[derive(Default)]
struct Tree {
    bvh: CwBvh,
    /// From the world, or the mesh, to the frame of the tree: a power of two, which rounds nothing.
    scale: f32,
}

impl Tree {
    fn build(mut boxes: Vec<Aabb>, quality: BuildQuality) -> Tree {
        if boxes.is_empty() {
            return Tree::default();
        }
        // The box of an instance may reach beyond f32 where its mesh does not.
        let clamp = |p: Vec3A| p.clamp(Vec3A::splat(f32::MIN), Vec3A::splat(f32::MAX));
        let largest = boxes
            .par_iter()
            .map(|b| clamp(b.min).abs().max(clamp(b.max).abs()))
            .reduce(|| Vec3A::ZERO, Vec3A::max);
        // The exponent with its sign turned, as far as a normal number has it.
        let scale = f32::from_bits((254 - (largest.max_element().to_bits() >> 23).clamp(1, 253)) << 23);
        boxes
            .par_iter_mut()
            .for_each(|b| *b = Aabb::new(clamp(b.min) * scale - SMALLEST, clamp(b.max) * scale + SMALLEST));
        Tree {
            bvh: build::shallow(&boxes, quality),
            scale,
        }
    }

    /// The box behind each slot that [`Tree::visit`] names.
    fn order(&self) -> &[u32] {
        &self.bvh.primitive_indices
    }

    /// Calls `test` with each slot whose box the segment may touch, roughly from near to far, until it returns true.
    /// `test` may shorten the segment.
    #[inline(always)]
    fn visit(&self, ray: &Ray, t_max: f32, mut test: impl FnMut(usize, &mut f32) -> bool) {
        let ray = &BoxRay::new(ray, self.scale);
        let bvh = &self.bvh;
        let mut t_max = t_max;
        let mut state = bvh.new_traversal(ray.direction);
        let mut node;
        'stop: {
            obvhs::traverse!(
                bvh,
                node,
                state,
                children_hit(node, ray, t_max, state.oct_inv4),
                if test(state.primitive_id as usize, &mut t_max) {
                    break 'stop;
                }
            );
        }
    }

    fn memory_bytes(&self) -> usize {
        size_of_val(&*self.bvh.nodes) + size_of_val(&*self.bvh.primitive_indices)
    }
}

/// Triangles under a tree, in the order of its slots.
struct TriangleTree {
    tree: Tree,
    corners: Vec<Corners>,
    /// Placement (of the merged tree only, else 0) and index in the mesh.
    ids: Vec<(u32, u32)>,
}

impl TriangleTree {
    /// Over the triangles that `corners` finds by their ids.
    fn build(
        mut ids: Vec<(u32, u32)>,
        corners: impl Fn((u32, u32)) -> [Vec3; 3] + Sync,
        quality: BuildQuality,
    ) -> TriangleTree {
        ids.retain(|id| triangle::can_be_hit(&corners(*id)));
        let boxes: Vec<Aabb> = ids
            .par_iter()
            .map(|id| Aabb::from_points(&corners(*id).map(Vec3A::from)))
            .collect();
        let tree = Tree::build(boxes, quality);
        let ids: Vec<(u32, u32)> = tree.order().par_iter().map(|&i| ids[i as usize]).collect();
        TriangleTree {
            corners: ids.par_iter().map(|id| corners(*id).into()).collect(),
            ids,
            tree,
        }
    }

    /// The nearest hit and the slot of its triangle: of several at the same distance, the one of the smallest ids.
    #[inline]
    fn intersect(&self, ray: &Ray, t_max: f32) -> Option<(usize, TriangleHit)> {
        let prepared = TriangleRay::new(ray)?;
        let mut nearest: Option<(usize, TriangleHit)> = None;
        let mut limit = t_max;
        self.tree.visit(ray, t_max, |slot, t_max| {
            if let Some(hit) = prepared.intersect(&self.corners[slot], limit)
                && nearest.is_none_or(|(other, near)| hit.t < near.t || self.ids[slot] < self.ids[other])
            {
                *t_max = hit.t;
                limit = hit.t.next_up();
                nearest = Some((slot, hit));
            }
            false
        });
        nearest
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        let Some(prepared) = TriangleRay::new(ray) else {
            return false;
        };
        let mut found = false;
        self.tree.visit(ray, ray.t_max, |slot, t_max| {
            found = prepared.intersect(&self.corners[slot], *t_max).is_some();
            found
        });
        found
    }

    fn memory_bytes(&self) -> usize {
        self.tree.memory_bytes() + size_of_val(&*self.corners) + size_of_val(&*self.ids)
    }
}

/// A placement with a transform.
struct Instance {
    placement: u32,
    mesh: u32,
    /// In f64, so that instances far from the origin of the world are not displaced.
    to_mesh: DAffine3,
}

impl Instance {
    /// The ray in the coordinates of the mesh; its direction is as much longer as the mesh is larger there.
    #[inline]
    fn ray_to_mesh(&self, ray: &Ray, t_max: f32) -> Ray {
        Ray {
            origin: self.to_mesh.transform_point3(ray.origin.as_dvec3()).as_vec3(),
            direction: self.to_mesh.transform_vector3(ray.direction.as_dvec3()).as_vec3(),
            t_min: ray.t_min,
            t_max,
        }
    }
}

/// The obvhs backend.
pub struct Obvhs {
    /// All placements without a transform.
    world: TriangleTree,
    /// One per mesh that has an instance.
    meshes: Vec<Option<TriangleTree>>,
    /// In the order of the slots of `instance_tree`.
    instances: Vec<Instance>,
    instance_tree: Tree,
    /// For [`BuildQuality::List`].
    list: Option<TriangleList>,
}

impl Accel for Obvhs {
    const NAME: &'static str = "obvhs";
    const INTERSECTORS: &'static [Intersector] = &[Intersector::Robust];

    fn build(geometry: &Geometry, options: BuildOptions) -> Result<Obvhs, AccelError> {
        let mut world = Vec::new();
        let mut meshes: Vec<Option<TriangleTree>> = geometry.meshes.iter().map(|_| None).collect();
        let mut instances = Vec::new();
        let mut boxes = Vec::new();
        for (id, placement) in (0..).zip(&geometry.placements) {
            let mesh = &geometry.meshes[placement.mesh as usize];
            let ids = |id| (0..mesh.indices.len() as u32).map(move |triangle| (id, triangle));
            let Some(to_world) = &placement.to_world else {
                world.extend(ids(id));
                continue;
            };
            meshes[placement.mesh as usize].get_or_insert_with(|| {
                let corners = |(_, triangle)| mesh.triangle(triangle as usize);
                TriangleTree::build(ids(0).collect(), corners, options.quality)
            });
            let to_world = DAffine3 {
                matrix3: to_world.matrix3.as_dmat3(),
                translation: to_world.translation.as_dvec3(),
            };
            instances.push(Instance {
                placement: id,
                mesh: placement.mesh,
                to_mesh: to_world.inverse(),
            });
            boxes.push(world_box(mesh.bounds(), &to_world));
        }
        let instance_tree = Tree::build(boxes, BuildQuality::Medium);
        let mut unordered: Vec<Option<Instance>> = instances.into_iter().map(Some).collect();
        Ok(Obvhs {
            world: TriangleTree::build(
                world,
                |(placement, triangle)| geometry.world_triangle(placement, triangle),
                options.quality,
            ),
            meshes,
            instances: instance_tree
                .order()
                .iter()
                .filter_map(|&i| unordered[i as usize].take())
                .collect(),
            instance_tree,
            list: TriangleList::if_wanted(geometry, options),
        })
    }

    #[inline]
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let to_hit = |tree: &TriangleTree, slot: usize, hit: TriangleHit| Hit {
            t: hit.t,
            placement: tree.ids[slot].0,
            triangle: tree.ids[slot].1,
            u: hit.u,
            v: hit.v,
        };
        let mut nearest = self
            .world
            .intersect(ray, ray.t_max)
            .map(|(slot, hit)| to_hit(&self.world, slot, hit));
        if !self.instances.is_empty() && is_traceable(ray) {
            let t_max = nearest.map_or(ray.t_max, |hit| hit.t);
            self.instance_tree.visit(ray, t_max, |slot, t_max| {
                let instance = &self.instances[slot];
                let limit = nearest.map_or(ray.t_max, |near| near.t.next_up());
                if let Some(tree) = &self.meshes[instance.mesh as usize]
                    && let Some((slot, hit)) = tree.intersect(&instance.ray_to_mesh(ray, limit), limit)
                    && nearest.is_none_or(|near| hit.t < near.t || instance.placement < near.placement)
                {
                    *t_max = hit.t;
                    nearest = Some(Hit {
                        placement: instance.placement,
                        ..to_hit(tree, slot, hit)
                    });
                }
                false
            });
        }
        nearest
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        let mut found = self.world.occluded(ray);
        if !found && !self.instances.is_empty() && is_traceable(ray) {
            self.instance_tree.visit(ray, ray.t_max, |slot, t_max| {
                let instance = &self.instances[slot];
                found = self.meshes[instance.mesh as usize]
                    .as_ref()
                    .is_some_and(|tree| tree.occluded(&instance.ray_to_mesh(ray, *t_max)));
                found
            });
        }
        found
    }

    fn intersect_coherent(&self, rays: &[Ray], hits: &mut Vec<Option<Hit>>) {
        match &self.list {
            Some(list) => list.intersect(rays, hits),
            None => hits.extend(rays.iter().map(|ray| self.intersect(ray))),
        }
    }

    fn list(&self) -> Option<&TriangleList> {
        self.list.as_ref()
    }

    fn memory_bytes(&self) -> usize {
        self.world.memory_bytes()
            + self
                .meshes
                .iter()
                .flatten()
                .map(TriangleTree::memory_bytes)
                .sum::<usize>()
            + self.instance_tree.memory_bytes()
            + size_of_val(&*self.instances)
            + self.list.as_ref().map_or(0, TriangleList::memory_bytes)
    }

    fn version() -> String {
        // The crate does not export its version; a test compares this with the lock file.
        "0.4.0".to_owned()
    }
}

/// The tree over instances sees rays before any triangle test could refuse them.
#[inline]
fn is_traceable(ray: &Ray) -> bool {
    ray.origin.is_finite() && ray.direction.is_finite() && ray.t_min < ray.t_max
}

/// The box around a transformed box, wide enough for the rounding of the transformed ray.
fn world_box((low, high): (Vec3, Vec3), to_world: &DAffine3) -> Aabb {
    let (low, high) = (low.as_dvec3(), high.as_dvec3());
    let columns = to_world.matrix3;
    let magnitude = low.abs().max(high.abs());
    let (mut min, mut max) = (to_world.translation, to_world.translation);
    let mut reach = to_world.translation.abs();
    for (column, low, high, magnitude) in [
        (columns.x_axis, low.x, high.x, magnitude.x),
        (columns.y_axis, low.y, high.y, magnitude.y),
        (columns.z_axis, low.z, high.z, magnitude.z),
    ] {
        min += (column * low).min(column * high);
        max += (column * low).max(column * high);
        reach += column.abs() * magnitude;
    }
    let slack = reach * f64::from(ROUNDING);
    Aabb::new((min - slack).as_vec3a(), (max + slack).as_vec3a())
}
