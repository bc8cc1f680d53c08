//! The FLIP difference between two images: how large a viewer who flips between them finds the error at each pixel.
//!
//! LDR: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild 2020, "FLIP: A Difference Evaluator for Alternating
//! Images", PACM CGIT 3(2). HDR: Andersson, Nilsson, Shirley, Akenine-Möller 2021, "Visualizing Errors in Rendered High
//! Dynamic Range Images", Eurographics short papers. Per pixel, with reference R and test T:
//!
//! 1. Colour: both images pass, in an opponent space linear in XYZ, through the contrast sensitivity functions of the eye
//!    (a sum of Gaussians per channel), are clamped to the Rec. 709 gamut and taken to CIELAB, where a\* and b\* are scaled
//!    by 0.01 L\* (Hunt effect). Their HyAB distance D = |ΔL| + ‖(Δa, Δb)‖, raised to 0.7, is mapped to ΔE_c in [0, 1].
//! 2. Features: edges and points of the unfiltered luminance are found with first and second derivatives of a Gaussian,
//!    ΔE_f = (max(|‖e_R‖ − ‖e_T‖|, |‖p_R‖ − ‖p_T‖|) / √2)^0.5, in [0, 1].
//! 3. FLIP = ΔE_c^(1 − ΔE_f).
//! 4. HDR: the largest FLIP over exposures 2^c, tone mapped, with c in equal steps from the value that brings the brightest
//!    pixel of R to 0.85 of the display range to the value that brings its median there.
//!
//! The opponent space YCxCz is 116 Y − 16, 500 (X − Y), 200 (Y − Z) relative to white. The filters have unit sum and the way
//! back undoes the constants, so (Y, X − Y, Y − Z) gives the same result without them. Every filter is separable, the
//! blue–yellow one as the sum of two, and the image border is repeated outwards.
//!
//! A pixel that is not finite in either image is taken as black in both, and a negative channel as zero: the papers define
//! neither.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::Image;
use crate::math::{DMat3, DVec3, Rgb};

/// Pixels per degree of visual angle for the papers' default observer, 0.7 m from a display 0.7 m and 3840 pixels wide
/// (Andersson et al. 2020, section 3; quoted there as 67).
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// HDR-FLIP (Andersson et al. 2021) of two linear Rec. 709 images of any non-negative range: an error in [0, 1] per pixel.
///
/// The exposures come from `reference` alone, so the arguments do not commute. Time grows with their number, the log₂ of the
/// reference's largest luminance over its median; a median below 2⁻²³ counts as 2⁻²³.
///
/// # Panics
/// If the sizes differ.
pub fn hdr_flip(reference: &Image<Rgb>, test: &Image<Rgb>) -> Image<f32> {
    let observer = Observer::new(PIXELS_PER_DEGREE);
    let mut result = Image::filled(reference.width, reference.height, 0.0);
    for exposure in exposures(reference) {
        let scale = exposure.exp2() as f32;
        observer.add_maximum(reference, test, |c| tone_map(c * scale), &mut result);
    }
    result
}

/// LDR-FLIP (Andersson et al. 2020) of two linear Rec. 709 images, clamped to [0, 1]: an error in [0, 1] per pixel.
///
/// The values are display-linear, that is, after the sRGB curve has been undone. The arguments commute.
///
/// # Panics
/// If the sizes differ.
pub fn ldr_flip(reference: &Image<Rgb>, test: &Image<Rgb>) -> Image<f32> {
    let observer = Observer::new(PIXELS_PER_DEGREE);
    let mut result = Image::filled(reference.width, reference.height, 0.0);
    observer.add_maximum(reference, test, |c| c.clamp(0.0, 1.0), &mut result);
    result
}

