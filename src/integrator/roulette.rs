//! Russian roulette: how likely a path goes on.

use super::Roulette;
use crate::math::Rgb;

/// Roulette by throughput lets a path survive with this times what it carries, relative to its first scattering. The
/// variance that a path may still bring grows with the square of its weight and its cost does not depend on it, so the best
/// that roulette can do is to keep weights equal; with a factor of 1 they would be kept as large as at the first vertex,
/// where all of the pixel's light arrives, and more error added than time saved (docs/performance.md). Relative to the first
/// scattering, because that is how an error counts: paths from dark surfaces are worth as much as those from bright ones.
pub(super) const FACTOR: f32 = 3.0;

/// Least and most that a path may survive a round of roulette by throughput with: after fewer than [`EARLY`] scattering
/// events, and after more. However little a path carries, the emitter that it meets may be as much brighter; by throughput
/// alone a path of 1e-12 would survive once in 1e12 samples, and the light that it brings be missing from every image. And
/// white walls would trap a path for good.
const SURVIVAL: [(f32, f32); 2] = [(0.5, 1.0), (0.05, 0.95)];

/// See [`SURVIVAL`].
const EARLY: u32 = 4;

/// The probability that random numbers, which are multiples of 2⁻²⁴, meet exactly: `p` rounded down to the next, but not to
/// 0. Any other would be met by too many; one below 2⁻²⁴ by the number 0, at a weight of 1 / `p`.
#[inline]
fn drawable(p: f32) -> f32 {
    const STEPS: f32 = 16_777_216.0;
    ((p * STEPS) as i32).max(i32::from(p > 0.0)) as f32 / STEPS
}

/// A round of roulette: what is the same for all paths.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    least: f32,
    most: f32,
}

impl Round {
    /// The round after the `depth`-th scattering event; `None` if nobody plays.
    pub(super) fn new(roulette: Roulette, depth: u32) -> Option<Round> {
        let (least, most) = match roulette {
            Roulette::Off => return None,
            Roulette::Fixed(survival) => (drawable(survival), drawable(survival)),
            Roulette::Throughput => SURVIVAL[usize::from(depth >= EARLY)],
        };
        Some(Round { least, most })
    }

    /// The probability that a path goes on, by its throughput times all that roulette weighs it with.
    #[inline(always)]
    #[allow(clippy::manual_clamp, reason = "clamp keeps NaN, and a path of NaN would never end")]
    pub(super) fn survival(self, carried: Rgb) -> f32 {
        carried.max_component().max(self.least).min(self.most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probabilities_are_met_by_exactly_as_many_random_numbers() {
        let step = 1.0 / 16_777_216.0;
        for p in [
            f32::MIN_POSITIVE,
            1e-9,
            step,
            1.5 * step,
            1e-6,
            0.05,
            0.3,
            SURVIVAL[1].1,
            1f32.next_down(),
        ] {
            let met = drawable(p);
            assert!(met > 0.0 && met < 1.0 && (met - p).abs() <= step, "{p} {met}");
            assert_eq!((met / step).fract(), 0.0, "{p} {met}");
        }
        assert_eq!([0.0, f32::NAN].map(drawable), [0.0; 2]);
    }
}
