//! OpenEXR reading and writing.

use super::{Image, ImageError, check_size, guarded};
use crate::math::Rgb;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::reader::ChunksReader;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::attribute::{
    self, AttributeValue, ChannelDescription, ChannelList, Chromaticities, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes};
use exr::meta::{BlockDescription, MetaData, magic_number, sequence_end};
use exr::prelude::f16;
use rayon::prelude::*;
use std::collections::HashSet;
use std::io::{Cursor, Write};
use std::path::Path;

const FORMAT: &str = "OpenEXR";

/// Blocks decompressed at a time: enough for every thread, few enough not to hold a second copy of the image.
const BLOCKS_AT_ONCE: usize = 64;

/// More than any renderer writes; bounds the size of a block together with the width.
const MAX_CHANNELS: usize = 1024;

/// Most bytes of an uncompressed block: the largest image of four 32-bit channels in one piece.
const MAX_BLOCK: u64 = 1 << 32;

/// Most bytes that a compressed byte can stand for: DEFLATE reaches 1032, and PXR24 then adds a fourth byte to every three.
/// Runs (64), Huffman codes of runs (454) and B44 (11) stay below.
const MAX_EXPANSION: u64 = 1032 * 4 / 3;

/// The same for DWA, which makes two halves of 64 values, at most, and then compresses these.
const DWA_EXPANSION: u64 = 1032 * 64;

/// ITU-R BT.709 primaries and the D65 white point, CIE 1931 xy.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// True if the content begins like an OpenEXR file.
pub fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&magic_number::BYTES)
}

/// Decodes the first layer that has channels `R`, `G` and `B`, or `Y` alone, which is read as grey. Names may have a
/// prefix (`view.R`). Values are as stored, thus possibly negative, infinite or NaN; other channels are skipped.
///
/// Samples may be of any type, in scan lines or tiles, under any compression of the crate `exr`. The image is the data
/// window; the display window does not matter. `path` is for messages only. Decompression runs on the current thread
/// pool.
///
/// # Errors
/// [`ImageError`]: damaged or incomplete content, a size out of range, no colour channels, deep or subsampled data.
pub fn read(bytes: &[u8], path: &Path) -> Result<Image<Rgb>, ImageError> {
    guarded(path, FORMAT, || decode(bytes, path))
}

fn decode(bytes: &[u8], path: &Path) -> Result<Image<Rgb>, ImageError> {
    let failed = |error| decode_error(path, error);
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    let meta = reader.meta_data().clone();
    let (layer, channels) = colour_layer(&meta.headers).ok_or_else(|| ImageError::Unsupported {
        path: path.to_owned(),
        found: format!("channels {}", channel_names(&meta.headers)),
        expected: "channels R, G and B, or Y alone",
    })?;
    let header = &meta.headers[layer];
    let (width, height) = check_header(path, header)?;
    // Each block has an offset of 8 bytes in the file; more blocks than fit need no list in memory.
    let blocks = meta.headers.iter().map(|h| h.chunk_count as u64).sum::<u64>();
    if blocks > bytes.len() as u64 / 8 {
        return Err(damaged(path, "it is cut short"));
    }
    let mut chunks = reader
        .filter_chunks(false, |_, tile, block| {
            block.layer == layer && tile.is_largest_resolution_level()
        })
        .map_err(failed)?;

    let mut seen = HashSet::new();
    let mut image = Image {
        width,
        height,
        pixels: Vec::new(),
    };
    loop {
        let batch: Vec<Chunk> = chunks
            .by_ref()
            .take(BLOCKS_AT_ONCE)
            .collect::<Result<_, _>>()
            .map_err(failed)?;
        if batch.is_empty() {
            break;
        }
        for chunk in &batch {
            check_block(path, &meta.headers, chunk)?;
        }
        let blocks: Vec<UncompressedBlock> = batch
            .into_par_iter()
            .map(|chunk| UncompressedBlock::decompress_chunk(chunk, &meta, false))
            .collect::<Result<_, _>>()
            .map_err(failed)?;
        // Not earlier, so that a file without a single good block allocates nothing.
        if image.pixels.is_empty() {
            image.pixels = vec![Rgb::BLACK; width as usize * height as usize];
        }
        for block in &blocks {
            let index = block.index;
            if index.layer != layer
                || index.level != Vec2(0, 0)
                || !seen.insert((index.pixel_position.0, index.pixel_position.1))
            {
                return Err(damaged(path, "its table of blocks is wrong"));
            }
            place(block, &header.channels, channels, &mut image)
                .ok_or_else(|| damaged(path, "a block is misplaced"))?;
        }
    }
    // Every block has been placed once, as positions differ and their number is that of the blocks.
    if image.pixels.is_empty() || seen.len() != chunks.expected_chunk_count() {
        return Err(damaged(path, "blocks are missing"));
    }
    Ok(image)
}