/// Colours of an error map, dark for 0 and light for 1, as sRGB bytes; values outside [0, 1] are clamped and NaN is 0.
///
/// Linear between 17 samples of the magma map (Smith and van der Walt 2015, public domain), within 3/255 of it.
pub fn heat_map(errors: &Image<f32>) -> Image<[u8; 3]> {
    let last = MAGMA.len() - 1;
    let colour = |&error: &f32| {
        // `clamp` would keep NaN.
        let error = if error > 0.0 { error.min(1.0) } else { 0.0 };
        let position = error * last as f32;
        let index = (position as usize).min(last - 1);
        let t = position - index as f32;
        std::array::from_fn(|c| {
            let (low, high) = (f32::from(MAGMA[index][c]), f32::from(MAGMA[index + 1][c]));
            (low + (high - low) * t).round() as u8
        })
    };
    Image {
        width: errors.width,
        height: errors.height,
        pixels: errors.pixels.iter().map(colour).collect(),
    }
}

/// Magma at 0, 1/16, …, 1.
const MAGMA: [[u8; 3]; 17] = [
    [0, 0, 4],
    [10, 8, 34],
    [29, 17, 70],
    [54, 16, 106],
    [80, 18, 124],
    [105, 28, 129],
    [130, 38, 129],
    [156, 46, 127],
    [182, 55, 121],
    [207, 65, 112],
    [230, 81, 99],
    [245, 105, 92],
    [251, 135, 97],
    [254, 165, 113],
    [254, 195, 135],
    [253, 224, 162],
    [252, 253, 191],
];

/// Numerator, then denominator, of the ACES fit of Narkowicz 2015 as used by Andersson et al. 2021, from the square down:
/// the argument is scaled by 0.6, which undoes the fit's own brightening.
const ACES: [[f64; 3]; 2] = [[0.36 * 2.51, 0.6 * 0.03, 0.0], [0.36 * 2.43, 0.6 * 0.59, 0.14]];

/// Tone-mapped value of `c >= 0`, in [0, 1].
fn tone_map(c: f32) -> f32 {
    // The fit passes 1 near 12 and squares overflow for huge values.
    let c = c.min(64.0);
    let [n, d] = ACES.map(|k| k.map(|v| v as f32));
    (((n[0] * c + n[1]) * c + n[2]) / ((d[0] * c + d[1]) * c + d[2])).clamp(0.0, 1.0)
}

/// Base-2 logarithms of the exposures (Andersson et al. 2021, section 3.1).
fn exposures(reference: &Image<Rgb>) -> Vec<f64> {
    let mut luminances: Vec<f64> = reference
        .pixels
        .iter()
        .map(|p| if p.is_finite() { *p } else { Rgb::BLACK })
        .map(|p| p.to_array().map(|c| f64::from(c.max(0.0))))
        .map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b)
        .collect();
    if luminances.is_empty() {
        return Vec::new();
    }
    // A black median has no exposure that brightens it, a black maximum neither.
    let floor = f64::from(f32::EPSILON);
    let maximum = luminances.iter().fold(floor, |m, &l| m.max(l));
    let middle = luminances.len() / 2;
    let median = luminances.select_nth_unstable_by(middle, f64::total_cmp).1.max(floor);

    // The larger root of ACES(x) = 0.85.
    let level = 0.85;
    let [a, b, c]: [f64; 3] = std::array::from_fn(|k| ACES[0][k] - level * ACES[1][k]);
    let bright = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);

    let (start, stop) = ((bright / maximum).log2(), (bright / median).log2());
    let count = (stop - start).ceil().max(2.0) as usize;
    let step = (stop - start) / (count - 1) as f64;
    (0..count).map(|k| start + k as f64 * step).collect()
}

/// Taps of a filter along one axis; the middle one is at the pixel.
struct Kernel(Vec<f32>);

impl Kernel {
    fn scaled(taps: &[f64], scale: f64) -> Kernel {
        Kernel(taps.iter().map(|t| (t * scale) as f32).collect())
    }

    fn radius(&self) -> usize {
        self.0.len() / 2
    }

