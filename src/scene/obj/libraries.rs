//! The material libraries that a file names.

use super::mtl::{self, MtlMaterial};
use std::collections::HashSet;
use std::io;
use std::path::Path;

/// Reads libraries as a file names them.
pub(super) struct Libraries<'p, L> {
    path: &'p Path,
    load_mtl: L,
    tried: HashSet<String>,
    pub(super) materials: Vec<MtlMaterial>,
    pub(super) warnings: Vec<String>,
}

impl<'p, L: FnMut(&str) -> io::Result<Vec<u8>>> Libraries<'p, L> {
    pub(super) fn new(path: &'p Path, load_mtl: L) -> Self {
        Libraries {
            path,
            load_mtl,
            tried: HashSet::new(),
            materials: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Reads what `mtllib` names in a line.
    pub(super) fn add(&mut self, line: u64, names: &str) {
        let names = names.replace('\\', "/");
        let names = names.trim_matches('"');
        if names.is_empty() {
            self.warn(line, "`mtllib` names no file");
            return;
        }
        // A name with spaces and several names look alike: as one name first.
        let Err(error) = self.load(names) else {
            return;
        };
        let words: Vec<&str> = names.split_ascii_whitespace().collect();
        let mut failures = Vec::new();
        if words.len() > 1 {
            failures.extend(words.iter().filter_map(|w| Some((*w, self.load(w).err()?))));
        }
        if failures.len() == words.len() || words.len() == 1 {
            failures = vec![(names, error)];
        }
        for (name, error) in failures {
            self.warn(line, &format!("material library `{name}` cannot be read: {error}"));
        }
    }

    /// Adds the materials of a library unless it has been tried before.
    fn load(&mut self, name: &str) -> io::Result<()> {
        // Also after a failure, which one warning is enough for.
        if !self.tried.insert(name.to_owned()) {
            return Ok(());
        }
        let bytes = (self.load_mtl)(name)?;
        self.materials.extend(mtl::read(name, &bytes, &mut self.warnings));
        Ok(())
    }

    fn warn(&mut self, line: u64, what: &str) {
        self.warnings.push(format!("{}:{line}: {what}", self.path.display()));
    }
}
