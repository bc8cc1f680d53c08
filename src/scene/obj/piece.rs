//! A piece of OBJ text, read by one thread.

use super::ObjError;
use super::lines::{Statements, TooLong};
use crate::math::{DVec3, Rgb, Vec2, Vec3, srgb_decode};
use crate::mesh::{Cut, Polygon};
use crate::scene::number::{decimal, whole};
use std::path::Path;

/// Stands for a texture coordinate or normal that a corner does not have.
const NONE: u32 = u32::MAX;

/// Lines, and positions, texture coordinates and normals.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub(super) lines: u64,
    pub(super) vertices: [usize; 3],
}

impl Counts {
    pub(super) fn plus(self, other: Counts) -> Counts {
        Counts {
            lines: self.lines + other.lines,
            vertices: [0, 1, 2].map(|kind| self.vertices[kind] + other.vertices[kind]),
        }
    }

    /// What a piece has, of which `lines_before` come before in its file.
    pub(super) fn of(text: &[u8], lines_before: u64) -> Counts {
        let mut vertices = [0; 3];
        let mut statements = Statements::new(text, lines_before + 1);
        // What is too long is an error when the piece is read.
        while let Some(Ok(_)) = statements.advance() {
            match split_keyword(statements.content()).0 {
                b"v" => vertices[0] += 1,
                b"vt" => vertices[1] += 1,
                b"vn" => vertices[2] += 1,
                _ => {}
            }
        }
        Counts {
            lines: statements.next_line() - 1 - lines_before,
            vertices,
        }
    }
}

/// Things that are read over, counted for one warning each.
#[derive(Default)]
pub(super) struct Ignored {
    pub(super) points: u64,
    pub(super) lines: u64,
    pub(super) curves: u64,
    /// Faces of which only some corners have normals or texture coordinates.
    pub(super) mixed_faces: u64,
    /// Vertex colours that are not within 0 to 1.
    pub(super) clamped_colors: u64,
    /// Statements of unknown keywords: how many, line and text of the first.
    pub(super) unknown: Option<(u64, u64, String)>,
}

impl Ignored {
    /// Adds what comes later in the file.
    pub(super) fn add(&mut self, later: Ignored) {
        self.points += later.points;
        self.lines += later.lines;
        self.curves += later.curves;
        self.mixed_faces += later.mixed_faces;
        self.clamped_colors += later.clamped_colors;
        self.unknown = match (self.unknown.take(), later.unknown) {
            (Some((count, line, text)), Some((more, ..))) => Some((count + more, line, text)),
            (first, second) => first.or(second),
        };
    }
}

/// Triangles in a row that have the same material and attributes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Run {
    /// Index into [`Piece::names`]; `None` goes on with the material of the text before.
    pub(super) name: Option<usize>,
    /// Every corner has texture coordinates.
    pub(super) uvs: bool,
    /// Every corner has a normal.
    pub(super) normals: bool,
    pub(super) triangles: usize,
}

/// What a piece of text says. Indices count from the beginning of the file.
#[derive(Default)]
pub(super) struct Piece {
    pub(super) positions: Vec<DVec3>,
    /// Of the first positions; [`NO_COLOR`] where there is none.
    pub(super) colors: Vec<Rgb>,
    pub(super) uvs: Vec<Vec2>,
    pub(super) normals: Vec<Vec3>,
    pub(super) runs: Vec<Run>,
    /// Positions of the triangles of all runs; texture coordinates and normals of those runs that have them.
    pub(super) corners: [Vec<[u32; 3]>; 3],
    /// Those of the first corners that are more than one triangle.
    polygons: Vec<Polygon>,
    /// What `usemtl` says, each time.
    pub(super) names: Vec<String>,
    /// Line and text of each `mtllib`.
    pub(super) libraries: Vec<(u64, String)>,
    pub(super) ignored: Ignored,
}

/// Stands for the colour of a vertex that has none.
pub(super) const NO_COLOR: Rgb = Rgb::splat(-1.0);

impl Piece {
    /// Cuts polygons that their fans do not cover. `positions` are all up to the end of the piece.
    pub(super) fn cut_polygons(&mut self, positions: &[DVec3]) {
        let cuts = Cut::all(positions, &self.corners[0], &std::mem::take(&mut self.polygons));
        let mut cuts = cuts.iter().peekable();
        // Where the run begins among the triangles of each kind.
        let mut start = [0; 3];
        for run in &self.runs {
            let end = start[0] + run.triangles;
            while let Some(cut) = cuts.next_if(|cut| cut.start() < end) {
                for (kind, has) in [true, run.uvs, run.normals].into_iter().enumerate() {
                    if has {
                        cut.apply(&mut self.corners[kind], cut.start() - start[0] + start[kind]);
                    }
                }
            }
            for (start, has) in start.iter_mut().zip([true, run.uvs, run.normals]) {
                *start += if has { run.triangles } else { 0 };
            }
        }
    }
}

