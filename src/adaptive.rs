//! Where further samples go, so that an image of a given error takes few.
//!
//! What decides about a cell of pixels are the cells around it, never its own samples. And of those only the first ones, up to
//! a number that is the same for all cells at the time: else the number of samples of a cell would depend on its own samples by
//! way of its neighbours'. So the number of samples of a pixel does not depend on their values, and their mean stays
//! unbiased, however many rounds there are. (If it did, pixels whose first samples missed the light would be left alone, and
//! the image would be too dark; Kirk and Arvo 1991, "Unbiased sampling techniques for image synthesis".) Only how far all
//! sampling goes depends on the whole image, by one number.

use crate::error;
use crate::film::{Cell, Film, PixelSums};
use crate::image::compare::RELATIVE_OFFSET;
use crate::render::plan_evenly;

/// When an image is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseTarget {
    /// Largest relative root-mean-square error ([`error::ErrorEstimate::relative_rmse`]), above 0.
    pub relative_rmse: f64,
    /// Samples that every pixel gets before any gets more, 2 or more; no more than the most that any gets.
    pub min_spp: u32,
}

/// Least share of the mean variance that a cell is taken to have: the samples around it may have missed something.
const LEAST_VARIANCE: f64 = 1e-3;

/// Least growth of a cell in a round, in samples.
const LEAST_STEP: u32 = 16;

/// What is aimed at is this part of the wanted squared error, so that the last round is not repeated for a trifle.
const AIM: f64 = 0.98;

/// Every cell has this share of the mean number of samples, so that more and more samples tell where the error is.
const LEAST_SHARE: f64 = 0.125;

/// What the first samples of a cell tell: the mean, and the variance of one sample as good as these are in company.
#[derive(Clone, Copy, Debug)]
struct Found {
    mean: [f32; 3],
    variance: [f32; 3],
}

/// Decides about samples, round by round.
#[derive(Clone, Debug)]
pub(crate) struct Planner {
    /// The relMSE to reach.
    target: f64,
    min_spp: u32,
    cap: u32,
    /// What the first `min_spp << level` samples of each cell tell, where there are so many.
    levels: Vec<Vec<Option<Found>>>,
}

impl Planner {
    /// For a film in which no pixel is to get more than `cap` samples.
    pub(crate) fn new(target: NoiseTarget, cap: u32) -> Planner {
        Planner {
            target: target.relative_rmse * target.relative_rmse,
            min_spp: target.min_spp.min(cap).max(1),
            cap,
            levels: Vec::new(),
        }
    }

    /// Sets the goals of the next round, and tells the number of paths that the image will take in all, as far as is known;
    /// `None` when the error is at the target, or all pixels at the cap.
    pub(crate) fn plan(&mut self, film: &mut Film) -> Option<u64> {
        let fewest = film.cells().map(|cell| cell.samples).min()?;
        if fewest < self.min_spp {
            return plan_evenly(film, self.min_spp);
        }
        let error = error::estimate(film)?.relmse.value;
        if error <= self.target {
            return None;
        }
        self.record(film);
        let level = (fewest / self.min_spp).ilog2() as usize;
        let variances = relative_variances(film, &self.levels[level]);
        self.share(film, &variances, self.target / error)
    }

    /// Keeps what each cell tells that has just reached a level.
    fn record(&mut self, film: &Film) {
        let cells = film.cells().count();
        for (i, (cell, pixels)) in film.cells_and_pixels().enumerate() {
            let Some(level) = self.level_of(cell.samples) else {
                continue;
            };
            while self.levels.len() <= level {
                self.levels.push(vec![None; cells]);
            }
            self.levels[level][i].get_or_insert_with(|| found(pixels));
        }
    }

    /// The level that has exactly so many samples.
    fn level_of(&self, samples: u32) -> Option<usize> {
        let times = samples / self.min_spp;
        (times.is_power_of_two() && times * self.min_spp == samples).then(|| times.ilog2() as usize)
    }

    /// Samples that a cell may have at the end of the next round: a step that is not too large, because each round knows more
    /// than the one before, and that ends at the next level.
    fn limit(&self, samples: u32) -> u32 {
        let level = (samples / self.min_spp).ilog2() + 1;
        let next_level = u64::from(self.min_spp) << level;
        let step = u64::from(samples) + u64::from((samples / 2).max(LEAST_STEP));
        next_level.min(step).min(self.cap.into()) as u32
    }

