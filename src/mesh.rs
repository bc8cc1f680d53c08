//! Indexed triangle meshes.

use crate::math::{DAffine3, DMat3, DVec3, Rgb, Vec2, Vec3};
use rayon::prelude::*;
use thiserror::Error;

mod polygon;
mod smooth;

pub(crate) use polygon::{Cut, Polygon};

/// An indexed triangle mesh. One index serves position, normal and texture coordinate alike.
///
/// Front faces are counter-clockwise seen from outside. Positions are in the unit of the scene: `DVec3` as read from a
/// file, so that a mesh far from the origin keeps its shape until the origin of rendering is known, and `Vec3` from then
/// on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh<P = Vec3> {
    /// Vertex positions; all finite.
    pub positions: Vec<P>,
    /// Unit vertex normals, one per position, or empty for flat shading.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per position, or empty. `v = 0` is the bottom row of an image.
    pub uvs: Vec<Vec2>,
    /// Linear colours, one per position, or empty: white.
    pub colors: Vec<Rgb>,
    /// Corner indices of each triangle.
    pub indices: Vec<[u32; 3]>,
}

/// What can be wrong with a mesh.
#[derive(Debug, Error, PartialEq)]
pub enum MeshError {
    /// A position has a component that is NaN or infinite.
    #[error("vertex {index} has a position that is not finite ({x}, {y}, {z})", x = .position.x, y = .position.y, z = .position.z)]
    Position {
        /// Index of the vertex, from 0.
        index: usize,
        /// Its position.
        position: DVec3,
    },
    /// A triangle refers to a vertex that is not there.
    #[error("triangle {triangle} uses vertex {index}, but the mesh has {vertices} vertices")]
    Index {
        /// Index of the triangle, from 0.
        triangle: usize,
        /// The index that is out of range.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An attribute array has another length than the positions.
    #[error("the mesh has {vertices} vertices but {count} {attribute}")]
    Attribute {
        /// "normals", "texture coordinates" or "colours".
        attribute: &'static str,
        /// Length of the array.
        count: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// No triangle at all.
    #[error("the mesh has no triangles")]
    Empty,
}

impl TriangleMesh<DVec3> {
    /// Checks the invariants that everything after loading relies on.
    ///
    /// # Errors
    /// The first violation found: no triangles, an index out of range, an array of the wrong length, a position that
    /// is not finite. Normals that are not finite are not an error; [`TriangleMesh::repair_normals`] mends them.
    pub fn validate(&self) -> Result<(), MeshError> {
        let vertices = self.positions.len();
        if self.indices.is_empty() {
            return Err(MeshError::Empty);
        }
        for (attribute, count) in [
            ("normals", self.normals.len()),
            ("texture coordinates", self.uvs.len()),
            ("colours", self.colors.len()),
        ] {
            if count != 0 && count != vertices {
                return Err(MeshError::Attribute {
                    attribute,
                    count,
                    vertices,
                });
            }
        }
        let position = self.positions.par_iter().enumerate();
        if let Some((index, &position)) = position.find_first(|(_, p)| !p.is_finite()) {
            return Err(MeshError::Position { index, position });
        }
        let outside = |corners: &[u32; 3]| corners.iter().find(|&&i| i as usize >= vertices).copied();
        let triangles = self.indices.par_iter().map(outside).enumerate();
        match triangles.find_first(|(_, outside)| outside.is_some()) {
            Some((triangle, Some(index))) => Err(MeshError::Index {
                triangle,
                index,
                vertices,
            }),
            _ => Ok(()),
        }
    }

    /// Makes every vertex normal a unit vector and returns how many could not be (zero length or not finite).
    /// Those become zero, and shading takes the face normal at every triangle that uses one.
    pub fn repair_normals(&mut self) -> usize {
        let mend = |n: &mut Vec3| {
            // A unit vector rounded to f32 stays as it is, so that meshes can be written and read again.
            if (n.as_dvec3().length_squared() - 1.0).abs() < 2.0 * f64::from(f32::EPSILON) {
                return 0;
            }
            // In f64, so that tiny and huge file normals neither vanish nor overflow.
            let unit = n.as_dvec3().try_normalize().map(|d| d.as_vec3());
            *n = unit.unwrap_or(Vec3::ZERO);
            usize::from(unit.is_none())
        };
        self.normals.par_iter_mut().map(mend).sum()
    }

    /// The mesh in other coordinates, rounded to f32. A transform that mirrors also swaps the winding, so that front stays
    /// front. Attributes that stay as they are move, without a copy.
    pub fn into_f32(self, transform: &DAffine3) -> TriangleMesh {
        let place = |p: &DVec3| transform.transform_point3(*p).as_vec3();
        let TriangleMesh {
            positions,
            mut normals,
            uvs,
            colors,
            mut indices,
        } = self;
        // A uniform scale leaves normals as they are, to the bit.
        let scale = transform.matrix3.x_axis.x;
        let turns = transform.matrix3 != DMat3::from_diagonal(DVec3::splat(scale)) || scale < 0.0;
        if turns {
            let normal_matrix = transform.matrix3.inverse().transpose();
            for n in &mut normals {
                *n = (normal_matrix * n.as_dvec3())
                    .try_normalize()
                    .unwrap_or(DVec3::ZERO)
                    .as_vec3();
            }
        }
        if turns && transform.matrix3.determinant() < 0.0 {
            indices.iter_mut().for_each(|t| t.swap(1, 2));
        }
        TriangleMesh {
            positions: positions.par_iter().map(place).collect(),
            normals,
            uvs,
            colors,
            indices,
        }
    }

    /// The smallest and largest corner of the axis-aligned box around all positions.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        self.positions
            .iter()
            .fold(empty, |(lo, hi), p| (lo.min(*p), hi.max(*p)))
    }
}

impl TriangleMesh {
    /// The corner positions of a triangle.
    pub fn triangle(&self, triangle: usize) -> [Vec3; 3] {
        self.indices[triangle].map(|i| self.positions[i as usize])
    }

