//! Errors of solving a system, with the numbers and the remedy.

use crate::base::machine::TooLarge;

/// Limits on relative errors of a solution: above the first there is a warning, above the second the solution is refused.
/// They apply to the forward error and to the errors of rigid motions.
pub const ERROR_LIMITS: [f64; 2] = [1e-3, 0.1];

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
        "{0}; coarsen the mesh, take fewer control elements, write solver = {{ method = \"pcg\" }} in the scene, or \
         give the program more memory"
    )]
    FactorMemory(TooLarge),
    #[error("{refused}; what would fit: {fitting}")]
    Unfit { refused: TooLarge, fitting: String },
    #[error("{0}; coarsen the mesh, take fewer control elements, or give the program more memory")]
    Memory(#[from] TooLarge),
    #[error(
        "column {column}: relative residual {residual:.1e} is above {limit:.1e} after {iterations} iterations; the \
         matrix is too ill-conditioned for conjugate gradients: look for slivers and large contrasts of stiffness \
         (`greenstage check`), write solver.method = \"cholesky\", or raise solver.tolerance (to 1e-3 at most)"
    )]
    Residual { column: usize, residual: f64, limit: f64, iterations: usize },
    #[error(
        "column {column}: the relative residual is {residual:.1e} after {iterations} iterations, so that {limit:.1e} would \
         take about {expected:.0e}; the matrix is too ill-conditioned for conjugate gradients: write solver.method = \
         \"auto\", or look for slivers, thin parts and large contrasts of stiffness (`greenstage check`)"
    )]
    Slow { column: usize, residual: f64, limit: f64, iterations: usize, expected: f64 },
    #[error(
        "column {column}: relative residual {residual:.1e} and backward error {backward:.1e} after refinement: the \
         factor is wrong; look for slivers and for large contrasts of stiffness (`greenstage check`)"
    )]
    Factor { column: usize, residual: f64, backward: f64 },
    #[error(
        "\"{0}\" leaves no factor that could be kept: write solver = {{ method = \"cholesky\" }}, or leave \
         kept = \"factor\" out of surface_compliance"
    )]
    NoFactor(&'static str),
    #[error("{figure} is {value:.1e}, above {}: the solution is not to be trusted; {remedy}", ERROR_LIMITS[1])]
    Inexact { figure: &'static str, value: f64, remedy: &'static str },
}

impl SolveError {
    /// Numbers the error's column among all, of which the solved ones begin at column `first`.
    pub fn of_columns_from(mut self, first: usize) -> SolveError {
        if let SolveError::Residual { column, .. }
        | SolveError::Slow { column, .. }
        | SolveError::Factor { column, .. } = &mut self
        {
            *column += first;
        }
        self
    }
}
