//! The distribution of differences, and what is wrong with it.

use super::parting::Cause;
use super::{Pixel, SPP, VISIBLE};
use crate::support::{Estimate, Significance};
use statrs::distribution::{DiscreteCDF, Poisson};
use std::fmt;

/// Rays of a path whose decisions matter: four vertices, a bounce and a shadow ray each.
const RAYS: f64 = 8.0;

/// Figures of one comparison.
pub(super) struct Report {
    /// Of pixels, ascending.
    differences: Vec<f64>,
    /// Mean over pixels and channels, in f64, and in f32 with the error of the difference.
    wide: f64,
    narrow: Estimate,
    samples: usize,
    causes: [usize; Cause::ALL.len()],
    /// Pixels with a visible difference: a sentence each.
    visible: Vec<String>,
}

impl Report {
    pub(super) fn new(pixels: &[Pixel]) -> Report {
        let mut differences: Vec<f64> = pixels.iter().map(Pixel::relative_difference).collect();
        differences.sort_by(f64::total_cmp);
        let wide = pixels.iter().map(|p| p.wide.element_sum() / 3.0).sum::<f64>() / pixels.len() as f64;
        let signed: Vec<f64> = pixels.iter().map(|p| (p.narrow - p.wide).element_sum() / 3.0).collect();
        let difference = Estimate::of(&signed);
        let samples = || pixels.iter().flat_map(|p| &p.samples);
        let visible = pixels.iter().filter(|p| p.relative_difference() > VISIBLE);
        Report {
            differences,
            wide,
            narrow: Estimate {
                mean: wide + difference.mean,
                ..difference
            },
            samples: samples().count(),
            causes: Cause::ALL.map(|cause| samples().filter(|s| s.parting.cause == cause).count()),
            visible: visible.map(describe).collect(),
        }
    }

    fn quantile(&self, share: f64) -> f64 {
        self.differences[((self.differences.len() - 1) as f64 * share).round() as usize]
    }

    /// Sentences about all that rounding does not explain. `offset` is how far rays start off a surface, over the size of
    /// what is in the scene.
    pub(super) fn problems(&self, pixels: &[Pixel], offset: f64) -> Vec<String> {
        let mut problems = Vec::new();
        // No bias: paired differences, whose pixels are independent of each other, against the rounding of a mean and the
        // distance by which all rays start too far out.
        let half = Significance::TEST.split(2);
        let shift = offset * self.wide;
        let excess = ((self.narrow.mean - self.wide).abs() - shift).max(0.0);
        let p = Estimate {
            mean: self.wide + excess,
            ..self.narrow
        }
        .p_value(&Estimate::exact(self.wide));
        if p < half.0 {
            problems.push(format!(
                "a bias of {:.1e}, p = {p:.1e}",
                self.narrow.mean / self.wide - 1.0
            ));
        }
        // A vertex that is moved by the offset changes a cosine, a squared distance and a lobe by a few times as much; a
        // path has about four.
        let median = self.quantile(0.5);
        if median > 16.0 * offset {
            problems.push(format!("a median of {median:.1e}, above 16 x {offset:.1e}"));
        }
        // A ray changes its mind where it passes a border by less than the offset, to either side; borders are about as
        // long as the scene is large. One sample that does so is enough.
        let expected = (pixels.len() as f64 * f64::from(SPP) * RAYS * 2.0 * offset).min(pixels.len() as f64);
        let visible = self.visible.len() as u64;
        let p = match visible {
            0 => 1.0,
            _ => Poisson::new(expected).expect("a positive mean").sf(visible - 1),
        };
        if p < half.0 {
            problems.push(format!("{visible} pixels that differ visibly, where {expected:.1} may"));
        }
        for sample in pixels.iter().flat_map(|p| &p.samples).filter(|s| !s.parting.close) {
            problems.push(format!(
                "{:?} parts where it should not: {:?}",
                sample.id, sample.parting
            ));
        }
        let unexplained = |p: &&Pixel| p.relative_difference() > VISIBLE && p.unexplained_difference() > VISIBLE;
        for pixel in pixels.iter().filter(unexplained) {
            problems.push(format!("not explained: {}", describe(pixel)));
        }
        problems
    }
}

/// Where a pixel's largest difference comes from.
fn describe(pixel: &Pixel) -> String {
    let worst = pixel.culprit();
    format!(
        "column {}, row {}: {:.1} %, in sample {} by {:?} after {} bounces, rays apart by {:.0e}",
        worst.id.x,
        worst.id.y,
        100.0 * pixel.relative_difference(),
        worst.id.sample,
        worst.parting.cause,
        worst.parting.bounce,
        worst.parting.drift,
    )
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(
            f,
            "median {:.1e}, 90 % {:.1e}, ",
            self.quantile(0.5),
            self.quantile(0.9)
        )?;
        write!(
            f,
            "99 % {:.1e}, largest {:.1e}; ",
            self.quantile(0.99),
            self.quantile(1.0)
        )?;
        let bias = self.narrow.mean / self.wide - 1.0;
        let error = self.narrow.standard_error / self.wide;
        write!(f, "mean {bias:+.1e} ± {error:.1e} (z = {:.1}); ", bias / error)?;
        let all = self.differences.len();
        write!(f, "{} of {all} pixels over {} %; ", self.visible.len(), 100.0 * VISIBLE)?;
        write!(f, "of {} samples part", self.samples)?;
        for (cause, count) in Cause::ALL.iter().zip(self.causes) {
            if *cause != Cause::Rounding {
                write!(f, " {cause:?} {count}")?;
            }
        }
        self.visible.iter().try_for_each(|pixel| write!(f, "\n    {pixel}"))
    }
}