    /// `out[x]` = the filter over `padded`, which begins `padding` pixels before the row.
    fn filter_row(&self, padded: &[f32], padding: usize, out: &mut [f32]) {
        out.fill(0.0);
        for (i, tap) in self.0.iter().enumerate() {
            let shifted = &padded[padding + i - self.radius()..];
            for (o, v) in out.iter_mut().zip(shifted) {
                *o += tap * v;
            }
        }
    }

    /// Adds to `out` the filter over the columns of `plane` at row `y`.
    fn add_columns(&self, rows: &Rows, plane: usize, y: usize, out: &mut [f32]) {
        for (i, tap) in self.0.iter().enumerate() {
            let row = (y + i).saturating_sub(self.radius()).min(rows.height - 1);
            for (o, v) in out.iter_mut().zip(rows.row(plane, row)) {
                *o += tap * v;
            }
        }
    }
}

/// Planes of [`Rows`]: achromatic, red–green, the two terms of blue–yellow, then luminance smoothed and differentiated.
const ACHROMATIC: usize = 0;
const RED_GREEN: usize = 1;
const BLUE_YELLOW: [usize; 2] = [2, 3];
const SMOOTH: usize = 4;
const EDGE: usize = 5;
const POINT: usize = 6;
const PLANES: usize = 7;

/// An image filtered along its rows, waiting for the columns. The planes of one row lie together.
struct Rows {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Rows {
    fn row(&self, plane: usize, y: usize) -> &[f32] {
        let begin = (y * PLANES + plane) * self.width;
        &self.values[begin..begin + self.width]
    }
}

/// One row of an image as the eye is taken to see it.
struct SeenRow {
    /// Filtered (Y, X − Y, Y − Z), then CIELAB with the Hunt adjustment.
    colour: [Vec<f32>; 3],
    /// Horizontal and vertical first derivative of luminance.
    edge: [Vec<f32>; 2],
    /// Horizontal and vertical second derivative of luminance.
    point: [Vec<f32>; 2],
}

impl SeenRow {
    fn new(width: usize) -> SeenRow {
        let row = || vec![0.0; width];
        SeenRow {
            colour: std::array::from_fn(|_| row()),
            edge: std::array::from_fn(|_| row()),
            point: std::array::from_fn(|_| row()),
        }
    }

    fn clear(&mut self) {
        self.colour.iter_mut().for_each(|v| v.fill(0.0));
        self.edge.iter_mut().for_each(|v| v.fill(0.0));
        self.point.iter_mut().for_each(|v| v.fill(0.0));
    }
}

type Matrix = [[f32; 3]; 3];

fn apply(m: &Matrix, v: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2])
}

/// The filters for a viewing distance and the constants of the colour spaces.
struct Observer {
    /// By plane.
    kernels: [Kernel; PLANES],
    padding: usize,
    /// Linear Rec. 709 to XYZ over the XYZ of white, so that white is (1, 1, 1).
    to_xyz: Matrix,
    from_xyz: Matrix,
    /// The largest colour distance, that of the green and blue primaries, raised to [`COLOUR_POWER`].
    largest_distance: f32,
}

/// q_c, p_c and p_t of Andersson et al. 2020, section 4.1.3: compression of the colour distance, and the point below which
/// (as a fraction of the largest) it uses the larger part of the range.
const COLOUR_POWER: f32 = 0.7;
const KNEE: f32 = 0.4;
const KNEE_ERROR: f32 = 0.95;

impl Observer {
    fn new(pixels_per_degree: f64) -> Observer {
        let [achromatic, red_green, wide, narrow] = contrast_kernels(pixels_per_degree);
        let [smooth, edge, point] = feature_kernels(pixels_per_degree);
        let kernels = [achromatic, red_green, wide, narrow, smooth, edge, point];
        let padding = kernels.iter().map(Kernel::radius).max().unwrap_or(0);
        let to_xyz = rec709_to_relative_xyz();
        let rows = |m: DMat3| {
            let t = m.transpose();
            [t.x_axis, t.y_axis, t.z_axis].map(|v| v.to_array().map(|c| c as f32))
        };
        let (to_xyz, from_xyz) = (rows(to_xyz), rows(to_xyz.inverse()));
        let lab = |rgb| hunt_lab(apply(&to_xyz, rgb));
        let largest_distance = hyab(lab([0.0, 1.0, 0.0]), lab([0.0, 0.0, 1.0])).powf(COLOUR_POWER);
        Observer {
            kernels,
            padding,
            to_xyz,
            from_xyz,
            largest_distance,
        }
    }

