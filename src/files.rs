//! Files that are written whole or not at all: under a temporary name beside the target, renamed when they are whole.

use std::io;
use std::path::Path;
use tempfile::NamedTempFile;

/// The folder that a path is in.
pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    }
}

/// A file beside `path`, which is gone at the end unless it is renamed.
pub(crate) fn temporary(path: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".embrace-");
    #[cfg(unix)]
    {
        // What any program would give a new file, less the umask; temporary files are private by default.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder_of(path))
}
