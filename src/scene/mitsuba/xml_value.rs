//! Values in attributes.

use crate::math::DVec3;

/// The parts of a list, which blanks and commas separate.
pub(super) fn parts(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| c.is_whitespace() || c == ',')
        .filter(|part| !part.is_empty())
}

pub(super) fn number(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("\"{}\" is not a finite number", excerpt(text))),
    }
}

pub(super) fn integer(text: &str) -> Result<i64, String> {
    text.trim()
        .parse()
        .map_err(|_| format!("\"{}\" is not a whole number", excerpt(text)))
}

pub(super) fn boolean(text: &str) -> Result<bool, String> {
    match text {
        _ if text.eq_ignore_ascii_case("true") => Ok(true),
        _ if text.eq_ignore_ascii_case("false") => Ok(false),
        _ => Err(format!("\"{}\" is neither true nor false", excerpt(text))),
    }
}

/// Exactly `N` numbers.
pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values = parts(text).map(number).collect::<Result<Vec<f64>, String>>()?;
    let count = values.len();
    <[f64; N]>::try_from(values).map_err(|_| format!("has {count} numbers; expected {N}"))
}

/// Three numbers, or one that stands for three.
pub(super) fn triple(text: &str) -> Result<DVec3, String> {
    match parts(text).count() {
        1 => number(text.trim_matches(|c: char| c.is_whitespace() || c == ',')).map(DVec3::splat),
        _ => numbers::<3>(text)
            .map(DVec3::from)
            .map_err(|problem| problem.replace("expected 3", "expected 1 or 3")),
    }
}

/// Enough of a text for a message.
pub(super) fn excerpt(text: &str) -> String {
    if text.chars().count() > 40 {
        text.chars().take(37).chain("...".chars()).collect()
    } else {
        text.to_owned()
    }
}
