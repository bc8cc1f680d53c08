//! The error of an image, told from the image itself.
//!
//! Samples of a pixel are stratified against each other: their mean is better than that of independent samples, and their
//! variance does not tell by how much. So the samplers make two sequences for each pixel, which are independent of each
//! other. Half of the difference of their means has the variance of the mean of all samples (independent replications of
//! a randomised quasi-Monte Carlo rule; Owen 1997, "Monte Carlo variance of scrambled net quadrature"). With two
//! replications this is good for nothing in one pixel, but over all pixels it is as good as knowing the truth.

use crate::film::Film;
use crate::image::Image;
use crate::image::compare::RELATIVE_OFFSET;
use crate::math::Rgb;
use rayon::prelude::*;
use serde::Serialize;

/// Of the standard normal distribution, for 95 % between the two ends.
const QUANTILE: f64 = 1.96;

/// Variance of a squared error over its mean square where errors are normal, as they nearly are relative to what pixels should be.
const NORMAL_SPREAD: f64 = 2.0 / 3.0;

/// The most that it can be: where few errors are most of it, as in bright pixels.
const MOST_SPREAD: f64 = 1.0;

/// Pixels to each side that tell what a pixel may be.
const REACH: u32 = 2;

/// From so many standard errors on, a pixel beside another is clearly something else. They are estimated from two numbers each,
/// and often too small.
const SOMETHING_ELSE: f64 = 6.0;

/// An estimate and where the truth lies in 95 of 100 cases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Interval {
    /// The estimate.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// Of the mean of many squared errors, estimated one by one. `spread`: the variance of one over its mean square.
    fn of_mean(estimates: impl Iterator<Item = f64>, spread: f64) -> Interval {
        let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for x in estimates {
            count += 1.0;
            sum += x;
            squares += x * x;
        }
        // Both the estimates and the truth vary, independently of each other. On a logarithmic scale, because few large ones count
        // most.
        let relative = (2.0 * spread * squares).sqrt() / f64::max(sum, f64::MIN_POSITIVE);
        let factor = (QUANTILE * relative).exp();
        let value = sum / count;
        Interval {
            value,
            low: value / factor,
            high: value * factor,
        }
    }

    /// Estimate, lower and upper end.
    pub fn to_array(self) -> [f64; 3] {
        [self.value, self.low, self.high]
    }

    fn map(self, f: impl Fn(f64) -> f64) -> Interval {
        Interval {
            value: f(self.value),
            low: f(self.low),
            high: f(self.high),
        }
    }
}

/// The error of an image, against that of infinitely many samples: what [`crate::image::compare::compare`] would find.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorEstimate {
    /// Mean over pixels and channels of the squared error over the square of the true value plus 0.01.
    pub relmse: Interval,
    /// Mean over pixels and channels of the squared error.
    pub mse: Interval,
}

impl ErrorEstimate {
    /// Square root of the mean squared error, in the unit of the image.
    pub fn rmse(&self) -> Interval {
        self.mse.map(f64::sqrt)
    }

    /// Square root of the mean squared relative error.
    pub fn relative_rmse(&self) -> Interval {
        self.relmse.map(f64::sqrt)
    }
}

