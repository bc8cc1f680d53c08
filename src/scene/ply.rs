//! PLY meshes (Turk 1994, "The PLY Polygon File Format"): ASCII and both binary orders.
//!
//! The reader is our own for speed: `ply-rs-bw` 4.0 takes 2.5 times as long as Mitsuba 3.9 for ten million binary triangles,
//! and a vector for each face; this one takes less time than that (docs/performance.md).

mod attributes;
mod content;
mod header;
mod rows;
mod write;

pub use attributes::PlyAttribute;
pub use write::write_ply;

use crate::math::{DVec3, Rgb, Vec2};
use crate::mesh::{Cut, MeshError, Polygon, TriangleMesh};
use content::Content;
use header::Format;
use rows::{Ascii, Binary};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The content of a PLY file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyMesh {
    /// The triangles, without colours; satisfies [`TriangleMesh::validate`]. Normals are unit vectors or zero, texture
    /// coordinates finite.
    pub mesh: TriangleMesh<DVec3>,
    /// What else vertices and faces have.
    pub attributes: Vec<PlyAttribute>,
    /// What was ignored or mended, one sentence each, naming the file.
    pub warnings: Vec<String>,
    /// The faces of more than three corners, in order.
    polygons: Vec<Polygon>,
}

/// Why a PLY file cannot be used.
#[derive(Debug, Error)]
pub enum PlyError {
    /// A line of the header is not what the format asks for.
    #[error("{}:{line}: `{text}`: expected {expected}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: u64,
        /// The beginning of the line.
        text: String,
        /// What should stand there.
        expected: &'static str,
    },
    /// There are fewer bytes than the header needs.
    #[error(
        "{}: the header says {count} of `{element}`, but only {available} bytes follow; the file was cut, or is damaged",
        path.display()
    )]
    Count {
        /// The file.
        path: PathBuf,
        /// "vertex", "face" or another.
        element: String,
        /// How many there should be.
        count: u64,
        /// Bytes in the rest of the file.
        available: usize,
    },
    /// What follows the header is not what that says.
    #[error("{}: {place}, {element} {row}: {problem}", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// The byte or line where it begins.
        place: String,
        /// "vertex", "face" or another.
        element: String,
        /// Which one, from 0.
        row: u64,
        /// What is wrong.
        problem: String,
    },
    /// The file has no face.
    #[error("{}: has no faces; point clouds cannot be shown, reconstruct a surface first", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The mesh violates an invariant.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The invariant.
        source: MeshError,
    },
}

/// Reads the content of a PLY file. `path` is for messages only.
///
/// Vertices keep their order, and all are kept. Faces of more than three corners become fans around the first corner, or
/// what ear clipping makes of them where a fan would leave them. Elements and lists of unknown name are skipped with a
/// warning, numbers of unknown name without.
///
/// # Errors
/// [`PlyError`], with the place in the file. Counts are checked against the length of the file before anything is allocated.
pub fn read(path: &Path, bytes: &[u8]) -> Result<PlyMesh, PlyError> {
    let header = header::read(path, bytes)?;
    let at = header.bytes;
    let content = match header.format {
        Format::Ascii => {
            let (line, line_end) = (header.line, header.line_end);
            let row = &bytes[..0];
            content::read(
                path,
                &header,
                Ascii {
                    bytes,
                    at,
                    line,
                    line_end,
                    row,
                },
            )
        }
        Format::LittleEndian => content::read(path, &header, Binary::<false> { bytes, at, row: at }),
        Format::BigEndian => content::read(path, &header, Binary::<true> { bytes, at, row: at }),
    }?;
    finish(path, content)
}