    /// Raises each pixel of `result` to the FLIP error of the two images, whose colours `display` maps to [0, 1].
    fn add_maximum(
        &self,
        reference: &Image<Rgb>,
        test: &Image<Rgb>,
        display: impl Fn(f32) -> f32 + Sync,
        result: &mut Image<f32>,
    ) {
        assert_eq!(
            (reference.width, reference.height),
            (test.width, test.height),
            "FLIP compares images of one size"
        );
        if result.pixels.is_empty() {
            return;
        }
        let width = reference.width as usize;
        let rows =
            [(reference, test), (test, reference)].map(|(image, other)| self.filter_rows(image, other, &display));
        result.pixels.par_chunks_mut(width).enumerate().for_each_init(
            || [SeenRow::new(width), SeenRow::new(width)],
            |[r, t], (y, out)| {
                self.see_row(&rows[0], y, r);
                self.see_row(&rows[1], y, t);
                for (x, o) in out.iter_mut().enumerate() {
                    *o = o.max(self.difference(r, t, x));
                }
            },
        );
    }

    /// Filters `image` along its rows; `other` only says where the pair is not finite.
    fn filter_rows(&self, image: &Image<Rgb>, other: &Image<Rgb>, display: &(impl Fn(f32) -> f32 + Sync)) -> Rows {
        let (width, height) = (image.width as usize, image.height as usize);
        let padding = self.padding;
        let mut values = vec![0.0; width * height * PLANES];
        values.par_chunks_mut(width * PLANES).enumerate().for_each_init(
            || [(); 3].map(|()| vec![0.0; width + 2 * padding]),
            |padded, (y, out)| {
                let pixels = y * width..(y + 1) * width;
                let pairs = image.pixels[pixels.clone()].iter().zip(&other.pixels[pixels]);
                for (x, (a, b)) in pairs.enumerate() {
                    let finite = a.is_finite() && b.is_finite();
                    let shown = if finite {
                        a.map(|c| display(c.max(0.0)))
                    } else {
                        Rgb::BLACK
                    };
                    let [cx, cy, cz] = apply(&self.to_xyz, shown.to_array());
                    for (row, v) in padded.iter_mut().zip([cy, cx - cy, cy - cz]) {
                        row[padding + x] = v;
                    }
                }
                for row in padded.iter_mut() {
                    let (first, last) = (row[padding], row[padding + width - 1]);
                    row[..padding].fill(first);
                    row[padding + width..].fill(last);
                }
                for (plane, (kernel, out)) in self.kernels.iter().zip(out.chunks_mut(width)).enumerate() {
                    let source = match plane {
                        RED_GREEN => &padded[1],
                        p if BLUE_YELLOW.contains(&p) => &padded[2],
                        _ => &padded[0],
                    };
                    kernel.filter_row(source, padding, out);
                }
            },
        );
        Rows { width, height, values }
    }

    /// Finishes row `y`: the filters along the columns, then CIELAB.
    fn see_row(&self, rows: &Rows, y: usize, seen: &mut SeenRow) {
        seen.clear();
        let SeenRow { colour, edge, point } = seen;
        let add = |kernel: usize, plane: usize, out: &mut [f32]| self.kernels[kernel].add_columns(rows, plane, y, out);
        add(ACHROMATIC, ACHROMATIC, &mut colour[0]);
        add(RED_GREEN, RED_GREEN, &mut colour[1]);
        for plane in BLUE_YELLOW {
            add(plane, plane, &mut colour[2]);
        }
        add(SMOOTH, EDGE, &mut edge[0]);
        add(EDGE, SMOOTH, &mut edge[1]);
        add(SMOOTH, POINT, &mut point[0]);
        add(POINT, SMOOTH, &mut point[1]);

        let [first, second, third] = colour;
        for ((u, v), w) in first.iter_mut().zip(second).zip(third) {
            let rgb = apply(&self.from_xyz, [*u + *v, *u, *u - *w]);
            [*u, *v, *w] = hunt_lab(apply(&self.to_xyz, rgb.map(|c| c.clamp(0.0, 1.0))));
        }
    }

