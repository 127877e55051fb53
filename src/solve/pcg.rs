//! Conjugate gradients on the 3×3-block matrix, preconditioned by its diagonal blocks (block-Jacobi); all columns
//! are iterated together, so that one pass over the matrix serves them all.

use super::{Conditioning, Progress, SolveError, SolveStats, residuals};
use crate::base::machine;
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::{DMatrix, Matrix3};
use rayon::prelude::*;
use std::time::Instant;

/// The solver's two limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pcg {
    /// On the true relative residual ‖b - A x‖₂ / ‖b‖₂ of every column.
    pub tolerance: f64,
    pub max_iterations: usize,
}

/// Iterations from which the condition number is taken.
const SPECTRUM: usize = 400;

/// The recurrence's residual parts from the true one by rounding; the iteration is restarted from the true
/// residual at most this often before it is called stagnant.
const RESTARTS: usize = 8;

impl Pcg {
    /// Solves A x = b from x = 0. Errors where a diagonal block is not positive definite, or where a column's true
    /// residual stays above the tolerance.
    pub fn solve(
        &self,
        a: &StiffnessMatrix,
        b: &NodeFields,
        progress: &dyn Progress,
    ) -> Result<(NodeFields, SolveStats), SolveError> {
        // x, r, z, p, A p and a true residual; the inverse blocks.
        let need = 6.0 * 24.0 * (b.nodes * b.columns) as f64 + 72.0 * b.nodes as f64;
        machine::expect(format!("iterating {} columns together", b.columns), need)?;
        let started = Instant::now();
        let inverse = inverse_diagonal(a)?;
        let factor_s = started.elapsed().as_secs_f64();
        // One unit a thousandth of the way down to the tolerance on a logarithmic scale.
        progress.begin("conjugate gradients", 1000);
        let started = Instant::now();
        let mut x = NodeFields::zeros(b.nodes, b.columns);
        let mut iterations = 0;
        let mut spectrum = Vec::new();
        let mut done = 0;
        let (mut relative, mut r) = residuals(a, &x, b);
        for _ in 0..=RESTARTS {
            if relative.iter().all(|&r| r <= self.tolerance) || iterations >= self.max_iterations {
                break;
            }
            iterations += self.iterate(
                a,
                &inverse,
                &mut x,
                r,
                &b.norms(),
                self.max_iterations - iterations,
                &mut spectrum,
                &mut |worst| {
                    let way = (1000.0 * (worst.max(self.tolerance).ln() / self.tolerance.ln())) as u64;
                    progress.advance(way.saturating_sub(done));
                    done = done.max(way);
                },
            );
            (relative, r) = residuals(a, &x, b);
        }
        progress.end();
        for (column, &residual) in relative.iter().enumerate() {
            if residual > self.tolerance || residual.is_nan() {
                return Err(SolveError::Residual { column, residual, limit: self.tolerance, iterations });
            }
        }
        let scaled_condition = condition(&spectrum);
        let forward_error = scaled_condition * relative.iter().copied().fold(0.0, f64::max);
        let stats = SolveStats {
            method: "pcg".into(),
            unknowns: 3 * b.nodes,
            columns: b.columns,
            factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            iterations,
            residuals: relative,
            conditioning: Some(Conditioning { scaled_condition, forward_error, seconds: 0.0 }),
            ..Default::default()
        };
        Ok((x, stats))
    }

