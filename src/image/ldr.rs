//! Formats of limited range and encoded values: PNG, JPEG and TGA decoding, PNG encoding.

use super::{Image, ImageError, check_length, check_size, guarded};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, Limits};
use std::io::{Cursor, Write};
use std::path::Path;

/// Most memory for a decoder: the largest image of 16 bits and 4 channels, twice.
const MAX_MEMORY: u64 = 1 << 32;

/// An image as its file stores it: encoded (commonly sRGB), not linear. Grey is repeated in each channel.
#[derive(Clone, Debug, PartialEq)]
pub enum LdrImage {
    /// At most 8 bits per channel.
    Bits8 {
        /// The colours.
        rgb: Image<[u8; 3]>,
        /// The opacity, if the file has it; 255 is opaque. Not premultiplied, always linear.
        alpha: Option<Image<u8>>,
    },
    /// 16 bits per channel, scaled to [0, 1].
    Bits16 {
        /// The colours.
        rgb: Image<[f32; 3]>,
        /// The opacity, if the file has it; 1 is opaque. Not premultiplied, always linear.
        alpha: Option<Image<f32>>,
    },
}

/// The formats [`read`] knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LdrFormat {
    /// Portable Network Graphics.
    Png,
    /// JPEG.
    Jpeg,
    /// Truevision TGA.
    Tga,
}

impl LdrFormat {
    /// Tells the format by the content, TGA by the extension of the file name.
    pub fn detect(path: &Path, bytes: &[u8]) -> Option<LdrFormat> {
        if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
            Some(LdrFormat::Png)
        } else if bytes.starts_with(b"\xff\xd8\xff") {
            Some(LdrFormat::Jpeg)
        } else {
            let extension = path.extension()?;
            extension.eq_ignore_ascii_case("tga").then_some(LdrFormat::Tga)
        }
    }

    fn name(self) -> &'static str {
        match self {
            LdrFormat::Png => "PNG",
            LdrFormat::Jpeg => "JPEG",
            LdrFormat::Tga => "TGA",
        }
    }

    /// The most that a byte can stand for.
    fn pixels_per_byte(self) -> u64 {
        match self {
            // DEFLATE makes 1032 bytes of one, and a palette of two colours has 8 pixels a byte.
            LdrFormat::Png => 1032 * 8,
            // A bit for each block of 8 x 8 pixels of the first scan.
            LdrFormat::Jpeg => 8 * 64,
            // Runs of 128 pixels of one byte, and the byte of their length.
            LdrFormat::Tga => 64,
        }
    }

    fn format(self) -> ImageFormat {
        match self {
            LdrFormat::Png => ImageFormat::Png,
            LdrFormat::Jpeg => ImageFormat::Jpeg,
            LdrFormat::Tga => ImageFormat::Tga,
        }
    }
}

/// Decodes an image of the given format. Colour profiles, gamma and orientation marks are not applied. `path` is for
/// messages only.
///
/// # Errors
/// [`ImageError`]: damaged or incomplete content, a size out of range, an unsupported variety of the format.
pub fn read(bytes: &[u8], format: LdrFormat, path: &Path) -> Result<LdrImage, ImageError> {
    guarded(path, format.name(), || decode(bytes, format, path))
}

fn decode(bytes: &[u8], format: LdrFormat, path: &Path) -> Result<LdrImage, ImageError> {
    let damaged = |reason: String| ImageError::Damaged {
        path: path.to_owned(),
        format: format.name(),
        reason,
    };
    let failed = |error: image::ImageError| match error {
        image::ImageError::Unsupported(error) => ImageError::Unsupported {
            path: path.to_owned(),
            found: error.to_string(),
            expected: "grey, palette or RGB pixels of 8 or 16 bits",
        },
        image::ImageError::Limits(_) => ImageError::Unsupported {
            path: path.to_owned(),
            found: format!("a {} image of more than 4 GiB, or a damaged one", format.name()),
            expected: "at most 16384 x 16384 pixels",
        },
        error => damaged(error.to_string()),
    };
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_MEMORY);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format.format());
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(failed)?;
    let (width, height) = decoder.dimensions();
    let size = check_size(path, width.into(), height.into())?;
    check_length(path, format.name(), bytes.len(), size, format.pixels_per_byte())?;
    if format == LdrFormat::Jpeg && !has_jpeg_end(bytes) {
        return Err(damaged("it is cut short".to_owned()));
    }
    let image = DynamicImage::from_decoder(decoder).map_err(failed)?;
    convert(&image).ok_or_else(|| ImageError::Unsupported {
        path: path.to_owned(),
        found: format!("an unusual {} pixel type", format.name()),
        expected: "grey, palette or RGB pixels of 8 or 16 bits",
    })
}