    /// Steps 1 to 3 of the module's description, after filtering, at column `x`.
    fn difference(&self, r: &SeenRow, t: &SeenRow, x: usize) -> f32 {
        let lab = |s: &SeenRow| [s.colour[0][x], s.colour[1][x], s.colour[2][x]];
        let distance = hyab(lab(r), lab(t)).powf(COLOUR_POWER);
        if distance == 0.0 {
            return 0.0;
        }
        let (largest, knee) = (self.largest_distance, KNEE * self.largest_distance);
        let colour = if distance < knee {
            KNEE_ERROR / knee * distance
        } else {
            KNEE_ERROR + (distance - knee) / (largest - knee) * (1.0 - KNEE_ERROR)
        };
        let norm = |d: &[Vec<f32>; 2]| (d[0][x] * d[0][x] + d[1][x] * d[1][x]).sqrt();
        let edge = (norm(&r.edge) - norm(&t.edge)).abs();
        let point = (norm(&r.point) - norm(&t.point)).abs();
        let feature = (edge.max(point) * std::f32::consts::FRAC_1_SQRT_2).sqrt();
        // Rounding can carry either a little past 1.
        colour.min(1.0).powf(1.0 - feature.min(1.0))
    }
}

/// The contrast sensitivity functions of achromatic, red–green and (two terms) blue–yellow contrast.
///
/// Andersson et al. 2020, section 4.1.1 and table 1: g(x) = Σ a √(π/b) exp(−π² x² / b) with x in degrees, over a square of
/// three standard deviations of the widest, with unit sum. A term of a sum keeps its share by a factor in both directions.
fn contrast_kernels(pixels_per_degree: f64) -> [Kernel; 4] {
    const WIDEST: f64 = 0.04;
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as usize;
    let gaussian = |b: f64| {
        // Six standard deviations of a narrow one reach below the rounding of `f32`.
        let deviation = (b / (2.0 * PI * PI)).sqrt() * pixels_per_degree;
        sampled_gaussian(deviation, radius.min((6.0 * deviation).ceil() as usize))
    };
    let single = |b: f64| {
        let taps = gaussian(b);
        Kernel::scaled(&taps, 1.0 / taps.iter().sum::<f64>())
    };
    let terms = [(34.1, WIDEST), (13.5, 0.025)].map(|(a, b)| (a * (PI / b).sqrt(), gaussian(b)));
    let total: f64 = terms.iter().map(|(a, taps)| a * taps.iter().sum::<f64>().powi(2)).sum();
    let [wide, narrow] = terms.map(|(a, taps)| Kernel::scaled(&taps, (a / total).sqrt()));
    [single(0.0047), single(0.0053), wide, narrow]
}

/// A Gaussian and its first and second derivative, for edges and points as wide as the eye detects (Andersson et al. 2020,
/// section 4.2): the standard deviation is half of 0.082 degrees. Positive taps sum to 1 and negative ones to −1.
fn feature_kernels(pixels_per_degree: f64) -> [Kernel; 3] {
    let deviation = 0.5 * 0.082 * pixels_per_degree;
    let radius = (3.0 * deviation).ceil() as usize;
    let smooth = sampled_gaussian(deviation, radius);
    let times = |f: fn(f64) -> f64| -> Vec<f64> {
        let taps = smooth.iter().enumerate();
        taps.map(|(i, g)| g * f((i as f64 - radius as f64) / deviation))
            .collect()
    };
    [smooth.clone(), times(|x| -x), times(|x| x * x - 1.0)].map(|taps| {
        let positive: f64 = taps.iter().filter(|t| **t > 0.0).sum();
        let negative: f64 = -taps.iter().filter(|t| **t < 0.0).sum::<f64>();
        let balanced = taps.iter().map(|t| {
            t / if *t > 0.0 {
                positive
            } else {
                negative.max(f64::MIN_POSITIVE)
            }
        });
        Kernel::scaled(&balanced.collect::<Vec<_>>(), 1.0)
    })
}

