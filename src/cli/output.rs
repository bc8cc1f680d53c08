//! Files written whole or not at all: a temporary name beside the target, then a rename.

use super::{Failure, SOFTWARE};
use crate::files;
use crate::image::exr::{self, ExrMetadata, Layer};
use crate::image::{Image, display, ldr};
use crate::math::Rgb;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Format of an image by the extension of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Exr,
    Png,
}

/// An image file to come.
#[derive(Clone, Debug)]
pub(super) struct Target {
    path: PathBuf,
    format: Format,
}

impl Target {
    /// Checks the extension, and that a file can be made there: nobody wants to learn that after the render.
    pub(super) fn new(path: &Path) -> Result<Target, Failure> {
        let extension = path
            .extension()
            .and_then(|e| e.to_str())
            .unwrap_or("")
            .to_ascii_lowercase();
        let format = match extension.as_str() {
            "exr" => Format::Exr,
            "png" => Format::Png,
            _ => {
                return Err(Failure::usage(format!(
                    "{}: the extension must be .exr or .png",
                    path.display()
                )));
            }
        };
        check_writable(path)?;
        Ok(Target {
            path: path.to_owned(),
            format,
        })
    }

    /// Whether layers can be written beside the image.
    pub(super) fn has_layers(&self) -> bool {
        self.format == Format::Exr
    }

    /// Writes the image; the layers and `metadata` are for EXR, `exposure` in stops for PNG.
    pub(super) fn write(
        &self,
        image: &Image<Rgb>,
        layers: &[Layer],
        metadata: &ExrMetadata,
        exposure: f32,
    ) -> Result<(), Failure> {
        write_atomically(&self.path, |writer| match self.format {
            Format::Exr => exr::write_layers(writer, image, layers, metadata, &self.path),
            Format::Png => ldr::write_png(writer, &display::to_srgb8(image, exposure), &self.path),
        })
    }
}

/// Metadata that every image has.
pub(super) fn metadata() -> ExrMetadata {
    ExrMetadata {
        software: SOFTWARE.into(),
        ..ExrMetadata::default()
    }
}

/// Fails if `path` names a directory or a device, or a file cannot be made beside it.
pub(super) fn check_writable(path: &Path) -> Result<(), Failure> {
    let refuse = |what| {
        let name = path.display();
        Err(Failure::output(format!("{name}: is {what}; give a file name")))
    };
    match fs::metadata(path) {
        Ok(existing) if existing.is_dir() => return refuse("a directory"),
        // The rename would put a file in the place of the device or pipe, for every program on the machine.
        Ok(existing) if !existing.is_file() => return refuse("not a regular file"),
        _ => {}
    }
    temporary(path).map(drop)
}

/// Writes a file by its temporary name and renames it when it is whole.
pub(super) fn write_atomically<E: ToString>(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), E>,
) -> Result<(), Failure> {
    let failure = |e: &dyn std::fmt::Display| {
        Failure::output(format!(
            "{}: cannot be written: {e}; check the free space and the permissions",
            path.display()
        ))
    };
    let mut file = temporary(path)?;
    let mut writer = BufWriter::with_capacity(1 << 20, file.as_file_mut());
    write(&mut writer).map_err(|e| Failure::output(e.to_string()))?;
    writer.flush().map_err(|e| failure(&e))?;
    drop(writer);
    file.as_file().sync_all().map_err(|e| failure(&e))?;
    file.persist(path).map_err(|e| failure(&e.error))?;
    Ok(())
}

fn temporary(path: &Path) -> Result<NamedTempFile, Failure> {
    files::temporary(path).map_err(|e| {
        Failure::output(format!(
            "{}: cannot be written: no file can be made in {} ({e}); make the directory or choose another",
            path.display(),
            files::folder_of(path).display()
        ))
    })
}
