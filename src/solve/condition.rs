//! How far a solution can be from the exact one: the condition number of A and a bound on the forward error.
//!
//! In: A, ways to apply A and A⁻¹, and a solution with its residual. Out: two numbers for the closing table and the
//! .green file. Each costs a few solves with one right-hand side.

use super::error::SolveError;
use super::residual::Column;
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::DMatrix;

/// A⁻¹ on some columns.
pub type Inverse<'a> = &'a (dyn Fn(&NodeFields) -> Result<NodeFields, SolveError> + Sync);

/// Lanczos steps on A and on A⁻¹, after which the extreme eigenvalues are known to about ten per cent, from below.
const STEPS: usize = 12;
const INVERSE_STEPS: usize = 6;
/// Rounds of the 1-norm estimator; it seldom needs a third.
const ROUNDS: usize = 3;
/// Unit roundoff of f64.
pub(super) const ROUNDOFF: f64 = 1.1e-16;

/// κ₂(S A S) with S = diag(A)^-1/2, by Lanczos with full reorthogonalisation (Golub and Van Loan, Matrix
/// Computations, 4th ed., section 10.1); an estimate from below. Scaling by the diagonal takes out what materials and
/// element sizes do alone, and loses no digit in Cholesky (Higham, Accuracy and Stability of Numerical Algorithms,
/// 2nd ed., section 10.1.1).
pub fn scaled_condition(a: &StiffnessMatrix, inverse: Inverse<'_>) -> Result<f64, SolveError> {
    let scale: Vec<f64> = a
        .diagonal
        .iter()
        .flat_map(|block| block.diagonal().iter().map(|d| d.sqrt()).collect::<Vec<_>>())
        .collect();
    let scaled = |x: &[f64], power: i32| -> NodeFields {
        let data = x.iter().zip(&scale).map(|(x, s)| x * s.powi(power)).collect();
        NodeFields { nodes: a.nodes(), columns: 1, data }
    };
    let largest = largest_eigenvalue(3 * a.nodes(), STEPS, |x| {
        let mut product = NodeFields::zeros(a.nodes(), 1);
        a.multiply(&scaled(x, -1), &mut product);
        Ok(scaled(&product.data, -1).data)
    })?;
    let inverse_smallest = largest_eigenvalue(3 * a.nodes(), INVERSE_STEPS, |x| {
        Ok(scaled(&inverse(&scaled(x, 1))?.data, 1).data)
    })?;
    Ok(largest * inverse_smallest)
}

/// The largest eigenvalue of a symmetric matrix of `size` that `apply` multiplies with.
pub(super) fn largest_eigenvalue(
    size: usize,
    steps: usize,
    apply: impl Fn(&[f64]) -> Result<Vec<f64>, SolveError>,
) -> Result<f64, SolveError> {
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let mut q = start(size);
    let steps = steps.min(size);
    let mut tridiagonal = DMatrix::zeros(steps, steps);
    for step in 0..steps {
        let mut next = apply(&q)?;
        basis.push(q);
        let before = norm(&next);
        tridiagonal[(step, step)] = dot(&next, &basis[step]);
        for old in basis.iter().chain(&basis) {
            let along = dot(&next, old);
            next.iter_mut().zip(old).for_each(|(next, old)| *next -= along * old);
        }
        let rest = norm(&next);
        // Where nothing is left, the space is invariant.
        if step + 1 == steps || rest <= 1e-12 * before {
            break;
        }
        tridiagonal[(step, step + 1)] = rest;
        tridiagonal[(step + 1, step)] = rest;
        next.iter_mut().for_each(|value| *value /= rest);
        q = next;
    }
    Ok(tridiagonal.symmetric_eigenvalues().max())
}

/// A pseudorandom vector of length 1.
fn start(size: usize) -> Vec<f64> {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
    };
    let mut values: Vec<f64> = (0..size).map(|_| next()).collect();
    let length = norm(&values);
    values.iter_mut().for_each(|value| *value /= length);
    values
}

