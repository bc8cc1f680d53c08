//! The view.

use super::{MAX_LENGTH, Result};
use crate::camera::CameraDesc;
use crate::math::DVec3;
use crate::scene::value::Table;

pub(super) fn camera(table: &Table<'_>) -> Result<CameraDesc> {
    let resolution = table.require("resolution")?;
    let sides = resolution.array()?;
    let [width, height] = sides.as_slice() else {
        return Err(resolution.error("expected an array of 2 whole numbers: width and height"));
    };
    let desc = CameraDesc {
        position: table.require("position")?.vector(MAX_LENGTH)?,
        look_at: table.require("look_at")?.vector(MAX_LENGTH)?,
        up: table.get("up").map_or(Ok(DVec3::Y), |f| f.vector(MAX_LENGTH))?,
        vfov_degrees: table.require("vfov")?.number()?,
        resolution: [width.count()?, height.count()?],
        aperture_radius: table
            .get("aperture_radius")
            .map_or(Ok(0.0), |f| f.number_in(0.0, MAX_LENGTH))?,
        focus_distance: table
            .get("focus_distance")
            .map(|f| f.number_in(0.0, MAX_LENGTH))
            .transpose()?,
        mirrored: table.get("mirrored").map_or(Ok(false), |f| f.flag())?,
    };
    table.finish()?;
    Ok(desc)
}
