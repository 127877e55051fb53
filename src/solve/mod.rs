//! Solving A x = b for many right-hand sides: A in 3×3 blocks and its right-hand sides in, solutions and the
//! figures that judge them out.
//!
//! Two ways: [`Cholesky`] (nested dissection, then a supernodal LLᵀ) and [`Pcg`] (block-Jacobi preconditioned
//! conjugate gradients, the paper's solver). Each measures the true residual of every column afterwards. [`Newton`] finds
//! static equilibrium at large strain, by a factor for each of its iterations.

mod cholesky;
mod condition;
mod newton;
mod ordering;
mod pcg;
mod progress;

pub use cholesky::{Cholesky, Symbolic};
pub use newton::{Counts, Equilibrium, Newton, NewtonError, Setback};
pub use ordering::{Ordering, nested_dissection};
pub use pcg::Pcg;
pub use progress::{Progress, Silent};

use crate::fem::{NodeFields, StiffnessMatrix};
use rayon::prelude::*;

/// What a solver did, for the closing table and the .green file.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct SolveStats {
    pub method: String,
    pub unknowns: usize,
    pub columns: usize,
    pub ordering_s: f64,
    pub symbolic_s: f64,
    pub factor_s: f64,
    pub solve_s: f64,
    /// Numbers held by the factor (supernodal: its explicit zeros counted), 0 for PCG.
    pub factor_entries: usize,
    /// Iterations of the slowest column, 0 for Cholesky.
    pub iterations: usize,
    /// ‖b - A x‖₂ / ‖b‖₂ of every column, computed from A after the solve; 0 where b = 0.
    pub residuals: Vec<f64>,
    /// Where it was asked for.
    pub conditioning: Option<Conditioning>,
}

/// Relative errors of a solution: above the first it is warned of, above the second refused. They judge the forward error
/// and what rigid motions show.
pub const ERROR_LIMITS: [f64; 2] = [1e-3, 0.1];

/// How far the solution can be from the exact one.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Conditioning {
    /// Estimate of κ₂ of A scaled by its diagonal (Cholesky), or by its 3×3 diagonal blocks (PCG).
    pub scaled_condition: f64,
    /// Cholesky: bound on max |x̂ - x| / max |x| of the column with the largest residual. PCG: ‖x̂ - x‖_A / ‖x̂‖_A of the
    /// column with the largest residual, whose error is solved for.
    pub forward_error: f64,
    pub seconds: f64,
}

impl SolveStats {
    pub fn worst_residual(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }
}

#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    #[error("the fill-reducing ordering of {nodes} nodes failed ({reason})")]
    Ordering { nodes: usize, reason: String },
    #[error(
        "the stiffness matrix of {unknowns} unknowns is not positive definite (pivot {pivot}): a part of the body \
         is held by no control element, or a material is not physical"
    )]
    NotPositiveDefinite { unknowns: usize, pivot: usize },
    #[error(
        "the factor needs {entries} numbers ({gigabytes:.1} GB), more than this machine gives; coarsen the mesh, \
         or write solver = {{ method = \"pcg\" }} in the scene"
    )]
    OutOfMemory { entries: usize, gigabytes: f64 },
    #[error(
        "column {column}: relative residual {residual:.1e} is above {limit:.1e} after {iterations} iterations; the \
         matrix is too ill-conditioned for conjugate gradients: look for slivers and large contrasts of stiffness \
         (`greenstage check`), write solver.method = \"cholesky\", or raise solver.tolerance (to 1e-3 at most)"
    )]
    Residual { column: usize, residual: f64, limit: f64, iterations: usize },
    #[error(
        "column {column}: relative residual {residual:.1e} and backward error {backward:.1e} after refinement: the \
         factor is wrong; look for slivers and for large contrasts of stiffness (`greenstage check`)"
    )]
    Factor { column: usize, residual: f64, backward: f64 },
    #[error("{figure} is {value:.1e}, above {}: the solution is not to be trusted; {remedy}", ERROR_LIMITS[1])]
    Inexact { figure: &'static str, value: f64, remedy: &'static str },
}

/// ‖b - A x‖₂ / ‖b‖₂ of every column, and b - A x itself.
pub fn residuals(a: &StiffnessMatrix, x: &NodeFields, b: &NodeFields) -> (Vec<f64>, NodeFields) {
    let mut r = NodeFields::zeros(b.nodes, b.columns);
    a.multiply(x, &mut r);
    r.data.par_iter_mut().zip(&b.data).with_min_len(4096).for_each(|(r, b)| *r = b - *r);
    let relative = r.norms().iter().zip(b.norms()).map(|(r, b)| if b == 0.0 { 0.0 } else { r / b }).collect();
    (relative, r)
}

/// One column with its residual, and the sizes |A| |x| + |b| of what was added up to it.
struct Column {
    x: NodeFields,
    r: NodeFields,
    sizes: NodeFields,
}

impl Column {
    fn of(a: &StiffnessMatrix, x: &NodeFields, b: &NodeFields, r: &NodeFields, column: usize) -> Column {
        let one = |fields: &NodeFields| NodeFields {
            nodes: fields.nodes,
            columns: 1,
            data: (0..3 * fields.nodes).map(|row| fields.row(row)[column]).collect(),
        };
        let positive = |mut fields: NodeFields| {
            fields.data.iter_mut().for_each(|value| *value = value.abs());
            fields
        };
        let mut matrix = a.clone();
        matrix.diagonal.iter_mut().chain(&mut matrix.blocks).for_each(|block| *block = block.abs());
        let x = one(x);
        let mut sizes = NodeFields::zeros(a.nodes(), 1);
        matrix.multiply(&positive(x.clone()), &mut sizes);
        sizes.data.iter_mut().zip(positive(one(b)).data).for_each(|(size, b)| *size += b);
        Column { x, r: one(r), sizes }
    }

    /// The componentwise backward error max_i |r_i| / (|A| |x| + |b|)_i (Arioli, Demmel and Duff, SIAM J. Matrix Anal.
    /// Appl. 10, 1989): how much A and b must be changed, relatively, for x to be exact.
    fn backward_error(&self) -> f64 {
        let ratio = |(r, size): (&f64, &f64)| if *r == 0.0 { 0.0 } else { r.abs() / size };
        self.r
            .data
            .iter()
            .zip(&self.sizes.data)
            .map(ratio)
            .fold(0.0, |worst, ratio| if ratio > worst || ratio.is_nan() { ratio } else { worst })
    }
}
