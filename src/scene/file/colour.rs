//! Colours and numbers that may vary over a surface, and the placement of bitmaps.

use super::{Context, Result};
use crate::material::{Channel, Checkerboard, Scalar, Spectrum};
use crate::math::{Affine2, Rgb, Vec2};
use crate::scene::bitmap::Role;
use crate::scene::value::{Field, Table};
use crate::texture::{Encoding, Filter, TextureMap, Wrap};

/// Tells what a bitmap is for from the encoding that stands beside it.
pub(super) type RoleOf = fn(Option<Encoding>) -> Role;

/// The colour of a surface.
pub(super) const COLOUR: RoleOf = Role::Colour;

/// Numbers: proportional unless stated.
pub(super) const NUMBERS: RoleOf = |encoding| Role::Colour(Some(encoding.unwrap_or(Encoding::Linear)));

/// How much of a surface is there.
pub(super) const COVERAGE: RoleOf = |encoding| encoding.map_or(Role::Coverage, |encoding| Role::Colour(Some(encoding)));

/// Largest element of a placement.
const MAX_PLACEMENT: f64 = f32::MAX as f64;

/// The colour that a table's keys give, channels up to `limit`; `None` without any of them.
pub(super) fn colour(
    table: &Table<'_>,
    limit: f64,
    role: RoleOf,
    context: &mut Context<'_>,
) -> Result<Option<Spectrum>> {
    let rgb = table.get("rgb");
    let map = texture_map(table, role, context)?;
    let checkerboard = table.get("checkerboard");
    let vertex_colors = match table.get("vertex_colors") {
        Some(field) if field.flag()? => Some(field),
        _ => None,
    };
    let tint = table.get("tint");
    let beside = |field: &Field<'_>, others: &[(&str, bool)]| match others.iter().find(|(_, is_there)| *is_there) {
        Some((other, _)) => Err(field.error(format!("stands beside `{other}`; keep one"))),
        None => Ok(()),
    };
    let others = [
        ("texture", map.is_some()),
        ("vertex_colors", vertex_colors.is_some()),
        ("checkerboard", checkerboard.is_some()),
    ];
    if let Some(rgb) = &rgb {
        beside(rgb, &others)?;
    }
    if let Some(checkerboard) = &checkerboard {
        beside(checkerboard, &others[..2])?;
    }
    if let (Some(tint), None, None) = (&tint, map, &vertex_colors) {
        return Err(tint.error("belongs to a `texture` or to `vertex_colors`"));
    }
    let tint = tint.map_or(Ok(Rgb::WHITE), |f| f.rgb_in(0.0, limit))?;
    Ok(if let Some(rgb) = rgb {
        Some(Spectrum::Constant(rgb.rgb_in(0.0, limit)?))
    } else if let Some(field) = checkerboard {
        let colors = field.array()?;
        let [first, second] = colors.as_slice() else {
            return Err(field.error("expected two colours: [[r, g, b], [r, g, b]]"));
        };
        Some(Spectrum::Checkerboard(Checkerboard {
            to_uv: placement(table)?,
            colors: [first.rgb_in(0.0, limit)?, second.rgb_in(0.0, limit)?],
        }))
    } else if vertex_colors.is_some() {
        Some(Spectrum::VertexColor(map, tint))
    } else {
        map.map(|map| Spectrum::Bitmap(map, tint))
    })
}

/// The bitmap that a table's keys name and place; `None` without any.
pub(super) fn texture_map(table: &Table<'_>, role: RoleOf, context: &mut Context<'_>) -> Result<Option<TextureMap>> {
    let texture = table.get("texture");
    let encoding = table.get("encoding");
    let wrap = table.get("wrap");
    let filter = table.get("filter");
    let to_uv = placement(table)?;
    let Some(texture) = texture else {
        if let Some(field) = &encoding {
            return Err(field.error("belongs to a `texture`; `rgb` is always linear"));
        }
        if let Some(field) = wrap.or(filter) {
            return Err(field.error("belongs to a `texture`"));
        }
        let has_pattern = table.get("checkerboard").is_some();
        return match table.get("to_uv") {
            Some(field) if !has_pattern => Err(field.error("belongs to a `texture` or a `checkerboard`")),
            _ => Ok(None),
        };
    };
    let encoding = encoding
        .map(|f| f.word(&[("srgb", Encoding::Srgb), ("linear", Encoding::Linear)]))
        .transpose()?;
    Ok(Some(TextureMap {
        to_uv,
        wrap: wrap.map_or(Ok([Wrap::Repeat; 2]), |f| wraps(&f))?,
        filter: filter.map_or(Ok(Filter::Bilinear), |f| {
            f.word(&[("bilinear", Filter::Bilinear), ("nearest", Filter::Nearest)])
        })?,
        ..TextureMap::new(context.bitmap(texture.string()?, role(encoding)))
    }))
}

