//! Medians and quantiles of measured numbers.

/// The median: the middle number, of an even count the mean of the middle two; 0 of none.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let sorted = sorted(values);
    let middle = sorted.len() / 2;
    match sorted.len() {
        0 => 0.0,
        count if count % 2 == 1 => sorted[middle],
        _ => sorted[middle - 1] + 0.5 * (sorted[middle] - sorted[middle - 1]),
    }
}

/// The number nearest to the place `share` (0 to 1) in ascending order: the largest with `share` = 1; 0 of none.
pub fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let sorted = sorted(values);
    let at = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(at).copied().unwrap_or(0.0)
}

/// The larger of two numbers, or NaN where one of them is NaN, which `f64::max` would drop.
pub fn larger(a: f64, b: f64) -> f64 {
    if b.is_nan() || b > a { b } else { a }
}

fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_count_is_the_mean_of_the_middle_two() {
        assert_eq!(median([0.5, 0.25]), 0.375);
        assert_eq!(median([4.0, 1.0, 3.0, 2.0]), 2.5);
        assert_eq!(median([5.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([7.0]), 7.0);
        assert_eq!(median([]), 0.0);
        assert_eq!(median([f64::MAX, f64::MAX]), f64::MAX, "no overflow");
    }

    #[test]
    fn the_larger_of_a_number_and_nan_is_nan() {
        assert_eq!((larger(1.0, 2.0), larger(2.0, 1.0)), (2.0, 2.0));
        assert!([f64::NAN, 1.0, 3.0].into_iter().fold(0.0, larger).is_nan());
        assert!([1.0, 3.0, f64::NAN].into_iter().fold(0.0, larger).is_nan());
    }

    #[test]
    fn quantiles_are_numbers_that_were_measured() {
        assert_eq!(quantile([3.0, 1.0, 2.0], 1.0), 3.0);
        assert_eq!(quantile((0..=100).map(f64::from), 0.99), 99.0);
        assert_eq!(quantile([], 0.5), 0.0);
        // Places 1.8 and 1.2 of 0 to 3.
        assert_eq!([0.6, 0.4].map(|share| quantile([4.0, 1.0, 3.0, 2.0], share)), [3.0, 2.0]);
    }
}
