//! Steps after a solve with a factor: iterative refinement, the refusal of what stays wrong, and a judgement.
//!
//! In: A, b, a solution, and a way to apply about A⁻¹. Out: a better solution with its true residuals, and how exact it is.

use super::condition::{self, Inverse};
use super::error::SolveError;
use super::residual::{Column, residuals};
use super::solver::Conditioning;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use std::time::Instant;

/// Relative residual above which a step of iterative refinement is made, and above which the backward error decides
/// whether a solution is refused.
const REFINE_ABOVE: f64 = 1e-12;
const REFUSE_ABOVE: f64 = 1e-7;
const BACKWARD_ABOVE: f64 = 1e-12;
const REFINEMENTS: usize = 3;

/// x with its residuals, refined where one is above 1e-12; errors where one stays above 1e-7.
pub(super) fn refined(
    a: &StiffnessMatrix,
    mut x: NodeFields,
    b: &NodeFields,
    inverse: Inverse<'_>,
) -> Result<(NodeFields, Vec<f64>), SolveError> {
    let (mut relative, mut r) = residuals(a, &x, b);
    for _ in 0..REFINEMENTS {
        if relative.iter().all(|&r| r <= REFINE_ABOVE) {
            break;
        }
        let correction = inverse(&r)?;
        let refined =
            NodeFields { data: x.data.iter().zip(&correction.data).map(|(x, d)| x + d).collect(), ..x };
        let (new_relative, new_r) = residuals(a, &refined, b);
        if worst(&new_relative).1 >= 0.5 * worst(&relative).1 {
            break;
        }
        (x, relative, r) = (refined, new_relative, new_r);
    }
    let (column, residual) = worst(&relative);
    if residual > REFUSE_ABOVE || residual.is_nan() {
        // A stiff part that floats makes residuals large beside b although x is as exact as A allows.
        let backward = Column::new(a, &x, b, &r, column).backward_error();
        if backward > BACKWARD_ABOVE || backward.is_nan() {
            return Err(SolveError::Factor { column, residual, backward });
        }
    }
    Ok((x, relative))
}

/// Estimates how exact the solution `x` of A x = b is, by three solves with four columns each.
pub(super) fn conditioning(
    a: &StiffnessMatrix,
    x: &NodeFields,
    b: &NodeFields,
    inverse: Inverse<'_>,
    progress: &dyn Progress,
) -> Result<Conditioning, SolveError> {
    progress.begin("conditioning", 0);
    let started = Instant::now();
    let (relative, r) = residuals(a, x, b);
    let column = Column::new(a, x, b, &r, worst(&relative).0);
    let (scaled_condition, forward_error) = condition::estimates(a, x, &column, inverse)?;
    progress.end();
    Ok(Conditioning {
        scaled_condition: Some(scaled_condition),
        forward_error,
        seconds: started.elapsed().as_secs_f64(),
    })
}

/// The column with the largest residual, and that.
fn worst(relative: &[f64]) -> (usize, f64) {
    relative.iter().copied().enumerate().fold((0, 0.0), |worst, (column, residual)| {
        if residual > worst.1 || residual.is_nan() { (column, residual) } else { worst }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_residual_that_is_no_number_is_the_worst() {
        assert_eq!(worst(&[1e-9, 3e-8, 2e-8]), (1, 3e-8));
        let (column, residual) = worst(&[1e-3, f64::NAN, 1e-9]);
        assert!(column == 1 && residual.is_nan(), "{column}: {residual}");
    }
}
