//! References of others.

use crate::cli::Failure;
use crate::image;
use crate::study::measure::Pixels;
use crate::study::reference::Reference;
use std::path::Path;

/// Reads one: of the right size, and finite everywhere.
pub(super) fn read(path: &Path, [width, height]: [u32; 2]) -> Result<Reference, Failure> {
    let name = path.display();
    let bytes = std::fs::read(path).map_err(|e| Failure::input(format!("{name}: cannot be read: {e}")))?;
    let image = image::read_rgb(path, &bytes).map_err(Failure::input)?;
    if (image.width, image.height) != (width, height) {
        return Err(Failure::input(format!(
            "{name}: the reference has {} x {} pixels, the images of the study {width} x {height}; \
             give --resolution {0}x{1}, or another reference",
            image.width, image.height
        )));
    }
    let mut bad = image.pixels.iter().enumerate().filter(|(_, p)| !p.is_finite());
    if let Some((first, _)) = bad.next() {
        let count = 1 + bad.count();
        return Err(Failure::input(format!(
            "{name}: {count} pixels of the reference are NaN or infinite, the first in column {}, row {}; \
             errors against it have no meaning: render it again",
            first as u32 % width,
            first as u32 / width
        )));
    }
    Ok(Reference::new(Pixels::of_image(&image), None))
}
