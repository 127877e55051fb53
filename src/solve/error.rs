//! Errors of solving a system, with the numbers and the remedy.

use crate::base::machine::TooLarge;
use crate::fem::AssemblyError;

/// Limits on relative errors of a solution: above the first there is a warning, above the second the solution is refused.
/// They apply to the forward error and to the errors of rigid motions.
pub const ERROR_LIMITS: [f64; 2] = [1e-3, 0.1];

#[derive(Debug, thiserror::Error)]
pub enum SolveError {
    #[error("the fill-reducing ordering of {nodes} nodes failed ({reason})")]
    Ordering { nodes: usize, reason: String },
    #[error(
        "the stiffness matrix of {unknowns} unknowns is not positive definite (pivot {pivot}): hold \
         every part by a control element"
    )]
    NotPositiveDefinite { unknowns: usize, pivot: usize },
    #[error("{0}; coarsen the mesh, or write solver = {{ method = \"pcg\" }}")]
    FactorMemory(TooLarge),
    #[error("{refused}; what would fit: {fitting}")]
    Unfit { refused: TooLarge, fitting: String },
    #[error("{0}; coarsen the mesh, take fewer control elements, or give the program more memory")]
    Memory(#[from] TooLarge),
    #[error(
        "column {column}: relative residual {residual:.1e} is above {limit:.1e} after {iterations} \
         iterations. Write solver.method = \"cholesky\", or look for slivers and large contrasts of \
         stiffness (`greenstage check`)"
    )]
    Residual { column: usize, residual: f64, limit: f64, iterations: usize },
    #[error(
        "column {column}: relative residual {residual:.1e} after {iterations} iterations; {limit:.1e} \
         would take about {expected:.0e}. Write solver.method = \"auto\", or look for slivers and large \
         contrasts of stiffness (`greenstage check`)"
    )]
    Slow { column: usize, residual: f64, limit: f64, iterations: usize, expected: f64 },
    #[error(
        "column {column}: relative residual {residual:.1e} and backward error {backward:.1e} after \
         refinement: the factor is wrong; look for slivers and large contrasts of stiffness (`greenstage \
         check`)"
    )]
    Factor { column: usize, residual: f64, backward: f64 },
    #[error(
        "\"{0}\" leaves no factor to keep: write solver = {{ method = \"cholesky\" }}, or leave kept = \
         \"factor\" out"
    )]
    NoFactor(&'static str),
    #[error(
        "mode {mode} at {hertz:.4e} Hz: relative residual {residual:.1e} is above {limit:.1e}. Ask for fewer modes, or write \
         solver.method = \"cholesky\""
    )]
    Mode { mode: usize, hertz: f64, residual: f64, limit: f64 },
    #[error("the body cannot be warmed to {stretch:.3} times its length at rest: {source}. Warm it less")]
    Warmth { stretch: f64, source: Box<AssemblyError> },
    #[error("the pushed control elements can move without a force: hold one of their free directions")]
    Loose,
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