/// True if the scan data is followed by an end mark. The decoder fills up what is missing with grey and says nothing.
fn has_jpeg_end(bytes: &[u8]) -> bool {
    // Segments before the first scan may hold a whole preview with an end mark of its own: skip them by their length.
    let mut at = 2;
    loop {
        match bytes.get(at..at + 4) {
            Some(&[0xff, 0xff, ..]) => at += 1,
            Some(&[0xff, 0xda, ..]) => break,
            Some(&[0xff, _, high, low]) => at += 2 + usize::from(u16::from_be_bytes([high, low])),
            // What else there may be is for the decoder to judge.
            Some(_) => at += 1,
            None => return false,
        }
    }
    bytes[at..].windows(2).any(|pair| pair == [0xff, 0xd9])
}

fn convert(image: &DynamicImage) -> Option<LdrImage> {
    let channels = usize::from(image.color().channel_count());
    let size = (image.width(), image.height());
    if let Some(samples) = image.as_flat_samples_u8() {
        let (rgb, alpha) = split(size, samples.samples, channels, |v| v);
        Some(LdrImage::Bits8 { rgb, alpha })
    } else if let Some(samples) = image.as_flat_samples_u16() {
        let (rgb, alpha) = split(size, samples.samples, channels, |v| f32::from(v) / f32::from(u16::MAX));
        Some(LdrImage::Bits16 { rgb, alpha })
    } else {
        None
    }
}

/// Takes interleaved pixels of 1 to 4 channels (grey, grey and alpha, RGB, RGBA) apart.
fn split<T: Copy, U>(
    (width, height): (u32, u32),
    samples: &[T],
    channels: usize,
    scale: impl Fn(T) -> U,
) -> (Image<[U; 3]>, Option<Image<U>>) {
    let pixels = || samples.chunks_exact(channels);
    let colours = if channels < 3 { [0, 0, 0] } else { [0, 1, 2] };
    let rgb = Image {
        width,
        height,
        pixels: pixels().map(|p| colours.map(|c| scale(p[c]))).collect(),
    };
    let alpha = channels.is_multiple_of(2).then(|| Image {
        width,
        height,
        pixels: pixels().map(|p| scale(p[channels - 1])).collect(),
    });
    (rgb, alpha)
}

