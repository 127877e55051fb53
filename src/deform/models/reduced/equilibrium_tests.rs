//! The search for equilibria: what stillness and saddles do to it.

use super::super::strain_energy::QuarticEnergy;
use super::*;
use crate::fem::QuarticShape;

/// V = (q + q² - y₀²)² + 10³ y₀² + y₁², moved and then held still but for rounding: what the search leaves of q for the next
/// call is no slope by y₁.
#[test]
fn stillness_teaches_the_tangent_nothing() {
    let shape = QuarticShape { variables: 4 };
    let mut coefficients = vec![0.0; shape.len()];
    // z = (1, y₀, y₁, q).
    for (term, value) in [
        ([0, 0, 3, 3], 1.0),
        ([0, 3, 3, 3], 2.0),
        ([3, 3, 3, 3], 1.0),
        ([0, 1, 1, 3], -2.0),
        ([1, 1, 3, 3], -2.0),
        ([1, 1, 1, 1], 1.0),
        ([0, 0, 1, 1], 1e3),
        ([0, 0, 2, 2], 1.0),
    ] {
        coefficients[shape.at(term)] = value;
    }
    let mut body = ReducedBody::new([2, 1, 0], Box::new(QuarticEnergy::new(4, &coefficients).unwrap()));
    for k in 0..40 {
        let y = 0.3 + 1e-3 * f64::from(k);
        for still in 0..4 {
            body.settle(&[y, 1e-9 * (1.0 + 1e-15 * f64::from(still))], None).unwrap();
        }
        let steepest = body.tangent.iter().fold(0.0, |most: f64, slope| most.max(slope.abs()));
        assert!(steepest < 1.0, "dq/dy₀ is below 0.7 and dq/dy₁ is 0: {steepest:e}");
    }
}

/// V = y² + (q₁ + q₁² - y)² + (½ - y) q₂² + q₂⁴, pressed by y with q₂ = 0: beyond y = ½ that is stationary but not stable, and V is
/// least, y² - (y - ½)²/4, at q₂² = (y - ½)/2.
#[test]
fn what_is_pressed_along_its_axis_buckles() {
    let shape = QuarticShape { variables: 4 };
    let mut coefficients = vec![0.0; shape.len()];
    // z = (1, y, q₁, q₂).
    for (term, value) in [
        ([0, 0, 1, 1], 2.0),
        ([0, 0, 2, 2], 1.0),
        ([0, 2, 2, 2], 2.0),
        ([2, 2, 2, 2], 1.0),
        ([0, 0, 1, 2], -2.0),
        ([0, 1, 2, 2], -2.0),
        ([0, 0, 3, 3], 0.5),
        ([0, 1, 3, 3], -1.0),
        ([3, 3, 3, 3], 1.0),
    ] {
        coefficients[shape.at(term)] = value;
    }
    let mut body = ReducedBody::new([1, 2, 0], Box::new(QuarticEnergy::new(4, &coefficients).unwrap()));
    for y in [0.2, 0.4, 0.6, 0.8, 0.9] {
        let found = body.settle(&[y], None).unwrap();
        let most = (y - 0.5_f64).max(0.0);
        println!("{y}: {found}, q {:?}", body.q());
        assert!((found - (y * y - 0.25 * most * most)).abs() < 1e-9, "{y}: {found}");
        assert!((body.q()[1].powi(2) - 0.5 * most).abs() < 1e-5, "{y}: {:?}", body.q());
    }
}

/// V = y² + (q₁ - y)² - 10⁻⁸ q₂² + q₂⁴, all but flat along q₂: the second derivatives are not positive definite, but V falls nowhere that
/// rounding would show, and the last step is Newton's, not one along q₂.
#[test]
fn a_mode_along_which_nothing_falls_is_not_gone() {
    let shape = QuarticShape { variables: 4 };
    let mut coefficients = vec![0.0; shape.len()];
    // z = (1, y, q₁, q₂).
    for (term, value) in [
        ([0, 0, 1, 1], 2.0),
        ([0, 0, 2, 2], 1.0),
        ([0, 0, 1, 2], -2.0),
        ([0, 0, 3, 3], -1e-8),
        ([3, 3, 3, 3], 1.0),
    ] {
        coefficients[shape.at(term)] = value;
    }
    let mut body = ReducedBody::new([1, 2, 0], Box::new(QuarticEnergy::new(4, &coefficients).unwrap()));
    let found = body.settle(&[0.3], None).unwrap();
    assert!((found - 0.09).abs() < 1e-9, "{found}");
    assert!((body.q()[0] - 0.3).abs() < 1e-6 && body.q()[1].abs() < 1e-3, "{:?}", body.q());
}