/// Copies the wanted channels of a block to the image; `None` if it does not lie inside.
fn place(block: &UncompressedBlock, list: &ChannelList, channels: [usize; 3], image: &mut Image<Rgb>) -> Option<()> {
    let width = image.width as usize;
    for line in block.lines(list) {
        let Vec2(x, y) = line.location.position;
        if x + line.location.sample_count > width {
            return None;
        }
        let start = y * width + x;
        let row = image.pixels.get_mut(start..start + line.location.sample_count)?;
        for (component, _) in channels
            .iter()
            .enumerate()
            .filter(|(_, c)| **c == line.location.channel)
        {
            let set = |(pixel, value): (&mut Rgb, f32)| match component {
                0 => pixel.r = value,
                1 => pixel.g = value,
                _ => pixel.b = value,
            };
            match list.list[line.location.channel].sample_type {
                SampleType::F16 => row
                    .iter_mut()
                    .zip(line.value.as_chunks().0.iter().map(|&b| f16::from_ne_bytes(b).to_f32()))
                    .for_each(set),
                SampleType::F32 => row
                    .iter_mut()
                    .zip(line.value.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)))
                    .for_each(set),
                SampleType::U32 => row
                    .iter_mut()
                    .zip(line.value.as_chunks().0.iter().map(|&b| u32::from_ne_bytes(b) as f32))
                    .for_each(set),
            }
        }
    }
    Some(())
}

/// The first layer with colours, and the indices of its red, green and blue channels.
fn colour_layer(headers: &[Header]) -> Option<(usize, [usize; 3])> {
    headers
        .iter()
        .enumerate()
        .find_map(|(layer, header)| Some((layer, colour_channels(&header.channels)?)))
}

fn colour_channels(channels: &ChannelList) -> Option<[usize; 3]> {
    let names: Vec<&[u8]> = channels.list.iter().map(|c| c.name.as_slice()).collect();
    let find = |prefix: &[u8], name: &[u8]| names.iter().position(|n| n.strip_prefix(prefix) == Some(name));
    let rgb = |prefix: &[u8]| Some([find(prefix, b"R")?, find(prefix, b"G")?, find(prefix, b"B")?]);
    // `Y` beside `RY` and `BY` is a luminance with chroma: read as grey it would lose its colours silently.
    let grey = |prefix: &[u8]| {
        find(prefix, b"Y")
            .filter(|_| find(prefix, b"RY").is_none())
            .map(|y| [y; 3])
    };
    // Channels are sorted by name in the file, so the first prefix is the first by name.
    let prefixes = || {
        names
            .iter()
            .filter_map(|n| Some(&n[..=n.iter().rposition(|&b| b == b'.')?]))
    };
    rgb(b"")
        .or_else(|| grey(b""))
        .or_else(|| prefixes().find_map(rgb))
        .or_else(|| prefixes().find_map(grey))
}

fn channel_names(headers: &[Header]) -> String {
    let names = headers
        .iter()
        .flat_map(|h| &h.channels.list)
        .map(|c| c.name.to_string());
    let shown: Vec<String> = names.take(20).collect();
    shown.join(", ")
}

/// Refuses sizes that would overflow the arithmetic of the decoder or ask for all memory.
fn check_header(path: &Path, header: &Header) -> Result<(u32, u32), ImageError> {
    let size = check_size(path, header.layer_size.0 as u64, header.layer_size.1 as u64)?;
    if header.channels.list.len() > MAX_CHANNELS {
        return Err(damaged(path, "it has too many channels"));
    }
    if let BlockDescription::Tiles(tiles) = header.blocks {
        check_size(path, tiles.tile_size.0 as u64, tiles.tile_size.1 as u64)?;
    }
    Ok(size)
}

