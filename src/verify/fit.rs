//! Orders of convergence from a sequence of meshes.

/// Slope of log(error) over log(h) by least squares; `None` of fewer than two levels, or where an error is 0 or not
/// finite.
pub fn rate_of_errors(h: &[f64], errors: impl IntoIterator<Item = f64>) -> Option<f64> {
    let points: Vec<(f64, f64)> = h.iter().zip(errors).map(|(h, error)| (h.ln(), error.ln())).collect();
    let (_, slope) = line(&points)?;
    slope.is_finite().then_some(slope)
}

/// p of value = limit + c h^p by least squares; `None` of fewer than three levels, and where the values
/// do not all go one way by smaller and smaller steps.
///
/// For published references: their own last digit is soon larger than the error, and the slope of log(error) would
/// then tell of the digit. p is looked for in steps of 0.01 up to 8.
pub fn rate_of_values(h: &[f64], values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.into_iter().collect();
    let slopes: Vec<f64> =
        (1..values.len()).map(|i| (values[i] - values[i - 1]) / (h[i - 1] - h[i])).collect();
    let is_one_way = slopes.len() >= 2 && slopes.iter().all(|slope| slope * slopes[0] > 0.0);
    if !is_one_way {
        return None;
    }
    let misfit = |p: f64| {
        let points: Vec<(f64, f64)> =
            h.iter().zip(&values).map(|(size, &value)| ((size / h[0]).powf(p), value)).collect();
        let (limit, slope) = line(&points)?;
        Some(points.iter().map(|(x, y)| (y - limit - slope * x).powi(2)).sum::<f64>())
    };
    let rates = (5..=800).map(|step| f64::from(step) * 0.01);
    let best = rates.filter_map(|p| Some((p, misfit(p)?))).min_by(|a, b| a.1.total_cmp(&b.1))?.0;
    (best > 0.05 && best < 8.0).then_some(best)
}

/// Intercept and slope of the line of least squares.
fn line(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    if points.len() < 2 {
        return None;
    }
    let count = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / count, sum.1 + y / count));
    let product: f64 = points.iter().map(|(x, y)| (x - mean.0) * (y - mean.1)).sum();
    let slope = product / points.iter().map(|(x, _)| (x - mean.0).powi(2)).sum::<f64>();
    Some((mean.1 - slope * mean.0, slope))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_found_again() {
        let h = [1.0, 0.5, 1.0 / 3.0, 0.25];
        for p in [0.7_f64, 1.0, 2.5, 4.0] {
            let errors = h.map(|h: f64| 3.0 * h.powf(p));
            assert!((rate_of_errors(&h, errors).unwrap() - p).abs() < 1e-12);
            let found = rate_of_values(&h, errors.map(|error| 7.0 - error)).unwrap();
            assert!((found - p).abs() < 0.011, "{p}: {found}");
        }
    }

    #[test]
    fn no_rate_is_made_up() {
        assert_eq!(rate_of_errors(&[1.0], [1.0]), None);
        assert_eq!(rate_of_errors(&[1.0, 0.5], [1.0, 0.0]), None);
        assert_eq!(rate_of_errors(&[1.0, 0.5], [1.0, f64::NAN]), None);
        assert_eq!(rate_of_values(&[1.0, 0.5], [1.0, 2.0]), None);
        assert_eq!(rate_of_values(&[1.0, 0.5, 0.25], [1.0, 2.0, 1.5]), None);
        assert_eq!(rate_of_values(&[1.0, 0.5, 0.25], [1.0, 2.0, 4.0]), None);
    }
}
