//! The solver of systems without unknowns: those of bodies whose nodes are all held.

use super::error::SolveError;
use super::solver::{Factor, LinearSolver, Method, SolveResult, SolveStats};
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};

pub const NO_UNKNOWNS: Method = Method {
    name: "none",
    is_direct: true,
    keeps_factor: false,
    bounds_error: true,
    remedy: "release a node",
    factor_number: 0,
    least_seconds: None,
    analyse: |_| Ok(Box::new(NoUnknowns)),
};

/// Solves for nothing.
pub(super) struct NoUnknowns;

impl LinearSolver for NoUnknowns {
    fn memory(&self, _: &StiffnessMatrix, _: usize) -> f64 {
        0.0
    }

    fn seconds(&self, _: &StiffnessMatrix, _: usize) -> f64 {
        0.0
    }

    fn fits(&self, _: &StiffnessMatrix, _: usize) -> Result<(), SolveError> {
        Ok(())
    }

    fn factor<'a>(
        &'a self,
        _: &'a StiffnessMatrix,
        _: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        Ok(Box::new(NoUnknowns))
    }
}

impl Factor for NoUnknowns {
    fn nodes(&self) -> usize {
        0
    }

    fn solve(&self, b: &NodeFields, _: &dyn Progress) -> SolveResult {
        let residuals = vec![0.0; b.columns];
        let stats = SolveStats { method: &NO_UNKNOWNS, columns: b.columns, residuals, ..Default::default() };
        Ok((b.clone(), stats))
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solve(b, progress)
    }
}
