//! Light that comes from no surface: the environment, points, cones and what is far away.

use super::colour::colour;
use super::{Context, MAX_LENGTH, MAX_RADIANCE, Result};
use crate::material::Spectrum;
use crate::math::{DMat3, DVec3, Rgb};
use crate::scene::bitmap::Role;
use crate::scene::desc::{Falloff, LightDesc, SlideDesc};
use crate::scene::value::{Field, Table};
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest factor on an environment map.
const MAX_SCALE: f64 = 1e15;

/// How far from a rotation a matrix of an environment may be, by rounding in the file that it comes from.
const ROTATION_ROUNDING: f64 = 1e-3;

#[derive(Debug)]
pub(in crate::scene) enum EnvironmentEntry {
    Constant(Rgb),
    File {
        file: String,
        scale: f32,
        rotation_degrees: f64,
        to_world: DMat3,
    },
}

pub(super) fn environment(field: &Field<'_>) -> Result<EnvironmentEntry> {
    let table = field.table()?;
    let file = table.get("file").map(|f| f.string()).transpose()?;
    let radiance = table.get("radiance").map(|f| f.rgb_in(0.0, MAX_RADIANCE)).transpose()?;
    let scale = table.get("scale").map_or(Ok(1.0), |f| f.number_in(0.0, MAX_SCALE))? as f32;
    let rotation_degrees = table.get("rotation_deg").map_or(Ok(0.0), |f| f.number())?;
    let to_world = table.get("transform").map_or(Ok(DMat3::IDENTITY), |f| rotation(&f))?;
    table.finish()?;
    match (file, radiance) {
        (Some(file), None) => Ok(EnvironmentEntry::File {
            file: file.to_owned(),
            scale,
            rotation_degrees,
            to_world,
        }),
        (None, Some(radiance)) => Ok(EnvironmentEntry::Constant(radiance * scale)),
        (Some(_), Some(_)) => Err(field.error("has both `file` and `radiance`; keep one")),
        (None, None) => Err(field.error("needs `file` (a latitude-longitude map) or `radiance` = [r, g, b]")),
    }
}

/// A 3 × 3 matrix in rows that keeps lengths and angles.
fn rotation(field: &Field<'_>) -> Result<DMat3> {
    let rows = field.array()?;
    let [x, y, z] = rows.as_slice() else {
        return Err(field.error(format!("expected 3 rows of 3 numbers, found {} rows", rows.len())));
    };
    let rows = [x.numbers::<3>()?, y.numbers::<3>()?, z.numbers::<3>()?];
    let matrix = DMat3::from_cols_array_2d(&rows).transpose();
    if !(matrix * matrix.transpose()).abs_diff_eq(DMat3::IDENTITY, ROTATION_ROUNDING) {
        return Err(field.error("is no rotation: its rows are not of length 1 and at right angles"));
    }
    Ok(matrix)
}

#[derive(Clone, Copy)]
enum LightKind {
    Point,
    Spot,
    Distant,
}

pub(super) fn light(table: &Table<'_>, context: &mut Context<'_>) -> Result<LightDesc> {
    let kind = table.require("type")?.word(&[
        ("point", LightKind::Point),
        ("spot", LightKind::Spot),
        ("distant", LightKind::Distant),
    ])?;
    let position = || table.require("position")?.vector(MAX_LENGTH);
    let intensity = |key| table.require(key)?.rgb_in(0.0, MAX_RADIANCE);
    let angles = || spot_angles(table);
    let light = match kind {
        LightKind::Point => LightDesc::Point {
            position: position()?,
            intensity: intensity("intensity")?,
        },
        LightKind::Spot => LightDesc::Spot {
            position: position()?,
            direction: direction(table, "direction")?,
            intensity: intensity("intensity")?,
            angles: angles()?,
            falloff: table.get("falloff").map_or(Ok(Falloff::default()), |f| {
                f.word(&[("angle", Falloff::Angle), ("cosine", Falloff::Cosine)])
            })?,
            slide: table
                .get("slide")
                .map(|f| slide(&f, angles()?[1], context))
                .transpose()?,
        },
        LightKind::Distant => LightDesc::Distant {
            direction: direction(table, "direction")?,
            irradiance: intensity("irradiance")?,
            radius: disc_radius(table)?,
        },
    };
    table.finish()?;
    Ok(light)
}

fn direction(table: &Table<'_>, key: &'static str) -> Result<DVec3> {
    let field = table.require(key)?;
    match field.vector(MAX_LENGTH)? {
        DVec3::ZERO => Err(field.error("has no length; give a direction")),
        direction => Ok(direction),
    }
}

fn slide(field: &Field<'_>, edge: f64, context: &mut Context<'_>) -> Result<SlideDesc> {
    if edge >= FRAC_PI_2 {
        return Err(field.error("needs a cone that ends below 90 degrees from its axis"));
    }
    let table = field.table()?;
    let factor = colour(&table, MAX_RADIANCE, Role::Radiance, context)?;
    let axes = [direction(&table, "u_axis")?, direction(&table, "v_axis")?];
    table.finish()?;
    match factor {
        Some(factor @ (Spectrum::Bitmap(..) | Spectrum::Checkerboard(_))) => Ok(SlideDesc { factor, axes }),
        _ => {
            Err(field.error("needs `texture` or `checkerboard`; what is the same everywhere belongs into `intensity`"))
        }
    }
}

/// An angle as it is written, and what makes radians of it.
type Angle<'a> = (Field<'a>, fn(f64) -> f64);

/// The one of two keys that is there, the second of which has radians for degrees.
fn angle<'a>(table: &Table<'a>, [degrees, radians]: [&'static str; 2]) -> Result<Option<Angle<'a>>> {
    match (table.get(degrees), table.get(radians)) {
        (Some(field), None) => Ok(Some((field, f64::to_radians))),
        (None, Some(field)) => Ok(Some((field, |angle| angle))),
        (Some(_), Some(field)) => Err(field.error(format!("stands beside `{degrees}`; keep one"))),
        (None, None) => Ok(None),
    }
}

fn spot_angles(table: &Table<'_>) -> Result<[f64; 2]> {
    let Some((field, to_radians)) = angle(table, ["angles_deg", "angles_rad"])? else {
        return Err(table.missing("angles_deg"));
    };
    let [beam, edge] = field.numbers::<2>()?.map(to_radians);
    if !(0.0 <= beam && beam < edge && edge <= PI) {
        return Err(field.error(
            "expected two angles from the axis: up to the first there is all of the light, from the second on none; \
             0 or more, the second above the first, at most 180 degrees",
        ));
    }
    Ok([beam, edge])
}

fn disc_radius(table: &Table<'_>) -> Result<f64> {
    let Some((field, to_radians)) = angle(table, ["radius_deg", "radius_rad"])? else {
        return Ok(0.0);
    };
    let radius = to_radians(field.number()?);
    if !(0.0..FRAC_PI_2).contains(&radius) {
        return Err(field.error("is not 0 or more and below 90 degrees"));
    }
    Ok(radius)
}
