//! The hierarchy of nodes.

use super::container::Placement;
use super::{Asset, LoadError, Notes};
use crate::math::{DAffine3, DMat3, DQuat, DVec3};

/// A node of the scene that is shown.
pub(super) struct Placed {
    pub(super) node: usize,
    pub(super) to_world: DAffine3,
}

/// The nodes of the scene, parents before children, in the order of the file.
pub(super) fn place(asset: &Asset<'_>, placements: &[Placement], notes: &mut Notes) -> Result<Vec<Placed>, LoadError> {
    let parents = parents(asset)?;
    let roots = roots(asset, &parents, notes)?;
    let mut placed = Vec::new();
    // A list and no recursion: chains of nodes may be as long as the file.
    let mut open: Vec<(usize, DAffine3)> = roots.into_iter().rev().map(|n| (n, DAffine3::IDENTITY)).collect();
    while let Some((node, parent)) = open.pop() {
        let to_world = parent * local(asset, node, &placements[node])?;
        if !to_world.is_finite() {
            return Err(asset.error(format!("nodes[{node}]"), "its place in the world is not finite"));
        }
        open.extend(children(asset, node).rev().map(|child| (child, to_world)));
        placed.push(Placed { node, to_world });
    }
    Ok(placed)
}

fn children<'a>(asset: &'a Asset<'_>, node: usize) -> impl DoubleEndedIterator<Item = usize> + 'a {
    let children = asset.root.nodes[node].children.as_deref().unwrap_or_default();
    children.iter().map(|child| child.value())
}

/// The parent of each node.
fn parents(asset: &Asset<'_>) -> Result<Vec<Option<usize>>, LoadError> {
    let count = asset.root.nodes.len();
    let mut parents = vec![None; count];
    for node in 0..count {
        for (i, child) in children(asset, node).enumerate() {
            if let Some(other) = parents[child].replace(node) {
                return Err(asset.error(
                    format!("nodes[{node}].children[{i}]"),
                    format!("node {child} is a child of node {other} already; a node has one parent at most"),
                ));
            }
        }
    }
    // With one parent each, what cannot be reached from a node without one goes round in a circle.
    let mut open: Vec<usize> = (0..count).filter(|&node| parents[node].is_none()).collect();
    let mut reached = vec![false; count];
    while let Some(node) = open.pop() {
        reached[node] = true;
        open.extend(children(asset, node));
    }
    match reached.iter().position(|reached| !reached) {
        Some(node) => Err(asset.error(
            format!("nodes[{node}]"),
            "the node is among its own descendants, or below one that is",
        )),
        None => Ok(parents),
    }
}

fn roots(asset: &Asset<'_>, parents: &[Option<usize>], notes: &mut Notes) -> Result<Vec<usize>, LoadError> {
    let root = &asset.root;
    let shown = root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = root.scenes.get(shown) else {
        return Ok((0..parents.len()).filter(|&node| parents[node].is_none()).collect());
    };
    if root.scenes.len() > 1 {
        let name = scene
            .name
            .as_deref()
            .map_or_else(String::new, |name| format!(" ({name})"));
        notes.add(
            format!("has {} scenes; scenes[{shown}]{name} is shown", root.scenes.len()),
            "",
        );
    }
    let mut seen = vec![false; parents.len()];
    let mut roots = Vec::with_capacity(scene.nodes.len());
    for (i, node) in scene.nodes.iter().map(|node| node.value()).enumerate() {
        let place = || format!("scenes[{shown}].nodes[{i}]");
        if let Some(parent) = parents[node] {
            return Err(asset.error(
                place(),
                format!("node {node} is a child of node {parent}; a scene lists nodes without parent"),
            ));
        }
        if std::mem::replace(&mut seen[node], true) {
            return Err(asset.error(place(), format!("node {node} is listed twice")));
        }
        roots.push(node);
    }
    Ok(roots)
}

/// Node to parent.
fn local(asset: &Asset<'_>, node: usize, placement: &Placement) -> Result<DAffine3, LoadError> {
    let error = |key: &str, problem: &str| Err(asset.error(format!("nodes[{node}].{key}"), problem));
    if let Some(m) = placement.matrix {
        let column = |i: usize| DVec3::new(m[4 * i], m[4 * i + 1], m[4 * i + 2]);
        let last_row = [m[3], m[7], m[11], m[15] - 1.0];
        if last_row.iter().any(|c| c.abs() > 1e-6) {
            return error(
                "matrix",
                "the last row is not 0, 0, 0, 1; only affine transforms place things",
            );
        }
        return Ok(DAffine3 {
            matrix3: DMat3::from_cols(column(0), column(1), column(2)),
            translation: column(3),
        });
    }
    let [x, y, z, w] = placement.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let length = DQuat::from_xyzw(x, y, z, w).length();
    if !(length > 1e-6 && length.is_finite()) {
        return error(
            "rotation",
            "the quaternion has no direction; a rotation is a unit quaternion",
        );
    }
    Ok(DAffine3::from_scale_rotation_translation(
        placement.scale.map_or(DVec3::ONE, DVec3::from),
        DQuat::from_xyzw(x / length, y / length, z / length, w / length),
        placement.translation.map_or(DVec3::ZERO, DVec3::from),
    ))
}
