//! Line by line preparation of an OBJ file for `tobj`.
//!
//! `tobj` holds every face of a model as a 104-byte enum until the model ends, ends one at every `o` and `g`, misaligns
//! normals where only some corners have them, draws polylines as polygons, rejects trailing comments, and says what
//! is wrong but not where. This reader hands it one checked statement at a time, of `v`, `vt`, `vn` and `f` only, and
//! starts a new `tobj` model where the material or the set of attributes changes or the model has become long.
//! What is left for `tobj` is number parsing and the single index per vertex; its errors belong to the line last
//! handed out.

use super::{ObjError, mtl};
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::io::{self, BufRead, Read};
use std::path::Path;

/// Corners after which a model ends although nothing changes: bounds the memory of `tobj` to some 200 MB. The price is
/// that the vertices on the seam are stored twice.
const MODEL_CORNERS: usize = 3 << 20;

/// No sensible line is longer; without a limit a file without line ends would be read into memory whole.
const MAX_LINE: u64 = 1 << 24;

/// What distinguishes the parts of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct PartKey {
    /// Index into [`Statements::names`].
    pub(super) material: Option<usize>,
    /// Every corner has texture coordinates.
    pub(super) uvs: bool,
    /// Every corner has a normal.
    pub(super) normals: bool,
}

/// Things that are read over, counted for one warning each.
#[derive(Default)]
pub(super) struct Ignored {
    pub(super) points: u64,
    pub(super) lines: u64,
    pub(super) curves: u64,
    /// Faces of which only some corners have normals or texture coordinates.
    pub(super) mixed_faces: u64,
    /// Statements of unknown keywords: how many, line and text of the first.
    pub(super) unknown: Option<(u64, u64, String)>,
}

/// A reader of checked statements; see the module documentation.
pub(super) struct Statements<'p, R, L> {
    path: &'p Path,
    reader: R,
    load_mtl: L,
    /// Line number of the statement last handed out, from 1, and of the last line read.
    pub(super) line: u64,
    last_line: u64,
    /// The statement as it is in the file.
    raw: Vec<u8>,
    /// The statement for `tobj`, and how much of it has been consumed.
    out: String,
    consumed: usize,
    ended: bool,
    /// Numbers of positions, texture coordinates and normals so far.
    counts: [usize; 3],
    /// Names of the materials in use, in order of appearance.
    pub(super) names: Vec<String>,
    name_index: HashMap<String, usize>,
    material: Option<usize>,
    /// The parts in order of appearance; a `tobj` model is named by an index into this.
    pub(super) parts: Vec<PartKey>,
    part_index: HashMap<PartKey, usize>,
    part: Option<usize>,
    model_corners: usize,
    libraries: HashSet<String>,
    pub(super) materials: Vec<mtl::MtlMaterial>,
    pub(super) warnings: Vec<String>,
    pub(super) ignored: Ignored,
    /// Why reading stopped, if not for `tobj`.
    pub(super) failure: Option<ObjError>,
}

impl<'p, R: BufRead, L: FnMut(&str) -> io::Result<Vec<u8>>> Statements<'p, R, L> {
    pub(super) fn new(path: &'p Path, reader: R, load_mtl: L) -> Self {
        Statements {
            path,
            reader,
            load_mtl,
            line: 0,
            last_line: 0,
            raw: Vec::new(),
            out: String::new(),
            consumed: 0,
            ended: false,
            counts: [0; 3],
            names: Vec::new(),
            name_index: HashMap::new(),
            material: None,
            parts: Vec::new(),
            part_index: HashMap::new(),
            part: None,
            model_corners: 0,
            libraries: HashSet::new(),
            materials: Vec::new(),
            warnings: Vec::new(),
            ignored: Ignored::default(),
            failure: None,
        }
    }

    /// The error for the statement last handed out.
    pub(super) fn statement_error(&self, expected: &'static str) -> ObjError {
        let text = String::from_utf8_lossy(&self.raw);
        ObjError::Statement {
            path: self.path.to_owned(),
            line: self.line,
            statement: excerpt(&text),
            expected,
        }
    }

