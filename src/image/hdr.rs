//! Radiance HDR (RGBE) decoding.

use super::{Image, ImageError, check_length, check_size, guarded};
use crate::math::Rgb;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use std::io::Cursor;
use std::path::Path;

const FORMAT: &str = "Radiance HDR";

/// A run of 127 in the new encoding takes 2 bytes for each of the 4 components, one of 255 in the old encoding 4 bytes.
/// There, runs of runs could stand for 65536 pixels in 12 bytes, but nothing writes maps of one colour that way.
const PIXELS_PER_BYTE: u64 = 64;

/// True if the content begins like a Radiance HDR file.
pub fn is_hdr(bytes: &[u8]) -> bool {
    bytes.starts_with(b"#?")
}

/// Decodes a Radiance HDR image to linear values, finite and not negative.
///
/// The values are as stored: `EXPOSURE` and `COLORCORR` of the header are not applied, as in most programs. `path` is
/// for messages only.
///
/// # Errors
/// [`ImageError`]: damaged content, a size out of range, XYZ pixels, a row order other than left to right and top to
/// bottom.
pub fn read(bytes: &[u8], path: &Path) -> Result<Image<Rgb>, ImageError> {
    guarded(path, FORMAT, || decode(bytes, path))
}

fn decode(bytes: &[u8], path: &Path) -> Result<Image<Rgb>, ImageError> {
    let damaged = |reason: String| ImageError::Damaged {
        path: path.to_owned(),
        format: FORMAT,
        reason,
    };
    if !is_hdr(bytes) {
        return Err(damaged("it does not begin with `#?`".to_owned()));
    }
    // Not strict, as the strict reader knows `#?RADIANCE` only and not `#?RGBE`.
    let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(|error| match error {
        image::ImageError::Unsupported(error) => ImageError::Unsupported {
            path: path.to_owned(),
            found: error.to_string(),
            expected: "RGB pixels (FORMAT=32-bit_rle_rgbe)",
        },
        error => damaged(error.to_string()),
    })?;
    let (width, height) = decoder.dimensions();
    let size = check_size(path, width.into(), height.into())?;
    check_length(path, FORMAT, bytes.len(), size, PIXELS_PER_BYTE)?;
    let mut samples = vec![0u8; width as usize * height as usize * size_of::<[f32; 3]>()];
    decoder.read_image(&mut samples).map_err(|e| damaged(e.to_string()))?;
    let pixels = samples
        .as_chunks::<12>()
        .0
        .iter()
        .map(|pixel| {
            let [r, g, b] = [0, 1, 2].map(|c| f32::from_ne_bytes([0, 1, 2, 3].map(|byte| pixel[4 * c + byte])));
            Rgb::new(r, g, b)
        })
        .collect();
    Ok(Image { width, height, pixels })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{assert_cuts_are_errors, damage};
    use super::*;

    fn picture(width: u32, height: u32) -> Vec<u8> {
        let pixels: Vec<image::Rgb<f32>> = (0..width * height)
            .map(|i| image::Rgb([i as f32, (i % width / 3) as f32 * 0.25, 1e-3 * (i % 7) as f32]))
            .collect();
        let mut bytes = Vec::new();
        image::codecs::hdr::HdrEncoder::new(&mut bytes)
            .encode(&pixels, width as usize, height as usize)
            .unwrap();
        bytes
    }

    fn read_picture(bytes: &[u8]) -> Result<Image<Rgb>, ImageError> {
        read(bytes, Path::new("dir/pic.hdr"))
    }

    #[test]
    fn pixels_are_read_to_the_precision_of_the_format_with_either_signature() {
        let bytes = picture(40, 8);
        let image = read_picture(&bytes).unwrap();
        assert_eq!((image.width, image.height), (40, 8));
        // The 8-bit mantissas share the exponent of the largest channel.
        let pixel = image.at(10, 2);
        assert!(
            (pixel.r - 90.0).abs() < 0.5 && (pixel.g - 0.75).abs() < 0.5,
            "{pixel:?}"
        );
        assert_eq!(bytes[..10], *b"#?RADIANCE");
        let other = [b"#?RGBE".as_slice(), &bytes[10..]].concat();
        assert_eq!(read_picture(&other).unwrap(), image);
    }

    #[test]
    fn the_old_run_length_encoding_is_read() {
        let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 6\n".to_vec();
        bytes.extend([128, 64, 0, 129, 1, 1, 1, 4, 0, 0, 0, 0]);
        let image = read_picture(&bytes).unwrap();
        assert_eq!(image.pixels[4], Rgb::new(1.0, 0.5, 0.0));
        assert_eq!(image.pixels[5], Rgb::BLACK);
    }

    #[test]
    fn cut_files_are_errors() {
        assert_cuts_are_errors(&picture(40, 8), read_picture);
    }

    #[test]
    fn damaged_files_never_panic() {
        let bytes = picture(40, 8);
        for seed in 0..3000 {
            let _ = read_picture(&damage(&bytes, seed));
        }
        // A chain of empty runs overflows in the decoder.
        let mut bytes = b"#?RADIANCE\n\n-Y 1 +X 6\n".to_vec();
        bytes.extend([128, 64, 0, 129]);
        bytes.extend([1, 1, 1, 0].repeat(20));
        assert!(read_picture(&bytes).is_err());
    }

    #[test]
    fn absurd_sizes_and_xyz_pixels_are_refused() {
        for size in [
            "-Y 2147483648 +X 2147483648",
            "-Y 0 +X 9",
            "-Y 60000 +X 60000",
            "-Y 60000 +X 4000",
        ] {
            let bytes = format!("#?RADIANCE\n\n{size}\n\0\0\0\0").into_bytes();
            assert!(read_picture(&bytes).is_err(), "{size}");
        }
        // Rows of 65536 pixels in 12 bytes: a run of 255, and one of 255 times 256.
        let mut runs = b"#?RADIANCE\n\n-Y 300 +X 65536\n".to_vec();
        runs.extend([128, 64, 0, 129, 1, 1, 1, 255, 1, 1, 1, 255].repeat(300));
        let error = read_picture(&runs).unwrap_err().to_string();
        assert!(error.contains("pixels do not fit into"), "{error}");
        let xyz = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\0\0\0\0";
        assert!(read_picture(xyz).unwrap_err().to_string().contains("xyze"));
    }
}
