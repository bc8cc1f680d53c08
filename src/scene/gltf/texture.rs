//! Bitmaps that materials refer to, and how they lie on the surface.

use super::super::bitmap::{Bitmaps, Role, decode_texture};
use super::super::input::read_file;
use super::resource::{Buffers, data, decoded, file};
use super::{Asset, LoadError};
use crate::math::{Affine2, Mat2, Vec2};
use crate::texture::{Filter, Texture, TextureMap, Wrap};
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::material::NormalTexture;
use gltf::json::texture::{Info, MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::PathBuf;

/// A material's reference to a texture.
#[derive(Clone, Debug)]
pub(super) struct Reference {
    texture: usize,
    /// Of texture coordinates.
    pub(super) set: u32,
    transform: Option<TextureTransform>,
}

impl Reference {
    fn new(texture: usize, set: u32, transform: Option<TextureTransform>) -> Reference {
        Reference {
            texture,
            set: transform.as_ref().and_then(|t| t.tex_coord).unwrap_or(set),
            transform,
        }
    }

    pub(super) fn of(info: &Info) -> Reference {
        let transform = info.extensions.as_ref().and_then(|e| e.texture_transform.clone());
        Reference::new(info.index.value(), info.tex_coord, transform)
    }

    /// `key`: of the material, for messages.
    pub(super) fn of_normals(asset: &Asset<'_>, normals: &NormalTexture, key: &str) -> Result<Reference, LoadError> {
        // The crate leaves the extensions of this one as they are.
        let json = normals
            .extensions
            .as_ref()
            .and_then(|e| e.others.get("KHR_texture_transform"));
        let transform = json.map(|json| serde_json::from_value(json.clone())).transpose();
        let transform = transform.map_err(|fault| {
            asset.error(
                format!("{key}.normalTexture.extensions.KHR_texture_transform"),
                fault.to_string(),
            )
        })?;
        Ok(Reference::new(normals.index.value(), normals.tex_coord, transform))
    }
}

/// Where the bytes of an image are.
enum Source<'a> {
    File(PathBuf),
    Data(&'a str),
    View(usize),
}

fn source<'a>(asset: &'a Asset<'_>, image: usize) -> Result<Source<'a>, LoadError> {
    let json = &asset.root.images[image];
    match (&json.uri, json.buffer_view) {
        (_, Some(view)) => Ok(Source::View(view.value())),
        (Some(uri), None) => Ok(match data(uri) {
            Some(data) => Source::Data(data),
            None => Source::File(file(asset, &format!("images[{image}].uri"), uri)?),
        }),
        (None, None) => Err(asset.error(format!("images[{image}]"), "has neither a URI nor a buffer view")),
    }
}

/// The bitmaps of a file's materials. Their numbers are those that they have in the description.
#[derive(Default)]
pub(super) struct Textures {
    bitmaps: Bitmaps,
    /// By the path that stands for the image in messages, which is that of its file if it has one.
    images: HashMap<PathBuf, usize>,
}

impl Textures {
    /// The bitmap in a role. `key`: of the material, for messages.
    pub(super) fn map(
        &mut self,
        asset: &Asset<'_>,
        reference: &Reference,
        role: Role,
        key: &str,
    ) -> Result<TextureMap, LoadError> {
        let texture = &asset.root.textures[reference.texture];
        let image = texture.source.value();
        let path = match source(asset, image)? {
            Source::File(path) => path,
            Source::View(_) | Source::Data(_) => PathBuf::from(format!("{}: images[{image}]", asset.path.display())),
        };
        self.images.entry(path.clone()).or_insert(image);
        let sampler = texture.sampler.map(|sampler| &asset.root.samplers[sampler.value()]);
        let wrap = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            _ => Wrap::Repeat,
        };
        let is_nearest = sampler.is_some_and(|s| s.mag_filter == Some(Checked::Valid(MagFilter::Nearest)));
        let to_uv = reference.transform.as_ref().map_or(Affine2::IDENTITY, to_uv);
        if !to_uv.is_finite() {
            return Err(asset.error(key, "the KHR_texture_transform of a texture is not finite"));
        }
        Ok(TextureMap {
            texture: self.bitmaps.want(path, role) as u32,
            to_uv,
            wrap: sampler.map_or([Wrap::Repeat; 2], |s| [wrap(s.wrap_s), wrap(s.wrap_t)]),
            filter: if is_nearest { Filter::Nearest } else { Filter::Bilinear },
        })
    }

    /// Decodes all that have been asked for.
    pub(super) fn decode(
        self,
        asset: &Asset<'_>,
        buffers: &Buffers<'_>,
        hasher: &mut blake3::Hasher,
    ) -> Result<Vec<Texture>, LoadError> {
        let decoded: Vec<Result<(Texture, Option<blake3::Hash>), LoadError>> = self
            .bitmaps
            .wanted
            .par_iter()
            .map(|(path, role)| {
                let image = self.images[path];
                let (bytes, hash) = match source(asset, image)? {
                    Source::View(view) => (Cow::Borrowed(buffers.view(asset, view)?), None),
                    Source::Data(uri) => (Cow::Owned(decoded(asset, &format!("images[{image}].uri"), uri)?), None),
                    Source::File(path) => {
                        let bytes = read_file(&path)?;
                        let hash = blake3::hash(&bytes);
                        (Cow::Owned(bytes), Some(hash))
                    }
                };
                Ok((decode_texture(path, &bytes, *role)?, hash))
            })
            .collect();
        decoded
            .into_iter()
            .map(|result| {
                let (texture, hash) = result?;
                if let Some(hash) = hash {
                    hasher.update(hash.as_bytes());
                }
                Ok(texture)
            })
            .collect()
    }
}

/// The transform of the extension for coordinates whose v goes up: it is meant for v that goes down.
fn to_uv(transform: &TextureTransform) -> Affine2 {
    let (sin, cos) = transform.rotation.0.sin_cos();
    let scale = Vec2::from(transform.scale.0);
    // Counter-clockwise as seen with v going down. The shader code in the extension's text turns the other way; its
    // examples and everyone's pictures turn like this.
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let down = Affine2::from_mat2_translation(rotation * Mat2::from_diagonal(scale), transform.offset.0.into());
    let flip = Affine2::from_mat2_translation(Mat2::from_diagonal(Vec2::new(1.0, -1.0)), Vec2::new(0.0, 1.0));
    flip * down * flip
}