    /// Shares out samples for the least error, so that it becomes this part of what it is.
    fn share(&self, film: &mut Film, variances: &[f64], part: f64) -> Option<u64> {
        let pixels = |cell: &Cell| cell.rect.pixels() as f64;
        let total: f64 = film.cells().map(|cell| pixels(cell) * f64::from(cell.samples)).sum();
        let least = LEAST_SHARE * total / film.crop().pixels() as f64;
        let cap = f64::from(self.cap);
        // Numbers of samples go by the square root of the variance (Neyman allocation).
        let goal = |factor: f64, v: f64, cell: &Cell| {
            let samples = f64::from(cell.samples);
            (factor * v.sqrt()).max(least).clamp(samples, samples.max(cap))
        };
        let error = |samples: &dyn Fn(f64, &Cell) -> f64| -> f64 {
            let cells = film.cells().zip(variances);
            cells.map(|(cell, v)| pixels(cell) * v / samples(*v, cell)).sum()
        };
        let wanted = AIM * part * error(&|_, cell| cell.samples.into());
        let suffices = |factor: f64| error(&|v, cell| goal(factor, v, cell)) <= wanted;
        let (mut low, mut high) = (0.0, 1.0);
        while high < f64::MAX.sqrt() && !suffices(high) {
            (low, high) = (high, 2.0 * high);
        }
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if suffices(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        let mut expected = 0.0;
        let mut is_more = false;
        for (cell, v) in film.cells_mut().zip(variances) {
            let goal = goal(high, *v, cell);
            expected += pixels(cell) * goal;
            // Even: as many of one half as of the other.
            let goal = (goal.ceil() as u32).checked_next_multiple_of(2).unwrap_or(u32::MAX);
            cell.goal = goal.min(self.limit(cell.samples)).max(cell.samples);
            is_more |= cell.goal > cell.samples;
        }
        is_more.then_some(expected as u64)
    }
}

fn found<'a>(pixels: impl Iterator<Item = &'a PixelSums>) -> Found {
    let (mut count, mut mean, mut variance) = (0.0, [0.0; 3], [0.0; 3]);
    for pixel in pixels {
        let (m, v) = (pixel.mean(), pixel.variance());
        count += 1.0;
        mean = [0, 1, 2].map(|c| mean[c] + m[c]);
        variance = [0, 1, 2].map(|c| variance[c] + v[c] * f64::from(pixel.samples()));
    }
    Found {
        mean: mean.map(|m| (m / count) as f32),
        variance: variance.map(|v| (v / count) as f32),
    }
}

/// By cell: the variance of a sample relative to the square of the mean, by the cells around it.
fn relative_variances(film: &Film, found: &[Option<Found>]) -> Vec<f64> {
    let (crop, size) = (film.crop(), film.cell_size());
    let (columns, rows) = (crop.width().div_ceil(size), crop.height().div_ceil(size));
    let place = |cell: &Cell| ((cell.rect.x0 - crop.x0) / size, (cell.rect.y0 - crop.y0) / size);
    let mut grid = vec![None; columns as usize * rows as usize];
    for (cell, found) in film.cells().zip(found) {
        let (x, y) = place(cell);
        grid[(y * columns + x) as usize] = *found;
    }
    let around = |x: u32, end: u32| x.saturating_sub(1)..(x + 2).min(end);
    let relative = |cell: &Cell| {
        let (x, y) = place(cell);
        let others = around(y, rows).flat_map(|row| around(x, columns).map(move |column| (column, row)));
        let others = others.filter(|other| *other != (x, y));
        let (mut count, mut mean, mut variance) = (0.0, [0.0; 3], [0.0; 3]);
        for found in others.filter_map(|(column, row)| grid[(row * columns + column) as usize]) {
            count += 1.0;
            mean = [0, 1, 2].map(|c| mean[c] + f64::from(found.mean[c]));
            variance = [0, 1, 2].map(|c| variance[c] + f64::from(found.variance[c]));
        }
        // A cell alone is like any other.
        let count = f64::max(count, 1.0);
        let of_channel = |c: usize| variance[c] / count / ((mean[c] / count).powi(2) + RELATIVE_OFFSET);
        (0..3).map(of_channel).sum::<f64>() / 3.0
    };
    let relative: Vec<f64> = film.cells().map(relative).collect();
    let least = LEAST_VARIANCE * relative.iter().sum::<f64>() / relative.len() as f64;
    relative
        .into_iter()
        .map(|v| v.max(least).max(f64::MIN_POSITIVE))
        .collect()
}
