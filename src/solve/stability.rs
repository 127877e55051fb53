//! Measures how near an equilibrium is to losing its stability: the least eigenvalues of its tangent stiffness.
//!
//! In: A, and its inverse applied to a block of columns. Out: the eigenvalues λ of A φ = λ φ that are nearest to zero with their
//! modes φ, by subspace iteration (Bathe, Finite Element Procedures, section 11.6): X ← A⁻¹ X, then the Ritz vectors of A on it.
//! Where an equilibrium becomes critical, λ falls to zero: linearly along the way where the body buckles to either side
//! (a bifurcation), as a square root where it snaps (a limit point) (Wriggers, Nonlinear Finite Element Methods, section
//! 7.1).

use super::error::SolveError;
use crate::fem::NodeFields;
use nalgebra::{DMatrix, SymmetricEigen};

/// Vectors that are iterated together, so that a mode that has a twin is found as fast as one that has none.
const BLOCK: usize = 4;
/// Change of the least eigenvalue, as a part, at which it is found: beside a critical state, and of any equilibrium.
pub(super) const EXACT: f64 = 1e-8;
pub(super) const ROUGH: f64 = 1e-3;
/// The iteration ends at the latest after this number of solves.
const MOST: usize = 60;
/// Eigenvalues up to this many times the least belong to one mode and its twins.
const TWIN: f64 = 1.2;

/// The stability of an equilibrium on a path.
#[derive(Clone, Debug, PartialEq)]
pub struct Stability {
    /// The least eigenvalue of the tangent stiffness at the free nodes, in parts of that at rest.
    pub least: f64,
    /// The least eigenvalue at rest, N/m.
    pub at_rest: f64,
    /// The share of the way at which it extrapolates to zero; `None` where it does not fall.
    pub zero_at: Option<f64>,
    /// Whether it is the stiffness of the mode that is lost, and not the solver at its end.
    pub is_critical: bool,
    /// The eigenvector of the least eigenvalue, of length 1, over all nodes.
    pub mode: NodeFields,
    /// Modes that lose their stiffness together, this one counted.
    pub modes: usize,
    /// |cosine| between the mode and the way on which the body would go: near 1 the path itself drives the mode, and the
    /// body snaps; near 0 it does not, and the body buckles to either side.
    pub driven: f64,
}

impl Stability {
    /// Whether the path ends because the body snaps, not because it buckles.
    pub fn snaps(&self) -> bool {
        self.driven > 0.5
    }
}

/// A matrix applied to a block of columns.
type Multiply<'a> = &'a dyn Fn(&DMatrix<f64>) -> DMatrix<f64>;
/// The inverse of that matrix, applied to a block of columns.
type Solve<'a> = &'a dyn Fn(&DMatrix<f64>) -> Result<DMatrix<f64>, SolveError>;

/// The eigenvalues of a symmetric matrix with `rows` rows that are nearest to zero, ascending, and the mode of the first, of length 1. The
/// iteration ends where the first changes by no more than the part `tolerance`.
pub(super) fn least_modes(
    rows: usize,
    tolerance: f64,
    solve: Solve<'_>,
    multiply: Multiply<'_>,
) -> Result<(Vec<f64>, DMatrix<f64>), SolveError> {
    let columns = BLOCK.min(rows);
    let mut x = DMatrix::from_row_slice(rows, columns, &scattered(rows * columns));
    let mut least = f64::INFINITY;
    let mut values = Vec::new();
    for _ in 0..MOST {
        let q = solve(&x)?.qr().q();
        let small = q.transpose() * multiply(&q);
        let ritz = SymmetricEigen::new((&small + small.transpose()) * 0.5);
        let mut order: Vec<usize> = (0..columns).collect();
        order.sort_by(|&i, &j| ritz.eigenvalues[i].total_cmp(&ritz.eigenvalues[j]));
        values = order.iter().map(|&i| ritz.eigenvalues[i]).collect();
        x = q * DMatrix::from_fn(columns, columns, |i, j| ritz.eigenvectors[(i, order[j])]);
        if (least - values[0]).abs() <= tolerance * values[0].abs() {
            break;
        }
        least = values[0];
    }
    let mode = if columns == 0 { DMatrix::zeros(rows, 1) } else { x.columns(0, 1).into_owned() };
    Ok((values, mode))
}

/// Number of eigenvalues that fall together with the least.
pub(super) fn twins(values: &[f64]) -> usize {
    values.iter().filter(|&&value| value <= TWIN * values[0]).count()
}

/// The share at which λ comes to zero, from two equilibria (share, λ): on a straight line, or where the body snaps on one of λ².
pub(super) fn zero_at(before: (f64, f64), now: (f64, f64), snaps: bool) -> Option<f64> {
    let of = |value: f64| if snaps { value * value } else { value };
    let slope = (of(now.1) - of(before.1)) / (now.0 - before.0);
    (slope < 0.0).then(|| now.0 - of(now.1) / slope)
}

/// Numbers between -1 and 1 without a pattern, always the same (Weyl's sequence).
pub(super) fn scattered(count: usize) -> Vec<f64> {
    (1..=count).map(|i| 2.0 * (i as f64 * 0.754_877_666_246_692_7).fract() - 1.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// λ = 1 - s/0.8 of a body that buckles and λ = √(1 - s/0.8) of one that snaps vanish at 0.8.
    #[test]
    fn a_stiffness_falls_to_zero_on_a_line_or_as_a_square_root() {
        for snaps in [false, true] {
            let least = |s: f64| if snaps { (1.0 - s / 0.8).sqrt() } else { 1.0 - s / 0.8 };
            let found = zero_at((0.3, least(0.3)), (0.6, least(0.6)), snaps).unwrap();
            assert!((found - 0.8).abs() < 1e-12, "{snaps}: {found}");
        }
        assert_eq!(zero_at((0.3, 0.5), (0.6, 0.7), false), None);
        assert_eq!(twins(&[2.0, 2.3, 2.5, 9.0]), 2);
    }
}