    /// The same mesh as a part of a description.
    pub fn into_f64(self) -> TriangleMesh<DVec3> {
        TriangleMesh {
            positions: self.positions.iter().map(|p| p.as_dvec3()).collect(),
            normals: self.normals,
            uvs: self.uvs,
            colors: self.colors,
            indices: self.indices,
        }
    }

    /// The smallest and largest corner of the axis-aligned box around all positions.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.positions
            .iter()
            .fold(empty, |(lo, hi), p| (lo.min(*p), hi.max(*p)))
    }

    /// Bytes held by the arrays.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.positions)
            + size_of_val(&*self.normals)
            + size_of_val(&*self.uvs)
            + size_of_val(&*self.colors)
            + size_of_val(&*self.indices)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one_triangle() -> TriangleMesh<DVec3> {
        TriangleMesh {
            positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
            indices: vec![[0, 1, 2]],
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn validation_names_what_is_wrong() {
        assert_eq!(one_triangle().validate(), Ok(()));
        let mut nan = one_triangle();
        nan.positions[1].y = f64::NAN;
        assert!(nan.validate().unwrap_err().to_string().contains("vertex 1"));
        let mut range = one_triangle();
        range.indices[0][2] = 7;
        assert_eq!(
            range.validate(),
            Err(MeshError::Index {
                triangle: 0,
                index: 7,
                vertices: 3
            })
        );
        let mut short = one_triangle();
        short.uvs = vec![Vec2::ZERO];
        assert!(
            short
                .validate()
                .unwrap_err()
                .to_string()
                .contains("texture coordinates")
        );
        assert_eq!(TriangleMesh::<DVec3>::default().validate(), Err(MeshError::Empty));
    }

    #[test]
    fn a_mirroring_transform_keeps_the_front_side() {
        let mesh = one_triangle().into_f32(&DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0)));
        let [a, b, c] = mesh.triangle(0);
        assert!((b - a).cross(c - a).z > 0.0);
    }

    #[test]
    fn unusable_normals_are_counted_and_zeroed() {
        let mut mesh = one_triangle();
        mesh.normals = vec![Vec3::new(0.0, 0.0, 1e-30), Vec3::ZERO, Vec3::new(f32::NAN, 0.0, 1.0)];
        assert_eq!(mesh.repair_normals(), 2);
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::ZERO, Vec3::ZERO]);
    }
}
