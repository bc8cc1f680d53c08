//! Primitives as triangle meshes.

use super::accessor::{Accessor, stated_counts};
use super::resource::Buffers;
use super::{Asset, LoadError, Notes};
use crate::math::{DVec3, Rgb, Vec2, Vec3};
use crate::mesh::TriangleMesh;
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use rayon::prelude::*;

/// Numbers that may be read of each byte of the buffers, all primitives together. Those of ordinary files are read once;
/// a small file that has the same numbers read a million times is damaged, or meant to do damage.
const MOST_READS_PER_BYTE: u64 = 64;

/// Reads that are always allowed.
const FREE_READS: u64 = 1 << 22;

/// How corners make triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Topology {
    List,
    Strip,
    Fan,
}

/// Texture coordinates of a primitive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Uvs {
    /// Nothing looks them up.
    Unused,
    /// They are looked up, but the file has none.
    Missing,
    Of(usize),
}

/// All that the triangles of a primitive depend on: accessors by index.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Shape {
    topology: Topology,
    indices: Option<usize>,
    positions: usize,
    normals: Option<usize>,
    uvs: Uvs,
    colors: Option<usize>,
}

impl Shape {
    /// `None` for what has no triangles. `set`: of texture coordinates, if any are needed. `place` is for messages.
    pub(super) fn of(primitive: &Primitive, set: Option<u32>, place: &str, notes: &mut Notes) -> Option<Shape> {
        let topology = match primitive.mode {
            Checked::Valid(Mode::Triangles) => Topology::List,
            Checked::Valid(Mode::TriangleStrip) => Topology::Strip,
            Checked::Valid(Mode::TriangleFan) => Topology::Fan,
            _ => {
                notes.add("points and lines are left out; only triangles are shown", place);
                return None;
            }
        };
        let accessor = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).map(|a| a.value());
        let Some(positions) = accessor(Semantic::Positions) else {
            notes.add("a primitive without positions is left out", place);
            return None;
        };
        if primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
            notes.add("morph targets are ignored: the mesh is shown without them", place);
        }
        let uvs = set.map_or(Uvs::Unused, |set| {
            accessor(Semantic::TexCoords(set)).map_or_else(
                || {
                    let problem = "the material has textures, but the mesh has no texture coordinates for them; \
                                   the first texel is used everywhere";
                    notes.add(problem, place);
                    Uvs::Missing
                },
                Uvs::Of,
            )
        });
        Some(Shape {
            topology,
            indices: primitive.indices.map(|indices| indices.value()),
            positions,
            normals: accessor(Semantic::Normals),
            uvs,
            colors: accessor(Semantic::Colors(0)),
        })
    }
}

/// Refuses files that would have the same numbers read again and again.
pub(super) fn check_work(
    asset: &Asset<'_>,
    buffers: &Buffers<'_>,
    shapes: &[(Shape, String)],
) -> Result<(), LoadError> {
    let limit = FREE_READS.saturating_add((buffers.total() as u64).saturating_mul(MOST_READS_PER_BYTE));
    let mut reads = 0u64;
    for (shape, place) in shapes {
        let corners = stated_counts(asset, shape.indices.unwrap_or(shape.positions)).0;
        let uvs = match shape.uvs {
            Uvs::Of(uvs) => Some(uvs),
            Uvs::Unused | Uvs::Missing => None,
        };
        let all = [shape.indices, Some(shape.positions), shape.normals, uvs, shape.colors];
        let sparse = all.into_iter().flatten().map(|a| stated_counts(asset, a).1);
        reads = sparse.fold(reads.saturating_add(corners), u64::saturating_add);
        if reads > limit {
            return Err(asset.error(
                place,
                format!(
                    "primitives up to this one use more than {limit} vertices and indices, far more than the file has"
                ),
            ));
        }
    }
    Ok(())
}

/// Opacity by vertex colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VertexAlpha {
    pub(super) mean: f32,
    pub(super) varies: bool,
}