/// One word for both directions, or one each for columns and rows.
fn wraps(field: &Field<'_>) -> Result<[Wrap; 2]> {
    let word = |field: &Field<'_>| {
        field.word(&[
            ("repeat", Wrap::Repeat),
            ("mirror", Wrap::Mirror),
            ("clamp", Wrap::Clamp),
        ])
    };
    match field.array().as_deref() {
        Ok([across, up]) => Ok([word(across)?, word(up)?]),
        Ok(_) => Err(field.error("expected one word, or two: for columns and for rows")),
        Err(_) => word(field).map(|wrap| [wrap; 2]),
    }
}

/// A 2 × 3 matrix in rows.
fn placement(table: &Table<'_>) -> Result<Affine2> {
    let Some(field) = table.get("to_uv") else {
        return Ok(Affine2::IDENTITY);
    };
    let rows = field.array()?;
    let [u, v] = rows.as_slice() else {
        return Err(field.error(format!("expected 2 rows of 3 numbers, found {} rows", rows.len())));
    };
    let row = |row: &Field<'_>| -> Result<[f32; 3]> {
        for number in row.array().unwrap_or_default() {
            number.number_in(-MAX_PLACEMENT, MAX_PLACEMENT)?;
        }
        Ok(row.numbers::<3>()?.map(|c| c as f32))
    };
    let (u, v) = (row(u)?, row(v)?);
    let column = |i: usize| Vec2::new(u[i], v[i]);
    Ok(Affine2::from_cols(column(0), column(1), column(2)))
}

/// A colour as a value: a number for grey, three numbers, or a table as in [`colour`], with its `limit`.
pub(super) fn spectrum(field: &Field<'_>, limit: f64, role: RoleOf, context: &mut Context<'_>) -> Result<Spectrum> {
    if field.is_number() {
        return Ok(Spectrum::Constant(Rgb::splat(field.number_in(0.0, 1.0)? as f32)));
    }
    if field.is_array() {
        return Ok(Spectrum::Constant(field.rgb_in(0.0, 1.0)?));
    }
    let table = field
        .table()
        .map_err(|_| field.expected("a number, [r, g, b], or a table such as { texture = \"file\" }"))?;
    let spectrum = colour(&table, limit, role, context)?;
    table.finish()?;
    spectrum.ok_or_else(|| field.error("has neither `rgb`, `texture`, `checkerboard` nor `vertex_colors`"))
}

/// A number in [0, 1], or a table with a colour as in [`colour`] and a `channel` of it.
pub(super) fn scalar(field: &Field<'_>, context: &mut Context<'_>) -> Result<Scalar> {
    if field.is_number() {
        return Ok(Scalar::Constant(field.number_in(0.0, 1.0)? as f32));
    }
    let table = field
        .table()
        .map_err(|_| field.expected("a number, or a table such as { texture = \"file\", channel = \"g\" }"))?;
    let spectrum = colour(&table, 1.0, NUMBERS, context)?;
    let channel = table.get("channel").map_or(Ok(Channel::Mean), |f| {
        f.word(&[
            ("r", Channel::R),
            ("g", Channel::G),
            ("b", Channel::B),
            ("mean", Channel::Mean),
            ("luminance", Channel::Luminance),
        ])
    })?;
    table.finish()?;
    spectrum
        .map(|spectrum| Scalar::Varying(spectrum, channel))
        .ok_or_else(|| field.error("has neither `rgb`, `texture`, `checkerboard` nor `vertex_colors`"))
}