/// exp(−x² / 2σ²) at the pixels from `-radius` to `radius`.
fn sampled_gaussian(deviation: f64, radius: usize) -> Vec<f64> {
    let pixel = |i: usize| (i as f64 - radius as f64) / deviation;
    (0..=2 * radius).map(|i| (-0.5 * pixel(i).powi(2)).exp()).collect()
}

/// The matrix from linear Rec. 709 to XYZ over the XYZ of white: the primaries of ITU-R BT.709, scaled to add up to D65.
fn rec709_to_relative_xyz() -> DMat3 {
    let from_xy = |x: f64, y: f64| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
    let primaries = DMat3::from_cols(from_xy(0.64, 0.33), from_xy(0.30, 0.60), from_xy(0.15, 0.06));
    let white = from_xy(0.3127, 0.3290);
    DMat3::from_diagonal(white.recip()) * primaries * DMat3::from_diagonal(primaries.inverse() * white)
}

/// CIELAB of XYZ relative to white, a\* and b\* scaled by 0.01 L\* (Andersson et al. 2020, section 4.1.2).
fn hunt_lab(xyz: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let [x, y, z] = xyz.map(|t| {
        if t > DELTA * DELTA * DELTA {
            t.cbrt()
        } else {
            t / (3.0 * DELTA * DELTA) + 4.0 / 29.0
        }
    });
    let lightness = 116.0 * y - 16.0;
    [lightness, 5.0 * lightness * (x - y), 2.0 * lightness * (y - z)]
}

