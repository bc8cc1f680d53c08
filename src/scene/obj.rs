//! Wavefront OBJ meshes with the materials of their MTL files.
//!
//! A file is read through a window, which is cut into pieces between two statements, and each piece is read by one thread.
//! It was read by `tobj` before, on one thread, which takes two to four times as long, and needs a reader before it that
//! checks and prepares every statement.

mod libraries;
mod lines;
mod mtl;
mod piece;
mod weld;

pub use mtl::{MapKind, MapRef, MtlMaterial};

use crate::math::{DVec3, Vec2};
use crate::mesh::{MeshError, TriangleMesh};
use libraries::Libraries;
use piece::{Counts, Ignored, Piece};
use rayon::prelude::*;
use std::collections::HashMap;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;
use weld::Content;

/// The content of an OBJ file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjScene {
    /// One part per material and set of attributes, in order of first use; at least one.
    pub parts: Vec<ObjPart>,
    /// The materials of all libraries, whether used or not.
    pub materials: Vec<MtlMaterial>,
    /// What was ignored or mended, one sentence each, naming file, and line or material.
    pub warnings: Vec<String>,
}

/// All faces of one material that have the same attributes (normals, texture coordinates).
#[derive(Clone, Debug, PartialEq)]
pub struct ObjPart {
    /// The name after `usemtl`, also if no library has it; `None` for faces before any `usemtl`.
    pub material_name: Option<String>,
    /// Index into [`ObjScene::materials`]; `None` if no library has the material.
    pub material: Option<usize>,
    /// The triangles; satisfies [`TriangleMesh::validate`]. Normals are unit vectors or zero, texture coordinates finite.
    pub mesh: TriangleMesh<DVec3>,
}

/// Why an OBJ file cannot be used.
#[derive(Debug, Error)]
pub enum ObjError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// A statement is not what the format asks for.
    #[error("{}:{line}: `{statement}`: expected {expected}", path.display())]
    Statement {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: u64,
        /// The beginning of the statement.
        statement: String,
        /// What should stand there.
        expected: &'static str,
    },
    /// A face refers to something that is not defined before it.
    #[error("{}:{line}: the face uses {kind} {index}, but the file has {defined} before this line", path.display())]
    Index {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: u64,
        /// "vertex", "texture coordinate" or "normal".
        kind: &'static str,
        /// The index as written.
        index: i64,
        /// How many are defined before the line.
        defined: usize,
    },
    /// The file has no face.
    #[error("{}: has no faces; export it as polygons", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// Vertices or triangles cannot be numbered with 32 bits.
    #[error("{}: there are more than 2^32 - 1 vertices, or triangles of one material; split the file", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// A part violates an invariant of meshes.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The invariant.
        source: MeshError,
    },
}

