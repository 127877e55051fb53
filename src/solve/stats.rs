//! What a solver did, and how exact its solution is.

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
    /// Cholesky: bound on max |x̂ - x| / max |x| of the column with the largest residual. PCG: the largest ‖x̂ - x‖_A /
    /// ‖x̂‖_A of all columns, whose errors are solved for.
    pub forward_error: f64,
    pub seconds: f64,
}

impl SolveStats {
    pub fn worst_residual(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }
}