/// Reads a piece that comes after `before`. Positions, texture coordinates and normals are 2^32 - 1 at most.
pub(super) fn read(path: &Path, text: &[u8], before: Counts) -> Result<Piece, ObjError> {
    let mut reader = Reader {
        piece: Piece::default(),
        defined: before.vertices,
        face: Vec::new(),
        line: 0,
    };
    let is_text = std::str::from_utf8(text).is_ok();
    let mut statements = Statements::new(text, before.lines + 1);
    loop {
        let failure = match statements.advance() {
            None => return Ok(reader.piece),
            Some(Err(TooLong)) => Failure::Expected("a line of at most 16 MiB; is this an OBJ file?"),
            Some(Ok(line)) => {
                reader.line = line;
                match reader.statement(statements.content(), is_text) {
                    Ok(()) => continue,
                    Err(failure) => failure,
                }
            }
        };
        let (path, line) = (path.to_owned(), statements.line());
        return Err(match failure {
            Failure::Expected(expected) => ObjError::Statement {
                path,
                line,
                statement: excerpt(&String::from_utf8_lossy(statements.text())),
                expected,
            },
            Failure::Index { kind, index, defined } => ObjError::Index {
                path,
                line,
                kind,
                index,
                defined,
            },
        });
    }
}

enum Failure {
    /// The statement is not what the text says.
    Expected(&'static str),
    /// The face refers to something that is not defined before it.
    Index {
        kind: &'static str,
        index: i64,
        defined: usize,
    },
}

/// The beginning of a statement, fit for a message.
fn excerpt(text: &str) -> String {
    let mut shown: String = text.trim().chars().filter(|c| !c.is_control()).take(60).collect();
    if text.trim().chars().nth(60).is_some() {
        shown.push('…');
    }
    shown
}

#[inline]
fn split_keyword(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
    text.split_at(end)
}

/// The words before a comment. Only a word of its own is one: `-1.#IND` is how some programs spell NaN.
#[inline]
fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty())
        .take_while(|word| word[0] != b'#')
}

struct Reader {
    piece: Piece,
    /// Numbers of positions, texture coordinates and normals up to the statement.
    defined: [usize; 3],
    /// The corners of a face: position, texture coordinate, normal.
    face: Vec<[u32; 3]>,
    line: u64,
}

impl Reader {
    fn statement(&mut self, text: &[u8], is_text: bool) -> Result<(), Failure> {
        if text.first().is_none_or(|&b| b == b'#') {
            return Ok(());
        }
        if !is_text && std::str::from_utf8(text).is_err() {
            return Err(Failure::Expected("UTF-8 text"));
        }
        let (keyword, rest) = split_keyword(text);
        let name = || String::from_utf8_lossy(rest.trim_ascii()).into_owned();
        let ignored = &mut self.piece.ignored;
        match keyword {
            b"v" => return self.position(rest),
            b"f" => return self.face(rest),
            b"vt" => return self.texture_coordinates(rest),
            b"vn" => return self.normal(rest),
            b"l" => ignored.lines += 1,
            b"p" => ignored.points += 1,
            b"curv" | b"curv2" | b"surf" => ignored.curves += 1,
            b"usemtl" => {
                let name = name();
                if name.is_empty() {
                    return Err(Failure::Expected("`usemtl` with the name of a material"));
                }
                self.piece.names.push(name);
            }
            b"mtllib" => self.piece.libraries.push((self.line, name())),
            // Groups, smoothing, free-form curve data and hints for display.
            b"o" | b"g" | b"s" | b"mg" | b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"parm" | b"trim"
            | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"bevel" | b"c_interp" | b"d_interp" | b"lod"
            | b"usemap" | b"maplib" | b"shadow_obj" | b"trace_obj" | b"ctech" | b"stech" => {}
            _ => {
                let first = || (0, self.line, excerpt(&String::from_utf8_lossy(text)));
                ignored.unknown.get_or_insert_with(first).0 += 1;
            }
        }
        Ok(())
    }

    fn position(&mut self, text: &[u8]) -> Result<(), Failure> {
        const EXPECTED: Failure =
            Failure::Expected("`v x y z` with finite numbers, and optionally a weight other than 0 or a colour");
        let mut values = [0.0; 7];
        let mut count = 0;
        for word in words(text) {
            *values.get_mut(count).ok_or(EXPECTED)? = decimal(word).ok_or(EXPECTED)?;
            count += 1;
        }
        let [x, y, z, weight, ..] = values;
        let mut position = DVec3::new(x, y, z);
        let is_finite = match count {
            3 => position.as_vec3().is_finite(),
            6 | 7 => {
                // With seven, a weight comes before the colour.
                self.color([0, 1, 2].map(|c| values[count - 3 + c]));
                position.as_vec3().is_finite()
            }
            4 => {
                let (p, w) = (position.as_vec3(), weight as f32);
                position /= weight;
                (p / w).is_finite() && w.is_finite()
            }
            _ => false,
        };
        if !is_finite {
            return Err(EXPECTED);
        }
        self.piece.positions.push(position);
        self.defined[0] += 1;
        Ok(())
    }

