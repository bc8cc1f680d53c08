//! OpenEXR decoding.

use crate::image::{Image, ImageError, check_size, guarded};
use crate::math::Rgb;
use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::reader::ChunksReader;
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelList, SampleType};
use exr::meta::header::Header;
use exr::prelude::f16;
use rayon::prelude::*;
use std::collections::HashSet;
use std::io::Cursor;
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

/// Decodes the colours of the first part that has channels `R`, `G` and `B`, or `Y` alone, which is read as grey. If there
/// are none of just these names, those with a prefix serve (`view.R`). Values are as stored, thus possibly negative, infinite
/// or NaN; other channels are skipped.
///
/// Samples may be of any type, in scan lines or tiles, under any compression of the crate `exr`. The image is the data
/// window; the display window does not matter. `path` is for messages only. Decompression runs on the current thread
/// pool.
///
/// # Errors
/// [`ImageError`]: damaged or incomplete content, a size out of range, no colour channels, deep or subsampled data.
pub fn read(bytes: &[u8], path: &Path) -> Result<Image<Rgb>, ImageError> {
    let missing = |headers: &[Header]| ImageError::Unsupported {
        path: path.to_owned(),
        found: format!("channels {}", channel_names(headers)),
        expected: "channels R, G and B, or Y alone",
    };
    let image = guarded(path, FORMAT, || decode(bytes, path, colour_channels, missing))?;
    Ok(Image {
        width: image.width,
        height: image.height,
        pixels: image.pixels.into_iter().map(Rgb::from).collect(),
    })
}

/// Decodes the channels `layer.channel` of the first part that has them all, in the order given; everything else is as for
/// [`read`].
///
/// # Errors
/// [`ImageError`], as for [`read`]; also if the file has no such layer.
pub fn read_layer<const N: usize>(
    bytes: &[u8],
    path: &Path,
    layer: &str,
    channels: [&str; N],
) -> Result<Image<[f32; N]>, ImageError> {
    let names = channels.map(|channel| super::channel_name(layer, channel));
    let find = |list: &ChannelList| {
        let found = names.iter().map(|name| list.list.iter().position(|c| c.name.eq(name)));
        found.collect::<Option<Vec<usize>>>()?.try_into().ok()
    };
    let missing = |headers: &[Header]| ImageError::Unsupported {
        path: path.to_owned(),
        found: format!("channels {}, and not {}", channel_names(headers), names.join(", ")),
        expected: "a file with this layer",
    };
    guarded(path, FORMAT, || decode(bytes, path, find, missing))
}

/// Decodes the channels that `find` chooses in the first part where it finds them.
fn decode<const N: usize>(
    bytes: &[u8],
    path: &Path,
    find: impl Fn(&ChannelList) -> Option<[usize; N]>,
    missing: impl FnOnce(&[Header]) -> ImageError,
) -> Result<Image<[f32; N]>, ImageError> {
    let failed = |error| decode_error(path, error);
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(failed)?;
    let meta = reader.meta_data().clone();
    let mut parts = meta.headers.iter().enumerate();
    let (layer, channels) = parts
        .find_map(|(layer, header)| Some((layer, find(&header.channels)?)))
        .ok_or_else(|| missing(&meta.headers))?;
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
            image.pixels = vec![[0.0; N]; width as usize * height as usize];
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
fn place<const N: usize>(
    block: &UncompressedBlock,
    list: &ChannelList,
    channels: [usize; N],
    image: &mut Image<[f32; N]>,
) -> Option<()> {
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
            let set = |(pixel, value): (&mut [f32; N], f32)| pixel[component] = value;
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

/// The indices of the red, green and blue channels.
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
