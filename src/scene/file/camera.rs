//! The view.

use super::{MAX_LENGTH, Result};
use crate::camera::CameraDesc;
use crate::math::DVec3;
use crate::scene::value::{Field, Table};

/// The view, and the part of its image that is wanted.
pub(super) fn camera(table: &Table<'_>) -> Result<(CameraDesc, Option<[u32; 4]>)> {
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
    let crop = table.get("crop").map(|f| crop(&f, desc.resolution)).transpose()?;
    table.finish()?;
    Ok((desc, crop))
}

fn crop(field: &Field<'_>, [width, height]: [u32; 2]) -> Result<[u32; 4]> {
    let corners = field.array()?;
    let [x0, y0, x1, y1] = corners.as_slice() else {
        return Err(field.error("expected an array of 4 whole numbers: x0, y0, x1, y1"));
    };
    let crop = [x0.count()?, y0.count()?, x1.count()?, y1.count()?];
    let [x0, y0, x1, y1] = crop;
    if x0 < x1 && x1 <= width && y0 < y1 && y1 <= height {
        Ok(crop)
    } else {
        Err(field.error(format!(
            "is not a part of the {width} x {height} pixels; expected x0 < x1 and y0 < y1 within them"
        )))
    }
}
