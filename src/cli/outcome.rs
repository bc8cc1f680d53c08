//! How a render ended, and whether that is what was asked for.

use super::budget::Budget;
use crate::error::ErrorEstimate;
use crate::render::ErrorControl;
use serde::Serialize;
use std::fmt::Write as _;

/// What ended a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Ending {
    /// All samples were taken.
    Spp,
    /// The error is at the target.
    Noise,
    /// Time was up.
    Time,
    /// A signal.
    Signal,
}

/// What there is at the end of a render.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outcome {
    /// The fewest samples of a pixel, and the most.
    pub(super) samples: (u32, u32),
    /// Samples of a pixel on average.
    pub(super) mean_samples: f64,
    /// The error, if it was estimated.
    pub(super) error: Option<ErrorEstimate>,
    /// The exit code of the signal that came, if one did.
    pub(super) signal: Option<u8>,
}

impl Outcome {
    /// What ended the render.
    pub(super) fn ending(&self, budget: &Budget) -> Ending {
        if self.target(budget).is_some_and(|target| self.relative_rmse() <= target) {
            Ending::Noise
        } else if self.samples.0 == budget.spp {
            Ending::Spp
        } else if self.signal.is_some() {
            Ending::Signal
        } else {
            Ending::Time
        }
    }

    /// The exit code: 5 if a target was not reached.
    pub(super) fn exit_code(&self, budget: &Budget) -> u8 {
        let is_reached = match self.ending(budget) {
            Ending::Noise => true,
            Ending::Spp => self.target(budget).is_none(),
            Ending::Time => self.target(budget).is_none() && self.samples.0 > 0,
            Ending::Signal => return self.signal.unwrap_or(1),
        };
        if is_reached { 0 } else { 5 }
    }

    /// The same for people: lines for standard error.
    pub(super) fn describe(&self, budget: &Budget) -> String {
        let (fewest, most) = self.samples;
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = match self.ending(budget) {
            Ending::Signal => writeln!(
                text,
                "interrupted: the image has {fewest} to {most} of {} samples per pixel",
                budget.spp
            ),
            _ if fewest == 0 => writeln!(
                text,
                "warning: time was up before every pixel had a sample; the others are black"
            ),
            _ => Ok(()),
        };
        if let Some(error) = &self.error {
            let _ = write!(text, "Estimated error: {}", percent(error));
            let _ = match self.target(budget) {
                Some(target) if self.relative_rmse() > target => {
                    writeln!(text, "; the target --noise {target} is not reached")
                }
                _ => writeln!(text),
            };
        }
        if fewest != most || budget.is_open() {
            let _ = writeln!(
                text,
                "Samples per pixel: {fewest} to {most}, {:.1} on average",
                self.mean_samples
            );
        }
        text
    }

    fn target(&self, budget: &Budget) -> Option<f64> {
        match budget.error {
            ErrorControl::Bounded(target) => Some(target.relative_rmse),
            _ => None,
        }
    }

    fn relative_rmse(&self) -> f64 {
        self.error.map_or(f64::INFINITY, |error| error.relative_rmse().value)
    }
}

fn percent(error: &ErrorEstimate) -> String {
    let relative = error.relative_rmse();
    let [value, low, high] = relative.to_array().map(|e| 100.0 * e);
    format!(
        "{value:.3} % relative RMSE (95 %: {low:.3} to {high:.3}), RMSE {:.3e}",
        error.rmse().value
    )
}
