//! Discrete sampling in constant time by the alias method (the article's section 2.2.2).
//!
//! Construction after Vose 1991, IEEE TSE 17(9). Slot `k` returns itself with probability `keep[k]`, else `alias[k]`,
//! so that for `n` slots
//!
//! P(i) = (keep\[i\] + Σ over k with alias\[k\] = i of (1 − keep\[k\])) / n.     (1)
//!
//! Three things separate this from the textbook:
//! - residual weights are f64. With f32 the residual of a hot entry stops changing when small deficits are taken from
//!   it, and the entries left over are then drawn too often: a map with one texel 1e8 times brighter than the rest
//!   doubles the light of everything that texel does not reach.
//! - a deficit is what the *stored* f32 leaves open, and each stored value is rounded against the error accumulated so
//!   far. Rounding therefore never piles up on one entry, and (1) holds to about 1e-7 relative for every entry.
//! - the slot and the coin come from one 64-bit number: the slot from its high part, the coin from the 40 or more bits
//!   that remain for any table that fits in memory. A 24-bit float would leave one bit for a 4096 × 2048 map.

use prefetch_index::prefetch_index;
use std::hint::select_unpredictable;

/// A table that draws index `i` with probability proportional to the `i`-th weight. Eight bytes per entry.
#[derive(Clone, Debug, Default)]
pub struct AliasTable {
    slots: Vec<Slot>,
}

#[derive(Clone, Copy, Debug)]
struct Slot {
    keep: f32,
    alias: u32,
}

impl AliasTable {
    /// Builds the table in O(n).
    ///
    /// Weights that are negative, NaN or infinite count as zero; callers that can name the culprit reject them first.
    /// Returns `None` if no weight is positive. At most 2³² entries.
    pub fn new(weights: impl ExactSizeIterator<Item = f64> + Clone) -> Option<AliasTable> {
        let n = weights.len();
        assert!(u32::try_from(n).is_ok(), "an alias table holds at most 2^32 entries");
        let usable = |w: f64| if w.is_finite() && w > 0.0 { w } else { 0.0 };
        // Scaled by the largest weight first: neither a sum of huge weights nor one of tiny ones leaves the f64 range.
        let largest = weights.clone().map(usable).fold(0.0, f64::max);
        if largest == 0.0 {
            return None;
        }
        let sum = accurate_sum(weights.clone().map(|w| usable(w) / largest));
        let mut residual: Vec<f64> = weights.map(|w| usable(w) / largest * (n as f64 / sum)).collect();

        let mut slots: Vec<Slot> = (0..n as u32).map(|k| Slot { keep: 1.0, alias: k }).collect();
        let mut small = Vec::new();
        let mut large = Vec::new();
        for (k, &r) in residual.iter().enumerate() {
            if r < 1.0 {
                small.push(k as u32)
            } else {
                large.push(k as u32)
            }
        }
        let mut rounding = 0.0; // what the stored values add up to, less what they should
        let mut lost = 0.0; // what subtraction has rounded away from the current donor (Kahan 1965)
        while let (Some(&a), Some(&b)) = (small.last(), large.last()) {
            small.pop();
            let keep = round_against(residual[a as usize], rounding);
            rounding += f64::from(keep) - residual[a as usize];
            slots[a as usize] = Slot { keep, alias: b };
            let deficit = 1.0 - f64::from(keep) + lost;
            let left = residual[b as usize] - deficit;
            lost = deficit - (residual[b as usize] - left);
            residual[b as usize] = left;
            if left < 1.0 {
                lost = 0.0;
                large.pop();
                small.push(b);
            }
        }
        // One queue is empty; what is left has a residual of 1 up to f64 rounding, except that an entry without weight
        // must never be drawn.
        let heaviest = (0..n).max_by(|&a, &b| residual[a].total_cmp(&residual[b])).unwrap_or(0) as u32;
        for k in small {
            if residual[k as usize] <= 0.0 {
                slots[k as usize] = Slot {
                    keep: 0.0,
                    alias: heaviest,
                };
            }
        }
        Some(AliasTable { slots })
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Draws an index from 64 uniform random bits, of which the high ones matter most.
    #[inline]
    pub fn sample(&self, u: u64) -> u32 {
        let (k, rest) = self.slot(u);
        let coin = (rest >> 11) as i64 as f64 * (1.0 / 9_007_199_254_740_992.0);
        let slot = self.slots[k];
        // A branch on the coin could not be predicted, and would hold up the loads behind it.
        select_unpredictable(coin < f64::from(slot.keep), k as u32, slot.alias)
    }

    /// Asks for the memory that [`AliasTable::sample`] reads.
    #[inline(always)]
    pub fn prefetch(&self, u: u64) {
        prefetch_index(&self.slots, self.slot(u).0);
    }

    /// The slot for random bits, and the bits that are left.
    #[inline(always)]
    fn slot(&self, u: u64) -> (usize, u64) {
        let scaled = u128::from(u) * self.slots.len() as u128;
        ((scaled >> 64) as usize, scaled as u64)
    }

    /// The probability of every index as the table draws it, equation (1). This, and not the weights, is what an
    /// estimator has to divide by.
    pub fn implied_pmf(&self) -> Vec<f64> {
        let n = self.slots.len() as f64;
        let mut pmf = vec![0.0; self.slots.len()];
        for (k, slot) in self.slots.iter().enumerate() {
            pmf[k] += f64::from(slot.keep) / n;
            pmf[slot.alias as usize] += (1.0 - f64::from(slot.keep)) / n;
        }
        pmf
    }

    /// Bytes held.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(&*self.slots)
    }
}

