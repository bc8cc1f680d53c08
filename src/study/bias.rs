//! Whether the mean of a setting is the reference, by images of several seeds of each.
//!
//! For a pixel of luminance x in n images of the setting and r in m images of the reference,
//!
//! (mean x − mean r)² − s²(x) / n − s²(r) / m     (1)
//!
//! has the square of the bias as its mean. Over the image, (1) with the weights of relMSE is what is left of the relMSE
//! however many samples are taken: its floor. Its error follows from the spreads of the pixels, which are independent of each
//! other: that of the two-sample test of means in many dimensions of Chen and Qin (2010, Annals of Statistics 38(2)), for
//! covariances that are diagonal. Rare bright samples enlarge the spread by the fourth power, so that the test grows
//! careful with them rather than wrong.

use super::measure::{Replications, luminance};
use super::reference::{REPLICATIONS, Reference};
use crate::image::compare::RELATIVE_OFFSET;
use serde::{Deserialize, Serialize};
use statrs::distribution::{ContinuousCDF, Normal};

/// Chance that any setting of a study without bias is flagged.
pub const SIGNIFICANCE: f64 = 0.01;

/// The estimate of a floor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// What remains of the relMSE of the luminance for infinitely many samples; below zero by chance alone.
    pub floor: f64,
    /// Standard error of that, if there is no bias.
    pub standard_error: f64,
    /// Chance of a floor as high as this without bias.
    pub p_value: f64,
}

/// The floor of a setting's error.
pub fn of(images: &Replications, reference: &Reference) -> Bias {
    let (n, m) = (f64::from(images.count()), f64::from(REPLICATIONS));
    let (mut floor, mut variance) = (0.0, 0.0);
    let (means, variances) = (images.mean(), images.variance_of_mean());
    for (i, (mean, spread)) in means.iter().zip(&variances).enumerate() {
        let expected = luminance(reference.pixels.values[i]);
        let weight = 1.0 / (expected * expected + RELATIVE_OFFSET);
        let difference = luminance(*mean) - expected;
        let of_image = spread[3];
        let of_reference = reference.noise.as_ref().map_or(0.0, |(_, variance)| variance[i]);
        floor += weight * (difference * difference - of_image - of_reference);
        // 2 s⁴ / (n (n − 1)) in terms of the variance of the mean, s² / n.
        variance += weight
            * weight
            * (2.0 * of_image * of_image * n / (n - 1.0)
                + 2.0 * of_reference * of_reference * m / (m - 1.0)
                + 4.0 * of_image * of_reference);
    }
    let pixels = means.len() as f64;
    let (floor, standard_error) = (floor / pixels, variance.sqrt() / pixels);
    // Rounding of f32 images: a floor below 1e-12 is none.
    let z = (floor - 1e-12) / standard_error.max(f64::MIN_POSITIVE);
    Bias {
        floor,
        standard_error,
        p_value: Normal::standard().sf(z),
    }
}

impl Bias {
    /// Whether the floor is there, among `tests` tests of a study (Šidák).
    pub fn is_significant(&self, tests: usize) -> bool {
        self.p_value < 1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests.max(1) as f64)
    }

    /// A floor that the true one is below with 95 % confidence.
    pub fn upper_bound(&self) -> f64 {
        self.floor.max(0.0) + 1.645 * self.standard_error
    }
}
