//! What a film makes of a million samples: against exact sums, and in any order.

use crate::support::Random;
use embrace::film::{Film, MergeError, Rect};
use embrace::math::Rgb;

const SAMPLES: usize = 1_000_000;

fn pixel() -> Rect {
    Rect {
        x0: 3,
        y0: 5,
        x1: 4,
        y1: 6,
    }
}

/// A film of one pixel with these samples.
fn film(samples: &[f32]) -> Film {
    let mut film = Film::new(pixel());
    let tile = &mut film.tiles_mut()[0];
    for sample in samples {
        tile.add(3, 5, Rgb::splat(*sample));
    }
    film
}

fn mean(film: &Film) -> f64 {
    let [mean] = film.means()[..] else { panic!("one pixel") };
    assert_eq!(mean, [mean[0]; 3]);
    mean[0]
}

/// The samples of a constant, of an exponential distribution, of 1e8 among exponential ones, and of magnitudes over 18
/// decades.
fn streams() -> [(&'static str, Vec<f32>); 4] {
    let mut random = Random(9);
    let mut stream = |f: &mut dyn FnMut(f64, usize) -> f64| -> Vec<f32> {
        (0..SAMPLES)
            .map(|i| f((f64::from(random.unit()) + 0.5 / 16_777_216.0).min(1.0), i) as f32)
            .collect()
    };
    [
        ("constant", stream(&mut |_, _| 0.1)),
        ("exponential", stream(&mut |u, _| -u.ln())),
        ("outlier", stream(&mut |u, i| if i == 777 { 1e8 } else { -u.ln() })),
        ("18 decades", stream(&mut |u, _| 10f64.powf(18.0 * u - 9.0))),
    ]
}

/// By the sum of integers: all samples are multiples of 2⁻⁸⁰ below 2³⁰, and their sum in these is below 2¹²⁷.
fn exact_mean(samples: &[f32]) -> f64 {
    const STEPS: f64 = (1u128 << 80) as f64;
    let whole = |s: &f32| {
        let steps = f64::from(*s) * STEPS;
        assert_eq!(steps.fract(), 0.0);
        steps as i128
    };
    samples.iter().map(whole).sum::<i128>() as f64 / STEPS / samples.len() as f64
}

fn ulps(a: f64, b: f64) -> u64 {
    a.to_bits().abs_diff(b.to_bits())
}

#[test]
fn the_mean_of_a_million_samples_is_exact_whatever_their_distribution() {
    for (name, samples) in streams() {
        let (found, exact) = (mean(&film(&samples)), exact_mean(&samples));
        println!("{name}: {found:e}, {} ulp of the exact mean", ulps(found, exact));
        // 1e-12 is what is asked; sums that keep their rounding error give the nearest numbers but for the last division.
        assert!((found / exact - 1.0).abs() < 1e-12, "{name}: {found:e} for {exact:e}");
        assert!(ulps(found, exact) <= 1, "{name}: {found:e} for {exact:e}");
    }
}

#[test]
fn partial_films_merge_to_the_same_mean_in_any_order() {
    let mut random = Random(10);
    for (name, samples) in streams() {
        let whole = mean(&film(&samples));
        let mut worst = 0;
        for parts in [2usize, 16, 1000] {
            let mut films: Vec<Film> = samples.chunks(SAMPLES.div_ceil(parts)).map(film).collect();
            for round in 0..20 {
                for i in (1..films.len()).rev() {
                    films.swap(i, random.below(i + 1));
                }
                let merged = if round % 2 == 0 {
                    // One by one.
                    films.iter().fold(Film::new(pixel()), merged)
                } else {
                    // By pairs, then pairs of pairs.
                    let mut level = films.clone();
                    while level.len() > 1 {
                        let pairs = level.chunks(2);
                        level = pairs
                            .map(|pair| pair[1..].iter().fold(pair[0].clone(), merged))
                            .collect();
                    }
                    level.swap_remove(0)
                };
                assert_eq!(merged.sample_range(), (SAMPLES as u32, SAMPLES as u32));
                worst = worst.max(ulps(mean(&merged), whole));
            }
        }
        println!("{name}: merged means within {worst} ulp");
        assert!(worst <= 1, "{name}: {worst} ulps");
    }
}

fn merged(mut to: Film, from: &Film) -> Film {
    to.merge(from).expect("films of the same pixel");
    to
}

#[test]
fn films_of_other_pixels_or_of_too_many_samples_are_refused_and_change_nothing() {
    let other = Rect { x1: 5, ..pixel() };
    let mut full = film(&[1.0, 3.0]);
    assert_eq!(full.merge(&Film::new(other)), Err(MergeError::Crop(pixel(), other)));
    // 2³² - 2 samples, by doubling.
    let many = (0..31).fold(film(&[]), |sum, bit| {
        if bit == 0 {
            film(&[2.0, 2.0])
        } else {
            merged(merged(sum.clone(), &sum), &film(&[2.0, 2.0]))
        }
    });
    assert_eq!(many.sample_range(), (u32::MAX - 1, u32::MAX - 1));
    assert_eq!(full.merge(&many), Err(MergeError::Samples));
    assert_eq!((mean(&full), full.sample_range()), (2.0, (2, 2)));
    let mut one = film(&[2.0]);
    assert_eq!(one.merge(&many), Ok(()));
    assert_eq!((mean(&one), one.sample_range()), (2.0, (u32::MAX, u32::MAX)));
}