    /// Iterates until the recurrence's residual of every column is below half the tolerance; returns the number of
    /// iterations. A column that has arrived is left as it is.
    #[allow(clippy::too_many_arguments, reason = "the state of one iteration, used nowhere else")]
    fn iterate(
        &self,
        a: &StiffnessMatrix,
        inverse: &[Matrix3<f64>],
        x: &mut NodeFields,
        mut r: NodeFields,
        b_norms: &[f64],
        limit: usize,
        spectrum: &mut Vec<[f64; 2]>,
        told: &mut dyn FnMut(f64),
    ) -> usize {
        let m = r.columns;
        let mut z = NodeFields::zeros(r.nodes, m);
        precondition(inverse, &r, &mut z);
        let mut p = z.clone();
        let mut ap = NodeFields::zeros(r.nodes, m);
        let mut rz = r.dots(&z);
        // The column with the most to do sees most of the spectrum.
        let slowest = (0..m).fold(0, |most, c| if rz[c] > rz[most] { c } else { most });
        for iteration in 0..limit {
            let relative: Vec<f64> =
                r.norms().iter().zip(b_norms).map(|(r, b)| if *b == 0.0 { 0.0 } else { r / b }).collect();
            let active: Vec<bool> = relative.iter().map(|r| *r > 0.5 * self.tolerance).collect();
            told(relative.iter().copied().fold(0.0, f64::max));
            if !active.contains(&true) {
                return iteration;
            }
            a.multiply(&p, &mut ap);
            let pap = p.dots(&ap);
            let alpha: Vec<f64> =
                (0..m).map(|c| if active[c] && pap[c] > 0.0 { rz[c] / pap[c] } else { 0.0 }).collect();
            add_scaled(x, &alpha, &p);
            let minus: Vec<f64> = alpha.iter().map(|a| -a).collect();
            add_scaled(&mut r, &minus, &ap);
            precondition(inverse, &r, &mut z);
            let new_rz = r.dots(&z);
            let beta: Vec<f64> = (0..m).map(|c| if rz[c] > 0.0 { new_rz[c] / rz[c] } else { 0.0 }).collect();
            p.data.par_chunks_mut(m).zip(z.data.par_chunks(m)).with_min_len(1024).for_each(|(p, z)| {
                for c in 0..m {
                    p[c] = z[c] + beta[c] * p[c];
                }
            });
            rz = new_rz;
            if spectrum.len() < SPECTRUM && alpha[slowest] > 0.0 {
                spectrum.push([alpha[slowest], beta[slowest]]);
            }
        }
        limit
    }
}

/// The condition number of the preconditioned matrix from the coefficients α, β of its iterations: conjugate gradients
/// are Lanczos in disguise (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed., section 6.7.3).
fn condition(spectrum: &[[f64; 2]]) -> f64 {
    if spectrum.is_empty() {
        return 1.0;
    }
    let n = spectrum.len();
    let mut t = DMatrix::zeros(n, n);
    for (k, [alpha, beta]) in spectrum.iter().enumerate() {
        t[(k, k)] += 1.0 / alpha;
        if k + 1 < n {
            t[(k + 1, k + 1)] += beta / alpha;
            t[(k, k + 1)] = beta.sqrt() / alpha;
            t[(k + 1, k)] = t[(k, k + 1)];
        }
    }
    let values = t.symmetric_eigenvalues();
    values.max() / values.min()
}

fn inverse_diagonal(a: &StiffnessMatrix) -> Result<Vec<Matrix3<f64>>, SolveError> {
    a.diagonal
        .iter()
        .enumerate()
        .map(|(node, block)| match block.cholesky() {
            Some(factor) => Ok(factor.inverse()),
            None => Err(SolveError::NotPositiveDefinite { unknowns: 3 * a.nodes(), pivot: 3 * node }),
        })
        .collect()
}

/// z = D⁻¹ r with D the diagonal blocks.
fn precondition(inverse: &[Matrix3<f64>], r: &NodeFields, z: &mut NodeFields) {
    let m = r.columns;
    z.data.par_chunks_mut(3 * m).zip(r.data.par_chunks(3 * m)).zip(inverse).with_min_len(512).for_each(
        |((z, r), inverse)| {
            for row in 0..3 {
                let (i0, i1, i2) = (inverse[(row, 0)], inverse[(row, 1)], inverse[(row, 2)]);
                for c in 0..m {
                    z[row * m + c] = i0 * r[c] + i1 * r[m + c] + i2 * r[2 * m + c];
                }
            }
        },
    );
}

/// x += s_c p for every column c.
fn add_scaled(x: &mut NodeFields, scale: &[f64], p: &NodeFields) {
    let m = x.columns;
    x.data.par_chunks_mut(m).zip(p.data.par_chunks(m)).with_min_len(1024).for_each(|(x, p)| {
        for c in 0..m {
            x[c] += scale[c] * p[c];
        }
    });
}
