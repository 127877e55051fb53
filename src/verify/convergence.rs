//! The order of convergence from a sequence of meshes.

use serde::Serialize;

/// One mesh of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Size of a cell as a part of the body's.
    pub h: f64,
    pub nodes: usize,
    pub value: f64,
    /// Relative.
    pub error: f64,
    /// Time from assembly to displacements, s.
    pub seconds: f64,
}

/// Slope of log(error) over log(h) by least squares, over the levels whose error is more than twice what the reference
/// is `known_to`; smaller errors are those of the reference. `None` with fewer than two such levels, or where an error is
/// 0 or not finite.
pub fn rate(levels: &[Level], known_to: f64) -> Option<f64> {
    let told = levels.iter().filter(|level| level.error.is_nan() || level.error > 2.0 * known_to);
    let points: Vec<(f64, f64)> = told.map(|level| (level.h.ln(), level.error.ln())).collect();
    if points.len() < 2 {
        return None;
    }
    let count = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / count, sum.1 + y / count));
    let product: f64 = points.iter().map(|(x, y)| (x - mean.0) * (y - mean.1)).sum();
    let slope = product / points.iter().map(|(x, _)| (x - mean.0).powi(2)).sum::<f64>();
    slope.is_finite().then_some(slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(h: &[f64], error: impl Fn(f64) -> f64) -> Vec<Level> {
        h.iter().map(|&h| Level { h, nodes: 0, value: 0.0, error: error(h), seconds: 0.0 }).collect()
    }

    #[test]
    fn powers_are_found_again() {
        for p in [0.7, 1.0, 2.5, 4.0] {
            let levels = levels(&[1.0, 0.5, 1.0 / 3.0, 0.25], |h| 3.0 * h.powf(p));
            assert!((rate(&levels, 0.0).unwrap() - p).abs() < 1e-12);
        }
    }

    #[test]
    fn errors_below_what_the_reference_is_known_to_are_left_out() {
        let levels = levels(&[1.0, 0.5, 0.25], |h| if h < 0.3 { 0.015 } else { 0.1 * h * h });
        assert!((rate(&levels, 0.01).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(rate(&levels, 0.03), None);
    }

    #[test]
    fn no_rate_is_made_up() {
        assert_eq!(rate(&levels(&[1.0], |_| 1.0), 0.0), None);
        assert_eq!(rate(&levels(&[1.0, 0.5], |_| f64::NAN), 0.0), None);
        assert_eq!(rate(&levels(&[1.0, 0.5], |_| f64::INFINITY), 0.0), None);
    }
}