/// Abasi, Amani Tehran, Fairchild 2020: the distance that also holds for large differences of colour.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [l, u, v] = std::array::from_fn(|i| a[i] - b[i]);
    l.abs() + (u * u + v * v).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth image with a bright spot and some colour, deterministic.
    fn scene(width: u32, height: u32) -> Image<Rgb> {
        let mut image = Image::filled(width, height, Rgb::BLACK);
        for (i, p) in image.pixels.iter_mut().enumerate() {
            let (x, y) = (i as u32 % width, i as u32 / width);
            let wave = |k: f32| 0.5 + 0.4 * (k * x as f32 + 0.3 * y as f32).sin();
            *p = Rgb::new(wave(0.2), wave(0.5), wave(0.9));
        }
        *image.pixels.last_mut().expect("not empty") = Rgb::splat(40.0);
        image
    }

    fn map_pixels(image: &Image<Rgb>, f: impl Fn(Rgb) -> Rgb) -> Image<Rgb> {
        Image {
            pixels: image.pixels.iter().map(|p| f(*p)).collect(),
            ..*image
        }
    }

    fn mean(image: &Image<f32>) -> f64 {
        image.pixels.iter().map(|&e| f64::from(e)).sum::<f64>() / image.pixels.len() as f64
    }

    fn assert_errors(map: &Image<f32>) {
        assert!(map.pixels.iter().all(|e| (0.0..=1.0).contains(e)), "{map:?}");
    }

    #[test]
    fn identical_images_have_no_flip_error() {
        let image = scene(37, 23);
        assert!(hdr_flip(&image, &image).pixels.iter().all(|&e| e == 0.0));
        assert!(ldr_flip(&image, &image).pixels.iter().all(|&e| e == 0.0));
    }

    #[test]
    fn flip_errors_are_between_zero_and_one() {
        let image = scene(37, 23);
        for factor in [0.0, 0.5, 3.0, 1e6] {
            let other = map_pixels(&image, |p| Rgb::new(p.b, p.r * factor, p.g));
            assert_errors(&hdr_flip(&image, &other));
            assert_errors(&ldr_flip(&image, &other));
        }
    }

    /// Andersson et al. 2020 define the range by this pair: its colour distance is the largest, and flat images have no
    /// features.
    #[test]
    fn flat_green_and_blue_are_as_different_as_can_be() {
        let green = Image::filled(30, 20, Rgb::new(0.0, 1.0, 0.0));
        let blue = Image::filled(30, 20, Rgb::new(0.0, 0.0, 1.0));
        for error in ldr_flip(&green, &blue).pixels {
            assert!((error - 1.0).abs() < 1e-4, "{error}");
        }
    }

    /// Flat greys have no features and only lightness: ΔE_c = 0.95 / (0.4 c) ΔL^0.7 below the knee, with c the largest
    /// distance raised to 0.7. Its value by hand from the CIELAB of green (87.74, −86.18, 83.18) and blue (32.30, 79.19,
    /// −107.86), Hunt-adjusted: 55.44 + ‖(−75.61 − 25.58, 72.98 + 34.84)‖ = 203.3.
    #[test]
    fn flat_greys_differ_by_their_lightness_as_the_paper_defines() {
        let lightness = |y: f64| 116.0 * y.cbrt() - 16.0;
        let expected = 0.95 / 0.4 * ((lightness(0.3) - lightness(0.2)) / 203.3).powf(0.7);
        let map = ldr_flip(
            &Image::filled(9, 9, Rgb::splat(0.2)),
            &Image::filled(9, 9, Rgb::splat(0.3)),
        );
        for error in map.pixels {
            assert!((f64::from(error) - expected).abs() < 1e-3, "{error} {expected}");
        }
    }

    #[test]
    fn ldr_flip_does_not_depend_on_the_order_of_its_arguments() {
        let image = scene(37, 23);
        let other = map_pixels(&image, |p| p * 0.7);
        assert_eq!(ldr_flip(&image, &other), ldr_flip(&other, &image));
    }

    #[test]
    fn mirrored_images_have_the_mirrored_error() {
        let image = scene(37, 23);
        let other = map_pixels(&image, |p| Rgb::new(p.r, p.r, p.b * 1.3));
        let mirror = |image: &Image<Rgb>| Image {
            pixels: image.pixels.iter().rev().copied().collect(),
            ..*image
        };
        let map = hdr_flip(&image, &other);
        let mirrored = hdr_flip(&mirror(&image), &mirror(&other));
        for (a, b) in map.pixels.iter().zip(mirrored.pixels.iter().rev()) {
            assert!((a - b).abs() < 2e-3, "{a} {b}");
        }
    }

    #[test]
    fn a_difference_of_one_pixel_is_seen_near_it_only() {
        let image = Image::filled(61, 61, Rgb::splat(0.3));
        let mut other = image.clone();
        other.pixels[30 * 61 + 30] = Rgb::splat(0.9);
        for map in [hdr_flip(&image, &other), ldr_flip(&image, &other)] {
            assert!(*map.at(30, 30) > 0.05);
            for y in 0..61_u32 {
                for x in 0..61_u32 {
                    // The widest filter reaches ten pixels.
                    let distance = x.abs_diff(30).max(y.abs_diff(30));
                    assert!(distance <= 10 || *map.at(x, y) < 1e-3, "{x} {y}: {}", map.at(x, y));
                }
            }
        }
    }

    #[test]
    fn a_larger_change_has_a_larger_error() {
        let image = scene(40, 30);
        let errors = [1.02, 1.1, 1.5, 3.0].map(|s| mean(&hdr_flip(&image, &map_pixels(&image, |p| p * s))));
        assert!(errors.is_sorted_by(|a, b| a < b), "{errors:?}");
    }

    /// The reference fixes the exposures, so a common factor cancels as long as the median stays above the floor.
    #[test]
    fn hdr_flip_does_not_depend_on_the_unit_of_radiance() {
        let image = scene(40, 30);
        let other = map_pixels(&image, |p| p * 1.2);
        let scaled = |image: &Image<Rgb>| map_pixels(image, |p| p * 1024.0);
        let (plain, large) = (hdr_flip(&image, &other), hdr_flip(&scaled(&image), &scaled(&other)));
        assert!((mean(&plain) - mean(&large)).abs() < 1e-4);
    }

    #[test]
    fn exposures_bring_the_maximum_and_the_median_to_the_level_of_the_paper() {
        let mut image = Image::filled(9, 9, Rgb::splat(0.25));
        image.pixels[40] = Rgb::splat(100.0);
        let exposures = exposures(&image);
        // log2(100 / 0.25) = 8.64 stops.
        assert_eq!(exposures.len(), 9);
        assert!((tone_map(100.0 * exposures[0].exp2() as f32) - 0.85).abs() < 1e-5);
        assert!((tone_map(0.25 * exposures[8].exp2() as f32) - 0.85).abs() < 1e-5);
    }

    #[test]
    fn pixels_that_are_not_finite_do_not_reach_the_error_map() {
        let image = scene(37, 23);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut other = image.clone();
            other.pixels[5] = Rgb::new(0.1, bad, 0.1);
            assert!(hdr_flip(&image, &other).pixels.iter().all(|&e| e == 0.0));
            assert!(hdr_flip(&other, &image).pixels.iter().all(|&e| e == 0.0));
            assert!(ldr_flip(&image, &other).pixels.iter().all(|&e| e == 0.0));
        }
        let huge = Image::filled(3, 3, Rgb::splat(f32::MAX));
        assert_errors(&hdr_flip(&huge, &image_of(3, 3, 1e-30)));
        assert_errors(&hdr_flip(&image_of(3, 3, 1e-30), &huge));
        assert_errors(&hdr_flip(&image_of(3, 3, -1.0), &huge));
    }

    fn image_of(width: u32, height: u32, value: f32) -> Image<Rgb> {
        Image::filled(width, height, Rgb::splat(value))
    }

    #[test]
    fn black_and_tiny_and_empty_images_are_compared() {
        let black = image_of(8, 5, 0.0);
        assert_eq!(hdr_flip(&black, &black), Image::filled(8, 5, 0.0));
        assert_errors(&hdr_flip(&black, &image_of(8, 5, 1.0)));
        assert!(mean(&hdr_flip(&black, &image_of(8, 5, 1.0))) > 0.9);
        assert!(mean(&hdr_flip(&image_of(8, 5, 1.0), &black)) > 0.9);
        assert_eq!(hdr_flip(&image_of(1, 1, 0.5), &image_of(1, 1, 0.5)).pixels, [0.0]);
        assert!(hdr_flip(&image_of(1, 1, 0.5), &image_of(1, 1, 0.8)).pixels[0] > 0.1);
        for (width, height) in [(0, 0), (0, 3), (3, 0)] {
            let empty = image_of(width, height, 0.0);
            assert!(hdr_flip(&empty, &empty).pixels.is_empty());
            assert!(ldr_flip(&empty, &empty).pixels.is_empty());
        }
    }

    #[test]
    fn heat_maps_run_from_dark_to_light_and_clamp() {
        let values = [0.0, 0.03125, 0.5, 1.0, -3.0, 7.0, f32::NAN, f32::INFINITY];
        let map = heat_map(&Image {
            width: 8,
            height: 1,
            pixels: values.to_vec(),
        });
        let (dark, middle, light) = ([0, 0, 4], [182, 55, 121], [252, 253, 191]);
        assert_eq!(map.pixels, [dark, [5, 4, 19], middle, light, dark, light, dark, light]);
        let ramp = heat_map(&Image {
            width: 65,
            height: 1,
            pixels: (0..65).map(|i| i as f32 / 64.0).collect(),
        });
        let luma = |p: &[u8; 3]| 2 * u32::from(p[0]) + 7 * u32::from(p[1]) + u32::from(p[2]);
        assert!(ramp.pixels.is_sorted_by_key(luma));
    }
}