    /// Reads one statement into `raw`: a line, and those it is continued on.
    fn read_statement(&mut self) -> Result<(), ObjError> {
        self.raw.clear();
        self.line = self.last_line + 1;
        loop {
            let before = self.raw.len() as u64;
            let read = self
                .reader
                .by_ref()
                .take(MAX_LINE + 1 - before)
                .read_until(b'\n', &mut self.raw)
                .map_err(|source| ObjError::Read {
                    path: self.path.to_owned(),
                    source,
                })?;
            if read == 0 {
                self.ended = true;
                return Ok(());
            }
            self.last_line += 1;
            if self.raw.len() as u64 > MAX_LINE {
                self.raw.truncate(64);
                return Err(self.statement_error("a line of at most 16 MiB; is this an OBJ file?"));
            }
            while self.raw.last().is_some_and(|b| b.is_ascii_whitespace()) {
                self.raw.pop();
            }
            if self.raw.last() != Some(&b'\\') || self.raw.first() == Some(&b'#') {
                return Ok(());
            }
            self.raw.pop();
            self.raw.push(b' ');
        }
    }

    /// Fills `out` with what `tobj` has to know of the statement in `raw`.
    fn prepare(&mut self) -> Result<(), ObjError> {
        let raw = std::mem::take(&mut self.raw);
        let result = self.prepare_text(&raw);
        self.raw = raw;
        result.map_err(|failure| match failure {
            Failure::Expected(expected) => self.statement_error(expected),
            Failure::Error(error) => error,
        })
    }

    fn prepare_text(&mut self, raw: &[u8]) -> Result<(), Failure> {
        let raw = if self.line == 1 {
            raw.strip_prefix(b"\xef\xbb\xbf").unwrap_or(raw)
        } else {
            raw
        };
        let raw = raw.trim_ascii_start();
        if raw.first().is_none_or(|&b| b == b'#') {
            return Ok(());
        }
        let text = std::str::from_utf8(raw).map_err(|_| Failure::Expected("UTF-8 text"))?;
        let (keyword, rest) = text.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((text, ""));
        let rest = rest.trim_ascii();
        // Only a word of its own is a comment: `-1.#IND` is how some programs spell NaN.
        let numbers = || match rest.find('#') {
            Some(at) if rest[..at].ends_with(|c: char| c.is_ascii_whitespace()) => &rest[..at],
            _ => rest,
        };
        match keyword {
            "v" => self.position(numbers()),
            "f" => self.face(numbers()),
            "vt" => self.texture_coordinates(numbers()),
            "vn" => {
                self.counts[2] += 1;
                self.hand_out("vn", numbers())
            }
            "l" => self.ignore(|i| &mut i.lines),
            "p" => self.ignore(|i| &mut i.points),
            "curv" | "curv2" | "surf" => self.ignore(|i| &mut i.curves),
            "usemtl" => self.use_material(rest),
            "mtllib" => self.library(rest),
            // Groups, smoothing, free-form curve data and hints for display.
            "o" | "g" | "s" | "mg" | "vp" | "cstype" | "deg" | "bmat" | "step" | "parm" | "trim" | "hole" | "scrv"
            | "sp" | "end" | "con" | "bevel" | "c_interp" | "d_interp" | "lod" | "usemap" | "maplib" | "shadow_obj"
            | "trace_obj" | "ctech" | "stech" => Ok(()),
            _ => {
                let line = self.line;
                let unknown = self.ignored.unknown.get_or_insert_with(|| (0, line, excerpt(text)));
                unknown.0 += 1;
                Ok(())
            }
        }
    }

    fn hand_out(&mut self, keyword: &str, rest: &str) -> Result<(), Failure> {
        self.out.extend([keyword, " ", rest, "\n"]);
        Ok(())
    }

    fn ignore(&mut self, counter: impl FnOnce(&mut Ignored) -> &mut u64) -> Result<(), Failure> {
        *counter(&mut self.ignored) += 1;
        Ok(())
    }

