//! Extensions of materials that the crate leaves as they are: the clear coat, and what is within.

use super::{Asset, LoadError};
use gltf::json::material::Material;
use gltf::json::texture::Info;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// `KHR_materials_clearcoat`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Clearcoat {
    pub(super) clearcoat_factor: f32,
    pub(super) clearcoat_texture: Option<Info>,
    pub(super) clearcoat_roughness_factor: f32,
    pub(super) clearcoat_roughness_texture: Option<Info>,
    pub(super) clearcoat_normal_texture: Option<serde_json::Value>,
}

impl Clearcoat {
    /// `name`: of the material, for messages.
    pub(super) fn of(asset: &Asset<'_>, material: &Material, name: &str) -> Result<Option<Clearcoat>, LoadError> {
        const KEY: &str = "KHR_materials_clearcoat";
        let coat: Option<Clearcoat> = read(asset, material, name, KEY)?;
        for info in coat.iter().flat_map(Clearcoat::textures) {
            if info.index.value() >= asset.root.textures.len() {
                return Err(asset.error(format!("{name}.extensions.{KEY}"), "there is no texture of that index"));
            }
        }
        Ok(coat)
    }

    pub(super) fn textures(&self) -> impl Iterator<Item = &Info> {
        self.clearcoat_texture.iter().chain(&self.clearcoat_roughness_texture)
    }
}

/// `KHR_materials_volume`.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(super) struct Volume {
    /// 0 for thin walls.
    pub(super) thickness_factor: f32,
    pub(super) attenuation_distance: Option<f32>,
}

impl Volume {
    /// `name`: of the material, for messages.
    pub(super) fn of(asset: &Asset<'_>, material: &Material, name: &str) -> Result<Option<Volume>, LoadError> {
        read(asset, material, name, "KHR_materials_volume")
    }
}

fn read<T: DeserializeOwned>(
    asset: &Asset<'_>,
    material: &Material,
    name: &str,
    key: &str,
) -> Result<Option<T>, LoadError> {
    let json = material.extensions.as_ref().and_then(|e| e.others.get(key));
    let value = json.map(|json| serde_json::from_value(json.clone())).transpose();
    value.map_err(|fault| asset.error(format!("{name}.extensions.{key}"), fault.to_string()))
}
