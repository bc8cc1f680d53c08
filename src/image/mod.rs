//! Images in memory, their codecs and their comparison. The only pixel file I/O of the crate.

pub mod compare;
pub mod display;
pub mod exr;
pub mod flip;
pub mod hdr;
pub mod ldr;

use crate::math::Rgb;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A row-major image; row 0 is the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels.
    pub pixels: Vec<T>,
}

impl<T: Clone> Image<T> {
    /// An image of one value.
    pub fn filled(width: u32, height: u32, value: T) -> Image<T> {
        Image {
            width,
            height,
            pixels: vec![value; width as usize * height as usize],
        }
    }
}

impl<T> Image<T> {
    /// The pixel in column `x`, row `y`.
    pub fn at(&self, x: u32, y: u32) -> &T {
        &self.pixels[y as usize * self.width as usize + x as usize]
    }
}

/// Most pixels per side of an image that is read.
pub const MAX_SIDE: u32 = 1 << 16;

/// Most pixels of an image that is read: 16384 x 16384, so that an environment map of 16384 x 8192 fits with room to
/// spare, and a damaged header cannot ask for all memory.
pub const MAX_PIXELS: u64 = 1 << 28;

/// Why an image file cannot be read or written.
#[derive(Debug, Error)]
pub enum ImageError {
    /// The content contradicts its format.
    #[error("{}: not a whole {format} image ({reason}); copy or export the file again", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The format expected from the content.
        format: &'static str,
        /// What the decoder says.
        reason: String,
    },
    /// The file is of another kind than is wanted, or uses a feature that is not supported.
    #[error("{}: {found}; expected {expected}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What the file is.
        found: String,
        /// What can be read in its place.
        expected: &'static str,
    },
    /// The size is zero or too large.
    #[error(
        "{}: says it has {width} x {height} pixels, expected 1 to {MAX_SIDE} per side and at most {MAX_PIXELS} in all; \
         scale the image down, or export it again if the size is wrong",
        path.display()
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Columns according to the header.
        width: u64,
        /// Rows according to the header.
        height: u64,
    },
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}; check the free space and the permissions", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
}

/// An image of any supported format.
#[derive(Clone, Debug, PartialEq)]
pub enum Decoded {
    /// Linear values of unlimited range, from OpenEXR or Radiance HDR.
    Linear(Image<Rgb>),
    /// Encoded values, from PNG, JPEG or TGA.
    Encoded(ldr::LdrImage),
}

/// Decodes an image. The format is told by the content; TGA, which has no mark, by the extension of `path`.
///
/// # Errors
/// [`ImageError`], also on damaged content.
pub fn read(path: &Path, bytes: &[u8]) -> Result<Decoded, ImageError> {
    if exr::is_exr(bytes) {
        exr::read(bytes, path).map(Decoded::Linear)
    } else if hdr::is_hdr(bytes) {
        hdr::read(bytes, path).map(Decoded::Linear)
    } else if let Some(format) = ldr::LdrFormat::detect(path, bytes) {
        ldr::read(bytes, format, path).map(Decoded::Encoded)
    } else {
        Err(ImageError::Unsupported {
            path: path.to_owned(),
            found: "no known image format".to_owned(),
            expected: "an OpenEXR, Radiance HDR, PNG, JPEG or TGA file",
        })
    }
}

/// Decodes an image of linear radiance or reflectance: OpenEXR or Radiance HDR.
///
/// # Errors
/// [`ImageError`], also if the image is of an 8-bit or 16-bit format.
pub fn read_rgb(path: &Path, bytes: &[u8]) -> Result<Image<Rgb>, ImageError> {
    if exr::is_exr(bytes) {
        exr::read(bytes, path)
    } else if hdr::is_hdr(bytes) {
        hdr::read(bytes, path)
    } else {
        Err(ImageError::Unsupported {
            path: path.to_owned(),
            found: "not an image of unlimited range".to_owned(),
            expected: "an OpenEXR or Radiance HDR file",
        })
    }
}

/// Refuses sizes that are zero or too large, before anything is allocated for them.
fn check_size(path: &Path, width: u64, height: u64) -> Result<(u32, u32), ImageError> {
    let side = 1..=u64::from(MAX_SIDE);
    if side.contains(&width) && side.contains(&height) && width * height <= MAX_PIXELS {
        // Both fit because of the limit.
        Ok((width as u32, height as u32))
    } else {
        Err(ImageError::Size {
            path: path.to_owned(),
            width,
            height,
        })
    }
}