/// Encodes an image of encoded (sRGB) values as PNG. `path` is for messages only.
///
/// # Errors
/// [`ImageError::Write`] if the writer fails, [`ImageError::Size`] if the image has no pixels.
pub fn write_png(writer: impl Write, image: &Image<[u8; 3]>, path: &Path) -> Result<(), ImageError> {
    check_size(path, image.width.into(), image.height.into())?;
    PngEncoder::new_with_quality(writer, CompressionType::Default, FilterType::Adaptive)
        .write_image(
            image.pixels.as_flattened(),
            image.width,
            image.height,
            ExtendedColorType::Rgb8,
        )
        .map_err(|error| ImageError::Write {
            path: path.to_owned(),
            source: match error {
                image::ImageError::IoError(source) => source,
                error => std::io::Error::other(error),
            },
        })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{assert_cuts_are_errors, damage};
    use super::*;

    const FORMATS: [(LdrFormat, &str); 3] = [
        (LdrFormat::Png, "dir/pic.png"),
        (LdrFormat::Jpeg, "dir/pic.jpg"),
        (LdrFormat::Tga, "dir/pic.tga"),
    ];

    fn encode(image: &DynamicImage, format: LdrFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format.format()).unwrap();
        bytes.into_inner()
    }

    /// A picture with detail, so that no cut falls into a long run.
    fn picture() -> DynamicImage {
        image::RgbImage::from_fn(37, 29, |x, y| {
            image::Rgb([(x * 7) as u8, (y * 9) as u8, (x * y * 31) as u8])
        })
        .into()
    }

    fn read_png(image: &DynamicImage) -> LdrImage {
        read(&encode(image, LdrFormat::Png), LdrFormat::Png, Path::new("dir/pic.png")).unwrap()
    }

    #[test]
    fn every_format_is_told_by_its_content_and_keeps_its_pixels() {
        for (format, name) in FORMATS {
            let bytes = encode(&picture(), format);
            assert_eq!(LdrFormat::detect(Path::new(name), &bytes), Some(format));
            let other_name = LdrFormat::detect(Path::new("dir/pic.txt"), &bytes);
            assert_eq!(other_name, (format != LdrFormat::Tga).then_some(format));
            let LdrImage::Bits8 { rgb, alpha: None } = read(&bytes, format, Path::new(name)).unwrap() else {
                panic!("{format:?}: wrong kind");
            };
            assert_eq!((rgb.width, rgb.height), (37, 29));
            if format != LdrFormat::Jpeg {
                assert_eq!(rgb.pixels.as_flattened(), picture().as_bytes());
            }
        }
    }

    #[test]
    fn png_round_trips() {
        let image = Image {
            width: 3,
            height: 2,
            pixels: vec![[0, 1, 2], [255, 254, 253], [9, 8, 7], [0; 3], [255; 3], [100, 0, 50]],
        };
        let path = Path::new("dir/pic.png");
        let mut bytes = Vec::new();
        write_png(&mut bytes, &image, path).unwrap();
        let back = read(&bytes, LdrFormat::Png, path).unwrap();
        assert_eq!(
            back,
            LdrImage::Bits8 {
                rgb: image,
                alpha: None
            }
        );
        let empty = write_png(Vec::new(), &Image::filled(0, 5, [0; 3]), path).unwrap_err();
        assert!(
            empty.to_string().starts_with("dir/pic.png: says it has 0 x 5"),
            "{empty}"
        );
    }

    #[test]
    fn a_writer_that_fails_is_reported_with_the_file() {
        let full: &mut [u8] = &mut [0; 20];
        let error = write_png(full, &Image::filled(50, 50, [1, 2, 3]), Path::new("dir/pic.png")).unwrap_err();
        assert!(matches!(error, ImageError::Write { .. }), "{error}");
        assert!(
            error.to_string().starts_with("dir/pic.png: cannot be written"),
            "{error}"
        );
    }

    #[test]
    fn grey_alpha_and_16_bits_are_read() {
        let bits8 = |pixel, alpha: Option<u8>| LdrImage::Bits8 {
            rgb: Image::filled(1, 1, pixel),
            alpha: alpha.map(|a| Image::filled(1, 1, a)),
        };
        let bits16 = |pixel, alpha: Option<f32>| LdrImage::Bits16 {
            rgb: Image::filled(1, 1, pixel),
            alpha: alpha.map(|a| Image::filled(1, 1, a)),
        };
        let half = 32768.0 / 65535.0;
        for (image, expected) in [
            (DynamicImage::ImageLuma8(one([7])), bits8([7; 3], None)),
            (DynamicImage::ImageLumaA8(one([7, 9])), bits8([7; 3], Some(9))),
            (DynamicImage::ImageRgba8(one([1, 2, 3, 4])), bits8([1, 2, 3], Some(4))),
            (DynamicImage::ImageLuma16(one([32768])), bits16([half; 3], None)),
            (
                DynamicImage::ImageLumaA16(one([65535, 32768])),
                bits16([1.0; 3], Some(half)),
            ),
            (
                DynamicImage::ImageRgb16(one([0, 32768, 65535])),
                bits16([0.0, half, 1.0], None),
            ),
            (
                DynamicImage::ImageRgba16(one([0, 0, 65535, 32768])),
                bits16([0.0, 0.0, 1.0], Some(half)),
            ),
        ] {
            assert_eq!(read_png(&image), expected);
        }
    }

    fn one<P: image::Pixel, const N: usize>(samples: [P::Subpixel; N]) -> image::ImageBuffer<P, Vec<P::Subpixel>> {
        image::ImageBuffer::from_pixel(1, 1, *P::from_slice(&samples))
    }

    #[test]
    fn a_palette_with_transparency_is_expanded() {
        // 2 x 1 pixels of a 1-bit palette: opaque red and half-transparent blue.
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        for (kind, data) in [
            (b"IHDR", b"\0\0\0\x02\0\0\0\x01\x01\x03\0\0\0".as_slice()),
            (b"PLTE", b"\xff\0\0\0\0\xff"),
            (b"tRNS", b"\xff\x80"),
            // One stored deflate block with the filter byte and 0b01000000, and its Adler-32.
            (b"IDAT", b"\x78\x01\x01\x02\0\xfd\xff\x00\x40\x00\x42\x00\x41"),
            (b"IEND", b""),
        ] {
            bytes.extend((data.len() as u32).to_be_bytes());
            let body = [kind.as_slice(), data].concat();
            bytes.extend(&body);
            bytes.extend(crc32(&body).to_be_bytes());
        }
        let image = read(&bytes, LdrFormat::Png, Path::new("dir/pic.png")).unwrap();
        let LdrImage::Bits8 {
            rgb,
            alpha: Some(alpha),
        } = image
        else {
            panic!("{image:?}");
        };
        assert_eq!(rgb.pixels, [[255, 0, 0], [0, 0, 255]]);
        assert_eq!(alpha.pixels, [255, 128]);
    }

    /// The checksum of PNG chunks (ISO 3309), bit by bit.
    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| (c >> 1) ^ (0xedb8_8320 * (c & 1)))
        })
    }

    #[test]
    fn cut_files_are_errors() {
        for (format, name) in FORMATS {
            assert_cuts_are_errors(&encode(&picture(), format), |bytes| {
                read(bytes, format, Path::new(name))
            });
        }
    }

    #[test]
    fn damaged_files_never_panic() {
        for (format, name) in FORMATS {
            let bytes = encode(&picture(), format);
            for seed in 0..1500 {
                let _ = read(&damage(&bytes, seed), format, Path::new(name));
            }
        }
    }

    #[test]
    fn absurd_sizes_are_refused_before_anything_is_allocated() {
        let mut tga = encode(&picture(), LdrFormat::Tga);
        tga[12..16].fill(0xff);
        let error = read(&tga, LdrFormat::Tga, Path::new("dir/pic.tga")).unwrap_err();
        assert!(error.to_string().contains("65535 x 65535"), "{error}");
        let mut png = encode(&picture(), LdrFormat::Png);
        png[16..24].copy_from_slice(b"\x7f\xff\xff\xff\x7f\xff\xff\xff");
        let crc = crc32(&png[12..29]);
        png[29..33].copy_from_slice(&crc.to_be_bytes());
        let error = read(&png, LdrFormat::Png, Path::new("dir/pic.png")).unwrap_err();
        assert!(error.to_string().contains("more than 4 GiB"), "{error}");
    }

    /// Sizes that are allowed, in files that cannot have so many pixels.
    #[test]
    fn sizes_that_the_file_is_too_short_for_are_refused_before_anything_is_allocated() {
        let short = |bytes: &[u8], format, name| {
            let error = read(bytes, format, Path::new(name)).unwrap_err().to_string();
            assert!(error.contains("16384 x 16384 pixels do not fit into"), "{error}");
        };
        let mut tga = encode(&picture(), LdrFormat::Tga);
        tga[12..16].copy_from_slice(&[0, 0x40, 0, 0x40]);
        short(&tga, LdrFormat::Tga, "dir/pic.tga");
        let mut png = encode(&picture(), LdrFormat::Png);
        png[16..24].copy_from_slice(&[0, 0, 0x40, 0, 0, 0, 0x40, 0]);
        let crc = crc32(&png[12..29]);
        png[29..33].copy_from_slice(&crc.to_be_bytes());
        short(&png, LdrFormat::Png, "dir/pic.png");
        let mut jpeg = encode(&picture(), LdrFormat::Jpeg);
        // The frame header: marker, length, precision, height, width.
        let frame = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
        jpeg[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
        short(&jpeg, LdrFormat::Jpeg, "dir/pic.jpg");
    }

    /// What compresses best: one colour, which `pixels_per_byte` must let pass.
    #[test]
    fn large_pictures_of_one_colour_are_read() {
        for (format, name) in FORMATS {
            let bytes = encode(&image::GrayImage::new(2048, 1024).into(), format);
            assert!(read(&bytes, format, Path::new(name)).is_ok(), "{name}");
        }
    }
}
