//! Writing all files of a scene.

use super::{Export, ExportError, ExportFile, SceneDesc};
use crate::files::temporary;
use crate::image::ImageError;
use rayon::prelude::*;
use std::ffi::OsString;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;
use thiserror::Error;

/// Why a scene is not written.
#[derive(Debug, Error)]
pub enum SaveError {
    /// The description cannot be said in a scene file.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// An image or a mesh cannot be written.
    #[error(transparent)]
    File(#[from] ImageError),
    /// The scene file or the folder beside it cannot be written.
    #[error("{}: cannot be written: {source}; check the folder, the free space and the permissions", path.display())]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// Writes a description as the scene file `path` (TOML) and, in a folder beside it (`scene_files` for `scene.toml`), meshes
/// as PLY and images as PNG and OpenEXR. Loading it gives the description again; see [`Export`]. Files of these names are
/// replaced, others in the folder stay. All are written before the first is renamed to its name, and the scene file is the
/// last one: what fails before that leaves everything as it was.
///
/// # Errors
/// [`SaveError`].
pub fn save(desc: &SceneDesc, path: &Path) -> Result<(), SaveError> {
    let failure = |path: &Path| {
        let path = path.to_owned();
        move |source| SaveError::Write { path, source }
    };
    let mut name = path.file_stem().map(OsString::from).unwrap_or_default();
    name.push("_files");
    let folder = path.with_file_name(&name);
    let Some(name) = name.to_str() else {
        let error = io::Error::new(io::ErrorKind::InvalidInput, "scene files can hold UTF-8 names only");
        return Err(failure(path)(error));
    };
    let export = Export::new(desc, name)?;
    let is_new = !export.files.is_empty() && !folder.is_dir();
    if is_new {
        fs::create_dir(&folder).map_err(failure(&folder))?;
    }
    let result = write_all(&export, &folder, path);
    if result.is_err() && is_new {
        // Fails if something is in it by now, which is then not ours to remove.
        let _ = fs::remove_dir(&folder);
    }
    result
}

fn write_all(export: &Export<'_>, folder: &Path, path: &Path) -> Result<(), SaveError> {
    let failure = |path: &Path, source| SaveError::Write {
        path: path.to_owned(),
        source,
    };
    let scene = write_one(path, |out| {
        out.write_all(export.scene.as_bytes()).map_err(|e| failure(path, e))
    })?;
    let files = export
        .files
        .par_iter()
        .map(|(name, file): &(String, ExportFile<'_>)| {
            let path = folder.join(name);
            let written = write_one(&path, |out| Ok(file.write(out, &path)?))?;
            Ok((written, path))
        })
        .collect::<Result<Vec<_>, SaveError>>()?;
    for (written, path) in files {
        written.persist(&path).map_err(|e| failure(&path, e.error))?;
    }
    scene.persist(path).map_err(|e| failure(path, e.error))
}

/// A whole file under a temporary name.
fn write_one(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut fs::File>) -> Result<(), SaveError>,
) -> Result<TempPath, SaveError> {
    let failure = |source| SaveError::Write {
        path: path.to_owned(),
        source,
    };
    let mut file = temporary(path).map_err(failure)?;
    let mut out = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    write(&mut out)?;
    out.flush().map_err(failure)?;
    drop(out);
    file.as_file().sync_all().map_err(failure)?;
    Ok(file.into_temp_path())
}
