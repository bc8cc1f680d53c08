//! Multiple importance sampling weights (Veach 1997, section 9.2).

/// The power heuristic (β = 2) for one sample of each of two techniques: the weight of the technique whose density at
/// the sample is `pdf`, against the other's.
///
/// Both densities in the same measure, 0 or more. An infinite `pdf` (a delta lobe) takes all the weight, an infinite
/// `other` takes it away; both zero gives zero.
#[inline(always)]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    if pdf == 0.0 {
        return 0.0;
    }
    // As a ratio, so that densities above 1e19 do not overflow when squared.
    let r = other / pdf;
    if r.is_nan() { 0.5 } else { 1.0 / (1.0 + r * r) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_weights_sum_to_one_over_the_whole_range_of_densities() {
        for a in [1e-30f32, 1e-3, 1.0, 7.0, 1e20, 1e38] {
            for b in [1e-30f32, 1e-3, 1.0, 7.0, 1e20, 1e38] {
                let sum = power_heuristic(a, b) + power_heuristic(b, a);
                assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
            }
        }
    }

    #[test]
    fn zero_and_infinite_densities_give_defined_weights() {
        assert_eq!(power_heuristic(0.0, 1.0), 0.0);
        assert_eq!(power_heuristic(0.0, 0.0), 0.0);
        assert_eq!(power_heuristic(f32::INFINITY, 1.0), 1.0);
        assert_eq!(power_heuristic(1.0, f32::INFINITY), 0.0);
        assert_eq!(power_heuristic(1.0, 0.0), 1.0);
    }
}
