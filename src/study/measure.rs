//! How far an image is from the reference, and what many images of different seeds say together.
//!
//! All in f64 from the means of the film: an image file holds f32.

use crate::film::Film;
use crate::image::Image;
use crate::image::compare::{RELATIVE_OFFSET, TRIMMED_SHARE};
use crate::math::Rgb;
use serde::{Deserialize, Serialize};

/// How many times brighter than everything around it in the reference a pixel is to count as a firefly.
pub const FIREFLY_FACTOR: f64 = 4.0;

/// How many pixels around it, to each side.
pub const FIREFLY_RADIUS: u32 = 2;

/// Means of pixels, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` colours.
    pub values: Vec<[f64; 3]>,
}

impl Pixels {
    /// What a film has.
    pub fn of_film(film: &Film, [width, height]: [u32; 2]) -> Pixels {
        Pixels {
            width,
            height,
            values: film.means(),
        }
    }

    /// What an image has.
    pub fn of_image(image: &Image<Rgb>) -> Pixels {
        Pixels {
            width: image.width,
            height: image.height,
            values: image.pixels.iter().map(|p| p.to_array().map(f64::from)).collect(),
        }
    }

    /// An image of 32 bits per channel.
    pub fn to_image(&self) -> Image<Rgb> {
        Image {
            width: self.width,
            height: self.height,
            pixels: self.values.iter().map(|&p| Rgb::from(p)).collect(),
        }
    }

    /// Mean of the luminance.
    pub fn mean_luminance(&self) -> f64 {
        self.values.iter().copied().map(luminance).sum::<f64>() / self.values.len() as f64
    }
}

/// Rec. 709 luminance.
pub fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// The pixel that is furthest off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WorstPixel {
    /// Column.
    pub x: u32,
    /// Row.
    pub y: u32,
    /// Its luminance.
    pub luminance: f64,
    /// What it should be.
    pub reference: f64,
}

/// The errors of one image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Mean of the squared difference over pixels and channels.
    pub mse: f64,
    /// The same over the square of the reference plus 0.01.
    pub relmse: f64,
    /// `relmse` without the worst 0.1 % of the pixels.
    pub relmse_trimmed: f64,
    /// Mean luminance over that of the reference.
    pub mean_ratio: f64,
    /// The largest difference of luminance.
    pub worst: WorstPixel,
    /// Pixels more than [`FIREFLY_FACTOR`] times as bright as anything within [`FIREFLY_RADIUS`] pixels in the reference.
    pub fireflies: u64,
}

/// The errors of an image. `brightest` is [`brightest_around`] of the reference.
pub fn errors(image: &Pixels, reference: &Pixels, brightest: &[f64]) -> Errors {
    let mut squares = 0.0;
    let mut relative = Vec::with_capacity(image.values.len());
    let (mut worst, mut worst_difference) = (WorstPixel::default(), -1.0);
    let mut fireflies = 0;
    for (i, (a, b)) in reference.values.iter().zip(&image.values).enumerate() {
        let mut pixel = 0.0;
        for c in 0..3 {
            let square = (a[c] - b[c]) * (a[c] - b[c]);
            squares += square;
            pixel += square / (a[c] * a[c] + RELATIVE_OFFSET);
        }
        relative.push(pixel / 3.0);
        let (was, is) = (luminance(*a), luminance(*b));
        if (is - was).abs() > worst_difference {
            worst_difference = (is - was).abs();
            worst = WorstPixel {
                x: i as u32 % image.width,
                y: i as u32 / image.width,
                luminance: is,
                reference: was,
            };
        }
        fireflies += u64::from(is > FIREFLY_FACTOR * (brightest[i] + RELATIVE_OFFSET));
    }
    let pixels = relative.len() as f64;
    let relmse = relative.iter().sum::<f64>() / pixels;
    let kept = relative.len() - ((TRIMMED_SHARE * pixels).round() as usize).clamp(1, relative.len());
    relative.select_nth_unstable_by(kept, f64::total_cmp);
    Errors {
        mse: squares / (3.0 * pixels),
        relmse,
        relmse_trimmed: relative[..kept].iter().sum::<f64>() / kept.max(1) as f64,
        mean_ratio: image.mean_luminance() / reference.mean_luminance(),
        worst,
        fireflies,
    }
}

/// The largest luminance around each pixel, itself included.
pub fn brightest_around(pixels: &Pixels) -> Vec<f64> {
    let luminances: Vec<f64> = pixels.values.iter().copied().map(luminance).collect();
    let around = |i: u32, end: u32| i.saturating_sub(FIREFLY_RADIUS)..end.min(i + FIREFLY_RADIUS + 1);
    let mut brightest = Vec::with_capacity(luminances.len());
    for y in 0..pixels.height {
        for x in 0..pixels.width {
            let rows = around(y, pixels.height).map(|row| row as usize * pixels.width as usize);
            let all = rows.flat_map(|row| around(x, pixels.width).map(move |column| row + column as usize));
            brightest.push(all.map(|i| luminances[i]).fold(0.0, f64::max));
        }
    }
    brightest
}

/// Mean and spread of each pixel over images of different seeds. Samples of one image are stratified and tell nothing of
/// its error; whole images of different seeds are independent.
#[derive(Clone, Debug)]
pub struct Replications {
    count: u32,
    /// Of the images, for Welford's update.
    mean: Vec<[f64; 4]>,
    squares: Vec<[f64; 4]>,
}

impl Replications {
    /// None yet.
    pub fn new(pixels: usize) -> Replications {
        Replications {
            count: 0,
            mean: vec![[0.0; 4]; pixels],
            squares: vec![[0.0; 4]; pixels],
        }
    }

    /// Takes in an image.
    pub fn add(&mut self, image: &Pixels) {
        self.count += 1;
        let count = f64::from(self.count);
        for ((mean, squares), &value) in self.mean.iter_mut().zip(&mut self.squares).zip(&image.values) {
            let [r, g, b] = value;
            for (c, x) in [r, g, b, luminance(value)].into_iter().enumerate() {
                let before = x - mean[c];
                mean[c] += before / count;
                squares[c] += before * (x - mean[c]);
            }
        }
    }

    /// How many images.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Mean of each pixel.
    pub fn mean(&self) -> Vec<[f64; 3]> {
        self.mean.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
    }

    /// Estimated variance of that mean: of the channels, then of the luminance. Needs two images.
    pub fn variance_of_mean(&self) -> Vec<[f64; 4]> {
        let count = f64::from(self.count);
        self.squares
            .iter()
            .map(|s| s.map(|s| s / (count * (count - 1.0))))
            .collect()
    }
}
