//! OpenEXR reading and writing.

mod read;
mod write;

pub use read::{read, read_layer};
pub use write::{ExrMetadata, Layer, write, write_layers};

use exr::meta::magic_number;

/// True if the content begins like an OpenEXR file.
pub fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&magic_number::BYTES)
}

/// The full name of a channel of a layer.
fn channel_name(layer: &str, channel: &str) -> String {
    format!("{layer}.{channel}")
}

#[cfg(test)]
mod tests {
    use super::super::tests::{assert_cuts_are_errors, damage};
    use super::write::REC_709;
    use super::*;
    use crate::image::{Image, ImageError};
    use crate::math::Rgb;
    use exr::compression::Compression;
    use exr::math::Vec2;
    use exr::meta::MetaData;
    use exr::meta::attribute::{AttributeValue, IntegerBounds, LineOrder, SampleType, Text};
    use exr::meta::header::ImageAttributes;
    use exr::prelude::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, LayerAttributes, WritableImage, f16};
    use std::io::Cursor;
    use std::path::Path;

    fn path() -> &'static Path {
        Path::new("dir/pic.exr")
    }

    fn read_picture(bytes: &[u8]) -> Result<Image<Rgb>, ImageError> {
        read(bytes, path())
    }

    fn written(image: &Image<Rgb>, metadata: &ExrMetadata) -> Vec<u8> {
        let mut bytes = Vec::new();
        write(&mut bytes, image, metadata, path()).unwrap();
        bytes
    }

    /// Values that do not compress away, exact in half precision.
    fn value(x: u32, y: u32, channel: u32) -> f32 {
        ((x * 37 + y * 101 + channel * 53) % 1009) as f32
    }

    fn picture(width: u32, height: u32) -> Image<Rgb> {
        let pixels = (0..width * height)
            .map(|i| Rgb::from([0, 1, 2].map(|c| value(i % width, i / width, c))))
            .collect();
        Image { width, height, pixels }
    }

    /// A layer of `picture`, encoded by the writer of the crate with the given channel names.
    fn layer(
        (width, height): (u32, u32),
        encoding: Encoding,
        samples: SampleType,
        names: &[(&str, u32)],
    ) -> exr::prelude::Layer<AnyChannels<FlatSamples>> {
        let channels = names.iter().map(|&(name, channel)| {
            let values = (0..width * height).map(|i| value(i % width, i / width, channel));
            let samples = match samples {
                SampleType::F16 => FlatSamples::F16(values.map(f16::from_f32).collect()),
                SampleType::F32 => FlatSamples::F32(values.collect()),
                SampleType::U32 => FlatSamples::U32(values.map(|v| v as u32).collect()),
            };
            AnyChannel::new(name, samples)
        });
        let attributes = LayerAttributes::named("layer").with_position(Vec2(-5, 7));
        exr::prelude::Layer::new(
            (width as usize, height as usize),
            attributes,
            encoding,
            AnyChannels::sort(channels.collect()),
        )
    }

    fn encode(layers: impl IntoIterator<Item = exr::prelude::Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        exr::prelude::Image::from_layers(
            ImageAttributes::new(IntegerBounds::from_dimensions((3, 3))),
            layers.into_iter().collect::<Vec<_>>(),
        )
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .unwrap();
        bytes.into_inner()
    }

    const RGB: [(&str, u32); 3] = [("R", 0), ("G", 1), ("B", 2)];

    fn encoding(compression: Compression, blocks: Blocks) -> Encoding {
        Encoding {
            compression,
            blocks,
            line_order: LineOrder::Increasing,
        }
    }

    #[test]
    fn every_value_survives_the_round_trip_exactly() {
        let mut image = picture(37, 41);
        for (pixel, v) in image.pixels.iter_mut().zip([
            f32::MAX,
            f32::MIN_POSITIVE,
            1e-45,
            -0.0,
            f32::INFINITY,
            -3.5e37,
            0.1,
            65505.0,
        ]) {
            *pixel = Rgb::new(v, 1.0, -v);
        }
        let back = read_picture(&written(&image, &ExrMetadata::default())).unwrap();
        assert_eq!((back.width, back.height), (37, 41));
        for (a, b) in image.pixels.iter().zip(&back.pixels) {
            assert_eq!(a.to_array().map(f32::to_bits), b.to_array().map(f32::to_bits));
        }
        // NaN marks a fault, which the file is to show.
        let nan = Image::filled(1, 1, Rgb::splat(f32::NAN));
        assert!(
            read_picture(&written(&nan, &ExrMetadata::default())).unwrap().pixels[0]
                .g
                .is_nan()
        );
    }

    #[test]
    fn metadata_and_windows_are_in_the_header() {
        let metadata = ExrMetadata {
            software: "embrace 0.1.0".to_owned(),
            scene_hash: Some("af13".to_owned()),
            spp: Some(64),
            spp_most: Some(u32::MAX),
            relmse: Some([0.5, 0.25, 1.0]),
            rmse: Some([2.0, 1.0, 4.0]),
            seed: Some(u64::MAX),
            backend: Some("Embree 4.3 – native".to_owned()),
            seconds: Some(1.25),
            display_size: Some([100, 80]),
            offset: [10, 20],
        };
        let bytes = written(&picture(5, 20), &metadata);
        let meta = MetaData::read_from_buffered(bytes.as_slice(), true).unwrap();
        let header = &meta.headers[0];
        let own = &header.own_attributes;
        assert_eq!(own.software_name, Some(Text::from("embrace 0.1.0")));
        assert_eq!(own.layer_position, Vec2(10, 20));
        assert_eq!(header.layer_size, Vec2(5, 20));
        assert_eq!(header.compression, Compression::ZIP16);
        assert_eq!(
            header.shared_attributes.display_window,
            IntegerBounds::from_dimensions((100, 80))
        );
        assert_eq!(header.shared_attributes.chromaticities, Some(REC_709));
        for (name, value) in [
            ("scene_hash", AttributeValue::Text(Text::from("af13"))),
            ("spp", AttributeValue::I32(64)),
            // The most that the attribute can hold.
            ("spp_most", AttributeValue::I32(i32::MAX)),
            ("relmse", AttributeValue::F32(0.5)),
            ("relmse_low", AttributeValue::F32(0.25)),
            ("relmse_high", AttributeValue::F32(1.0)),
            ("rmse", AttributeValue::F32(2.0)),
            ("rmse_low", AttributeValue::F32(1.0)),
            ("rmse_high", AttributeValue::F32(4.0)),
            ("seed", AttributeValue::Text(Text::from("18446744073709551615"))),
            ("backend", AttributeValue::Text(Text::from("Embree 4.3 ? native"))),
            ("seconds", AttributeValue::F32(1.25)),
        ] {
            assert_eq!(own.other.get(&Text::from(name)), Some(&value), "{name}");
        }
        assert_eq!(own.other.len(), 12);
        assert_eq!(read_picture(&bytes).unwrap(), picture(5, 20));
        // A hash map would order the attributes differently each time.
        for _ in 0..20 {
            assert_eq!(written(&picture(5, 20), &metadata), bytes);
        }
    }

    /// Three layers of `picture`, with values that an image would not have.
    fn layers(width: u32, height: u32) -> [Layer; 3] {
        let values = |channels: u32| {
            let pixels = (0..width * height).flat_map(|i| (0..channels).map(move |c| (i, c)));
            pixels
                .map(|(i, c)| -value(i % width, i / width, 7 + c))
                .collect::<Vec<f32>>()
        };
        let mut depth = values(1);
        depth[0] = f32::INFINITY;
        [
            ("normal", &["X", "Y", "Z"] as &[&str], values(3)),
            ("depth", &["Z"], depth),
            ("albedo", &["R", "G", "B"], values(3)),
        ]
        .map(|(name, channels, values)| Layer { name, channels, values })
    }

    fn written_with_layers(width: u32, height: u32) -> Vec<u8> {
        let (mut bytes, metadata) = (Vec::new(), ExrMetadata::default());
        write_layers(
            &mut bytes,
            &picture(width, height),
            &layers(width, height),
            &metadata,
            path(),
        )
        .unwrap();
        bytes
    }

    #[test]
    fn layers_are_read_back_exactly_by_name_and_the_colours_are_those_of_the_image() {
        let (width, height) = (37, 41);
        let bytes = written_with_layers(width, height);
        assert_eq!(read_picture(&bytes).unwrap(), picture(width, height));
        let [normal, depth, albedo] = layers(width, height);
        for (layer, channels) in [(normal, ["X", "Y", "Z"]), (albedo, ["R", "G", "B"])] {
            let read = read_layer(&bytes, path(), layer.name, channels).unwrap();
            assert_eq!((read.width, read.height), (width, height));
            assert_eq!(read.pixels.into_flattened(), layer.values, "{}", layer.name);
        }
        let read = read_layer(&bytes, path(), "depth", ["Z"]).unwrap();
        assert_eq!(read.pixels.into_flattened(), depth.values);
        let swapped = read_layer(&bytes, path(), "normal", ["Z", "X"]).unwrap();
        let [x, _, z] = read_layer(&bytes, path(), "normal", ["X", "Y", "Z"]).unwrap().pixels[5];
        assert_eq!(swapped.pixels[5], [z, x]);
        for (name, channel) in [("albedo", "X"), ("variance", "R"), ("", "R")] {
            let error = read_layer(&bytes, path(), name, [channel]).unwrap_err().to_string();
            assert!(error.contains(&format!("and not {name}.{channel}; ")), "{error}");
        }
    }

    #[test]
    fn the_channels_are_the_colours_alone_unless_there_are_layers() {
        let names = |bytes: &[u8]| -> Vec<String> {
            let meta = MetaData::read_from_buffered(bytes, true).unwrap();
            let channels = meta.headers[0].channels.list.iter();
            channels.map(|c| format!("{} {:?}", c.name, c.sample_type)).collect()
        };
        let bytes = written(&picture(5, 20), &ExrMetadata::default());
        assert_eq!(names(&bytes), ["B F32", "G F32", "R F32"]);
        let all = [
            "B", "G", "R", "albedo.B", "albedo.G", "albedo.R", "depth.Z", "normal.X", "normal.Y", "normal.Z",
        ];
        assert_eq!(
            names(&written_with_layers(5, 20)),
            all.map(|name| format!("{name} F32"))
        );
    }

    #[test]
    fn images_that_the_format_cannot_hold_are_refused() {
        let outside = ExrMetadata {
            offset: [u32::MAX, 0],
            ..ExrMetadata::default()
        };
        for (image, metadata) in [
            (Image::filled(0, 3, Rgb::BLACK), ExrMetadata::default()),
            (Image::filled(2, 3, Rgb::BLACK), outside),
        ] {
            let error = write(Vec::new(), &image, &metadata, path()).unwrap_err();
            assert!(matches!(error, ImageError::Size { .. }), "{error}");
        }
        let full: &mut [u8] = &mut [0; 20];
        let error = write(full, &picture(4, 4), &ExrMetadata::default(), path()).unwrap_err();
        assert!(
            error.to_string().starts_with("dir/pic.exr: cannot be written"),
            "{error}"
        );
    }

    #[test]
    fn every_lossless_encoding_and_sample_type_is_read() {
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
        ] {
            for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 32))] {
                for samples in [SampleType::F16, SampleType::F32, SampleType::U32] {
                    let bytes = encode([layer((45, 50), encoding(compression, blocks), samples, &RGB)]);
                    let image = read_picture(&bytes).unwrap();
                    assert!(image == picture(45, 50), "{compression:?} {blocks:?} {samples:?}");
                }
            }
        }
    }

    #[test]
    fn lossy_encodings_are_read_to_their_precision() {
        for compression in [
            Compression::PXR24,
            Compression::B44,
            Compression::B44A,
            Compression::DWAA(None),
            Compression::DWAB(None),
        ] {
            let bytes = encode([layer(
                (45, 50),
                encoding(compression, Blocks::ScanLines),
                SampleType::F16,
                &RGB,
            )]);
            let image = read_picture(&bytes).unwrap();
            let pairs = || image.pixels.iter().zip(picture(45, 50).pixels);
            let mean = pairs().map(|(a, b)| (a.g - b.g).abs()).sum::<f32>() / image.pixels.len() as f32;
            assert!(mean < 50.0, "{compression:?}: {mean}");
        }
    }

    #[test]
    fn the_first_layer_with_colours_is_found_among_other_channels() {
        let plain = encoding(Compression::ZIP1, Blocks::ScanLines);
        let of = |names: &[(&str, u32)]| layer((6, 5), plain, SampleType::F32, names);
        let grey = Image {
            width: 6,
            height: 5,
            pixels: picture(6, 5).pixels.iter().map(|p| Rgb::splat(p.g)).collect(),
        };
        for (names, expected) in [
            (vec![("A", 3), ("B", 2), ("G", 1), ("R", 0), ("Z", 5)], picture(6, 5)),
            (
                vec![("view.B", 2), ("view.G", 1), ("view.R", 0), ("depth.Z", 9)],
                picture(6, 5),
            ),
            (vec![("a.b.R", 0), ("a.b.G", 1), ("a.b.B", 2), ("R", 7)], picture(6, 5)),
            (vec![("Y", 1), ("A", 5)], grey.clone()),
            (vec![("view.Y", 1)], grey),
        ] {
            assert_eq!(read_picture(&encode([of(&names)])).unwrap(), expected, "{names:?}");
        }
        let two = [of(&[("Z", 4)]), of(&RGB)].map(|mut layer| {
            let name = format!("layer {}", layer.channel_data.list.len());
            layer.attributes.layer_name = Some(Text::from(name.as_str()));
            layer
        });
        assert_eq!(read_picture(&encode(two)).unwrap(), picture(6, 5));
        for names in [vec![("Z", 0), ("A", 1)], vec![("Y", 0), ("RY", 1), ("BY", 2)]] {
            let error = read_picture(&encode([of(&names)])).unwrap_err().to_string();
            assert!(
                error.contains(names[0].0) && error.contains("expected channels R"),
                "{error}"
            );
        }
    }

    #[test]
    fn cut_files_are_errors() {
        assert_cuts_are_errors(&written(&picture(40, 70), &ExrMetadata::default()), read_picture);
        let tiles = encoding(Compression::PIZ, Blocks::Tiles(Vec2(16, 16)));
        assert_cuts_are_errors(&written_with_layers(20, 40), |bytes| {
            read_layer(bytes, path(), "albedo", ["R", "G", "B"])
        });
        assert_cuts_are_errors(&encode([layer((40, 70), tiles, SampleType::F16, &RGB)]), read_picture);
    }

    #[test]
    fn a_block_that_stands_twice_in_the_table_is_noticed() {
        let image = picture(40, 70);
        let mut bytes = written(&image, &ExrMetadata::default());
        let table = (0..bytes.len() - 16)
            .find(|&at| {
                let entry = |i: usize| u64::from_le_bytes(*bytes[at + 8 * i..].first_chunk().unwrap());
                entry(0) == at as u64 + 8 * 5
            })
            .unwrap();
        bytes.copy_within(table..table + 8, table + 8);
        assert!(
            read_picture(&bytes)
                .unwrap_err()
                .to_string()
                .contains("table of blocks")
        );
    }

    #[test]
    fn damaged_files_never_panic() {
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP16,
            Compression::PIZ,
            Compression::PXR24,
            Compression::B44,
            Compression::DWAA(None),
        ] {
            for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 16))] {
                let bytes = encode([layer((20, 40), encoding(compression, blocks), SampleType::F16, &RGB)]);
                for seed in 0..400 {
                    let _ = read_picture(&damage(&bytes, seed));
                }
            }
        }
        let bytes = written_with_layers(20, 40);
        for seed in 0..400 {
            let _ = read_layer(&damage(&bytes, seed), path(), "normal", ["X", "Y", "Z"]);
        }
    }

    #[test]
    fn absurd_sizes_are_refused_before_anything_is_allocated() {
        let bytes = written(&picture(4, 4), &ExrMetadata::default());
        let at = bytes.windows(10).position(|w| w == b"dataWindow").unwrap() + b"dataWindow\0box2i\0".len() + 4;
        for corner in [
            [i32::MAX; 2],
            [1 << 29; 2],
            [99_999, 99_999],
            [65_535, 65_535],
            [8_191, 16_383],
        ] {
            let mut absurd = bytes.clone();
            for (i, c) in corner.iter().enumerate() {
                absurd[at + 8 + 4 * i..][..4].copy_from_slice(&c.to_le_bytes());
            }
            let error = read_picture(&absurd).unwrap_err().to_string();
            assert!(error.starts_with("dir/pic.exr: "), "{error}");
        }
    }
}
