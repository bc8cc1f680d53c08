//! Hierarchies that are never deep.
//!
//! The crate's builder pairs neighbours by the area around both (Meister, Bittner 2018, "Parallel locally-ordered
//! clustering for bounding volume hierarchy construction"). Where many boxes are equal, or lie inside each other, it finds
//! one pair at a time: the tree becomes a list, building it takes the square of its length, and recursion over it ends the
//! process. Equal boxes are therefore built as one and divided afterwards; lists that are left are built anew, balanced.

use crate::accel::BuildQuality;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use rayon::prelude::*;

/// The crate's traversal remembers so many levels, and may forget triangles of deeper trees.
const MAX_DEPTH: usize = 32;

/// Binary trees that are deeper are not worth converting, which recurses.
const MAX_BINARY_DEPTH: usize = 1000;

/// A tree of less than [`MAX_DEPTH`] levels.
pub(super) fn shallow(boxes: &[Aabb], quality: BuildQuality) -> CwBvh {
    let order = by_box_if_many_are_equal(boxes);
    let bvh2 = match &order {
        None => binary(boxes, quality),
        Some(order) => {
            let groups: Vec<&[u32]> = order
                .chunk_by(|&a, &b| boxes[a as usize] == boxes[b as usize])
                .collect();
            let firsts: Vec<Aabb> = groups.iter().map(|group| boxes[group[0] as usize]).collect();
            binary(&firsts, quality).map(|bvh2| divide_groups(bvh2, &groups, boxes))
        }
    };
    if let Some(bvh) = bvh2.map(|bvh2| to_wide(&bvh2))
        && depth(&bvh) < MAX_DEPTH
    {
        return bvh;
    }
    let mut balanced = Bvh2 {
        nodes: vec![Bvh2Node::default()],
        ..Bvh2::default()
    };
    let mut order = order.unwrap_or_else(|| (0..boxes.len() as u32).collect());
    balance(&mut balanced, 0, &mut order, boxes);
    to_wide(&balanced)
}

/// So many equal boxes do not make a list that matters. The two halves of a quad are two.
const FEW: usize = 16;

/// The indices of the boxes, equal boxes in a row; `None` where never more than [`FEW`] are equal.
fn by_box_if_many_are_equal(boxes: &[Aabb]) -> Option<Vec<u32>> {
    // Sums of products mix well enough: boxes that differ may follow each other in any order.
    let key = |b: &Aabb| {
        [b.min, b.max].iter().flat_map(|p| p.to_array()).fold(0u64, |key, c| {
            (key ^ u64::from(c.to_bits()))
                .wrapping_mul(0x9E37_79B9_7F4A_7C15)
                .rotate_left(29)
        })
    };
    // Keys alone are sorted in half of the time, and tell most scenes.
    let mut keys: Vec<u64> = boxes.par_iter().map(key).collect();
    keys.par_sort_unstable();
    if keys.par_windows(FEW + 1).all(|keys| keys[0] != keys[FEW]) {
        return None;
    }
    drop(keys);
    let mut keyed: Vec<(u64, u32)> = boxes.par_iter().map(key).zip(0..boxes.len() as u32).collect();
    keyed.par_sort_unstable();
    Some(keyed.into_iter().map(|(_, i)| i).collect())
}

/// The crate's builder; `None` where it makes a list.
fn binary(boxes: &[Aabb], quality: BuildQuality) -> Option<Bvh2> {
    let params = match quality {
        BuildQuality::Low => BvhBuildParams::very_fast_build(),
        BuildQuality::List | BuildQuality::Medium => BvhBuildParams::medium_build(),
        // Without its splits of triangles: a leaf is one of our triangles.
        BuildQuality::High => BvhBuildParams::slow_build(),
    };
    let mut bvh2 = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    if bvh2.max_depth > MAX_BINARY_DEPTH {
        return None;
    }
    ReinsertionOptimizer::default().run(&mut bvh2, params.reinsertion_batch_ratio, None);
    Some(bvh2)
}

fn to_wide(bvh2: &Bvh2) -> CwBvh {
    /// The most that a node of the crate's eight-wide tree can hold.
    const LEAF: u32 = 3;
    bvh2_to_cwbvh(bvh2, LEAF, true, false)
}

