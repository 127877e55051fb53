//! Sparse Cholesky A = P L Lᵀ Pᵀ with a nested dissection ordering, refinement, and a judgement of its solutions.

use super::analysis::Analysis;
use super::error::SolveError;
use super::kept_factor::KeptFactor;
use super::llt::Llt;
use super::refinement::{conditioning, refined};
use super::solver::{Conditioning, Factor, InverseStrip, LinearSolver, Method, SolveResult, SolveStats};
use crate::base::progress::{Progress, Silent};
use crate::fem::{NodeFields, StiffnessMatrix};
use std::sync::Arc;
use std::time::Instant;

pub const CHOLESKY: Method = Method {
    name: "cholesky",
    is_direct: true,
    keeps_factor: true,
    bounds_error: true,
    remedy: "look for slivers and large contrasts of stiffness (`greenstage check`)",
    factor_number: size_of::<f64>(),
    least_seconds: Some(|asked| asked.pattern.least_seconds::<f64>(asked.a, asked.job.columns)),
    analyse: |asked| Ok(Box::new(Direct { analysis: asked.pattern.analysis(asked.a, asked.progress)? })),
};

/// All matrices of one graph.
struct Direct {
    analysis: Arc<Analysis>,
}

impl LinearSolver for Direct {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.analysis.memory::<f64>(a, columns)
    }

    fn seconds(&self, _: &StiffnessMatrix, columns: usize) -> f64 {
        self.analysis.seconds::<f64>(columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        self.analysis.fits::<f64>(a, columns)
    }

    fn keeps(&self, _: &StiffnessMatrix, _: usize) -> bool {
        true
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        Ok(Box::new(Cholesky::new(a, &self.analysis, progress)?))
    }
}

/// A with its factor.
pub(super) struct Cholesky<'a> {
    a: &'a StiffnessMatrix,
    analysis: &'a Analysis,
    llt: Llt<'a, f64>,
}

impl<'a> Cholesky<'a> {
    /// Errors where A is not positive definite or the factor does not fit into memory.
    pub(super) fn new(
        a: &'a StiffnessMatrix,
        analysis: &'a Analysis,
        progress: &dyn Progress,
    ) -> Result<Cholesky<'a>, SolveError> {
        Ok(Cholesky { a, analysis, llt: Llt::new(a, analysis, progress)? })
    }

    /// Judges the solution `x` of A x = b: its conditioning and error.
    pub(super) fn judge(
        &self,
        x: &NodeFields,
        b: &NodeFields,
        progress: &dyn Progress,
    ) -> Result<Conditioning, SolveError> {
        conditioning(self.a, x, b, &|b| self.llt.substitute(b, &Silent), progress)
    }
}

impl Factor for Cholesky<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    /// One substitution, without a look at its residual.
    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.llt.substitute(b, &Silent)
    }

    /// Solves A x = b for all columns, refining where a residual is above 1e-12; errors where one stays above 1e-7.
    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        progress.begin("solves", b.columns as u64);
        let started = Instant::now();
        let x = self.llt.substitute(b, progress)?;
        progress.end();
        let (x, relative) = refined(self.a, x, b, &|b| self.llt.substitute(b, &Silent))?;
        let stats = SolveStats {
            method: &CHOLESKY,
            chosen: None,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            ordering_s: self.analysis.ordering_s,
            symbolic_s: self.analysis.symbolic_s,
            factor_s: self.llt.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            factor_entries: self.llt.entries(),
            iterations: 0,
            residuals: relative,
            conditioning: None,
        };
        Ok((x, stats))
    }

    fn solve_at(&self, loaded: &[u32], b: &NodeFields, asked: &[u32]) -> Result<NodeFields, SolveError> {
        self.llt.between(loaded, b, asked, &Silent)
    }

    fn kept(&self, nodes: &[u32], progress: &dyn Progress) -> Result<Option<KeptFactor>, SolveError> {
        progress.begin("factor as it is kept", 0);
        let kept = self.llt.kept(nodes);
        progress.end();
        kept.map(Some)
    }

    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        self.llt.inverse_block_from(first, nodes, take, progress)
    }

    fn solve_memory(&self, columns: usize, asked: usize) -> f64 {
        self.llt.solve_memory(columns, asked)
    }

    fn strip_nodes(&self) -> usize {
        self.llt.strip_nodes()
    }

    fn strip_memory(&self, nodes: usize) -> f64 {
        self.llt.strip_memory(nodes)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let (x, mut stats) = self.solve(b, progress)?;
        stats.conditioning = Some(self.judge(&x, b, progress)?);
        Ok((x, stats))
    }
}
