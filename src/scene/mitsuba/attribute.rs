//! Numbers that a mesh file gives by vertex or triangle, kept as colours of the mesh.

use super::tessellate::split;
use crate::math::{DVec3, Rgb};
use crate::mesh::TriangleMesh;

/// Numbers by vertex or by triangle.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Attribute {
    /// Begins with `vertex_` or `face_`.
    pub(super) name: String,
    /// Numbers each; 1 or 3 can be used.
    pub(super) count: usize,
    /// All of them.
    pub(super) values: Vec<f32>,
}

/// Gives the mesh an attribute as its colours.
pub(super) fn apply(mesh: &mut TriangleMesh<DVec3>, attributes: &[Attribute], name: &str) -> Result<(), String> {
    let Some(attribute) = attributes.iter().find(|attribute| attribute.name == name) else {
        let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name.as_str()).collect();
        let has = if names.is_empty() {
            "none".to_owned()
        } else {
            names.join(", ")
        };
        return Err(format!(
            "has no mesh attribute \"{name}\", which its material asks for; it has {has}"
        ));
    };
    let color = |numbers: &[f32]| match *numbers {
        [grey] => Ok(Rgb::splat(grey)),
        [r, g, b] => Ok(Rgb::new(r, g, b)),
        _ => Err(format!(
            "has a mesh attribute \"{name}\" of {} numbers; expected 1 or 3",
            numbers.len()
        )),
    };
    if attribute.values.iter().any(|value| !value.is_finite() || *value < 0.0) {
        return Err(format!(
            "has a mesh attribute \"{name}\" with negative numbers, or such that are not finite"
        ));
    }
    let colors = attribute.values.chunks_exact(attribute.count.max(1)).map(color);
    let colors = colors.collect::<Result<Vec<Rgb>, String>>()?;
    let expected = if name.starts_with("face_") {
        mesh.indices.len()
    } else {
        mesh.positions.len()
    };
    if colors.len() != expected {
        return Err(format!(
            "has {} values of the mesh attribute \"{name}\"; expected {expected}",
            colors.len()
        ));
    }
    if name.starts_with("face_") {
        split(mesh);
        mesh.colors = colors.into_iter().flat_map(|color| [color; 3]).collect();
    } else {
        mesh.colors = colors;
    }
    Ok(())
}