/// Refuses blocks that claim to hold more than their bytes can: some decompressors allocate what the header says, and a
/// header of a few hundred bytes may say a terabyte.
fn check_block(path: &Path, headers: &[Header], chunk: &Chunk) -> Result<(), ImageError> {
    let failed = |error| decode_error(path, error);
    let header = headers
        .get(chunk.layer_index)
        .ok_or_else(|| damaged(path, "its table of blocks is wrong"))?;
    let stored = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => block.compressed_pixels_le.len(),
        CompressedBlock::Tile(block) => block.compressed_pixels_le.len(),
        // Deep data is refused by the decoder.
        _ => return Ok(()),
    };
    let indices = header.get_block_data_indices(&chunk.compressed_block).map_err(failed)?;
    let size = header
        .get_absolute_block_pixel_coordinates(indices)
        .map_err(failed)?
        .size;
    let held = size.0 as u64 * size.1 as u64 * header.channels.bytes_per_pixel as u64;
    let expansion = match header.compression {
        Compression::DWAA(_) | Compression::DWAB(_) => DWA_EXPANSION,
        _ => MAX_EXPANSION,
    };
    if held > MAX_BLOCK || held / expansion > stored as u64 {
        return Err(damaged(path, "a block is cut short"));
    }
    Ok(())
}

fn damaged(path: &Path, reason: &str) -> ImageError {
    ImageError::Damaged {
        path: path.to_owned(),
        format: FORMAT,
        reason: reason.to_owned(),
    }
}

fn decode_error(path: &Path, error: exr::error::Error) -> ImageError {
    match error {
        exr::error::Error::NotSupported(what) => ImageError::Unsupported {
            path: path.to_owned(),
            found: what.into_owned(),
            expected: "a flat OpenEXR image without subsampling",
        },
        error => damaged(path, &error.to_string()),
    }
}

/// What is written beside the pixels. Absent values are not written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrMetadata {
    /// Attribute `software`: program and version, as `embrace 0.1.0`.
    pub software: String,
    /// Attribute `scene_hash`.
    pub scene_hash: Option<String>,
    /// Attribute `spp` (int): samples per pixel.
    pub spp: Option<u32>,
    /// Attribute `seed`: as text, since no attribute type holds 64-bit integers.
    pub seed: Option<u64>,
    /// Attribute `backend`: what traced the rays.
    pub backend: Option<String>,
    /// Attribute `seconds` (float, which viewers show better than double): render time. Leave it out where runs are to give the same bytes.
    pub seconds: Option<f64>,
    /// Width and height of the display window, whose corner is (0, 0); absent = the size of the image.
    pub display_size: Option<[u32; 2]>,
    /// Where the image lies in the display window: columns from the left, rows from the top.
    pub offset: [u32; 2],
}

/// Encodes an image: RGB, 32-bit float, ZIP compression in blocks of 16 lines, Rec. 709 chromaticities. The same image
/// and metadata give the same bytes. Compression runs on the current thread pool; the compressed image is held in
/// memory. `path` is for messages only.
///
/// # Errors
/// [`ImageError::Write`] if the writer fails, [`ImageError::Size`] if the image has no pixels or its windows are
/// beyond the range of the format.
pub fn write(
    mut writer: impl Write,
    image: &Image<Rgb>,
    metadata: &ExrMetadata,
    path: &Path,
) -> Result<(), ImageError> {
    check_size(path, image.width.into(), image.height.into())?;
    let write_error = |error| ImageError::Write {
        path: path.to_owned(),
        source: match error {
            exr::error::Error::Io(source) => source,
            error => std::io::Error::other(error.to_string()),
        },
    };
    let header = header(image, metadata).ok_or_else(|| {
        let [width, height] = metadata.display_size.unwrap_or(metadata.offset);
        ImageError::Size {
            path: path.to_owned(),
            width: width.into(),
            height: height.into(),
        }
    })?;
    let headers = std::slice::from_ref(&header);
    let blocks: Vec<Vec<u8>> = (0..header.chunk_count)
        .into_par_iter()
        .map(|block| {
            let mut bytes = Vec::new();
            block_of(image, block)
                .compress_to_chunk(headers)?
                .write(&mut bytes, 1)?;
            Ok(bytes)
        })
        .collect::<exr::error::Result<_>>()
        .map_err(write_error)?;
    let head = encode_head(&header).map_err(write_error)?;

    let mut offset = head.len() as u64 + 8 * blocks.len() as u64;
    let mut table = Vec::with_capacity(8 * blocks.len());
    for block in &blocks {
        table.extend(offset.to_le_bytes());
        offset += block.len() as u64;
    }
    [head, table]
        .iter()
        .chain(&blocks)
        .try_for_each(|bytes| writer.write_all(bytes))
        .and_then(|()| writer.flush())
        .map_err(|source| ImageError::Write {
            path: path.to_owned(),
            source,
        })
}

