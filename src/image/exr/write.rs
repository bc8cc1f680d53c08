//! OpenEXR encoding.

use crate::image::{Image, ImageError, check_size};
use crate::math::Rgb;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::compression::Compression;
use exr::math::Vec2;
use exr::meta::attribute::{
    self, AttributeValue, ChannelDescription, Chromaticities, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes};
use exr::meta::{BlockDescription, MetaData, magic_number, sequence_end};
use rayon::prelude::*;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

/// ITU-R BT.709 primaries and the D65 white point, CIE 1931 xy.
pub(super) const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// What is written beside the pixels. Absent values are not written.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrMetadata {
    /// Attribute `software`: program and version, as `embrace 0.1.0`.
    pub software: String,
    /// Attribute `scene_hash`.
    pub scene_hash: Option<String>,
    /// Attribute `spp` (int): samples per pixel; the fewest, where pixels differ.
    pub spp: Option<u32>,
    /// Attribute `spp_most` (int): the most samples of a pixel.
    pub spp_most: Option<u32>,
    /// Attributes `relmse`, `relmse_low`, `relmse_high` (float): estimated relative mean squared error of the image, and the ends of
    /// its 95 % interval.
    pub relmse: Option<[f64; 3]>,
    /// Attributes `rmse`, `rmse_low`, `rmse_high` (float): the same for the root-mean-square error.
    pub rmse: Option<[f64; 3]>,
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

/// Named values of every pixel beside its colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The part of the channels' names before the dot.
    pub name: &'static str,
    /// The part after it.
    pub channels: &'static [&'static str],
    /// Row by row, the channels of a pixel side by side.
    pub values: Vec<f32>,
}

/// Encodes an image: RGB, 32-bit float, ZIP compression in blocks of 16 lines, Rec. 709 chromaticities. The same image
/// and metadata give the same bytes. Compression runs on the current thread pool; the compressed image is held in
/// memory. `path` is for messages only.
///
/// # Errors
/// [`ImageError::Write`] if the writer fails, [`ImageError::Size`] if the image has no pixels or its windows are
/// beyond the range of the format.
pub fn write(writer: impl Write, image: &Image<Rgb>, metadata: &ExrMetadata, path: &Path) -> Result<(), ImageError> {
    write_layers(writer, image, &[], metadata, path)
}

/// The same with further channels `name.channel` in the same part, which is what compositing programs and renderers read.
/// 32-bit float all of them: programs that compute in float divide integer channels by 2³² - 1 on reading.
///
/// # Errors
/// As for [`write()`].
///
/// # Panics
/// If two channels have the same name, or a layer has another number of values than the image asks for.
pub fn write_layers(
    mut writer: impl Write,
    image: &Image<Rgb>,
    layers: &[Layer],
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
    let channels = Channel::of(image, layers);
    let header = header(image, &channels, metadata).ok_or_else(|| {
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
            block_of(image, &channels, block)
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
fn header(image: &Image<Rgb>, channels: &[Channel], metadata: &ExrMetadata) -> Option<Header> {
    let channels = channels
        .iter()
        .map(|channel| ChannelDescription::named(channel.name.as_str(), SampleType::F32));
    let size = Vec2(image.width as usize, image.height as usize);
    let mut header = Header::new(Text::from("rgb"), size, channels.collect()).with_encoding(
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
    let as_int = |n: u32| AttributeValue::I32(i32::try_from(n).unwrap_or(i32::MAX));
    let as_float = |x: f64| AttributeValue::F32(x as f32);
    let number = |interval: Option<[f64; 3]>, i: usize| interval.map(|numbers| as_float(numbers[i]));
    let custom = [
        ("scene_hash", metadata.scene_hash.as_ref().map(as_text)),
        ("spp", metadata.spp.map(as_int)),
        ("spp_most", metadata.spp_most.map(as_int)),
        ("relmse", number(metadata.relmse, 0)),
        ("relmse_low", number(metadata.relmse, 1)),
        ("relmse_high", number(metadata.relmse, 2)),
        ("rmse", number(metadata.rmse, 0)),
        ("rmse_low", number(metadata.rmse, 1)),
        ("rmse_high", number(metadata.rmse, 2)),
        (
            "seed",
            metadata.seed.map(|n| AttributeValue::Text(text(&n.to_string()))),
        ),
        ("backend", metadata.backend.as_ref().map(as_text)),
        ("seconds", metadata.seconds.map(as_float)),
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

/// A channel, and where its values are.
struct Channel<'a> {
    name: String,
    values: Values<'a>,
}

enum Values<'a> {
    /// One of the channels of a colour.
    Colour(&'a [Rgb], usize),
    /// One of several numbers of a pixel side by side.
    Layer(&'a Layer, usize),
}

impl<'a> Channel<'a> {
    /// All channels in alphabetical order, as the format wants them.
    fn of(image: &'a Image<Rgb>, layers: &'a [Layer]) -> Vec<Channel<'a>> {
        let mut channels: Vec<Channel> = ["R", "G", "B"]
            .iter()
            .enumerate()
            .map(|(i, name)| Channel {
                name: (*name).to_owned(),
                values: Values::Colour(&image.pixels, i),
            })
            .collect();
        for layer in layers {
            assert_eq!(
                layer.values.len(),
                image.pixels.len() * layer.channels.len(),
                "values of layer {}",
                layer.name
            );
            channels.extend(layer.channels.iter().enumerate().map(|(i, name)| Channel {
                name: super::channel_name(layer.name, name),
                values: Values::Layer(layer, i),
            }));
        }
        channels.sort_by(|a, b| a.name.cmp(&b.name));
        assert!(
            channels.windows(2).all(|pair| pair[0].name != pair[1].name),
            "two channels of the same name"
        );
        channels
    }

    /// Appends the values of some pixels.
    fn append(&self, pixels: Range<usize>, bytes: &mut Vec<u8>) {
        match self.values {
            Values::Colour(colours, channel) => {
                bytes.extend(colours[pixels].iter().flat_map(|colour| colour[channel].to_ne_bytes()));
            }
            Values::Layer(layer, channel) => {
                let count = layer.channels.len();
                let values = layer.values[pixels.start * count..pixels.end * count].iter();
                bytes.extend(
                    values
                        .skip(channel)
                        .step_by(count)
                        .flat_map(|value| value.to_ne_bytes()),
                );
            }
        }
    }
}

/// The samples of a block of lines as the format orders them: line by line, channel by channel.
fn block_of(image: &Image<Rgb>, channels: &[Channel], block: usize) -> UncompressedBlock {
    let (width, height) = (image.width as usize, image.height as usize);
    let lines = Compression::ZIP16.scan_lines_per_block();
    let first = block * lines;
    let rows = lines.min(height - first);
    let mut data = Vec::with_capacity(rows * width * channels.len() * size_of::<f32>());
    for row in first..first + rows {
        for channel in channels {
            channel.append(row * width..(row + 1) * width, &mut data);
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