/// A bound on max |x̂ - x| / max |x| for one column x̂ with residual r = b - A x̂:
///
/// ```text
/// ‖x̂ - x‖∞ ≤ ‖ |A⁻¹| (|r| + γ (|A| |x̂| + |b|)) ‖∞      γ = (n + 1) 1.1e-16, n the numbers in a row of A
/// ```
///
/// (Higham, section 7.1, equation 7.31, as LAPACK's xPORFS has it), with the norm of A⁻¹ diag(…) found by Hager's
/// estimator (section 15.2): a bound that is seldom missed and mostly a hundred times too large.
pub fn forward_error(a: &StiffnessMatrix, inverse: Inverse<'_>, column: &Column) -> Result<f64, SolveError> {
    let row = |node: usize| 3.0 * (1 + a.neighbours(node).count()) as f64;
    let doubt: Vec<f64> = (0..3 * a.nodes())
        .map(|i| column.r.data[i].abs() + (row(i / 3) + 1.0) * ROUNDOFF * column.sizes.data[i])
        .collect();
    let largest = column.x.data.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    Ok(if largest == 0.0 { 0.0 } else { inverse_norm(inverse, &doubt, a.nodes())? / largest })
}

/// Estimates ‖A⁻¹ F‖∞ = ‖F A⁻¹‖₁ for F = diag(`weights`) ≥ 0 and symmetric A.
pub(super) fn inverse_norm(inverse: Inverse<'_>, weights: &[f64], nodes: usize) -> Result<f64, SolveError> {
    let solve = |data: Vec<f64>| Ok::<_, SolveError>(inverse(&NodeFields { nodes, columns: 1, data })?.data);
    let mut x = vec![1.0 / weights.len() as f64; weights.len()];
    let mut best = 0.0;
    for _ in 0..ROUNDS {
        let y: Vec<f64> = solve(x.clone())?.iter().zip(weights).map(|(y, w)| y * w).collect();
        let estimate: f64 = y.iter().map(|y| y.abs()).sum();
        if estimate.is_nan() {
            return Ok(f64::NAN);
        }
        if estimate <= best {
            break;
        }
        best = estimate;
        let z = solve(y.iter().zip(weights).map(|(y, w)| w.copysign(*y)).collect())?;
        let (at, largest) = z
            .iter()
            .enumerate()
            .fold((0, 0.0), |most, (i, z)| if z.abs() > most.1 { (i, z.abs()) } else { most });
        if largest <= dot(&z, &x) {
            break;
        }
        x = vec![0.0; weights.len()];
        x[at] = 1.0;
    }
    Ok(best)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A diagonal matrix knows its eigenvalues and its inverse.
    #[test]
    fn lanczos_finds_the_ends_of_a_known_spectrum() {
        for size in [1, 2, 30, 300] {
            let value = |i: usize| 1.0 + 99.0 * (i as f64 / (size - 1).max(1) as f64).powi(2);
            let largest =
                largest_eigenvalue(size, STEPS, |x| Ok((0..size).map(|i| value(i) * x[i]).collect()))
                    .unwrap();
            let exact = value(size - 1);
            assert!(
                largest <= exact * (1.0 + 1e-12) && largest > 0.95 * exact,
                "{size}: {largest} of {exact}"
            );
        }
    }

    #[test]
    fn the_norm_of_a_known_inverse_is_found() {
        // A⁻¹ = diag(1, 2, 3) on one node, F = diag(5, 1, 1): the largest row sum is 5.
        let inverse = |b: &NodeFields| {
            let data = b.data.iter().zip([1.0, 2.0, 3.0]).map(|(b, d)| b * d).collect();
            Ok(NodeFields { data, ..b.clone() })
        };
        assert_eq!(inverse_norm(&inverse, &[5.0, 1.0, 1.0], 1).unwrap(), 5.0);
    }
}