/// Reads an OBJ file and its material libraries.
///
/// `path` is for messages only. `load_mtl` is given the file name of each `mtllib` as written, with `/` as separator,
/// and returns the content of that file.
///
/// Faces are grouped by material across `o` and `g`; faces with and without normals or texture coordinates form
/// separate parts, so that none lose what they have. Polygons become triangle fans around their first corner, or what ear
/// clipping makes of them where a fan would leave them. Vertex colours are taken as sRGB. Points, lines and curves are not
/// read. A material library that is missing or odd, and a material that no
/// library has, are warnings.
///
/// # Errors
/// [`ObjError`], with the line where one is to blame. A face may use only vertices defined before it.
pub fn read(
    path: &Path,
    mut reader: impl Read + Send,
    load_mtl: impl FnMut(&str) -> io::Result<Vec<u8>>,
) -> Result<ObjScene, ObjError> {
    let mut libraries = Libraries::new(path, load_mtl);
    let mut content = Content::default();
    let mut before = Counts::default();
    let (mut window, mut next) = (Vec::new(), Vec::new());
    let mut more = fill(&mut reader, &mut window);
    loop {
        let (text, rest) = window.split_at(match (&more, lines::whole_statements(&window)) {
            (Ok(false), _) => window.len(),
            // A statement longer than that is an error, which reading it gives.
            (Ok(true), 0) => lines::whole_lines(&window),
            (_, end) => end,
        });
        next.clear();
        next.extend_from_slice(rest);
        // The rest is read again with what comes next, meanwhile.
        let (pieces, more_after) = rayon::join(
            || read_pieces(path, text, &mut before),
            || {
                if matches!(more, Ok(true)) {
                    fill(&mut reader, &mut next)
                } else {
                    Ok(false)
                }
            },
        );
        let pieces = pieces?;
        for (line, names) in pieces.iter().flat_map(|piece| &piece.libraries) {
            libraries.add(*line, names);
        }
        content.extend(pieces);
        match std::mem::replace(&mut more, more_after) {
            Ok(true) => std::mem::swap(&mut window, &mut next),
            Ok(false) => break,
            Err(source) => {
                let path = path.to_owned();
                return Err(ObjError::Read { path, source });
            }
        }
    }
    drop((window, next));

    let mut warnings = libraries.warnings;
    warn_of_ignored(path, &content.ignored, &mut warnings);
    let materials = libraries.materials;
    let names = std::mem::take(&mut content.names);
    let indices = resolve_materials(path, &names, &materials, &mut warnings);
    let mut parts = Vec::new();
    for (name, mesh) in content.weld() {
        let mesh = mesh.ok_or_else(|| ObjError::TooLarge { path: path.to_owned() })?;
        let material_name = name.map(|name| names[name].clone());
        parts.push(ObjPart {
            mesh: finish_mesh(path, material_name.as_deref(), mesh, &mut warnings)?,
            material: name.and_then(|name| indices[name]),
            material_name,
        });
    }
    if parts.is_empty() {
        return Err(ObjError::Empty { path: path.to_owned() });
    }
    Ok(ObjScene {
        parts,
        materials,
        warnings,
    })
}

/// Bytes of a file that are in memory at a time, twice. More than two statements can have.
const WINDOW: usize = 2 * lines::MAX_LINE + 2;

/// Bytes that one thread reads at a time.
const PIECE: usize = 1 << 18;

/// Adds to `window` until it is full or there is no more, and says whether there may be.
fn fill(reader: &mut impl Read, window: &mut Vec<u8>) -> io::Result<bool> {
    let room = WINDOW - window.len();
    let read = reader.take(room as u64).read_to_end(window)?;
    Ok(read == room)
}

/// Reads whole statements that come after `before`, to which it adds theirs.
fn read_pieces(path: &Path, text: &[u8], before: &mut Counts) -> Result<Vec<Piece>, ObjError> {
    let pieces = lines::pieces(text, PIECE);
    // Faces refer to what comes before them, so that this has to be known first. A piece has a line at least.
    let counts: Vec<Counts> = pieces
        .par_iter()
        .enumerate()
        .map(|(i, text)| Counts::of(text, before.lines + i as u64))
        .collect();
    let jobs: Vec<(&[u8], Counts)> = pieces
        .into_iter()
        .zip(counts)
        .map(|(text, counts)| {
            let start = *before;
            *before = start.plus(counts);
            (text, start)
        })
        .collect();
    if before.vertices.iter().any(|&count| count > u32::MAX as usize) {
        return Err(ObjError::TooLarge { path: path.to_owned() });
    }
    jobs.par_iter()
        .map(|(text, before)| piece::read(path, text, *before))
        .collect::<Vec<_>>()
        .into_iter()
        .collect()
}

fn warn_of_ignored(path: &Path, ignored: &Ignored, warnings: &mut Vec<String>) {
    let file = path.display();
    if ignored.points + ignored.lines + ignored.curves > 0 {
        warnings.push(format!(
            "{file}: {} points, {} lines and {} curves or surfaces are ignored; only polygons are read",
            ignored.points, ignored.lines, ignored.curves
        ));
    }
    if ignored.mixed_faces > 0 {
        warnings.push(format!(
            "{file}: {} faces have normals or texture coordinates at some corners only; these are dropped",
            ignored.mixed_faces
        ));
    }
    if ignored.clamped_colors > 0 {
        warnings.push(format!(
            "{file}: {} vertex colours are not within 0 to 1 and are clamped",
            ignored.clamped_colors
        ));
    }
    if let Some((count, line, statement)) = &ignored.unknown {
        warnings.push(format!(
            "{file}: {count} statements of unknown kind are ignored, the first in line {line}: `{statement}`"
        ));
    }
}

