//! The method `pcg`: conjugate gradients preconditioned by multigrid, several columns at a time
//! ([`super::conjugate_gradients`]), as many as fit into memory; what it takes is planned before.

use super::conjugate_gradients::{Batch, System};
use super::error::SolveError;
use super::multigrid::{Multigrid, NotDefinite};
use super::solver::{Conditioning, Factor, LinearSolver, Method, SolveResult, SolveStats, Solver};
use crate::base::lanes::padded;
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::{NodeFields, StiffnessMatrix};
use rayon::prelude::*;
use std::ops::Range;
use std::time::Instant;

pub const PCG: Method = Method {
    name: "pcg",
    is_direct: false,
    keeps_factor: false,
    bounds_error: false,
    remedy: "write solver.method = \"cholesky\", and look for slivers and large contrasts of stiffness \
             (`greenstage check`)",
    factor_number: 0,
    least_seconds: Some(|asked| expected(asked.a, asked.job.columns)),
    analyse: |asked| {
        let Solver { method, tolerance, max_iterations } = asked.settings;
        Ok(Box::new(Limits { method, tolerance, max_iterations, seconds: None }))
    },
};

/// The limits of an iteration; the method needs to know nothing of the graph of A.
#[derive(Clone, Copy)]
struct Limits {
    method: &'static Method,
    /// Bound on the true relative residual ‖b - A x‖₂ / ‖b‖₂ of every column.
    tolerance: f64,
    max_iterations: usize,
    /// Time that the iterations may take by the prediction, s.
    seconds: Option<f64>,
}

impl LinearSolver for Limits {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        memory(a, columns)
    }

    fn seconds(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        expected(a, columns)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        let what = format!("multigrid, with the iteration of {columns} columns");
        Ok(machine::fits(what, self.memory(a, columns), 0.0)?)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        self.make(a, progress)
    }

    fn factor_within<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        seconds: f64,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        Limits { seconds: Some(seconds), ..*self }.make(a, progress)
    }
}

impl Limits {
    fn make<'a>(
        self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        progress.begin("multigrid", 0);
        let started = Instant::now();
        let multigrid = Multigrid::new(a).map_err(|NotDefinite { node }| {
            SolveError::NotPositiveDefinite { unknowns: 3 * a.nodes(), pivot: 3 * node }
        })?;
        progress.end();
        Ok(Box::new(Pcg { a, multigrid, limits: self, factor_s: started.elapsed().as_secs_f64() }))
    }
}

/// Seconds of the levels and of all iterations.
fn expected(a: &StiffnessMatrix, columns: usize) -> f64 {
    let pairs = a.edges.len() as f64;
    pairs * (LEVELS_S + ITERATIONS * ITERATION_S * columns as f64) / rayon::current_num_threads() as f64
}

/// Number of iterations that fit into `seconds`, of those that [`expected`] counts.
fn iterations_in(seconds: f64, a: &StiffnessMatrix, columns: usize) -> usize {
    let one = expected(a, columns) / ITERATIONS;
    (seconds / one.max(f64::MIN_POSITIVE)).ceil() as usize
}

/// Bytes of the levels while they are made, or with the solutions and what is iterated together.
pub(super) fn memory(a: &StiffnessMatrix, columns: usize) -> f64 {
    let [making, levels] = Multigrid::memory(a);
    let solutions = 24.0 * (a.nodes() * columns) as f64;
    making.max(levels + solutions + batch_memory(a, batch_width(a).min(columns)))
}
/// Seconds on one thread, for each pair of coupled nodes: of the levels, and of an iteration of one column.
const LEVELS_S: f64 = 3.0e-6;
const ITERATION_S: f64 = 1.7e-8;
/// Iterations of a body without large contrasts, with those of the forward error; thin bodies take up to twice as many.
const ITERATIONS: f64 = 30.0;

