//! Error measures between two images.
//!
//! A is the reference. All sums are in `f64`, over the pixels that are finite in both images; the others are counted and
//! left out of every number, so that a few bad pixels neither hide the rest nor pass for black ones. A caller that needs
//! sound images must look at the counts.

use serde::Serialize;

use super::Image;
use super::flip::hdr_flip;
use crate::math::Rgb;

/// Keeps the relative error of a black reference pixel finite.
pub const RELATIVE_OFFSET: f64 = 0.01;
/// The share of the pixels that the trimmed relMSE drops: fireflies, whose number says more about luck than about quality.
pub(crate) const TRIMMED_SHARE: f64 = 0.001;

/// What [`compare`] found. Every mean is NaN (null in JSON) if no pixel is finite in both images.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Mean of (a − b)² over pixels and channels; at least 0.
    pub mse: f64,
    /// Square root of `mse`, in the unit of the images.
    pub rmse: f64,
    /// Mean of (a − b)² / (a² + 0.01) over pixels and channels; at least 0.
    pub relmse: f64,
    /// `relmse` without the 0.1 % of the pixels, at least one, whose mean over the channels is largest. A single pixel is
    /// kept: there is nothing to trim it against.
    pub relmse_trimmed: f64,
    /// Mean of the reference per channel.
    pub mean_a: [f64; 3],
    /// Mean of the other image per channel.
    pub mean_b: [f64; 3],
    /// `mean_b` over `mean_a` per channel: 1 where the means are equal, infinite (null in JSON) where only A is black.
    pub mean_ratio: [f64; 3],
    /// Mean of HDR-FLIP with A as the reference, in [0, 1] ([`hdr_flip`]; pixels left out are black in both images there).
    pub flip: f64,
    /// Pixels of the reference with a channel that is NaN or infinite.
    pub nonfinite_a: usize,
    /// Pixels of the other image with a channel that is NaN or infinite.
    pub nonfinite_b: usize,
    /// Columns of both images.
    pub width: u32,
    /// Rows of both images.
    pub height: u32,
}

/// Why two images cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// The images differ in width or height.
    #[error("the images differ in size: the reference is {} x {}, the other {} x {}", a.0, a.1, b.0, b.1)]
    Sizes {
        /// Columns and rows of the reference.
        a: (u32, u32),
        /// Columns and rows of the other image.
        b: (u32, u32),
    },
}