/// The index of each named material. The first of equal name counts, as libraries are searched in order.
fn resolve_materials(
    path: &Path,
    names: &[String],
    materials: &[MtlMaterial],
    warnings: &mut Vec<String>,
) -> Vec<Option<usize>> {
    let mut by_name = HashMap::new();
    for (index, material) in materials.iter().enumerate() {
        if by_name.contains_key(material.name.as_str()) {
            warnings.push(format!(
                "{}: material `{}` is defined more than once; the first definition is used",
                path.display(),
                material.name
            ));
        } else {
            by_name.insert(material.name.as_str(), index);
        }
    }
    names
        .iter()
        .map(|name| {
            let index = by_name.get(name.as_str()).copied();
            if index.is_none() {
                warnings.push(format!(
                    "{}: no material library has material `{name}`; its faces have no material",
                    path.display()
                ));
            }
            index
        })
        .collect()
}

/// Checks a mesh and mends its attributes.
fn finish_mesh(
    path: &Path,
    material: Option<&str>,
    mut mesh: TriangleMesh<DVec3>,
    warnings: &mut Vec<String>,
) -> Result<TriangleMesh<DVec3>, ObjError> {
    mesh.validate().map_err(|source| ObjError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    let part = match material {
        Some(name) => format!("{}, material `{name}`", path.display()),
        None => path.display().to_string(),
    };
    let normals = mesh.repair_normals();
    if normals > 0 {
        warnings.push(format!(
            "{part}: {normals} vertex normals have no direction; face normals are used there"
        ));
    }
    let mut uvs = 0;
    for uv in mesh.uvs.iter_mut().filter(|uv| !uv.is_finite()) {
        *uv = Vec2::ZERO;
        uvs += 1;
    }
    if uvs > 0 {
        warnings.push(format!(
            "{part}: {uvs} texture coordinates are not finite and are set to 0"
        ));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DAffine3, Rgb, Vec3, srgb_decode};

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

    fn read_bytes(bytes: &[u8], library: impl FnMut(&str) -> io::Result<Vec<u8>>) -> Result<ObjScene, ObjError> {
        read(Path::new("dir/mesh.obj"), bytes, library)
    }

    fn missing(_: &str) -> io::Result<Vec<u8>> {
        Err(io::Error::new(io::ErrorKind::NotFound, "no such file"))
    }

    fn read_str(text: &str) -> ObjScene {
        read_bytes(text.as_bytes(), missing).unwrap_or_else(|e| panic!("{text}: {e}"))
    }

    fn error_of(text: &str) -> String {
        match read_bytes(text.as_bytes(), missing) {
            Ok(scene) => panic!("{text}: {scene:?}"),
            Err(error) => error.to_string(),
        }
    }

    fn corners(mesh: &TriangleMesh<DVec3>) -> Vec<[Vec3; 3]> {
        let mesh = mesh.clone().into_f32(&DAffine3::IDENTITY);
        (0..mesh.indices.len()).map(|t| mesh.triangle(t)).collect()
    }

    #[test]
    fn crlf_comments_continuations_and_a_missing_final_newline_change_nothing() {
        let plain = read_str(&format!("{TRIANGLE}f 1 2 3\n"));
        assert_eq!(plain.parts.len(), 1);
        assert_eq!(plain.warnings, [""; 0]);
        assert_eq!(corners(&plain.parts[0].mesh), [[Vec3::ZERO, Vec3::X, Vec3::Y]]);
        for same in [
            "\u{feff}# comment\r\nv 0 0 0\r\nv 1 0 0 # comment\r\n\r\nv\t0  1 0\r\no x\r\ng y z\r\ns off\r\nf 1 2 3 #c\r\n",
            "v 0 0 0\nv 1 0 0\n  v 0 1 0\nf 1 2 3",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 \\\n 2 \\\r\n3\\",
            "v 0 0 0 1\nv 2 0 0 2\nv 0 1 0 1\nf 1 2 3",
            "v 0 0 0\nv 1e0 0 0\nv 0 1 0\nf -3 -2 -1",
        ] {
            assert_eq!(read_str(same), plain, "{same}");
        }
        // A comment may be in any encoding.
        let latin = [b"# caf\xe9\n".as_slice(), TRIANGLE.as_bytes(), b"f 1 2 3"].concat();
        assert_eq!(read_bytes(&latin, missing).unwrap(), plain);
    }

    #[test]
    fn negative_indices_count_back_from_the_line_they_are_on() {
        let scene = read_str(&format!("{TRIANGLE}f -3 -2 -1\nv 0 0 5\nf -4 -3 -1\n"));
        assert_eq!(
            corners(&scene.parts[0].mesh),
            [
                [Vec3::ZERO, Vec3::X, Vec3::Y],
                [Vec3::ZERO, Vec3::X, Vec3::new(0.0, 0.0, 5.0)]
            ]
        );
    }

    #[test]
    fn polygons_become_fans_that_cover_them() {
        let scene = read_str("v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 3 0\nv -1 1 0\nf 1 2 3 4 5\nf 1 2 3 4\n");
        let areas: Vec<f32> = corners(&scene.parts[0].mesh)
            .iter()
            .map(|[a, b, c]| 0.5 * (*b - *a).cross(*c - *a).z)
            .collect();
        assert_eq!(areas, [1.0, 4.0, 2.0, 1.0, 4.0]);
    }

    /// The sums of the areas along z, with and without sign.
    fn areas(mesh: &TriangleMesh<DVec3>) -> (f64, f64) {
        let areas = mesh.indices.iter().map(|corners| {
            let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
            0.5 * (b - a).cross(c - a).z
        });
        (areas.clone().sum(), areas.map(f64::abs).sum())
    }

    /// Of runs with and without attributes, so that the places of their corners differ.
    #[test]
    fn concave_polygons_are_covered_once_and_keep_their_attributes() {
        let arrow = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 0.5 1 0\n";
        let attributes = "vt 0 0\nvt 2 1\nvt 0 2\nvt 0.5 1\nvn 0 0 1\n";
        let faces = "f 1 2 4\nf 1//1 2//1 4//1\nf 1 2 3 4\nf 1/1 2/2 4/4\nf 1/1 2/2 3/3 4/4\nf 1/1/1 2/2/1 3/3/1 4/4/1\n\
                     f 1//1 2//1 3//1 4//1\nf 2 3 4 1\n";
        let scene = read_str(&format!("{arrow}{attributes}{faces}"));
        assert_eq!(scene.warnings, [""; 0]);
        assert_eq!(scene.parts.len(), 4);
        for part in &scene.parts {
            let (sum, total) = areas(&part.mesh);
            assert!((sum - total).abs() < 1e-12 && sum >= 1.5, "{:?}", part.mesh);
            for (uv, position) in part.mesh.uvs.iter().zip(&part.mesh.positions) {
                assert_eq!(uv.as_dvec2(), position.truncate());
            }
        }
        let all: f64 = scene.parts.iter().map(|part| areas(&part.mesh).0).sum();
        assert!((all - (3.0 * 0.75 + 5.0 * 1.5)).abs() < 1e-12, "{all}");
        // The fan of the last face is right already, and stays as it is.
        let last = read_str(&format!("{arrow}f 4 1 2 3\n"));
        assert_eq!(
            corners(&last.parts[0].mesh)[0],
            [Vec3::new(0.5, 1.0, 0.0), Vec3::ZERO, Vec3::new(2.0, 1.0, 0.0)]
        );
    }

    #[test]
    fn vertex_colours_are_srgb_and_white_where_a_vertex_has_none() {
        let scene =
            read_str("v 0 0 0\nv 1 0 0 1 0 0.5\nv 0 1 0 0.25 0 1\nv 1 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 1 4 1\n");
        let half = srgb_decode(0.5);
        let [a, b] = &*scene.parts else {
            panic!("{:?}", scene.parts)
        };
        let expected = [
            Rgb::WHITE,
            Rgb::new(1.0, 0.0, half),
            Rgb::new(srgb_decode(0.25), 0.0, 1.0),
        ];
        assert_eq!(a.mesh.colors, expected);
        assert_eq!(b.mesh.colors, []);
        // The same through the way for files of which every vertex is in use, and with a weight.
        let scene = read_str("v 0 0 0 1 1 1 1\nv 1 0 0 1 0 0.5\nv 0 1 0 0.25 0 1\nf 1 2 3\n");
        assert_eq!(scene.parts[0].mesh.colors, expected);
        let scene = read_str("v 0 0 0 255 0 0\nv 1 0 0 nan 0 0\nv 0 1 0 0 -1 0\nf 1 2 3\n");
        assert_eq!(
            scene.parts[0].mesh.colors,
            [Rgb::new(1.0, 0.0, 0.0), Rgb::BLACK, Rgb::BLACK]
        );
        assert!(
            scene.warnings.len() == 1 && scene.warnings[0].contains("3 vertex colours"),
            "{:?}",
            scene.warnings
        );
    }

    #[test]
    fn faces_of_one_material_form_one_part_across_objects_and_groups() {
        let scene = read_bytes(
            format!(
                "mtllib lib.mtl\n{TRIANGLE}f 1 2 3\nusemtl red\no a\nf 1 2 3\nusemtl blue\nf 3 2 1\ng b\nusemtl red\nf 2 3 1\n"
            )
            .as_bytes(),
            |name| {
                assert_eq!(name, "lib.mtl");
                Ok(b"newmtl blue\nKd 0 0 1\nnewmtl red\nKd 1 0 0\n".to_vec())
            },
        )
        .unwrap();
        assert_eq!(scene.warnings, [""; 0]);
        let summary: Vec<_> = scene
            .parts
            .iter()
            .map(|p| (p.material_name.as_deref(), p.material, p.mesh.indices.len()))
            .collect();
        assert_eq!(
            summary,
            [(None, None, 1), (Some("red"), Some(1), 2), (Some("blue"), Some(0), 1)]
        );
        assert_eq!(corners(&scene.parts[1].mesh)[1], [Vec3::X, Vec3::Y, Vec3::ZERO]);
    }

    #[test]
    fn each_corner_gets_the_normal_and_texture_coordinate_it_names() {
        let scene = read_str(&format!(
            "{TRIANGLE}vt 0.1 0.2\nvt 0.3 0.4 0\nvt 0.5\nvn 0 0 2\nvn 1 0 0\nf 1/1/1 2/2/2 3/3/1\nf 1/2/1 2/2/2 3/3/1\n"
        ));
        let mesh = &scene.parts[0].mesh;
        assert_eq!((mesh.positions.len(), mesh.indices.len()), (4, 2));
        let [a, b, c] = mesh.indices[0].map(|i| (mesh.normals[i as usize], mesh.uvs[i as usize]));
        assert_eq!(a, (Vec3::Z, Vec2::new(0.1, 0.2)));
        assert_eq!(b, (Vec3::X, Vec2::new(0.3, 0.4)));
        assert_eq!(c, (Vec3::Z, Vec2::new(0.5, 0.0)));
        assert_eq!(mesh.uvs[mesh.indices[1][0] as usize], Vec2::new(0.3, 0.4));
        assert_eq!(scene.warnings, [""; 0]);
    }

    /// As they are, if one index serves all; what no triangle has is left out, and other indices are not mixed up.
    #[test]
    fn vertices_are_those_that_triangles_have_with_the_attributes_they_name() {
        let attributes = "vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nvn 0 1 0\nvn 1 0 0\n";
        let (unused, own) = ("v 9 9 9\nvt 0 0\nvn 0 0 1\n", "f 3/3/3 1/1/1 2/2/2\n");
        for (face, more, uv, normal) in [
            (own, "", Vec2::ZERO, Vec3::Z),
            (own, unused, Vec2::ZERO, Vec3::Z),
            ("f 3/3/3 1/2/1 2/1/2\n", "", Vec2::X, Vec3::Z),
            ("f 3/3/3 1/1/2 2/2/1\n", "", Vec2::ZERO, Vec3::Y),
        ] {
            let scene = read_str(&format!("{TRIANGLE}{attributes}{more}{face}"));
            let mesh = &scene.parts[0].mesh;
            assert_eq!((scene.parts.len(), mesh.positions.len()), (1, 3), "{face}{more}");
            assert_eq!(corners(mesh), [[Vec3::Y, Vec3::ZERO, Vec3::X]], "{face}{more}");
            let second = mesh.indices[0][1] as usize;
            assert_eq!((mesh.uvs[second], mesh.normals[second]), (uv, normal), "{face}{more}");
        }
        assert_eq!(
            read_str(&format!("{TRIANGLE}{attributes}{own}")).parts[0].mesh.indices,
            [[2, 0, 1]]
        );
    }

    #[test]
    fn faces_with_and_without_normals_are_kept_apart() {
        let scene = read_str(&format!(
            "{TRIANGLE}vn 0 0 1\nvt 0 0\nf 1//1 2//1 3//1\nf 1 2 3\nf 3//1 2//1 1//1\nf 1/1/1 2//1 3/1/1\nf 1/1 2/1 3\n"
        ));
        let sizes: Vec<_> = scene
            .parts
            .iter()
            .map(|p| (p.mesh.indices.len(), p.mesh.normals.len(), p.mesh.uvs.len()))
            .collect();
        assert_eq!(sizes, [(3, 3, 0), (2, 0, 0)]);
        assert_eq!(scene.parts[1].mesh.positions.len(), 3);
        assert!(
            scene.warnings.len() == 1 && scene.warnings[0].contains("2 faces"),
            "{:?}",
            scene.warnings
        );
    }

    #[test]
    fn attributes_that_are_not_usable_are_mended_and_counted() {
        let scene = read_str(&format!(
            "{TRIANGLE}vn 0 0 0\nvn nan 0 1\nvn 0 0 9\nvt inf 0\nusemtl m\nf 1/1/1 2/1/2 3/1/3\n"
        ));
        let mesh = &scene.parts[0].mesh;
        assert_eq!(mesh.normals, [Vec3::ZERO, Vec3::ZERO, Vec3::Z]);
        assert_eq!(mesh.uvs, [Vec2::ZERO; 3]);
        let warnings = scene.warnings.join("\n");
        assert!(
            warnings.contains("2 vertex normals") && warnings.contains("3 texture"),
            "{warnings}"
        );
    }

    #[test]
    fn points_lines_and_curves_are_counted_in_one_warning() {
        let scene = read_str(&format!(
            "{TRIANGLE}p 1 2\nl 1 2 3\nf 1\nf 1 2\ncurv 0 1 1 2\nf 1 2 3\nbogus 1\nbogus 2\n"
        ));
        assert_eq!(scene.parts[0].mesh.indices.len(), 1);
        assert_eq!(scene.warnings.len(), 2);
        assert!(scene.warnings[0].starts_with("dir/mesh.obj: 2 points, 2 lines and 1 curves"));
        assert!(scene.warnings[1].contains("2 statements") && scene.warnings[1].contains("line 10: `bogus 1`"));
    }

    #[test]
    fn errors_name_the_file_and_the_line() {
        for (statement, expected) in [
            ("f 1 2 4", "uses vertex 4, but the file has 3"),
            ("f 1 2 -4", "uses vertex -4"),
            ("f 0 1 2", "uses vertex 0"),
            ("f 1/1 2/1 3/1", "uses texture coordinate 1, but the file has 0"),
            (
                "f 1//-9223372036854775808 2//1 3//1",
                "uses normal -9223372036854775808",
            ),
            ("f 1//9223372036854775807 2//1 3//1", "uses normal"),
            ("f 1 2 99999999999999999999", "whole numbers"),
            ("f 1 2 x", "whole numbers"),
            ("f 1///1 2 3", "whole numbers"),
            ("f /1 /1 /1", "whole numbers"),
            ("f", "corners"),
            ("v 1 2", "finite numbers"),
            ("v 1 2 nan", "finite numbers"),
            ("v 1 2 1e39", "finite numbers"),
            ("v 1 2 -inf", "finite numbers"),
            ("v 1 2 3 0", "finite numbers"),
            ("v 1 2 3 1e-44", "finite numbers"),
            ("v 1 2 3 4 5", "finite numbers"),
            ("v 1,5 2 3", "finite numbers"),
            ("v 1 2 1.2.3", "finite numbers"),
            ("vn 1 2", "vn x y z"),
            ("vn 1 2 -1.#IND", "vn x y z"),
            ("vt", "vt u v"),
            ("vt a b", "vt u v"),
            ("usemtl", "name of a material"),
        ] {
            let message = error_of(&format!("# one\n{TRIANGLE}{statement}\nf 1 2 3\n"));
            assert!(
                message.starts_with("dir/mesh.obj:5: ") && message.contains(expected),
                "{statement}: {message}"
            );
        }
        let huge = format!("v 1 2 {}\n", "9".repeat(120));
        assert!(error_of(&huge).contains("finite"));
    }

    #[test]
    fn files_without_faces_are_refused() {
        for text in [
            "",
            "\n",
            "# nothing",
            TRIANGLE,
            "o a\ng b\nusemtl c",
            "v 0 0 0\nv 1 0 0\nl 1 2",
        ] {
            let message = error_of(text);
            assert!(message.starts_with("dir/mesh.obj: has no faces"), "{text}: {message}");
        }
    }

    #[test]
    fn bytes_that_are_not_text_are_refused_with_their_line() {
        for bytes in [
            b"v 0 0 0\nusemtl caf\xe9\n".as_slice(),
            b"\n\xff\xfev\0 \x000\0",
            b"v 0 0 0\nv \x80 0 0\n",
        ] {
            let message = read_bytes(bytes, missing).unwrap_err().to_string();
            assert!(
                message.starts_with("dir/mesh.obj:2: ") && message.contains("UTF-8"),
                "{message}"
            );
        }
        let long = vec![b'x'; (1 << 24) + 1];
        assert!(read_bytes(&long, missing).unwrap_err().to_string().contains("16 MiB"));
    }

    #[test]
    fn damaged_text_never_panics() {
        let text =
            "mtllib a.mtl\nv 0 0 0\nv 1 0 0 1\nv 0 1 0\nvt 0 1\nvn 0 0 1\nusemtl m\ng\nf 1/1/1 2/1/1 -1/-1/-1\nl 1 2\n";
        let mtl = "newmtl m\nKd 1 0 0\nmap_Kd -s 1 2 3 -o 1 a.png\nd 1\nTr 0\nNs 3\n";
        let mut state = 1u64;
        for round in 0..20_000 {
            let mut damaged = [text.as_bytes().to_vec(), mtl.as_bytes().to_vec()];
            for bytes in &mut damaged {
                for _ in 0..1 + round % 4 {
                    state = state
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(1_442_695_040_888_963_407);
                    let at = (state >> 33) as usize % bytes.len();
                    match state >> 60 & 3 {
                        0 => bytes.truncate(at.max(1)),
                        1 => bytes[at] = (state >> 20) as u8,
                        2 => bytes.insert(at, b" /-\\\n9e#"[(state >> 20) as usize % 8]),
                        _ => drop(bytes.remove(at)),
                    }
                    if bytes.is_empty() {
                        bytes.push(b'v');
                    }
                }
            }
            if let Ok(scene) = read_bytes(&damaged[0], |_| Ok(damaged[1].clone())) {
                for part in &scene.parts {
                    assert_eq!(part.mesh.validate(), Ok(()));
                }
            }
        }
    }

    #[test]
    fn a_read_error_names_the_file() {
        struct Broken;
        impl Read for Broken {
            fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
                Err(io::Error::other("disk on fire"))
            }
        }
        let message = read(Path::new("a.obj"), Broken, missing).unwrap_err().to_string();
        assert!(
            message.starts_with("a.obj: ") && message.contains("disk on fire"),
            "{message}"
        );
    }

    #[test]
    fn missing_libraries_and_unknown_materials_are_warnings() {
        let scene = read_str(&format!(
            "mtllib none.mtl\nmtllib none.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\nusemtl b\nf 1 2 3"
        ));
        let names: Vec<_> = scene
            .parts
            .iter()
            .map(|p| (p.material_name.as_deref(), p.material))
            .collect();
        assert_eq!(names, [(Some("a"), None), (Some("b"), None)]);
        assert_eq!(scene.warnings.len(), 3, "{:?}", scene.warnings);
        assert!(scene.warnings[0].starts_with("dir/mesh.obj:1: ") && scene.warnings[0].contains("`none.mtl`"));
        assert!(scene.warnings[1].contains("`a`") && scene.warnings[2].contains("`b`"));
    }

    #[test]
    fn library_names_may_have_spaces_backslashes_or_be_several() {
        let available = |name: &str| match name {
            "my lib.mtl" | "sub/lib.mtl" | "a.mtl" => Ok(format!("newmtl {name}\n").into_bytes()),
            _ => missing(name),
        };
        for (statement, materials, warnings) in [
            ("mtllib my lib.mtl", vec!["my lib.mtl"], 0),
            ("mtllib \"my lib.mtl\"", vec!["my lib.mtl"], 0),
            ("mtllib sub\\lib.mtl", vec!["sub/lib.mtl"], 0),
            ("mtllib\ta.mtl sub/lib.mtl", vec!["a.mtl", "sub/lib.mtl"], 0),
            ("mtllib a.mtl gone.mtl", vec!["a.mtl"], 1),
            ("mtllib gone too.mtl", vec![], 1),
            ("mtllib", vec![], 1),
        ] {
            let text = format!("{statement}\r\n{TRIANGLE}f 1 2 3\n");
            let scene = read_bytes(text.as_bytes(), available).unwrap();
            let names: Vec<_> = scene.materials.iter().map(|m| m.library.as_str()).collect();
            assert_eq!(names, materials, "{statement}");
            assert_eq!(scene.warnings.len(), warnings, "{statement}: {:?}", scene.warnings);
        }
    }

    #[test]
    fn the_first_definition_of_a_material_counts() {
        let scene = read_bytes(format!("mtllib a.mtl\n{TRIANGLE}usemtl m\nf 1 2 3").as_bytes(), |_| {
            Ok(b"newmtl m\nKd 1 1 1\nnewmtl m\nKd 0 0 0\n".to_vec())
        })
        .unwrap();
        assert_eq!(scene.parts[0].material, Some(0));
        assert!(scene.warnings.len() == 1 && scene.warnings[0].contains("more than once"));
    }

    #[test]
    fn long_meshes_are_whole_although_they_are_read_in_pieces() {
        let strip = 1_200_000;
        let mut text = String::from("v 0 0 0\nv 0 1 0\n");
        for i in 1..=strip {
            text.push_str(&format!("v {i} 0 0\nf -3 -2 -1\n"));
        }
        let mesh = &read_str(&text).parts[0].mesh;
        assert_eq!(mesh.indices.len(), strip);
        assert_eq!(mesh.positions.len(), strip + 2);
        assert_eq!(corners(mesh)[strip - 1][2], Vec3::new(strip as f32, 0.0, 0.0));
    }
}