/// Iterations before the rest is foreseen where another method waits.
const SIGHT: usize = 3;
/// Part of `max_iterations` before it is where none does: residuals may rise before they fall.
const PATIENCE: usize = 4;

/// Columns that are iterated together, of small bodies and of those whose vectors would take more than [`BATCH_MEMORY`].
/// The bits of a column do not depend on the others.
const BATCHES: [usize; 2] = [24, 8];
const BATCH_MEMORY: f64 = 1e9;

fn batch_width(a: &StiffnessMatrix) -> usize {
    if batch_memory(a, BATCHES[0]) <= BATCH_MEMORY { BATCHES[0] } else { BATCHES[1] }
}

/// Bytes of the vectors of `columns` columns: x, r, p and A p in f64, four of the finest level and half of them again in f32.
fn batch_memory(a: &StiffnessMatrix, columns: usize) -> f64 {
    3.0 * (a.nodes() * padded(columns)) as f64 * (4.0 * 8.0 + 4.5 * 4.0)
}

/// A with its multigrid levels.
struct Pcg<'a> {
    a: &'a StiffnessMatrix,
    multigrid: Multigrid,
    limits: Limits,
    factor_s: f64,
}

impl Factor for Pcg<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    fn columns_together(&self) -> usize {
        batch_width(self.a)
    }

    /// Right-hand sides, solutions, and a batch.
    fn solve_memory(&self, columns: usize, asked: usize) -> f64 {
        let fields = 24.0 * ((2 * self.a.nodes() + asked) * columns) as f64;
        fields + batch_memory(self.a, batch_width(self.a).min(columns))
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solve_batches(b, false, progress)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        self.solve_batches(b, true, progress)
    }
}

impl Pcg<'_> {
    fn solve_batches(&self, b: &NodeFields, is_judged: bool, progress: &dyn Progress) -> SolveResult {
        let width = batch_width(self.a);
        let started = Instant::now();
        let mut x = NodeFields::zeros(b.nodes, b.columns);
        let mut stats = SolveStats {
            method: self.limits.method,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            factor_s: self.factor_s,
            ..Default::default()
        };
        let Limits { tolerance, max_iterations, seconds, .. } = self.limits;
        let worth = seconds.map_or(usize::MAX, |seconds| iterations_in(seconds, self.a, b.columns));
        let max_iterations = max_iterations.min(worth);
        let sight = if seconds.is_some() { SIGHT } else { max_iterations / PATIENCE };
        let system = System { a: self.a, multigrid: &self.multigrid, tolerance, max_iterations, sight };
        let mut error = Conditioning::default();
        // One unit a thousandth of the way down to the tolerance on a logarithmic scale.
        let batches = b.columns.div_ceil(width);
        progress.begin("conjugate gradients", 1000 * batches as u64);
        for batch in 0..batches {
            let columns = batch * width..((batch + 1) * width).min(b.columns);
            let mut own = Batch::new(system, b, columns.clone());
            own.converge(progress)?;
            stats.iterations = stats.iterations.max(own.iterations());
            stats.residuals.extend(own.relative_residuals());
            put(own.solution(), columns, &mut x);
            if is_judged {
                let probing = Instant::now();
                let found = own.energy_error();
                if found > error.forward_error || found.is_nan() {
                    error.forward_error = found;
                }
                error.seconds += probing.elapsed().as_secs_f64();
            }
        }
        progress.end();
        stats.solve_s = started.elapsed().as_secs_f64() - error.seconds;
        stats.conditioning = is_judged.then_some(error);
        Ok((x, stats))
    }
}

/// Brings the columns of a batch to their places.
fn put(part: &NodeFields, columns: Range<usize>, fields: &mut NodeFields) {
    let count = fields.columns;
    let rows = part.data.par_chunks_exact(part.columns).zip(fields.data.par_chunks_exact_mut(count));
    rows.with_min_len(1024)
        .for_each(|(from, to)| to[columns.clone()].copy_from_slice(&from[..columns.len()]));
}
