//! Three ways to draw an index by weight, timed: the alias method, binary search in the cumulative table, and a linear scan.
//!
//! The tables are those of an environment map with a sun: most weights near each other, some far above. Draws are
//! independent, as in a renderer, so that the processor may overlap them; the random numbers are in the time of all three.

use crate::sampling::AliasTable;
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::time::Instant;

/// How long one measurement of one method takes, about (s).
const SECONDS: f64 = 0.03;

/// Measurements of each method, taking turns; the median counts.
const ROUNDS: usize = 5;

/// Entries from which on a linear scan is left out: a draw takes tens of milliseconds.
const LONGEST_SCAN: u64 = 10_000_000;

/// Peak memory while the tables of one entry are built: weights and residuals, stacks, both tables.
const BYTES_PER_ENTRY: u64 = 40;

/// Bytes of a line of the cache.
const LINE: u64 = 64;

/// What a table of one size takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Choice {
    /// Entries.
    pub entries: u64,
    /// Bytes of either table.
    pub table_bytes: u64,
    /// Time of a draw by the alias method (ns).
    pub alias_ns: f64,
    /// Time of a draw by binary search (ns).
    pub binary_ns: f64,
    /// Time of a draw by linear scan (ns); `None` where it would take too long.
    pub linear_ns: Option<f64>,
    /// Time to build the alias table (ns per entry).
    pub alias_build_ns: f64,
    /// Time to build the cumulative table (ns per entry).
    pub cumulative_build_ns: f64,
    /// Lines of the cache that a draw touches: alias, binary search, linear scan.
    pub lines: [f64; 3],
    /// Cache misses of a draw as the processor counts them, in the same order; `None` where the system does not tell, and for
    /// what was left out.
    pub misses: [Option<f64>; 3],
}

/// What a table of so many entries needs while it is built (bytes).
pub fn memory_bytes(entries: u64) -> u64 {
    entries * BYTES_PER_ENTRY
}

/// Measures tables of a size.
pub fn measure(entries: u64) -> Choice {
    let n = entries as usize;
    let weights = || (0..n).map(|i| weight(i as u64));
    let (alias, alias_seconds) = timed(|| AliasTable::new(weights()).expect("weights are positive"));
    let (cumulative, cumulative_seconds) = timed(|| {
        let mut sum = 0.0;
        weights()
            .map(|w| {
                sum += w;
                sum
            })
            .collect::<Vec<f64>>()
    });
    let total = cumulative[n - 1];
    let by_alias = |bits: u64| alias.sample(bits) as usize;
    let by_binary_search = |bits: u64| cumulative.partition_point(|&c| c <= unit(bits) * total);
    let by_scan = |bits: u64| {
        let u = unit(bits) * total;
        cumulative.iter().position(|&c| c > u).unwrap_or(n - 1)
    };

    let scans = entries <= LONGEST_SCAN;
    let draws = [
        draws_in(&by_alias),
        draws_in(&by_binary_search),
        if scans { draws_in(&by_scan) } else { 0 },
    ];
    let mut times = [const { Vec::new() }; 3];
    for round in 0..ROUNDS as u64 {
        times[0].push(nanoseconds(&by_alias, draws[0], round));
        times[1].push(nanoseconds(&by_binary_search, draws[1], round));
        if scans {
            times[2].push(nanoseconds(&by_scan, draws[2], round));
        }
    }
    let [alias_ns, binary_ns, linear_ns] = times.map(|mut times| {
        times.sort_unstable_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    });
    let misses = [
        misses(&by_alias, draws[0]),
        misses(&by_binary_search, draws[1]),
        scans.then(|| misses(&by_scan, draws[2])).flatten(),
    ];
    let per_line = (LINE / 8) as f64;
    Choice {
        entries,
        table_bytes: 8 * entries,
        alias_ns: alias_ns.expect("was measured"),
        binary_ns: binary_ns.expect("was measured"),
        linear_ns,
        alias_build_ns: alias_seconds * 1e9 / n as f64,
        cumulative_build_ns: cumulative_seconds * 1e9 / n as f64,
        // The last steps of a binary search are within one line.
        lines: [
            1.0,
            (n as f64 / per_line).log2().max(0.0) + 1.0,
            (n as f64 / 2.0 / per_line).max(1.0),
        ],
        misses,
    }
}

/// A weight as of a sky: a smooth part, and one texel in a million that is a million times as bright.
fn weight(i: u64) -> f64 {
    let bits = mix(i.wrapping_mul(2) + 1);
    if bits.is_multiple_of(1_000_000) {
        1e6
    } else {
        0.5 + unit(bits)
    }
}

fn timed<T>(f: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let value = f();
    (value, start.elapsed().as_secs_f64())
}

/// How many draws take about [`SECONDS`].
fn draws_in(draw: &impl Fn(u64) -> usize) -> u64 {
    let mut draws = 8;
    loop {
        let seconds = nanoseconds(draw, draws, 0) * 1e-9 * draws as f64;
        if seconds > SECONDS * 0.1 {
            return ((draws as f64 * SECONDS / seconds) as u64).max(8);
        }
        draws *= 4;
    }
}

/// Time of one of many draws.
fn nanoseconds(draw: &impl Fn(u64) -> usize, draws: u64, round: u64) -> f64 {
    let (_, seconds) = timed(|| {
        let mut sum = 0;
        for i in 0..draws {
            sum ^= draw(mix(round << 40 | i));
        }
        black_box(sum)
    });
    seconds * 1e9 / draws as f64
}

/// Cache misses of one of many draws.
#[cfg(target_os = "linux")]
fn misses(draw: &impl Fn(u64) -> usize, draws: u64) -> Option<f64> {
    use perf_event::Builder;
    use perf_event::events::Hardware;
    let mut counter = Builder::new(Hardware::CACHE_MISSES).build().ok()?;
    counter.enable().ok()?;
    nanoseconds(draw, draws, ROUNDS as u64);
    counter.disable().ok()?;
    Some(counter.read().ok()? as f64 / draws as f64)
}

/// Cache misses of one of many draws: only Linux is asked.
#[cfg(not(target_os = "linux"))]
fn misses(_: &impl Fn(u64) -> usize, _: u64) -> Option<f64> {
    None
}

/// In [0, 1).
fn unit(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}

/// Random bits of a counter (SplitMix64, Steele et al. 2014).
fn mix(counter: u64) -> u64 {
    let z = counter.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_measured_for_a_small_table_and_the_linear_scan_is_left_out_of_none() {
        let choice = measure(1000);
        assert_eq!(choice.table_bytes, 8000);
        assert!(choice.alias_ns > 0.0 && choice.binary_ns > 0.0 && choice.linear_ns.is_some_and(|t| t > 0.0));
        assert_eq!(choice.lines[0], 1.0);
        assert!(choice.lines[1] < choice.lines[2]);
    }
}
