//! Alias tables from any weights: the bytes are little-endian f64.

use embrace::sampling::AliasTable;

/// More weights take time and show nothing new: the table's own test goes to 1e7.
const MOST: usize = 1024;

pub(crate) fn check(data: &[u8]) {
    let weights: Vec<f64> = data
        .as_chunks()
        .0
        .iter()
        .take(MOST)
        .map(|&b| f64::from_le_bytes(b))
        .collect();
    let usable: Vec<f64> = weights
        .iter()
        .map(|&w| if w.is_finite() && w > 0.0 { w } else { 0.0 })
        .collect();
    let largest = usable.iter().copied().fold(0.0, f64::max);
    let Some(table) = AliasTable::new(weights.iter().copied()) else {
        assert_eq!(largest, 0.0, "there is a positive weight, but no table");
        return;
    };
    assert_eq!(table.len(), weights.len());
    assert!(largest > 0.0, "there is no positive weight, but a table");

    let sum: f64 = usable.iter().map(|w| w / largest).sum();
    let pmf = table.implied_pmf();
    for (i, (&p, &w)) in pmf.iter().zip(&usable).enumerate() {
        let expected = w / largest / sum;
        // A slot's share is an f32: rounded to 2^-24 of itself, or to its smallest number where it is below the normal
        // ones. The rest of the 1e-6 that the table promises is for what its donors have been rounded by.
        let tolerance = 1e-6 * expected + f64::from(f32::from_bits(1));
        assert!((p - expected).abs() <= tolerance, "entry {i}: {p} for {expected}");
        assert!(w > 0.0 || p == 0.0, "entry {i} has no weight but a probability of {p}");
    }
    let total: f64 = pmf.iter().sum();
    assert!((total - 1.0).abs() < 1e-12, "the probabilities add up to {total}");

    // The lowest and the highest coin of every slot, and one between.
    let n = weights.len() as u128;
    for k in 0..n {
        let start = (k << 64).div_ceil(n) as u64;
        let end = (((k + 1) << 64).div_ceil(n) - 1) as u64;
        for u in [start, start + (end - start) / 3, end] {
            let drawn = table.sample(u) as usize;
            assert!(usable[drawn] > 0.0, "{u} draws entry {drawn}, which has no weight");
        }
    }
}