/// The file up to the table of blocks. Not by the writer of the crate, whose order of custom attributes is that of a
/// hash map and differs from run to run.
fn encode_head(header: &Header) -> exr::error::Result<Vec<u8>> {
    let mut head = Vec::new();
    magic_number::write(&mut head)?;
    MetaData::validate(std::slice::from_ref(header), true)?.write(&mut head)?;
    let mut attributes: Vec<_> = header.all_named_attributes().collect();
    attributes.sort_by_key(|(name, _)| *name);
    for (name, value) in attributes {
        attribute::write(name, &value, &mut head)?;
    }
    sequence_end::write(&mut head)?;
    Ok(head)
}

/// `None` if the windows are beyond the range of the format.
fn header(image: &Image<Rgb>, metadata: &ExrMetadata) -> Option<Header> {
    // The format wants the channels in alphabetical order.
    let channels = ["B", "G", "R"].map(|name| ChannelDescription::named(name, SampleType::F32));
    let size = Vec2(image.width as usize, image.height as usize);
    let mut header = Header::new(Text::from("rgb"), size, channels.into_iter().collect()).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    let [x, y] = metadata.offset;
    let [width, height] = metadata.display_size.unwrap_or([image.width, image.height]);
    header.own_attributes.layer_name = None;
    header.own_attributes.layer_position = Vec2(i32::try_from(x).ok()?, i32::try_from(y).ok()?);
    header.own_attributes.software_name = Some(text(&metadata.software));
    header.shared_attributes = ImageAttributes {
        chromaticities: Some(REC_709),
        ..ImageAttributes::new(IntegerBounds::new(Vec2(0, 0), Vec2(width as usize, height as usize)))
    };
    let as_text = |value: &String| AttributeValue::Text(text(value));
    let custom = [
        ("scene_hash", metadata.scene_hash.as_ref().map(as_text)),
        (
            "spp",
            metadata
                .spp
                .map(|n| AttributeValue::I32(i32::try_from(n).unwrap_or(i32::MAX))),
        ),
        (
            "seed",
            metadata.seed.map(|n| AttributeValue::Text(text(&n.to_string()))),
        ),
        ("backend", metadata.backend.as_ref().map(as_text)),
        ("seconds", metadata.seconds.map(|s| AttributeValue::F32(s as f32))),
    ];
    for (name, value) in custom {
        if let Some(value) = value {
            header.own_attributes.other.insert(Text::from(name), value);
        }
    }
    header.validate(false, &mut false, true).ok().map(|()| header)
}

/// Text of an attribute: characters beyond Latin-1, which it cannot hold, become question marks.
fn text(value: &str) -> Text {
    let latin = value.chars().map(|c| u8::try_from(c).unwrap_or(b'?'));
    Text::from_bytes_unchecked(latin.collect())
}

/// The samples of a block of lines as the format orders them: line by line, channel by channel.
fn block_of(image: &Image<Rgb>, block: usize) -> UncompressedBlock {
    let (width, height) = (image.width as usize, image.height as usize);
    let lines = Compression::ZIP16.scan_lines_per_block();
    let first = block * lines;
    let rows = lines.min(height - first);
    let mut data = Vec::with_capacity(rows * width * size_of::<[f32; 3]>());
    for row in image.pixels[first * width..(first + rows) * width].chunks_exact(width) {
        for channel in [2, 1, 0] {
            data.extend(row.iter().flat_map(|pixel| pixel[channel].to_ne_bytes()));
        }
    }
    UncompressedBlock {
        index: BlockIndex {
            layer: 0,
            pixel_position: Vec2(0, first),
            pixel_size: Vec2(width, rows),
            level: Vec2(0, 0),
        },
        data,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{assert_cuts_are_errors, damage};
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Layer, LayerAttributes, WritableImage};

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
    ) -> Layer<AnyChannels<FlatSamples>> {
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
        Layer::new(
            (width as usize, height as usize),
            attributes,
            encoding,
            AnyChannels::sort(channels.collect()),
        )
    }

    fn encode(layers: impl IntoIterator<Item = Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
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
            ("seed", AttributeValue::Text(Text::from("18446744073709551615"))),
            ("backend", AttributeValue::Text(Text::from("Embree 4.3 ? native"))),
            ("seconds", AttributeValue::F32(1.25)),
        ] {
            assert_eq!(own.other.get(&Text::from(name)), Some(&value), "{name}");
        }
        assert_eq!(own.other.len(), 5);
        assert_eq!(read_picture(&bytes).unwrap(), picture(5, 20));
        // A hash map would order the attributes differently each time.
        for _ in 0..20 {
            assert_eq!(written(&picture(5, 20), &metadata), bytes);
        }
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
