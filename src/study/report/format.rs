//! Numbers as people read them.

use crate::study::analysis::{Estimate, Slope};

/// Three significant digits; powers of ten where that is shorter.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        return "–".into();
    }
    if size == 0.0 {
        return "0".into();
    }
    if (0.001..100_000.0).contains(&size) {
        let digits = (2 - size.log10().floor() as i32).max(0) as usize;
        return format!("{value:.digits$}").replace('-', "−");
    }
    let exponent = size.log10().floor() as i32;
    format!("{:.2}·10{}", value / 10f64.powi(exponent), superscript(exponent)).replace('-', "−")
}

/// A number with its standard error, to the digits that the error leaves.
pub(super) fn estimate(estimate: Estimate) -> String {
    let (mean, error) = (estimate.mean, estimate.standard_error);
    if !(error > 0.0 && mean.is_finite() && error.is_finite()) {
        return number(mean);
    }
    let largest = mean.abs().max(error);
    let exponent = largest.log10().floor() as i32;
    let (scale, power) = if (-3..5).contains(&exponent) {
        (1.0, String::new())
    } else {
        (10f64.powi(exponent), format!("·10{}", superscript(exponent)))
    };
    let digits = (1 - (error / scale).log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{:.digits$} ± {:.digits$}", mean / scale, error / scale).replace('-', "−");
    if power.is_empty() {
        text
    } else {
        format!("({text}){power}")
    }
}

/// The exponent with its error.
pub(super) fn slope(slope: Option<Slope>) -> String {
    slope.map_or("–".into(), |s| estimate(s.slope))
}

/// As a factor.
pub(super) fn times(value: f64) -> String {
    format!("{} ×", number(value))
}

/// A count of entries or bytes, by powers of ten.
pub(super) fn power(value: u64) -> String {
    let exponent = value.checked_ilog10().unwrap_or(0);
    if value == 10u64.pow(exponent) && exponent > 3 {
        return format!("10{}", superscript(exponent as i32));
    }
    value.to_string()
}

/// Bytes with a binary unit.
pub(super) fn bytes(value: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB"];
    let unit = (value.max(1).ilog2() / 10).min(3);
    format!(
        "{} {}",
        number(value as f64 / f64::from(1u32 << (10 * unit))),
        units[unit as usize]
    )
}

/// An exponent.
pub(in crate::study) fn superscript(exponent: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        _ => c
            .to_digit(10)
            .and_then(|d| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().nth(d as usize))
            .unwrap_or(c),
    };
    exponent.to_string().chars().map(digit).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_errors_set_their_digits() {
        for (value, text) in [
            (0.0, "0"),
            (1234.5, "1234"),
            (0.012345, "0.0123"),
            (-2.0, "−2.00"),
            (1.5e-7, "1.50·10⁻⁷"),
            (f64::INFINITY, "–"),
        ] {
            assert_eq!(number(value), text);
        }
        let with = |mean, standard_error| estimate(Estimate { mean, standard_error });
        assert_eq!(with(1.2344, 0.021), "1.234 ± 0.021");
        assert_eq!(with(1.2344e-6, 2.1e-8), "(1.234 ± 0.021)·10⁻⁶");
        assert_eq!(with(-1.0, 0.0), "−1.00");
        assert_eq!(bytes(8_000_000), "7.63 MiB");
        assert_eq!(power(1_000_000), "10⁶");
    }
}
