//! The method that is fastest among those that fit into memory, by a prediction from the symbolic step.
//!
//! In: A's graph and the number of columns. Out: Cholesky or conjugate gradients, and the reason in words, which goes into
//! the closing table.

use super::cholesky::CHOLESKY;
use super::error::SolveError;
use super::kept_factor::KeptFactor;
use super::ordering::ordering_memory;
use super::pcg::PCG;
use super::solver::{Factor, InverseStrip, LinearSolver, Method, SolveResult, SolveStats, Solver};
use crate::base::machine;
use crate::base::progress::Progress;
use crate::base::table::{bytes, seconds};
use crate::fem::{NodeFields, StiffnessMatrix};
use std::sync::{Mutex, PoisonError};

pub const AUTO: Method = Method {
    name: "auto",
    is_direct: false,
    keeps_factor: true,
    bounds_error: false,
    remedy: "write solver.method = \"cholesky\", and look for slivers, for thin parts and for large contrasts of stiffness \
             (`greenstage check`)",
    analyse: |solver, a, progress| Ok(Box::new(Auto::new(solver, a, progress)?)),
};

/// Fewer unknowns are factorised in less time than a look at the alternative is worth.
const SMALL: usize = 30_000;
/// Numbers of the factor over n^{4/3} of thin bodies: only rods have fewer.
const LEAST_FILL: f64 = 6.0;
/// Both methods; the factor's symbolic step only where it may be wanted.
struct Auto {
    direct: Option<Box<dyn LinearSolver>>,
    iterative: Box<dyn LinearSolver>,
    /// Why there is no direct one.
    unfit: String,
    /// How many columns there will be: told by [`LinearSolver::fits`].
    columns: Mutex<usize>,
}

impl Auto {
    fn new(solver: &Solver, a: &StiffnessMatrix, progress: &dyn Progress) -> Result<Auto, SolveError> {
        let of = |method: &'static Method| (method.analyse)(&Solver { method, ..*solver }, a, progress);
        let iterative = of(&PCG)?;
        let least = 8.0 * LEAST_FILL * (3.0 * a.nodes() as f64).powf(4.0 / 3.0);
        let need = least.max(ordering_memory(a));
        let (direct, unfit) = match machine::fits("the least factor of a body of this size", need, 0.0) {
            Err(refused) if 3 * a.nodes() > SMALL => (None, refused.to_string()),
            _ => match of(&CHOLESKY) {
                Ok(direct) => (Some(direct), String::new()),
                Err(SolveError::FactorMemory(refused)) => (None, refused.to_string()),
                Err(other) => return Err(other),
            },
        };
        Ok(Auto { direct, iterative, unfit, columns: Mutex::new(24) })
    }

    /// The method to take, and why.
    fn choose(&self, a: &StiffnessMatrix, columns: usize) -> (&dyn LinearSolver, String) {
        let Some(direct) = &self.direct else {
            return (self.iterative.as_ref(), format!("pcg by \"auto\", for {}", self.unfit));
        };
        if 3 * a.nodes() <= SMALL && direct.fits(a, columns).is_ok() {
            return (direct.as_ref(), "cholesky by \"auto\", as for every small body".into());
        }
        let both = [direct.as_ref(), self.iterative.as_ref()];
        let times = both.map(|solver| solver.seconds(a, columns));
        let memory = both.map(|solver| bytes(solver.memory(a, columns)));
        let told = |i: usize| format!("{} and {}", seconds(times[i]), memory[i]);
        let told = format!("predicted for cholesky {}, for pcg {}", told(0), told(1));
        if let Err(refused) = direct.fits(a, columns) {
            let (SolveError::FactorMemory(refused) | SolveError::Unfit { refused, .. }) = refused else {
                return (self.iterative.as_ref(), format!("pcg by \"auto\": {told}"));
            };
            return (self.iterative.as_ref(), format!("pcg by \"auto\", for {refused}; {told}"));
        }
        let is_direct = times[0] <= times[1] || self.iterative.fits(a, columns).is_err();
        let (solver, name) =
            if is_direct { (direct.as_ref(), "cholesky") } else { (self.iterative.as_ref(), "pcg") };
        (solver, format!("{name} by \"auto\": {told}"))
    }

    fn columns(&self) -> usize {
        *self.columns.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LinearSolver for Auto {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.choose(a, columns).0.memory(a, columns)
    }

    fn seconds(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.choose(a, columns).0.seconds(a, columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        *self.columns.lock().unwrap_or_else(PoisonError::into_inner) = columns;
        self.choose(a, columns).0.fits(a, columns)
    }

    fn keeps(&self, a: &StiffnessMatrix, columns: usize) -> bool {
        self.choose(a, columns).0.keeps(a, columns)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        let (solver, chosen) = self.choose(a, self.columns());
        Ok(Box::new(Chosen { factor: solver.factor(a, progress)?, chosen }))
    }
}

/// A factor with the reason why it was taken.
struct Chosen<'a> {
    factor: Box<dyn Factor + 'a>,
    chosen: String,
}

impl Chosen<'_> {
    fn told(&self, (x, stats): (NodeFields, SolveStats)) -> (NodeFields, SolveStats) {
        (x, SolveStats { chosen: Some(self.chosen.clone()), ..stats })
    }
}

impl Factor for Chosen<'_> {
    fn nodes(&self) -> usize {
        self.factor.nodes()
    }

    fn columns_together(&self) -> usize {
        self.factor.columns_together()
    }

    fn solve_at(&self, loaded: &[u32], b: &NodeFields, asked: &[u32]) -> Result<NodeFields, SolveError> {
        self.factor.solve_at(loaded, b, asked)
    }

    fn kept(&self, nodes: &[u32], progress: &dyn Progress) -> Result<Option<KeptFactor>, SolveError> {
        self.factor.kept(nodes, progress)
    }

    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        self.factor.inverse_block_from(first, nodes, take, progress)
    }

    fn solve_memory(&self, columns: usize, asked: usize) -> f64 {
        self.factor.solve_memory(columns, asked)
    }

    fn strip_nodes(&self) -> usize {
        self.factor.strip_nodes()
    }

    fn strip_memory(&self, nodes: usize) -> f64 {
        self.factor.strip_memory(nodes)
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.factor.solve(b, progress).map(|solved| self.told(solved))
    }

    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.factor.precondition(b)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.factor.solve_and_judge(b, progress).map(|solved| self.told(solved))
    }
}
