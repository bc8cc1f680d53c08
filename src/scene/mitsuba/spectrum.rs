//! Spectra, and what they are in linear Rec. 709 RGB.

use super::tables::{OBSERVER, OBSERVER_START, OBSERVER_STEP};
use super::xml_value::{excerpt, number, parts};
use crate::math::{DMat3, DVec3};

/// A spectrum as it is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SpectrumValue {
    /// The same at all wavelengths.
    Uniform(f64),
    /// Wavelengths [nm], which grow, and values; at least two. Linear between, zero outside.
    Samples(Vec<[f64; 2]>),
}

/// Luminance of a spectrum of one is one.
const Y_SCALE: f64 = 1.0 / 106.750_259_399_414_06;

/// Luminance of the illuminant D65 is one.
const D65_SCALE: f64 = 1.0 / 98.997_417_518_762_55;

/// Wavelengths that the integral is a sum over, evenly from the first of the observer's to its last.
const STEPS: usize = 1000;

impl SpectrumValue {
    /// A number, or a list of `wavelength:value`.
    pub(super) fn parse(text: &str) -> Result<SpectrumValue, String> {
        if parts(text).count() == 1 && !text.contains(':') {
            return number(text).map(SpectrumValue::Uniform);
        }
        let pair = |part: &str| match part.split_once(':') {
            Some((wavelength, value)) => Ok([number(wavelength)?, number(value)?]),
            None => Err(format!("\"{}\" is not of the form wavelength:value", excerpt(part))),
        };
        SpectrumValue::samples(parts(text).map(pair).collect::<Result<_, _>>()?)
    }

    /// A file of lines with a wavelength and a value each; `#` begins a comment.
    pub(super) fn parse_file(text: &str) -> Result<SpectrumValue, String> {
        let lines = text
            .lines()
            .map(str::trim)
            .filter(|line| !line.is_empty() && !line.starts_with('#'));
        let pair = |line: &str| match super::xml_value::numbers::<2>(line) {
            Ok(pair) => Ok(pair),
            Err(_) => Err(format!(
                "its file has a line \"{}\"; expected a wavelength and a value",
                excerpt(line)
            )),
        };
        SpectrumValue::samples(lines.map(pair).collect::<Result<_, _>>()?)
    }

    fn samples(samples: Vec<[f64; 2]>) -> Result<SpectrumValue, String> {
        if samples.len() < 2 {
            return Err("has fewer than two wavelengths".into());
        }
        if samples.windows(2).any(|pair| pair[1][0] <= pair[0][0]) {
            return Err("has wavelengths that do not grow".into());
        }
        Ok(SpectrumValue::Samples(samples))
    }

    /// The colour of a surface that reflects or refracts so, under D65; components may lie outside [0, 1].
    pub(super) fn surface(&self) -> DVec3 {
        match self {
            SpectrumValue::Uniform(value) => DVec3::splat(*value),
            SpectrumValue::Samples(samples) => rgb(integrate(samples, true)),
        }
    }

    /// The colour of a light that emits so; components may be negative.
    pub(super) fn emission(&self) -> DVec3 {
        match self {
            // Equal energy at all wavelengths is not the white of Rec. 709.
            SpectrumValue::Uniform(value) => rgb(DVec3::ONE) * *value,
            SpectrumValue::Samples(samples) => rgb(integrate(samples, false)),
        }
    }
}

/// Linear Rec. 709 RGB of CIE XYZ.
fn rgb(xyz: DVec3) -> DVec3 {
    DMat3::from_cols(
        DVec3::new(3.240_479, -0.969_256, 0.055_648),
        DVec3::new(-1.537_150, 1.875_991, -0.204_043),
        DVec3::new(-0.498_535, 0.041_556, 1.057_311),
    ) * xyz
}

/// CIE XYZ of a spectrum, or of what reflects D65 so.
fn integrate(samples: &[[f64; 2]], under_d65: bool) -> DVec3 {
    let range = OBSERVER_STEP * (OBSERVER.len() - 1) as f64;
    let mut sum = DVec3::ZERO;
    for step in 0..STEPS {
        let wavelength = OBSERVER_START + range * step as f64 / (STEPS - 1) as f64;
        let after = samples
            .partition_point(|[w, _]| *w <= wavelength)
            .min(samples.len() - 1);
        if after == 0 || wavelength > samples[after][0] {
            continue;
        }
        let ([w0, v0], [w1, v1]) = (samples[after - 1], samples[after]);
        let value = v0 + (v1 - v0) * (wavelength - w0) / (w1 - w0);
        let position = (wavelength - OBSERVER_START) / OBSERVER_STEP;
        let row = (position as usize).min(OBSERVER.len() - 2);
        let fraction = position - row as f64;
        let column = |k: usize| OBSERVER[row][k] + (OBSERVER[row + 1][k] - OBSERVER[row][k]) * fraction;
        let illuminant = if under_d65 { column(3) * D65_SCALE } else { 1.0 };
        sum += DVec3::new(column(0), column(1), column(2)) * (value * illuminant);
    }
    sum * (range * Y_SCALE / STEPS as f64)
}
