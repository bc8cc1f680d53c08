//! From cells to answers: how fast errors fall, what is left of them, and which setting is best for a given time.

use super::bias::Bias;
use super::cell::Cell;
use super::measure::WorstPixel;
use super::reference::Noise;
use serde::Serialize;

/// A cell's error counts while it is at least so many times the reference's noise: below, it tells of the reference.
const ABOVE_NOISE: f64 = 2.0;

/// A slope counts beyond the measurements if its standard error is at most this; otherwise errors fall as those of
/// independent samples do, which is what all settings come to in the end.
const TRUSTED_SLOPE_ERROR: f64 = 0.1;

/// Times that the report answers for (s).
pub const BUDGETS: [f64; 3] = [1.0, 10.0, 100.0];

/// A number with its uncertainty.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// The mean over seeds.
    pub mean: f64,
    /// Its standard error.
    pub standard_error: f64,
}

impl Estimate {
    /// Of independent values.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Estimate {
        let values: Vec<f64> = values.into_iter().collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
        Estimate {
            mean,
            standard_error: (squares / (n * (n - 1.0).max(1.0))).sqrt(),
        }
    }
}

/// A cell in numbers. Errors are less the reference's noise.
#[derive(Clone, Debug, Serialize)]
pub struct Point {
    /// Samples per pixel.
    pub spp: u32,
    /// Time to render (s).
    pub seconds: Estimate,
    /// Time to build tables and tree (s).
    pub build_seconds: f64,
    /// Mean squared error.
    pub mse: Estimate,
    /// Relative mean squared error.
    pub relmse: Estimate,
    /// The same without the worst 0.1 % of the pixels; the reference's noise is in it.
    pub relmse_trimmed: Estimate,
    /// Mean luminance over the reference's.
    pub mean_ratio: Estimate,
    /// HDR-FLIP of the first image.
    pub flip: f64,
    /// Fireflies of an image.
    pub fireflies: Estimate,
    /// The worst pixel of all images.
    pub worst: WorstPixel,
    /// Samples of all images that were not finite.
    pub dropped: u64,
    /// Whether the error is well above the reference's noise, and so counts in fits.
    pub is_above_noise: bool,
    /// What the mean of all images says.
    pub bias: Bias,
}

impl Point {
    /// From a cell.
    pub fn of(cell: &Cell, noise: Noise) -> Point {
        let over = |f: &dyn Fn(&super::cell::Run) -> f64| Estimate::of(cell.runs.iter().map(f));
        let relmse = over(&|run| run.errors.relmse - noise.relmse);
        let off = |worst: &WorstPixel| (worst.luminance - worst.reference).abs();
        let worst = cell.runs.iter().map(|run| run.errors.worst);
        Point {
            spp: cell.spp,
            seconds: over(&|run| run.seconds),
            build_seconds: cell.build_seconds,
            mse: over(&|run| run.errors.mse - noise.mse),
            relmse_trimmed: over(&|run| run.errors.relmse_trimmed),
            mean_ratio: over(&|run| run.errors.mean_ratio),
            flip: cell.flip,
            fireflies: over(&|run| run.errors.fireflies as f64),
            worst: worst.max_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default(),
            dropped: cell.runs.iter().map(|run| run.dropped).sum(),
            is_above_noise: relmse.mean > ABOVE_NOISE * noise.relmse,
            relmse,
            bias: cell.bias,
        }
    }
}

/// The exponent of a power law: error ∝ samples^slope.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Slope {
    /// -1 for independent samples; steeper for stratified ones; towards 0 where a bias is left.
    #[serde(flatten)]
    pub slope: Estimate,
    /// The first and the last number of samples that it is fitted to.
    pub spp: [u32; 2],
}

/// Fits log error against log samples for each seed on its own: the spread of the slopes is then their error, although
/// the images of one seed share samples. `errors[i]` has one value per seed for `spp[i]`. `None` with fewer than two points.
pub fn slope(spp: &[u32], errors: &[Vec<f64>]) -> Option<Slope> {
    let usable: Vec<(f64, &[f64])> = spp
        .iter()
        .zip(errors)
        .filter(|(_, errors)| errors.iter().all(|&e| e > 0.0))
        .map(|(&spp, errors)| (f64::from(spp).log2(), errors.as_slice()))
        .collect();
    let (&(first, some), &(last, _)) = (usable.first()?, usable.last()?);
    if usable.len() < 2 {
        return None;
    }
    let mean_x = usable.iter().map(|(x, _)| x).sum::<f64>() / usable.len() as f64;
    let squares: f64 = usable.iter().map(|(x, _)| (x - mean_x) * (x - mean_x)).sum();
    let of_seed = |seed: usize| usable.iter().map(|(x, e)| (x - mean_x) * e[seed].log2()).sum::<f64>() / squares;
    Some(Slope {
        slope: Estimate::of((0..some.len()).map(of_seed)),
        spp: [first.exp2() as u32, last.exp2() as u32],
    })
}