    fn position(&mut self, numbers: &str) -> Result<(), Failure> {
        const EXPECTED: &str = "`v x y z` with finite numbers, and optionally a weight other than 0 or a colour";
        self.counts[0] += 1;
        // Plain decimals of moderate length cannot be infinite or NaN; the others are tried here, where the line is
        // known. A weight divides the position, which is tried likewise.
        let plain = numbers.len() < 100 && numbers.bytes().all(|b| !b.is_ascii_alphabetic());
        let count = numbers.split_ascii_whitespace().count();
        if !plain || count == 4 {
            let values: Option<Vec<f32>> = numbers.split_ascii_whitespace().map(|n| n.parse().ok()).collect();
            let finite = match values.as_deref() {
                Some([xyz @ .., w]) if count == 4 => xyz.iter().all(|v| (v / w).is_finite()) && w.is_finite(),
                Some(values) => values.iter().take(3).all(|v| v.is_finite()),
                None => false,
            };
            if !finite {
                return Err(Failure::Expected(EXPECTED));
            }
        }
        match count {
            3 | 4 => self.hand_out("v", numbers),
            // A colour, which `tobj` accepts only if every vertex has one.
            6 | 7 => {
                self.out.push('v');
                for number in numbers.split_ascii_whitespace().take(3) {
                    self.out.extend([" ", number]);
                }
                self.out.push('\n');
                Ok(())
            }
            _ => Err(Failure::Expected(EXPECTED)),
        }
    }

    fn texture_coordinates(&mut self, numbers: &str) -> Result<(), Failure> {
        self.counts[1] += 1;
        self.hand_out("vt", numbers)?;
        // The second coordinate is optional and 0 by default.
        if numbers.split_ascii_whitespace().nth(1).is_none() {
            self.out.pop();
            self.out.push_str(" 0\n");
        }
        Ok(())
    }

    fn face(&mut self, corners: &str) -> Result<(), Failure> {
        let (mut count, mut with_uv, mut with_normal) = (0, 0, 0);
        for corner in corners.split_ascii_whitespace() {
            let (uv, normal) = self.check_corner(corner)?;
            count += 1;
            with_uv += usize::from(uv);
            with_normal += usize::from(normal);
        }
        match count {
            0 => return Err(Failure::Expected("the corners of a face")),
            1 => return self.ignore(|i| &mut i.points),
            2 => return self.ignore(|i| &mut i.lines),
            _ => {}
        }
        let key = PartKey {
            material: self.material,
            uvs: with_uv == count,
            normals: with_normal == count,
        };
        self.start_model(key, 3 * (count - 2));
        if [with_uv, with_normal].iter().all(|&n| n == 0 || n == count) {
            return self.hand_out("f", corners);
        }
        self.ignored.mixed_faces += 1;
        self.out.push('f');
        for corner in corners.split_ascii_whitespace() {
            let mut fields = corner.split('/');
            let mut field = |wanted: bool| fields.next().filter(|_| wanted).unwrap_or("");
            let (v, vt, vn) = (field(true), field(key.uvs), field(key.normals));
            self.out.extend([" ", v, "/", vt, "/", vn]);
        }
        self.out.push('\n');
        Ok(())
    }