/// Compares image `b` with the reference `a`, both linear Rec. 709.
///
/// # Errors
/// [`CompareError::Sizes`] if the images differ in size.
pub fn compare(a: &Image<Rgb>, b: &Image<Rgb>) -> Result<Comparison, CompareError> {
    if (a.width, a.height) != (b.width, b.height) {
        return Err(CompareError::Sizes {
            a: (a.width, a.height),
            b: (b.width, b.height),
        });
    }
    let errors = hdr_flip(a, b);
    let (mut squares, mut flip) = (0.0, 0.0);
    let (mut sum_a, mut sum_b) = ([0.0; 3], [0.0; 3]);
    let mut relative = Vec::with_capacity(a.pixels.len());
    for ((p, q), error) in a.pixels.iter().zip(&b.pixels).zip(&errors.pixels) {
        if !(p.is_finite() && q.is_finite()) {
            continue;
        }
        let mut pixel = 0.0;
        for c in 0..3 {
            let (p, q) = (f64::from(p[c]), f64::from(q[c]));
            let square = (p - q) * (p - q);
            squares += square;
            pixel += square / (p * p + RELATIVE_OFFSET);
            sum_a[c] += p;
            sum_b[c] += q;
        }
        relative.push(pixel / 3.0);
        flip += f64::from(*error);
    }
    let count = relative.len() as f64;
    let mse = squares / (3.0 * count);
    let (mean_a, mean_b) = (sum_a.map(|s| s / count), sum_b.map(|s| s / count));
    let nonfinite = |image: &Image<Rgb>| image.pixels.iter().filter(|p| !p.is_finite()).count();
    Ok(Comparison {
        mse,
        rmse: mse.sqrt(),
        relmse: mean(&relative),
        relmse_trimmed: trimmed_mean(&mut relative),
        mean_a,
        mean_b,
        mean_ratio: std::array::from_fn(|c| {
            // 0 / 0 would call two black images different.
            if mean_a[c] == mean_b[c] {
                1.0
            } else {
                mean_b[c] / mean_a[c]
            }
        }),
        flip: flip / count,
        nonfinite_a: nonfinite(a),
        nonfinite_b: nonfinite(b),
        width: a.width,
        height: a.height,
    })
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Mean without the largest `max(1, round(0.001 n))` of `values`, which are reordered.
fn trimmed_mean(values: &mut [f64]) -> f64 {
    if values.len() < 2 {
        return mean(values);
    }
    let dropped = ((TRIMMED_SHARE * values.len() as f64).round() as usize).max(1);
    let kept = values.len() - dropped;
    values.select_nth_unstable_by(kept, f64::total_cmp);
    mean(&values[..kept])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> Image<Rgb> {
        let mut image = Image::filled(width, height, Rgb::BLACK);
        for (i, p) in image.pixels.iter_mut().enumerate() {
            *p = Rgb::new(0.25, 1.0, 4.0) * ((i + 1) as f32 / 64.0);
        }
        image
    }

    fn assert_close(value: f64, expected: f64) {
        assert!((value - expected).abs() <= 1e-9 * expected.abs(), "{value} {expected}");
    }

    #[test]
    fn an_image_does_not_differ_from_itself() {
        let image = ramp(40, 30);
        let c = compare(&image, &image).expect("one size");
        assert_eq!(
            [c.mse, c.rmse, c.relmse, c.relmse_trimmed, c.flip],
            [0.0; 5],
            "every error is exactly zero"
        );
        assert_eq!(c.mean_a, c.mean_b);
        assert_eq!(c.mean_ratio, [1.0; 3]);
        assert_eq!((c.nonfinite_a, c.nonfinite_b, c.width, c.height), (0, 0, 40, 30));
    }

    /// With b = 2 a, (a − b)² is a²: on a flat image of 0.5, MSE = 0.25 and relMSE = 0.25 / 0.26.
    #[test]
    fn a_doubled_flat_image_has_the_errors_of_the_closed_form() {
        let a = Image::filled(30, 20, Rgb::splat(0.5));
        let b = Image::filled(30, 20, Rgb::splat(1.0));
        let c = compare(&a, &b).expect("one size");
        assert_close(c.mse, 0.25);
        assert_close(c.rmse, 0.5);
        assert_close(c.relmse, 0.25 / 0.26);
        assert_close(c.relmse_trimmed, 0.25 / 0.26);
        assert_eq!((c.mean_a, c.mean_b, c.mean_ratio), ([0.5; 3], [1.0; 3], [2.0; 3]));
    }

    /// b = 1.5 a: MSE is a quarter of the mean square, for a = k s / 64 with k from 1 to n that is s² (n + 1)(2n + 1) / 6 / 64².
    #[test]
    fn a_scaled_ramp_has_the_error_of_the_closed_form() {
        let a = ramp(16, 8);
        let mut b = a.clone();
        b.pixels.iter_mut().for_each(|p| *p *= 1.5);
        let c = compare(&a, &b).expect("one size");
        let scales = (0.0625 + 1.0 + 16.0) / 3.0;
        assert_close(c.mse, 0.25 * scales * 129.0 * 257.0 / 6.0 / 4096.0);
        assert_eq!(c.mean_ratio, [1.5; 3]);
        assert_close(c.mean_a[1], 129.0 / 2.0 / 64.0);
    }

    /// 2000 pixels: two are trimmed. Three are wrong, by 1, 2 and 3 in every channel of a black reference.
    #[test]
    fn trimming_drops_the_worst_thousandth_of_the_pixels() {
        let a = Image::filled(50, 40, Rgb::BLACK);
        let mut b = a.clone();
        for (pixel, error) in [(7, 3.0), (900, 1.0), (1999, 2.0)] {
            b.pixels[pixel] = Rgb::splat(error);
        }
        let c = compare(&a, &b).expect("one size");
        assert_close(c.relmse, (1.0 + 4.0 + 9.0) / 0.01 / 2000.0);
        assert_close(c.relmse_trimmed, 1.0 / 0.01 / 1998.0);
    }

    #[test]
    fn pixels_that_are_not_finite_are_counted_and_left_out() {
        let a = Image::filled(10, 10, Rgb::splat(0.5));
        let mut b = Image::filled(10, 10, Rgb::splat(0.75));
        let expected = compare(&a, &b).expect("one size");
        let mut bad_a = a.clone();
        bad_a.pixels[3].r = f32::INFINITY;
        b.pixels[3].g = f32::NAN;
        b.pixels[4].b = f32::NEG_INFINITY;
        let c = compare(&bad_a, &b).expect("one size");
        assert_eq!((c.nonfinite_a, c.nonfinite_b), (1, 2));
        assert_eq!(
            (c.mse, c.mean_a, c.mean_b),
            (expected.mse, expected.mean_a, expected.mean_b)
        );
        assert_close(c.relmse, expected.relmse);
        assert!(c.flip > 0.0 && c.flip < 1.0);
    }

    #[test]
    fn an_image_without_a_finite_pixel_has_no_error_rather_than_a_small_one() {
        let a = Image::filled(2, 2, Rgb::WHITE);
        let b = Image::filled(2, 2, Rgb::splat(f32::NAN));
        let c = compare(&a, &b).expect("one size");
        assert_eq!(c.nonfinite_b, 4);
        assert!(c.mse.is_nan() && c.relmse.is_nan() && c.relmse_trimmed.is_nan() && c.flip.is_nan());
    }

    #[test]
    fn one_pixel_and_black_images_are_compared() {
        let one = |v| Image::filled(1, 1, Rgb::splat(v));
        let c = compare(&one(0.5), &one(1.0)).expect("one size");
        assert_close(c.relmse, 0.25 / 0.26);
        assert_close(c.relmse_trimmed, c.relmse);
        let c = compare(&one(0.0), &one(0.0)).expect("one size");
        assert_eq!((c.mse, c.relmse, c.flip, c.mean_ratio), (0.0, 0.0, 0.0, [1.0; 3]));
        let c = compare(&one(0.0), &one(1.0)).expect("one size");
        assert_close(c.relmse, 100.0);
        assert_eq!(c.mean_ratio, [f64::INFINITY; 3]);
    }

    #[test]
    fn images_of_different_sizes_are_an_error_that_names_both() {
        let error = compare(&ramp(4, 3), &ramp(3, 4)).expect_err("sizes differ");
        assert_eq!(
            error.to_string(),
            "the images differ in size: the reference is 4 x 3, the other 3 x 4"
        );
    }

    #[test]
    fn the_json_object_has_the_documented_keys() {
        let c = compare(&ramp(2, 2), &ramp(2, 2)).expect("one size");
        let json = serde_json::to_value(&c).expect("numbers only");
        let mut keys: Vec<&str> = json
            .as_object()
            .expect("an object")
            .keys()
            .map(String::as_str)
            .collect();
        keys.sort_unstable();
        let mut expected = [
            "mse",
            "rmse",
            "relmse",
            "relmse_trimmed",
            "mean_a",
            "mean_b",
            "mean_ratio",
            "flip",
            "nonfinite_a",
            "nonfinite_b",
            "width",
            "height",
        ];
        expected.sort_unstable();
        assert_eq!(keys, expected);
    }
}