/// Gives every leaf, which stands for a group of equal boxes, all the boxes of its group.
fn divide_groups(mut bvh2: Bvh2, groups: &[&[u32]], boxes: &[Aabb]) -> Bvh2 {
    let old = std::mem::take(&mut bvh2.primitive_indices);
    for node in 0..bvh2.nodes.len() {
        let leaf = bvh2.nodes[node];
        if leaf.is_leaf() {
            let slots = leaf.first_index as usize..(leaf.first_index + leaf.prim_count) as usize;
            let mut items: Vec<u32> = old[slots].iter().flat_map(|&g| groups[g as usize]).copied().collect();
            balance(&mut bvh2, node, &mut items, boxes);
        }
    }
    bvh2
}

/// Makes `node` the root of a tree over `items`, halved along the longest axis.
fn balance(bvh2: &mut Bvh2, node: usize, items: &mut [u32], boxes: &[Aabb]) {
    let bounds = items
        .iter()
        .fold(Aabb::INVALID, |all, &i| all.union(&boxes[i as usize]));
    if let [item] = *items {
        bvh2.nodes[node] = Bvh2Node::new(bounds, 1, bvh2.primitive_indices.len() as u32);
        bvh2.primitive_indices.push(item);
        return;
    }
    let size = bounds.max - bounds.min;
    let axis = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b])).unwrap_or(0);
    let middle = |i: &u32| boxes[*i as usize].min[axis] + boxes[*i as usize].max[axis];
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)));
    let (low, high) = items.split_at_mut(half);
    let first = bvh2.nodes.len();
    bvh2.nodes.extend([Bvh2Node::default(); 2]);
    bvh2.nodes[node] = Bvh2Node::new(bounds, 0, first as u32);
    balance(bvh2, first, low, boxes);
    balance(bvh2, first + 1, high, boxes);
}

/// Levels of a tree. Children stand behind their parents.
fn depth(bvh: &CwBvh) -> usize {
    let mut levels = vec![1; bvh.nodes.len()];
    for (i, node) in bvh.nodes.iter().enumerate() {
        let first = node.child_base_idx as usize;
        for child in first..first + node.imask.count_ones() as usize {
            levels[child] = levels[i] + 1;
        }
    }
    levels.into_iter().max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::super::{Obvhs, TriangleTree};
    use super::*;
    use crate::accel::brute::Brute;
    use crate::accel::{Accel, BuildOptions, Geometry, Placement, Ray};
    use crate::math::Vec3;
    use crate::mesh::TriangleMesh;
    use std::sync::Arc;

    /// From all around, in a tree of no more levels than can be.
    fn assert_hits_are_those_of_brute_force(triangles: &[[Vec3; 3]]) {
        let geometry = Geometry {
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
        };
        let obvhs = Obvhs::build(&geometry, BuildOptions::default()).unwrap();
        assert!(depth(&obvhs.world.tree.bvh) < MAX_DEPTH);
        let brute = Brute::build(&geometry, BuildOptions::default()).unwrap();
        let mut hits = 0;
        for triangle in triangles {
            let target = (triangle[0] + triangle[1] + triangle[2]) / 3.0;
            for origin in [
                Vec3::new(0.1, 0.2, 3.0),
                Vec3::new(-2.0, 1.0, 1.0),
                target + Vec3::splat(1e-3),
            ] {
                let ray = Ray::new(origin, (target - origin).normalize());
                let hit = brute.intersect(&ray);
                assert_eq!(obvhs.intersect(&ray), hit, "{ray:?}");
                hits += usize::from(hit.is_some());
            }
        }
        assert!(hits > triangles.len(), "{hits}");
    }

    #[test]
    fn nothing_is_missed_among_triangles_of_all_sizes_around_a_point() {
        for (ratio, count) in [(0.25, 60), (0.5, 120), (0.8, 400), (0.9, 600)] {
            let nested: Vec<[Vec3; 3]> = (0..count)
                .map(|i| [Vec3::NEG_X, Vec3::X, Vec3::Y].map(|p| p * f32::powi(ratio, i)))
                .collect();
            assert_hits_are_those_of_brute_force(&nested);
        }
    }

    #[test]
    fn nothing_is_missed_among_a_thousand_equal_triangles() {
        let many = TriangleTree::build(
            vec![(0, 0); 100_000],
            |_| [Vec3::NEG_X, Vec3::X, Vec3::Y],
            BuildQuality::Medium,
        );
        assert!(depth(&many.tree.bvh) < MAX_DEPTH);
        assert_hits_are_those_of_brute_force(&[[Vec3::NEG_X, Vec3::X, Vec3::Y]; 1000]);
        let mut one_large = vec![[Vec3::NEG_X, Vec3::X, Vec3::Y].map(|p| p * 1e-25); 1000];
        one_large.push([Vec3::NEG_X, Vec3::X, Vec3::Y]);
        assert_hits_are_those_of_brute_force(&one_large);
    }
}