/// What a shape has.
pub(super) struct MeshRead {
    /// `None` without triangles.
    pub(super) mesh: Option<TriangleMesh<DVec3>>,
    pub(super) alpha: VertexAlpha,
    pub(super) notes: Vec<String>,
}

/// Reads a shape; `place` is for messages.
pub(super) fn read(
    asset: &Asset<'_>,
    buffers: &Buffers<'_>,
    shape: &Shape,
    place: &str,
) -> Result<MeshRead, LoadError> {
    let mut notes = Vec::new();
    let positions = Accessor::open(asset, buffers, shape.positions, &[3])?;
    let attribute = |name: &str, index: usize, allowed: &[usize]| {
        let accessor = Accessor::open(asset, buffers, index, allowed)?;
        if accessor.count != positions.count {
            return Err(asset.error(
                format!("{place}.attributes.{name}"),
                format!("has {} elements, but POSITION has {}", accessor.count, positions.count),
            ));
        }
        Ok(accessor)
    };
    let normals = shape.normals.map(|a| attribute("NORMAL", a, &[3])).transpose()?;
    let colors = shape.colors.map(|a| attribute("COLOR_0", a, &[3, 4])).transpose()?;
    let uvs = match shape.uvs {
        Uvs::Of(a) => Some(attribute("TEXCOORD", a, &[2])?),
        Uvs::Unused | Uvs::Missing => None,
    };

    let corners = corners(asset, buffers, shape.indices, positions.count, place)?;
    let mut indices = triangles(shape.topology, &corners);
    let left_over = match shape.topology {
        Topology::List => corners.len() % 3,
        Topology::Strip | Topology::Fan => 0,
    };
    drop(corners);
    if indices.is_empty() || left_over > 0 {
        notes.push("a primitive has corners that make no whole triangle; they are left out".into());
    }
    let mut alpha = VertexAlpha {
        mean: 1.0,
        varies: false,
    };
    if indices.is_empty() {
        return Ok(MeshRead {
            mesh: None,
            alpha,
            notes,
        });
    }
    let used = compact(&mut indices, positions.count);
    let vertex = |i: usize| used.as_ref().map_or(i, |used| used[i] as usize);
    let count = used.as_ref().map_or(positions.count, Vec::len);
    let vertices = || (0..count).into_par_iter().map(vertex);

    let mut mesh = TriangleMesh {
        positions: vertices()
            .map(|i| DVec3::from(positions.floats(i).map(f64::from)))
            .collect(),
        indices,
        ..TriangleMesh::default()
    };
    if let Some(normals) = normals {
        mesh.normals = vertices().map(|i| Vec3::from(normals.floats(i))).collect();
    }
    if let Some(uvs) = &uvs {
        mesh.uvs = vertices()
            .map(|i| {
                let [u, v] = uvs.floats(i);
                // Rows count from the top in the file, and from the bottom here.
                Vec2::new(u, 1.0 - v)
            })
            .collect();
    }
    if shape.uvs == Uvs::Missing {
        mesh.uvs = vec![Vec2::new(0.0, 1.0); count];
    }
    if let Some(colors) = colors {
        let unit = |c: f32| if c.is_nan() { 0.0 } else { c.clamp(0.0, 1.0) };
        mesh.colors = vertices().map(|i| Rgb::from(colors.floats(i).map(unit))).collect();
        if colors.components == 4 {
            let alphas = || (0..count).map(|i| unit(colors.floats::<4>(vertex(i))[3]));
            let first = alphas().next().unwrap_or(1.0);
            alpha.varies = alphas().any(|a| a != first);
            alpha.mean = if alpha.varies {
                (alphas().map(f64::from).sum::<f64>() / count as f64) as f32
            } else {
                first
            };
        }
    }
    check(asset, &mut mesh, place, &mut notes)?;
    Ok(MeshRead {
        mesh: Some(mesh),
        alpha,
        notes,
    })
}

