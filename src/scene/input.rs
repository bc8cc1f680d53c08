//! Opening the files that a scene names.

use super::load::LoadError;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Opens a file that a scene names and that has an end: a device or a pipe could be read, or waited for, for ever.
pub(super) fn open(path: &Path) -> io::Result<File> {
    if fs::metadata(path)?.is_file() {
        File::open(path)
    } else {
        Err(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file"))
    }
}

pub(super) fn read_bytes(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, LoadError> {
    read_bytes(path).map_err(|source| LoadError::Read {
        path: path.to_owned(),
        source,
    })
}
