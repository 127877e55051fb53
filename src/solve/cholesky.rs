//! Sparse Cholesky A = P L Lᵀ Pᵀ with a nested dissection ordering, refinement, and a judgement of its solutions.

use super::condition;
use super::error::SolveError;
use super::llt::{Analysis, Llt};
use super::residual::{Column, residuals};
use super::solver::{Conditioning, Factor, InverseStrip, LinearSolver, Method, SolveResult, SolveStats};
use crate::base::progress::{Progress, Silent};
use crate::fem::{NodeFields, StiffnessMatrix};
use std::time::Instant;

pub const CHOLESKY: Method = Method {
    name: "cholesky",
    is_direct: true,
    bounds_error: true,
    remedy: "look for slivers and large contrasts of stiffness (`greenstage check`), for parts a thousand times as long \
             as thick, and for a Poisson's ratio next to 0.5",
    analyse: |_, a, progress| Ok(Box::new(Direct { analysis: Analysis::new(a, progress)? })),
};

/// Relative residual above which a step of iterative refinement is made, and above which the backward error decides
/// whether a solution is refused.
const REFINE_ABOVE: f64 = 1e-12;
const REFUSE_ABOVE: f64 = 1e-7;
const BACKWARD_ABOVE: f64 = 1e-12;
const REFINEMENTS: usize = 3;

/// All matrices of one graph.
struct Direct {
    analysis: Analysis,
}

impl LinearSolver for Direct {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.analysis.memory::<f64>(a, columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        self.analysis.fits::<f64>(a, columns)
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

    /// Estimates how exact the solution `x` of A x = b is, by a few solves with one column each, on two threads.
    fn conditioning(
        &self,
        x: &NodeFields,
        b: &NodeFields,
        progress: &dyn Progress,
    ) -> Result<Conditioning, SolveError> {
        progress.begin("conditioning", 0);
        let started = Instant::now();
        let inverse = |b: &NodeFields| self.llt.substitute(b, &Silent);
        let (relative, r) = residuals(self.a, x, b);
        let column = Column::of(self.a, x, b, &r, worst(&relative).0);
        let (scaled_condition, forward_error) = rayon::join(
            || condition::scaled_condition(self.a, &inverse),
            || condition::forward_error(self.a, &inverse, &column),
        );
        progress.end();
        Ok(Conditioning {
            scaled_condition: Some(scaled_condition?),
            forward_error: forward_error?,
            seconds: started.elapsed().as_secs_f64(),
        })
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
        let mut x = self.llt.substitute(b, progress)?;
        progress.end();
        let (mut relative, mut r) = residuals(self.a, &x, b);
        for _ in 0..REFINEMENTS {
            if relative.iter().all(|&r| r <= REFINE_ABOVE) {
                break;
            }
            let correction = self.llt.substitute(&r, &Silent)?;
            let refined =
                NodeFields { data: x.data.iter().zip(&correction.data).map(|(x, d)| x + d).collect(), ..x };
            let (new_relative, new_r) = residuals(self.a, &refined, b);
            if worst(&new_relative).1 >= 0.5 * worst(&relative).1 {
                break;
            }
            (x, relative, r) = (refined, new_relative, new_r);
        }
        let (column, residual) = worst(&relative);
        if residual > REFUSE_ABOVE || residual.is_nan() {
            // A stiff part that floats makes residuals large beside b although x is as exact as A allows.
            let backward = Column::of(self.a, &x, b, &r, column).backward_error();
            if backward > BACKWARD_ABOVE || backward.is_nan() {
                return Err(SolveError::Factor { column, residual, backward });
            }
        }
        let stats = SolveStats {
            method: &CHOLESKY,
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

    fn inverse_block(
        &self,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        self.llt.inverse_block(nodes, take, progress)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let (x, mut stats) = self.solve(b, progress)?;
        stats.conditioning = Some(self.conditioning(&x, b, progress)?);
        Ok((x, stats))
    }
}

fn worst(relative: &[f64]) -> (usize, f64) {
    relative.iter().copied().enumerate().fold((0, 0.0), |worst, (column, residual)| {
        if residual > worst.1 || residual.is_nan() { (column, residual) } else { worst }
    })
}
