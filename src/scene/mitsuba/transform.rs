//! The parts of a transform.

use super::xml_value::{number, numbers, parts, triple};
use crate::math::{Affine2, DAffine3, DMat3, DMat4, DVec3, Vec2};

/// The attributes of an element within a transform.
pub(super) fn attributes(element: &str) -> Option<&'static [&'static str]> {
    Some(match element {
        "translate" | "scale" => &["value", "x", "y", "z"],
        "rotate" => &["value", "x", "y", "z", "!angle"],
        "lookat" => &["!origin", "!target", "up"],
        "matrix" => &["!value"],
        _ => return None,
    })
}

/// The matrix of one such element.
pub(super) fn step<'a>(element: &str, get: impl Fn(&str) -> Option<&'a str>) -> Result<DMat4, String> {
    let of = |name| get(name).unwrap_or_default();
    match element {
        "translate" => Ok(DMat4::from_translation(vector(get, Some(0.0))?)),
        "scale" => Ok(DMat4::from_scale(vector(get, Some(1.0))?)),
        "rotate" => {
            let angle = number(of("angle"))?;
            let axis = vector(get, Some(0.0))?;
            let axis = axis.try_normalize().ok_or("the axis has no length")?;
            Ok(DMat4::from_axis_angle(axis, angle.to_radians()))
        }
        "lookat" => {
            let [origin, target] = ["origin", "target"].map(|name| numbers::<3>(of(name)).map(DVec3::from));
            let (origin, target) = (origin?, target?);
            let up = get("up").map_or(Ok(DVec3::ZERO), |up| numbers::<3>(up).map(DVec3::from))?;
            let forward = (target - origin)
                .try_normalize()
                .ok_or("`origin` and `target` are the same point")?;
            let up = up.try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
            let left = up.cross(forward);
            if left.length() < 1e-9 {
                return Err("`up` is parallel to the view".into());
            }
            let left = left.normalize();
            let rotation = DMat3::from_cols(left, forward.cross(left), forward);
            Ok(DMat4::from(DAffine3::from_mat3_translation(rotation, origin)))
        }
        // The caller has asked for the attributes of the same element.
        _ if parts(of("value")).count() == 9 => {
            let rows = numbers::<9>(of("value"))?;
            Ok(DMat4::from_mat3(DMat3::from_cols_array(&rows).transpose()))
        }
        _ => {
            let rows = numbers::<16>(of("value")).map_err(|problem| problem.replace("16", "9 or 16"))?;
            Ok(DMat4::from_cols_array(&rows).transpose())
        }
    }
}

/// `value`, or `x`, `y` and `z`, which are all required unless there is a default.
pub(super) fn vector<'a>(get: impl Fn(&str) -> Option<&'a str>, default: Option<f64>) -> Result<DVec3, String> {
    let components = ["x", "y", "z"].map(&get);
    if let Some(value) = get("value") {
        return if components.iter().any(Option::is_some) {
            Err("has `value` as well as `x`, `y` or `z`; expected one of the forms".into())
        } else {
            triple(value)
        };
    }
    let component = |k: usize| match (components[k], default) {
        (Some(text), _) => number(text),
        (None, Some(default)) => Ok(default),
        (None, None) => Err("expected `value`, or `x`, `y` and `z`".to_owned()),
    };
    Ok(DVec3::new(component(0)?, component(1)?, component(2)?))
}

/// A transform of space: no perspective, and invertible.
pub(super) fn affine(matrix: &DMat4) -> Result<DAffine3, String> {
    if matrix.row(3) != glam::DVec4::W {
        return Err("is not affine: the last row of the matrix is not 0 0 0 1".into());
    }
    let affine = DAffine3::from_mat4(*matrix);
    let sizes = affine.matrix3.x_axis.length() * affine.matrix3.y_axis.length() * affine.matrix3.z_axis.length();
    if affine.matrix3.determinant().abs() > 1e-12 * sizes {
        Ok(affine)
    } else {
        Err("is not invertible: it flattens what it is applied to".into())
    }
}

/// A transform of texture coordinates: what it does to x and y.
pub(super) fn of_uv(matrix: &DMat4) -> Affine2 {
    let v = |a: f64, b: f64| Vec2::new(a as f32, b as f32);
    Affine2::from_cols(
        v(matrix.x_axis.x, matrix.x_axis.y),
        v(matrix.y_axis.x, matrix.y_axis.y),
        v(matrix.w_axis.x, matrix.w_axis.y),
    )
}
