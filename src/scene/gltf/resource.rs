//! Bytes that a file refers to: within it, in data URIs, and in files beside it.

use super::super::input::read_file;
use super::{Asset, LoadError};
use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use gltf::json::buffer::View;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// Base64 whose padding may be left out, as some exporters do.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
);

/// What follows the scheme of a data URI; `None` for other URIs.
pub(super) fn data(uri: &str) -> Option<&str> {
    uri.strip_prefix("data:")
}

/// The bytes of a data URI that stands at `key`.
pub(super) fn decoded(asset: &Asset<'_>, key: &str, data: &str) -> Result<Vec<u8>, LoadError> {
    let Some((kind, data)) = data.split_once(',') else {
        return Err(asset.error(key, "the data URI has no comma before its data"));
    };
    if !kind.ends_with(";base64") {
        return Err(asset.error(key, "the data URI is not base64, the only encoding that is read"));
    }
    BASE64
        .decode(data)
        .map_err(|fault| asset.error(key, format!("the data URI is not whole base64: {fault}")))
}

/// The path of another URI.
pub(super) fn file(asset: &Asset<'_>, key: &str, uri: &str) -> Result<PathBuf, LoadError> {
    if uri.contains("://") {
        return Err(asset.error(
            key,
            format!(
                "{} is not read; only files and data URIs are: save it beside the scene",
                beginning(uri)
            ),
        ));
    }
    let name =
        percent_decoded(uri).ok_or_else(|| asset.error(key, format!("{} is not a URI of UTF-8", beginning(uri))))?;
    let base = asset.path.parent().unwrap_or(Path::new(""));
    let (decoded, literal) = (base.join(name), base.join(uri));
    // Some exporters write names as they are.
    let is_literal = decoded != literal && literal.is_file() && !decoded.is_file();
    Ok(if is_literal { literal } else { decoded })
}

/// The first characters, for messages.
fn beginning(text: &str) -> String {
    if text.chars().count() > 60 {
        text.chars().take(60).chain("...".chars()).collect()
    } else {
        text.to_owned()
    }
}

/// Bytes for their %XX; `None` if the result is not UTF-8. Other percent signs stand for themselves.
fn percent_decoded(uri: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        let digit = |at: usize| after.get(at).and_then(|&d| char::from(d).to_digit(16));
        rest = match (first, digit(0), digit(1)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((16 * high + low) as u8);
                &after[2..]
            }
            _ => {
                bytes.push(first);
                after
            }
        };
    }
    String::from_utf8(bytes).ok()
}

/// The content of all buffers.
pub(super) struct Buffers<'a>(Vec<Cow<'a, [u8]>>);

impl<'a> Buffers<'a> {
    /// `blob`: the bytes of a GLB.
    pub(super) fn read(
        asset: &Asset<'_>,
        blob: Option<&'a [u8]>,
        hasher: &mut blake3::Hasher,
    ) -> Result<Buffers<'a>, LoadError> {
        let mut buffers = Vec::with_capacity(asset.root.buffers.len());
        for (i, buffer) in asset.root.buffers.iter().enumerate() {
            let key = format!("buffers[{i}]");
            let mut bytes = match (&buffer.uri, blob) {
                (Some(uri), _) => {
                    let key = format!("{key}.uri");
                    Cow::Owned(match data(uri) {
                        Some(data) => decoded(asset, &key, data)?,
                        None => {
                            let bytes = read_file(&file(asset, &key, uri)?)?;
                            hasher.update(blake3::hash(&bytes).as_bytes());
                            bytes
                        }
                    })
                }
                (None, Some(blob)) if i == 0 => Cow::Borrowed(blob),
                (None, _) => return Err(asset.error(key, "has neither a URI nor bytes in the file")),
            };
            let says = buffer.byte_length.0;
            if says > bytes.len() as u64 {
                return Err(asset.error(
                    format!("{key}.byteLength"),
                    format!(
                        "says {says} bytes, but {} are there; copy or export the file again",
                        bytes.len()
                    ),
                ));
            }
            // What follows is padding.
            match &mut bytes {
                Cow::Owned(bytes) => bytes.truncate(says as usize),
                Cow::Borrowed(bytes) => *bytes = &bytes[..says as usize],
            }
            buffers.push(bytes);
        }
        Ok(Buffers(buffers))
    }

    /// Bytes of all.
    pub(super) fn total(&self) -> usize {
        self.0.iter().map(|bytes| bytes.len()).sum()
    }

    /// The bytes of a view.
    pub(super) fn view(&self, asset: &Asset<'_>, index: usize) -> Result<&[u8], LoadError> {
        let View {
            buffer,
            byte_length,
            byte_offset,
            ..
        } = &asset.root.buffer_views[index];
        let bytes = &*self.0[buffer.value()];
        let (start, length) = (byte_offset.unwrap_or_default().0, byte_length.0);
        let end = start.checked_add(length).filter(|&end| end <= bytes.len() as u64);
        end.map(|end| &bytes[start as usize..end as usize]).ok_or_else(|| {
            asset.error(
                format!("bufferViews[{index}]"),
                format!(
                    "{length} bytes from byte {start} on are not within buffer {}, which has {}",
                    buffer.value(),
                    bytes.len()
                ),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_stand_for_bytes_or_for_themselves() {
        assert_eq!(percent_decoded("a%20b%2Fc").as_deref(), Some("a b/c"));
        assert_eq!(percent_decoded("100%").as_deref(), Some("100%"));
        assert_eq!(percent_decoded("%e2%9d%A4.png").as_deref(), Some("\u{2764}.png"));
        assert_eq!(percent_decoded("%zz%4").as_deref(), Some("%zz%4"));
        assert_eq!(percent_decoded("%ff"), None);
    }
}