/// A sum with the rounding error of each addition carried along (Neumaier 1974): the total of 1e7 weights is wanted to
/// better than one of them.
fn accurate_sum(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut lost) = (0.0f64, 0.0f64);
    for value in values {
        let next = sum + value;
        lost += if sum.abs() >= value.abs() {
            (sum - next) + value
        } else {
            (value - next) + sum
        };
        sum = next;
    }
    sum + lost
}

/// The f32 next to `value` in [0, 1] on the side that brings the accumulated `error` back towards zero. Zero stays zero.
fn round_against(value: f64, error: f64) -> f32 {
    let nearest = value as f32;
    let wide = f64::from(nearest);
    let rounded = if wide == value {
        nearest
    } else if error > 0.0 {
        if wide > value { nearest.next_down() } else { nearest }
    } else if wide < value {
        nearest.next_up()
    } else {
        nearest
    };
    rounded.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small generator for test weights (SplitMix64, Steele et al. 2014).
    fn splitmix(state: &mut u64) -> u64 {
        *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (*state ^ (*state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn assert_implied_pmf(name: &str, weights: &[f64]) {
        let table = AliasTable::new(weights.iter().copied()).expect("some weight is positive");
        let sum = accurate_sum(weights.iter().copied());
        for (i, (p, w)) in table.implied_pmf().iter().zip(weights).enumerate() {
            let expected = w / sum;
            if expected == 0.0 {
                assert_eq!(*p, 0.0, "{name}: entry {i} has no weight");
            } else {
                assert!(
                    (p / expected - 1.0).abs() < 1e-6,
                    "{name}, n = {}: entry {i}: {p} for {expected}",
                    weights.len()
                );
            }
        }
    }

    #[test]
    fn the_implied_pmf_is_the_weights_for_every_kind_of_weights_and_size() {
        let mut state = 1;
        for n in [1usize, 2, 3, 7, 100, 10_007, 1_000_000, 10_000_000] {
            let uniform = |s: &mut u64| (splitmix(s) >> 11) as f64 / (1u64 << 53) as f64;
            assert_implied_pmf("random", &(0..n).map(|_| uniform(&mut state)).collect::<Vec<_>>());
            assert_implied_pmf("constant", &vec![0.1; n]);
            let mut hot = vec![1.0; n];
            hot[n / 3] = 1e12;
            assert_implied_pmf("one hot", &hot);
            let mut two = vec![1.0; n];
            two[n / 2] = 2.0;
            assert_implied_pmf("one of double weight", &two);
            let mut zeros: Vec<f64> = (0..n)
                .map(|_| {
                    if splitmix(&mut state) & 1 == 0 {
                        0.0
                    } else {
                        uniform(&mut state)
                    }
                })
                .collect();
            zeros[n - 1] = 0.5;
            assert_implied_pmf("half zero", &zeros);
            assert_implied_pmf(
                "twelve decades",
                &(0..n)
                    .map(|_| 10f64.powf(12.0 * uniform(&mut state) - 6.0))
                    .collect::<Vec<_>>(),
            );
        }
    }

    #[test]
    fn an_index_of_zero_weight_is_never_drawn() {
        let weights: Vec<f64> = (0..1000)
            .map(|i| if i % 3 == 0 { 0.0 } else { 1.0 + f64::from(i) })
            .collect();
        let table = AliasTable::new(weights.iter().copied()).unwrap();
        let mut state = 7;
        for draw in 0..1_000_000u64 {
            // Random numbers, and for every slot its lowest and its highest coin.
            let u = match draw {
                0..1000 => ((u128::from(draw) << 64) / 1000) as u64 + 1,
                1000..2000 => ((u128::from(draw - 999) << 64) / 1000 - 1) as u64,
                _ => splitmix(&mut state),
            };
            let i = table.sample(u);
            assert!(weights[i as usize] > 0.0, "drew {i} from {u}");
        }
    }

    #[test]
    fn no_positive_weight_makes_no_table() {
        assert!(AliasTable::new([0.0, -1.0, f64::NAN].into_iter()).is_none());
        assert!(AliasTable::new(std::iter::empty()).is_none());
    }

    #[test]
    fn weights_at_the_ends_of_the_f64_range_neither_overflow_nor_vanish() {
        assert_implied_pmf("huge", &[1e300, 2e300, 3e300]);
        assert_implied_pmf("tiny", &[1e-300, 2e-300, 3e-300]);
    }
}
