//! Cameras.

use super::node::Placed;
use super::{Asset, LoadError, Notes, label};
use crate::camera::CameraDesc;
use crate::image::MAX_SIDE;
use crate::math::DVec3;
use gltf::json::validation::Checked;

/// Rows of the image where a camera states the shape of its image; the format has no number of pixels.
const HEIGHT: u32 = 600;

/// The camera of a name, or the first one. `None` if the scene has none and none is asked for.
pub(super) fn choose(
    asset: &Asset<'_>,
    placed: &[Placed],
    name: Option<&str>,
    notes: &mut Notes,
) -> Result<Option<CameraDesc>, LoadError> {
    let cameras: Vec<(&Placed, usize)> = placed
        .iter()
        .filter_map(|placed| Some((placed, asset.root.nodes[placed.node].camera?.value())))
        .collect();
    // What a camera may be called: its own name, or that of its node.
    let names = |(placed, camera): &(&Placed, usize)| {
        let own = asset.root.cameras[*camera].name.as_deref();
        let node = asset.root.nodes[placed.node].name.as_deref();
        [own, node].into_iter().flatten().filter(|name| !name.is_empty())
    };
    let chosen = match name {
        Some(name) => {
            let found = cameras.iter().find(|camera| names(camera).any(|other| other == name));
            Some(found.ok_or_else(|| unknown(asset, name, cameras.iter().flat_map(names).collect()))?)
        }
        None => cameras.first(),
    };
    let Some(&(placed, camera)) = chosen else {
        return Ok(None);
    };
    if name.is_none() && cameras.len() > 1 {
        notes.add(
            format!(
                "has {} cameras; {} is used, and --camera NAME chooses another",
                cameras.len(),
                label("cameras", camera, asset.root.cameras[camera].name.as_deref())
            ),
            "",
        );
    }
    describe(asset, placed, camera).map(Some)
}

fn unknown(asset: &Asset<'_>, name: &str, mut names: Vec<&str>) -> LoadError {
    names.dedup();
    let there = match names.as_slice() {
        [] => "the scene has no camera with a name".to_owned(),
        names => format!("there are {}", names.join(", ")),
    };
    asset.error("--camera", format!("no camera is called {name:?}; {there}"))
}

fn describe(asset: &Asset<'_>, placed: &Placed, index: usize) -> Result<CameraDesc, LoadError> {
    let json = &asset.root.cameras[index];
    let key = label("cameras", index, json.name.as_deref());
    let perspective = match (json.type_, &json.perspective) {
        (Checked::Valid(gltf::json::camera::Type::Orthographic), _) => {
            return Err(asset.error(
                key,
                "is orthographic, which is not supported; choose a perspective camera with --camera NAME",
            ));
        }
        (_, Some(perspective)) => perspective,
        (_, None) => return Err(asset.error(key, "is perspective, but says no angle")),
    };
    let vfov_degrees = f64::from(perspective.yfov).to_degrees();
    if !(vfov_degrees > 0.0 && vfov_degrees < 180.0) {
        return Err(asset.error(
            format!("{key}.perspective.yfov"),
            format!("{} is not between 0 and pi radians", perspective.yfov),
        ));
    }
    let resolution = match perspective.aspect_ratio {
        None => [800, HEIGHT],
        Some(aspect) => {
            let width = (f64::from(aspect) * f64::from(HEIGHT)).round();
            if !(width >= 1.0 && width <= f64::from(MAX_SIDE)) {
                return Err(asset.error(
                    format!("{key}.perspective.aspectRatio"),
                    format!("{aspect} makes no image of {HEIGHT} rows"),
                ));
            }
            [width as u32, HEIGHT]
        }
    };
    // A camera looks along its -z, +y is up, and +x right: unless the transform mirrors.
    let axes = placed.to_world.matrix3;
    let (Some(forward), Some(up)) = ((-axes.z_axis).try_normalize(), axes.y_axis.try_normalize()) else {
        return Err(asset.error(
            format!("nodes[{}]", placed.node),
            "the transform leaves the camera no direction",
        ));
    };
    let position = placed.to_world.translation;
    Ok(CameraDesc {
        position,
        // Far enough that its rounding turns nothing.
        look_at: position + forward * position.abs().max_element().max(1.0),
        up,
        vfov_degrees,
        resolution,
        aperture_radius: 0.0,
        focus_distance: None,
        mirrored: forward.cross(up).dot(axes.x_axis) < 0.0 && axes.x_axis != DVec3::ZERO,
    })
}