/// Refuses a file that says it has more pixels than its bytes can hold: the decoders allocate for all of them before they
/// read any. `most` is the largest number of pixels that a byte stands for in the format.
fn check_length(
    path: &Path,
    format: &'static str,
    bytes: usize,
    size: (u32, u32),
    most: u64,
) -> Result<(), ImageError> {
    if u64::from(size.0) * u64::from(size.1) / most > bytes as u64 {
        return Err(ImageError::Damaged {
            path: path.to_owned(),
            format,
            reason: format!("{} x {} pixels do not fit into {bytes} bytes", size.0, size.1),
        });
    }
    Ok(())
}

/// Runs a decoder that may panic on damaged input: the decoders of the crates `exr` and `image` assert what a damaged
/// file may violate, and overflow in builds with overflow checks.
fn guarded<T>(
    path: &Path,
    format: &'static str,
    decode: impl FnOnce() -> Result<T, ImageError>,
) -> Result<T, ImageError> {
    // Nothing of the decoder survives the panic, so nothing half-changed can be seen.
    catch_unwind(AssertUnwindSafe(decode)).unwrap_or_else(|_| {
        Err(ImageError::Damaged {
            path: path.to_owned(),
            format,
            reason: "the decoder gave up".to_owned(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Changes bytes here and there, differently for each `seed`.
    pub(super) fn damage(bytes: &[u8], seed: u64) -> Vec<u8> {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let mut damaged = bytes.to_vec();
        for _ in 0..1 + seed % 5 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            // Headers are short: half of the changes go there.
            let range = if state >> 63 == 0 {
                damaged.len()
            } else {
                damaged.len().min(400)
            };
            damaged[(state >> 24) as usize % range] = (state >> 16) as u8;
        }
        damaged
    }

    /// Checks that every cut of a file is an error that names it, unless the pixels were whole already.
    pub(super) fn assert_cuts_are_errors<T: PartialEq + std::fmt::Debug>(
        bytes: &[u8],
        read: impl Fn(&[u8]) -> Result<T, ImageError>,
    ) {
        let whole = read(bytes).expect("the whole file is good");
        for cut in (0..bytes.len()).step_by(1 + bytes.len() / 300) {
            match read(&bytes[..cut]) {
                Ok(image) => assert_eq!(image, whole, "cut at {cut} of {}", bytes.len()),
                Err(error) => assert!(error.to_string().starts_with("dir/pic"), "{error}"),
            }
        }
        // A cut in the middle never leaves the pixels whole.
        assert!(read(&bytes[..bytes.len() * 3 / 4]).is_err());
    }

    #[test]
    fn garbage_is_refused_whatever_its_name() {
        for name in [
            "dir/pic.exr",
            "dir/pic.hdr",
            "dir/pic.png",
            "dir/pic.jpg",
            "dir/pic.tga",
            "dir/pic",
        ] {
            for seed in 0..200 {
                let garbage = damage(&vec![seed as u8; 1 + seed as usize], seed * 16 + 4);
                let path = Path::new(name);
                if let Err(error) = read(path, &garbage) {
                    assert!(error.to_string().starts_with(name), "{error}");
                }
                assert!(read_rgb(path, &garbage).is_err());
            }
            assert!(read(Path::new(name), &[]).is_err());
        }
    }

    #[test]
    fn an_encoded_image_is_not_taken_for_a_linear_one() {
        let mut png = Vec::new();
        ldr::write_png(&mut png, &Image::filled(1, 1, [1, 2, 3]), Path::new("dir/pic.png")).unwrap();
        let error = read_rgb(Path::new("dir/pic.exr"), &png).unwrap_err();
        assert!(
            error.to_string().contains("expected an OpenEXR or Radiance HDR"),
            "{error}"
        );
        assert!(matches!(read(Path::new("dir/pic.exr"), &png), Ok(Decoded::Encoded(_))));
    }

    #[test]
    fn the_size_limits_admit_large_environment_maps_and_refuse_absurd_ones() {
        let path = Path::new("dir/pic");
        assert_eq!(check_size(path, 16384, 8192).unwrap(), (16384, 8192));
        for (width, height) in [
            (0, 1),
            (1, 0),
            (1 << 31, 1 << 31),
            (1 << 17, 1),
            (1 << 16, 1 << 13),
            (u64::MAX, 2),
        ] {
            let error = check_size(path, width, height).unwrap_err().to_string();
            assert!(error.contains(&format!("{width} x {height}")), "{error}");
        }
    }
}
