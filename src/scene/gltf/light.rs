//! Lights of `KHR_lights_punctual`.
//!
//! The format has them in candela and lux, and rendering takes watts. One watt is taken for 683 lumens, the efficacy that
//! defines the candela: so does the exporter of Blender, unless told otherwise, and its importer undoes it. Emission of
//! surfaces is taken as it is written, which is what that exporter writes as well.

use super::super::desc::{Falloff, LightDesc};
use super::node::Placed;
use super::{Asset, LoadError, Notes, label};
use crate::math::Rgb;
use gltf::json::extensions::scene::khr_lights_punctual::{Light, Type};
use gltf::json::validation::Checked;

/// Lumens of a watt.
const LUMENS_PER_WATT: f32 = 683.0;

/// The lights of the scene.
pub(super) fn read(asset: &Asset<'_>, placed: &[Placed], notes: &mut Notes) -> Result<Vec<LightDesc>, LoadError> {
    let lights: &[Light] = asset.root.as_ref();
    let mut found = Vec::new();
    for placed in placed {
        let extensions = asset.root.nodes[placed.node].extensions.as_ref();
        if let Some(reference) = extensions.and_then(|e| e.khr_lights_punctual.as_ref()) {
            let index = reference.light.value();
            found.extend(describe(asset, placed, index, &lights[index], notes)?);
        }
    }
    Ok(found)
}

/// `None` for one that gives no light.
fn describe(
    asset: &Asset<'_>,
    placed: &Placed,
    index: usize,
    light: &Light,
    notes: &mut Notes,
) -> Result<Option<LightDesc>, LoadError> {
    let key = label("extensions.KHR_lights_punctual.lights", index, light.name.as_deref());
    let strength = Rgb::from(light.color) * (light.intensity / LUMENS_PER_WATT);
    if !strength.to_array().iter().all(|c| c.is_finite() && *c >= 0.0) {
        return Err(asset.error(key, "color times intensity is negative or not finite"));
    }
    if strength.is_black() {
        return Ok(None);
    }
    if light.range.is_some() {
        notes.add(
            "the range is ignored: light falls off with the square of the distance",
            &key,
        );
    }
    let position = placed.to_world.translation;
    let direction = (-placed.to_world.matrix3.z_axis).try_normalize();
    let direction = || {
        direction.ok_or_else(|| {
            asset.error(
                format!("nodes[{}]", placed.node),
                "the transform leaves the light no direction",
            )
        })
    };
    Ok(Some(match (light.type_, &light.spot) {
        (Checked::Valid(Type::Point), _) => LightDesc::Point {
            position,
            intensity: strength,
        },
        (Checked::Valid(Type::Directional), _) => LightDesc::Distant {
            direction: direction()?,
            irradiance: strength,
            radius: 0.0,
        },
        (Checked::Valid(Type::Spot), Some(spot)) => {
            let angles = [spot.inner_cone_angle, spot.outer_cone_angle].map(f64::from);
            // The widest angle may be written as pi / 2 in 32 bits, which is more than that.
            if !(angles[0] >= 0.0 && angles[0] < angles[1] && angles[1] <= std::f64::consts::FRAC_PI_2 + 1e-6) {
                return Err(asset.error(
                    format!("{key}.spot"),
                    format!(
                        "the cone from {} to {} radians is none; 0 <= innerConeAngle < outerConeAngle <= pi / 2",
                        angles[0], angles[1]
                    ),
                ));
            }
            LightDesc::Spot {
                slide: None,
                position,
                direction: direction()?,
                intensity: strength,
                angles,
                falloff: Falloff::Cosine,
            }
        }
        _ => return Err(asset.error(key, "is of no type that the extension has")),
    }))
}