fn finish(path: &Path, content: Content) -> Result<PlyMesh, PlyError> {
    let Content {
        mut mesh,
        polygons,
        attributes,
        small_faces,
        unread,
        trailing,
    } = content;
    if mesh.indices.is_empty() {
        return Err(PlyError::Empty { path: path.to_owned() });
    }
    mesh.validate().map_err(|source| PlyError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    for cut in Cut::all(&mesh.positions, &mesh.indices, &polygons) {
        cut.apply(&mut mesh.indices, cut.start());
    }
    let file = path.display();
    let mut warnings: Vec<String> = unread
        .into_iter()
        .map(|(what, count)| format!("{file}: {what}, {count} times, is not read"))
        .collect();
    let mut warn = |count: u64, what: &str| {
        if count > 0 {
            warnings.push(format!("{file}: {count} {what}"));
        }
    };
    warn(small_faces, "faces have fewer than three corners and are ignored");
    warn(
        trailing,
        "bytes after the last row are ignored; the header's counts may be wrong",
    );
    let normals = mesh.repair_normals();
    warn(
        normals as u64,
        "vertex normals have no direction; face normals are used there",
    );
    let mut uvs = 0;
    for uv in mesh.uvs.iter_mut().filter(|uv| !uv.is_finite()) {
        *uv = Vec2::ZERO;
        uvs += 1;
    }
    warn(uvs, "texture coordinates are not finite and are set to 0");
    Ok(PlyMesh {
        mesh,
        attributes,
        warnings,
        polygons,
    })
}

/// So many triangles can have vertices of their own.
const MOST_PARTED: usize = (u32::MAX / 3) as usize;

impl PlyMesh {
    /// The name of the attribute that is the colour of the surface, if there is one.
    pub fn color(&self) -> Option<&'static str> {
        let can_be_parted = self.mesh.indices.len() <= MOST_PARTED;
        let has = |name: &&str| self.attributes.iter().any(|a| a.name == *name && a.channels >= 3);
        let names = [Some("vertex_color"), can_be_parted.then_some("face_color")];
        names.into_iter().flatten().find(has)
    }

    /// The mesh, with its colours if it has any. `None` as of [`PlyMesh::into_mesh_colored_by`].
    pub fn into_mesh(self) -> Option<TriangleMesh<DVec3>> {
        match self.color() {
            Some(name) => self.into_mesh_colored_by(name),
            None => Some(self.mesh),
        }
    }

    /// The mesh with an attribute as its colours: one number stands for three, a fourth one is left out. Numbers that are
    /// negative or not finite become 0. One of faces gives each triangle vertices of its own. `None` if there is no such
    /// attribute, or if these cannot be numbered with 32 bits.
    pub fn into_mesh_colored_by(self, name: &str) -> Option<TriangleMesh<DVec3>> {
        let attribute = self.attributes.iter().find(|attribute| attribute.name == name)?;
        let usable = |c: f32| if c.is_finite() { c.max(0.0) } else { 0.0 };
        let colors = attribute.values.chunks_exact(attribute.channels).map(|numbers| {
            Rgb::from(match *numbers {
                [grey] => [grey; 3],
                [r, g] => [r, g, 0.0],
                [r, g, b, ..] => [r, g, b],
                [] => [0.0; 3],
            })
            .map(usable)
        });
        if name.starts_with("vertex_") {
            let colors = colors.collect();
            return Some(TriangleMesh { colors, ..self.mesh });
        }
        if self.mesh.indices.len() > MOST_PARTED {
            return None;
        }
        let mut polygons = self.polygons.iter().peekable();
        let mut triangle_colors = Vec::with_capacity(self.mesh.indices.len());
        for color in colors {
            let start = triangle_colors.len() as u32;
            let polygon = polygons.next_if(|polygon| polygon.start == start);
            let triangles = polygon.map_or(1, |polygon| polygon.triangles());
            triangle_colors.extend(std::iter::repeat_n(color, triangles));
        }
        Some(part_faces(self.mesh, &triangle_colors))
    }
}

/// Gives each triangle vertices of its own, of its colour.
fn part_faces(mesh: TriangleMesh<DVec3>, colors: &[Rgb]) -> TriangleMesh<DVec3> {
    fn part<T: Copy>(values: &[T], indices: &[[u32; 3]]) -> Vec<T> {
        let has_any = !values.is_empty();
        let corners = indices.as_flattened().iter().filter(|_| has_any);
        corners.map(|&i| values[i as usize]).collect()
    }
    let indices = &mesh.indices;
    TriangleMesh {
        positions: part(&mesh.positions, indices),
        normals: part(&mesh.normals, indices),
        uvs: part(&mesh.uvs, indices),
        colors: colors.iter().flat_map(|&color| [color; 3]).collect(),
        indices: (0..indices.len() as u32)
            .map(|t| [0, 1, 2].map(|k| 3 * t + k))
            .collect(),
    }
}

#[cfg(test)]
mod tests;