/// The vertices in the order of the corners.
fn corners(
    asset: &Asset<'_>,
    buffers: &Buffers<'_>,
    indices: Option<usize>,
    vertices: usize,
    place: &str,
) -> Result<Vec<u32>, LoadError> {
    if u32::try_from(vertices).is_err() {
        return Err(asset.error(place, "has more than 2^32 - 1 vertices; split it"));
    }
    let Some(index) = indices else {
        return Ok((0..vertices as u32).collect());
    };
    let indices = Accessor::open(asset, buffers, index, &[1])?;
    if !indices.is_unsigned() {
        return Err(asset.error(
            format!("accessors[{index}].componentType"),
            "indices are unsigned integers",
        ));
    }
    let corners: Vec<u32> = (0..indices.count).into_par_iter().map(|i| indices.integer(i)).collect();
    match corners.iter().position(|&corner| corner as usize >= vertices) {
        None => Ok(corners),
        Some(at) => Err(asset.error(
            format!("{place}.indices"),
            format!("index {at} is {}, but there are {vertices} vertices", corners[at]),
        )),
    }
}

fn triangles(topology: Topology, corners: &[u32]) -> Vec<[u32; 3]> {
    match topology {
        Topology::List => corners.as_chunks().0.to_vec(),
        Topology::Strip => {
            let pair = |i: usize| if i.is_multiple_of(2) { [1, 2] } else { [2, 1] };
            let triangle = |(i, window): (usize, &[u32])| [window[0], window[pair(i)[0]], window[pair(i)[1]]];
            corners.windows(3).enumerate().map(triangle).collect()
        }
        Topology::Fan => match corners.split_first() {
            Some((&first, rest)) => rest.windows(2).map(|pair| [pair[0], pair[1], first]).collect(),
            None => Vec::new(),
        },
    }
}

/// Where few of the vertices are used, numbers those anew, and returns which they are: many primitives may share one large
/// array.
fn compact(indices: &mut [[u32; 3]], vertices: usize) -> Option<Vec<u32>> {
    if 3 * indices.len() >= vertices {
        return None;
    }
    let mut used = indices.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    for corner in indices.as_flattened_mut() {
        *corner = used.partition_point(|&vertex| vertex < *corner) as u32;
    }
    Some(used)
}

/// Checks a mesh and mends its attributes.
fn check(
    asset: &Asset<'_>,
    mesh: &mut TriangleMesh<DVec3>,
    place: &str,
    notes: &mut Vec<String>,
) -> Result<(), LoadError> {
    mesh.validate().map_err(|fault| asset.error(place, fault.to_string()))?;
    if mesh.repair_normals() > 0 {
        notes.push("some normals have no direction; face normals are used there".into());
    }
    let mut odd = 0;
    for uv in mesh.uvs.iter_mut().filter(|uv| !uv.is_finite()) {
        *uv = Vec2::ZERO;
        odd += 1;
    }
    if odd > 0 {
        notes.push("some texture coordinates are not finite and are set to 0".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_the_front() {
        assert_eq!(
            triangles(Topology::Strip, &[5, 6, 7, 8, 9]),
            [[5, 6, 7], [6, 8, 7], [7, 8, 9]]
        );
        assert_eq!(triangles(Topology::Fan, &[5, 6, 7, 8]), [[6, 7, 5], [7, 8, 5]]);
        assert_eq!(triangles(Topology::List, &[1, 2, 3, 4, 5]), [[1, 2, 3]]);
        for topology in [Topology::List, Topology::Strip, Topology::Fan] {
            assert!(triangles(topology, &[]).is_empty() && triangles(topology, &[1, 2]).is_empty());
        }
    }

    #[test]
    fn vertices_that_are_not_used_are_dropped_where_they_are_many() {
        let mut few = [[900, 7, 44], [7, 44, 1000]];
        assert_eq!(compact(&mut few, 2000), Some(vec![7, 44, 900, 1000]));
        assert_eq!(few, [[2, 0, 1], [0, 1, 3]]);
        let mut most = [[0, 1, 3]];
        assert_eq!(compact(&mut most, 3), None);
        assert_eq!(most, [[0, 1, 3]]);
    }
}