/// The slopes of a setting in MSE and relMSE.
pub fn slopes(cells: &[&Cell], points: &[Point], noise: Noise) -> [Option<Slope>; 2] {
    let used = || cells.iter().zip(points).filter(|(_, point)| point.is_above_noise);
    let spp: Vec<u32> = used().map(|(cell, _)| cell.spp).collect();
    let errors = |f: &dyn Fn(&super::cell::Run) -> f64| -> Vec<Vec<f64>> {
        used().map(|(cell, _)| cell.runs.iter().map(f).collect()).collect()
    };
    [
        slope(&spp, &errors(&|run| run.errors.mse - noise.mse)),
        slope(&spp, &errors(&|run| run.errors.relmse - noise.relmse)),
    ]
}

/// How many times the samples halve the root of the error.
pub fn samples_to_halve(slope: f64) -> Option<f64> {
    (slope < 0.0).then(|| 0.25f64.powf(1.0 / slope))
}

/// What a setting reaches in a given time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reached {
    /// The time (s).
    pub seconds: f64,
    /// The relMSE; `None` where even one sample takes longer.
    pub relmse: Option<f64>,
    /// Its relative standard error.
    pub relative_error: f64,
    /// Samples per pixel in that time.
    pub spp: f64,
    /// Whether it lies beyond what was measured.
    pub is_extrapolated: bool,
}

/// The relMSE of a setting after some time: between measurements by a line in log-log, beyond the last by the fitted slope,
/// or by -1 where that is not known well, down to the floor where there is one.
pub fn reached(points: &[Point], slope: Option<Slope>, floor: f64, seconds: f64) -> Reached {
    let mut answer = Reached {
        seconds,
        relmse: None,
        relative_error: 0.0,
        spp: 0.0,
        is_extrapolated: false,
    };
    let usable: Vec<&Point> = points
        .iter()
        .filter(|p| p.relmse.mean > 0.0 && p.is_above_noise)
        .collect();
    let (Some(first), Some(last)) = (usable.first(), usable.last()) else {
        return answer;
    };
    if seconds < first.seconds.mean {
        return answer;
    }
    let uncertainty = |p: &Point| p.relmse.standard_error / p.relmse.mean;
    if seconds > last.seconds.mean {
        let more = seconds / last.seconds.mean;
        let (slope, slope_error) = slope
            .map(|s| (s.slope.mean, s.slope.standard_error))
            .filter(|&(slope, error)| error <= TRUSTED_SLOPE_ERROR && slope < 0.0)
            .unwrap_or((-1.0, TRUSTED_SLOPE_ERROR));
        let falling = (last.relmse.mean - floor).max(0.0);
        answer.relmse = Some(floor.max(0.0) + falling * more.powf(slope));
        answer.relative_error = uncertainty(last).hypot(slope_error * more.ln());
        answer.spp = f64::from(last.spp) * more;
        answer.is_extrapolated = more > 1.0 + 1e-9;
        return answer;
    }
    let after = usable
        .iter()
        .position(|p| p.seconds.mean >= seconds)
        .unwrap_or(usable.len() - 1);
    let (a, b) = (usable[after.saturating_sub(1)], usable[after]);
    let span = (b.seconds.mean / a.seconds.mean).ln();
    let fraction = if span > 0.0 {
        (seconds / a.seconds.mean).ln() / span
    } else {
        1.0
    };
    let between = |a: f64, b: f64| a * (b / a).powf(fraction);
    answer.relmse = Some(between(a.relmse.mean, b.relmse.mean));
    answer.relative_error = uncertainty(a).max(uncertainty(b));
    answer.spp = between(f64::from(a.spp), f64::from(b.spp));
    answer
}

/// The measured points that no other is both faster and better than: indices into `points`, by time.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| {
        points[a]
            .0
            .total_cmp(&points[b].0)
            .then(points[a].1.total_cmp(&points[b].1))
    });
    let mut best = f64::INFINITY;
    order.retain(|&i| {
        let is_better = points[i].1 < best;
        best = best.min(points[i].1);
        is_better
    });
    order
}