    /// Checks the indices of a corner and says whether it has texture coordinates and a normal.
    fn check_corner(&self, corner: &str) -> Result<(bool, bool), Failure> {
        const EXPECTED: &str = "corners of the form v, v/vt, v//vn or v/vt/vn with whole numbers";
        const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];
        let mut present = [false; 3];
        for (kind, field) in corner.split('/').enumerate() {
            if kind > 2 || (kind == 0 && field.is_empty()) {
                return Err(Failure::Expected(EXPECTED));
            }
            if field.is_empty() {
                continue;
            }
            let index: i64 = field.parse().map_err(|_| Failure::Expected(EXPECTED))?;
            let defined = self.counts[kind];
            if index == 0 || index.unsigned_abs() > defined as u64 {
                return Err(Failure::Error(ObjError::Index {
                    path: self.path.to_owned(),
                    line: self.line,
                    kind: KINDS[kind],
                    index,
                    defined,
                }));
            }
            present[kind] = true;
        }
        Ok((present[1], present[2]))
    }

    /// Tells `tobj` to start a model if one is due before a face of `corners` corners.
    fn start_model(&mut self, key: PartKey, corners: usize) {
        let same = self.part.is_some_and(|p| self.parts[p] == key);
        if !same || self.model_corners + corners > MODEL_CORNERS {
            let part = *self.part_index.entry(key).or_insert_with(|| {
                self.parts.push(key);
                self.parts.len() - 1
            });
            self.part = Some(part);
            self.model_corners = 0;
            // Writing to a string cannot fail.
            let _ = writeln!(self.out, "g {part}");
        }
        self.model_corners += corners;
    }

    fn use_material(&mut self, name: &str) -> Result<(), Failure> {
        if name.is_empty() {
            return Err(Failure::Expected("`usemtl` with the name of a material"));
        }
        self.material = Some(match self.name_index.get(name) {
            Some(&index) => index,
            None => {
                let index = self.names.len();
                self.names.push(name.to_owned());
                self.name_index.insert(name.to_owned(), index);
                index
            }
        });
        Ok(())
    }

    fn library(&mut self, names: &str) -> Result<(), Failure> {
        let names = names.replace('\\', "/");
        let names = names.trim_matches('"');
        if names.is_empty() {
            self.warn("`mtllib` names no file");
            return Ok(());
        }
        // A name with spaces and several names look alike: as one name first.
        let Err(error) = self.load_library(names) else {
            return Ok(());
        };
        let words: Vec<&str> = names.split_ascii_whitespace().collect();
        let mut failures = Vec::new();
        if words.len() > 1 {
            failures.extend(words.iter().filter_map(|w| Some((*w, self.load_library(w).err()?))));
        }
        if failures.len() == words.len() || words.len() == 1 {
            failures = vec![(names, error)];
        }
        for (name, error) in failures {
            self.warn(&format!("material library `{name}` cannot be read: {error}"));
        }
        Ok(())
    }

    /// Adds the materials of a library unless it has been tried before.
    fn load_library(&mut self, name: &str) -> io::Result<()> {
        // Also after a failure, which one warning is enough for.
        if !self.libraries.insert(name.to_owned()) {
            return Ok(());
        }
        let bytes = (self.load_mtl)(name)?;
        self.materials.extend(mtl::read(name, &bytes, &mut self.warnings));
        Ok(())
    }

    fn warn(&mut self, what: &str) {
        self.warnings
            .push(format!("{}:{}: {what}", self.path.display(), self.line));
    }
}

enum Failure {
    /// The statement is not what the text says.
    Expected(&'static str),
    Error(ObjError),
}

/// The beginning of a statement, fit for a message.
fn excerpt(text: &str) -> String {
    let mut shown: String = text.trim().chars().filter(|c| !c.is_control()).take(60).collect();
    if text.trim().chars().nth(60).is_some() {
        shown.push('…');
    }
    shown
}

impl<R: BufRead, L: FnMut(&str) -> io::Result<Vec<u8>>> BufRead for Statements<'_, R, L> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.consumed >= self.out.len() && !self.ended {
            self.out.clear();
            self.consumed = 0;
            if let Err(failure) = self.read_statement().and_then(|()| self.prepare()) {
                self.failure = Some(failure);
                self.ended = true;
                self.out.clear();
                return Err(io::Error::other("the file is damaged"));
            }
        }
        Ok(&self.out.as_bytes()[self.consumed..])
    }

    fn consume(&mut self, amount: usize) {
        self.consumed += amount;
    }
}

impl<R: BufRead, L: FnMut(&str) -> io::Result<Vec<u8>>> Read for Statements<'_, R, L> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(buffer)?;
        self.consume(read);
        Ok(read)
    }
}