/// The error of the image that a film makes, whose sampler has independent halves; `None` if a pixel has fewer than two
/// samples.
pub fn estimate(film: &Film) -> Option<ErrorEstimate> {
    if film.sample_range().0 < 2 {
        return None;
    }
    let mean = film.develop();
    // Standard errors, because squares may leave the range of f32.
    let deviation = film.map(|pixel| Rgb::from(pixel.variance().map(f64::sqrt)));
    let sees_light = film.map(|pixel| pixel.sees_light);
    let rows = (0..mean.height).into_par_iter();
    // By the smaller weight, by one between the two, by the larger one.
    let relative: Vec<[f64; 3]> = rows
        .flat_map_iter(|y| (0..mean.width).map(move |x| (x, y)))
        .map(|(x, y)| {
            let [a, b] = weights(&mean, &deviation, *sees_light.at(x, y), [x, y]);
            let of = |w: fn(f64, f64) -> f64| sum_of_squares(*deviation.at(x, y), [0, 1, 2].map(|c| w(a[c], b[c])));
            [of(f64::min), of(|a, b| (a * b).sqrt()), of(f64::max)]
        })
        .collect();
    let [low, value, high] = [0, 1, 2].map(|k| Interval::of_mean(relative.iter().map(|of| of[k]), NORMAL_SPREAD));
    let absolute = deviation.pixels.iter().map(|d| sum_of_squares(*d, [1.0; 3]));
    Some(ErrorEstimate {
        relmse: Interval {
            value: value.value,
            low: low.low,
            high: high.high,
        },
        mse: Interval::of_mean(absolute, MOST_SPREAD),
    })
}

/// Mean over the channels of weighted squares.
fn sum_of_squares(x: Rgb, weight: [f64; 3]) -> f64 {
    (0..3).map(|c| f64::from(x[c]).powi(2) * weight[c]).sum::<f64>() / 3.0
}

/// The weight of a squared error in the relative one, by the true value.
fn weight(value: f64) -> f64 {
    1.0 / (value * value + RELATIVE_OFFSET)
}

/// Two guesses at that for a pixel whose true value is not known. Its own mean says little where it is noise, and goes with
/// the estimate of the variance. So what is around it is taken, as far as its own mean does not differ clearly from that:
/// once all of it and the pixel, as if a bright one were one of many there; and once without the pixel, as if it were an
/// accident, and without what is clearly something else, such as a lamp beside it. Which of the two it is, no image tells. One
/// that sees a light is an accident hardly ever, but may be the edge of a small lamp: it is taken for what it is once, and once
/// as one among the others.
fn weights(mean: &Image<Rgb>, deviation: &Image<Rgb>, sees_light: bool, [x, y]: [u32; 2]) -> [[f64; 3]; 2] {
    let around = |x: u32, end: u32| x.saturating_sub(REACH)..(x + REACH + 1).min(end);
    let own = mean.at(x, y).to_array().map(f64::from);
    let noise = deviation.at(x, y).to_array().map(|d| f64::from(d).powi(2));
    let (mut count, mut sum) = (0.0, [0.0; 3]);
    let (mut alike_count, mut alike_sum) = ([0.0; 3], [0.0; 3]);
    for other_y in around(y, mean.height) {
        for other_x in around(x, mean.width) {
            let (other, its_deviation) = (mean.at(other_x, other_y), deviation.at(other_x, other_y));
            count += 1.0;
            for c in 0..3 {
                let value = f64::from(other[c]);
                sum[c] += value;
                let variance = noise[c] + f64::from(its_deviation[c]).powi(2);
                if (other_x, other_y) != (x, y)
                    && (value - own[c]).powi(2) <= SOMETHING_ELSE * SOMETHING_ELSE * variance
                {
                    alike_count[c] += 1.0;
                    alike_sum[c] += value;
                }
            }
        }
    }
    let among_others = sum.map(|s| s / count);
    let others = [0, 1, 2].map(|c| {
        if alike_count[c] > 0.0 {
            alike_sum[c] / alike_count[c]
        } else {
            own[c]
        }
    });
    let guesses = if sees_light {
        [own, among_others]
    } else {
        [among_others, others]
    };
    guesses.map(|guess| {
        [0, 1, 2].map(|c| {
            let difference = (own[c] - guess[c]).powi(2);
            // Within two standard errors nothing is clear.
            let share = if difference > 4.0 * noise[c] {
                1.0 - 4.0 * noise[c] / difference
            } else {
                0.0
            };
            weight(guess[c] + share * (own[c] - guess[c]))
        })
    })
}