    /// Adds the colour of the next position. Exporters and importers agree on sRGB.
    fn color(&mut self, color: [f64; 3]) {
        let piece = &mut self.piece;
        piece.colors.resize(piece.positions.len(), NO_COLOR);
        // Also NaN becomes 0.
        let decode = |c: f64| srgb_decode(if c > 0.0 { c.min(1.0) as f32 } else { 0.0 });
        piece.ignored.clamped_colors += u64::from(!color.iter().all(|c| (0.0..=1.0).contains(c)));
        piece.colors.push(Rgb::from(color.map(decode)));
    }

    fn texture_coordinates(&mut self, text: &[u8]) -> Result<(), Failure> {
        const EXPECTED: Failure = Failure::Expected("`vt u v` with two numbers");
        let mut values = words(text).map(|word| decimal(word).ok_or(EXPECTED));
        let u = values.next().ok_or(EXPECTED)??;
        // The second coordinate is optional and 0 by default.
        let v = values.next().unwrap_or(Ok(0.0))?;
        self.piece.uvs.push(Vec2::new(u as f32, v as f32));
        self.defined[1] += 1;
        Ok(())
    }

    fn normal(&mut self, text: &[u8]) -> Result<(), Failure> {
        const EXPECTED: Failure = Failure::Expected("`vn x y z` with three numbers");
        let mut values = words(text).map(|word| decimal(word).ok_or(EXPECTED));
        let mut next = || values.next().ok_or(EXPECTED)?;
        self.piece.normals.push(DVec3::new(next()?, next()?, next()?).as_vec3());
        self.defined[2] += 1;
        Ok(())
    }

    fn face(&mut self, text: &[u8]) -> Result<(), Failure> {
        self.face.clear();
        for word in words(text) {
            let corner = self.corner(word)?;
            self.face.push(corner);
        }
        match self.face.len() {
            0 => return Err(Failure::Expected("the corners of a face")),
            1 => self.piece.ignored.points += 1,
            2 => self.piece.ignored.lines += 1,
            _ => self.polygon(),
        }
        Ok(())
    }

    /// A corner as indices of its position, texture coordinate and normal, from 0.
    #[inline]
    fn corner(&self, word: &[u8]) -> Result<[u32; 3], Failure> {
        const EXPECTED: Failure = Failure::Expected("corners of the form v, v/vt, v//vn or v/vt/vn with whole numbers");
        const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];
        let mut corner = [NONE; 3];
        for (kind, field) in word.split(|&b| b == b'/').enumerate() {
            if kind > 2 || (kind == 0 && field.is_empty()) {
                return Err(EXPECTED);
            }
            if field.is_empty() {
                continue;
            }
            let index = whole(field).ok_or(EXPECTED)?;
            let defined = self.defined[kind];
            if index == 0 || index.unsigned_abs() > defined as u64 {
                return Err(Failure::Index {
                    kind: KINDS[kind],
                    index,
                    defined,
                });
            }
            // Negative indices count back from the statement.
            let from_zero = if index > 0 { index - 1 } else { defined as i64 + index };
            corner[kind] = from_zero as u32;
        }
        Ok(corner)
    }

    /// Adds a face of three corners or more as a fan around the first.
    fn polygon(&mut self) {
        let face = &self.face;
        let has = |kind: usize| face.iter().filter(|corner| corner[kind] != NONE).count();
        let (uvs, normals) = (has(1), has(2));
        let is_mixed = |count: usize| count != 0 && count != face.len();
        self.piece.ignored.mixed_faces += u64::from(is_mixed(uvs) || is_mixed(normals));
        let wanted = [true, uvs == face.len(), normals == face.len()];
        let run = Run {
            name: self.piece.names.len().checked_sub(1),
            uvs: wanted[1],
            normals: wanted[2],
            triangles: 0,
        };
        let triangles = face.len() - 2;
        if triangles > 1 {
            self.piece.polygons.push(Polygon {
                start: self.piece.corners[0].len() as u32,
                corners: face.len() as u32,
            });
        }
        match self.piece.runs.last_mut() {
            Some(last) if Run { triangles: 0, ..*last } == run => last.triangles += triangles,
            _ => self.piece.runs.push(Run { triangles, ..run }),
        }
        for (kind, corners) in self.piece.corners.iter_mut().enumerate() {
            if wanted[kind] {
                corners.extend(
                    face[1..]
                        .windows(2)
                        .map(|pair| [face[0], pair[0], pair[1]].map(|c| c[kind])),
                );
            }
        }
    }
}
