//! Sparse Cholesky A = P L Lᵀ Pᵀ by faer, always supernodal, with a nested dissection ordering.
//!
//! The symbolic step depends only on the graph and is reused when only materials change; the numeric step makes
//! the factor; solves run in blocks of columns, one thread each (faer's own parallel solve is slower than one
//! thread).

use super::condition;
use super::error::SolveError;
use super::ordering::{Ordering, nested_dissection, ordering_memory};
use super::residual::{Column, residuals};
use super::solver::{Conditioning, Factor, LinearSolver, Method, SolveResult, SolveStats};
use crate::base::machine;
use crate::base::progress::{Progress, Silent};
use crate::fem::{NodeFields, StiffnessMatrix};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, Mat, Par, Side};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::Instant;

pub const CHOLESKY: Method = Method {
    name: "cholesky",
    is_direct: true,
    bounds_error: true,
    remedy: "look for slivers and large contrasts of stiffness (`greenstage check`), for parts a thousand times as long \
             as thick, and for a Poisson's ratio next to 0.5",
    analyse: |_, a, progress| Ok(Box::new(Symbolic::new(a, progress)?)),
};

/// Columns that one thread solves together: fewer waste the cache that holds a supernode, more leave threads idle.
/// The width depends on the number of columns alone, so that the bits do not depend on the number of threads.
const BLOCK_COLUMNS: std::ops::RangeInclusive<usize> = 12..=128;
/// Entries of the factor from which on faer's parallel kernels are faster than one thread: with 2 threads a
/// factor of 2.4 million entries took 1.6 times as long, one of 12 million as long, one of 62 million 0.75 times.
const PARALLEL_ENTRIES: usize = 15_000_000;
/// Relative residual above which a step of iterative refinement is made, and above which the backward error decides
/// whether a solution is refused.
const REFINE_ABOVE: f64 = 1e-12;
const REFUSE_ABOVE: f64 = 1e-7;
const BACKWARD_ABOVE: f64 = 1e-12;
const REFINEMENTS: usize = 3;

/// Whether a system has been solved in this process: the threads then own their buffers already.
static BUFFERED: AtomicBool = AtomicBool::new(false);

/// The symbolic factorization: the pattern of A and of its factor.
struct Symbolic {
    factor: SymbolicCholesky<usize>,
    column_start: Vec<usize>,
    row_index: Vec<usize>,
    ordering_s: f64,
    symbolic_s: f64,
}

impl Symbolic {
    /// Orders the graph of `a` and finds the pattern of its factor.
    fn new(a: &StiffnessMatrix, progress: &dyn Progress) -> Result<Symbolic, SolveError> {
        machine::expect("ordering the unknowns and finding the factor's pattern", ordering_memory(a))
            .map_err(SolveError::FactorMemory)?;
        progress.begin("ordering", 0);
        let started = Instant::now();
        let ordering = nested_dissection(a)?;
        let ordering_s = started.elapsed().as_secs_f64();
        progress.end();

        let started = Instant::now();
        let (column_start, row_index) = lower_pattern(a);
        let unknowns = 3 * a.nodes();
        let pattern =
            SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &column_start, None, &row_index);
        let factor = analyse(pattern, &ordering)?;
        Ok(Symbolic {
            factor,
            column_start,
            row_index,
            ordering_s,
            symbolic_s: started.elapsed().as_secs_f64(),
        })
    }

    /// Numbers in the factor, with the explicit zeros of its supernodes.
    fn factor_entries(&self) -> usize {
        self.factor.len_val()
    }
}

impl LinearSolver for Symbolic {
    /// Bytes of the factor, and of what needs more: making it (A's numbers, faer's scratch), the solves (at most five
    /// fields of all columns at once, a block of columns for each thread), or the estimate of conditioning (|A|, and
    /// some 30 fields of one column).
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        let entries = self.factor_entries();
        let scratch =
            self.factor.factorize_numeric_llt_scratch::<f64>(parallelism(entries), Default::default());
        let making = 8.0 * self.row_index.len() as f64 + scratch.size_bytes() as f64;
        let width = block_width(columns).min(columns);
        let threads = rayon::current_num_threads().min(columns.div_ceil(width.max(1)));
        let solve = self.factor.solve_in_place_scratch::<f64>(width, Par::Seq).size_bytes() as f64;
        let field = 24.0 * a.nodes() as f64;
        let solves = 5.0 * field * columns as f64 + threads as f64 * solve;
        let conditioning = 100.0 * a.edges.len() as f64 + 30.0 * field + 2.0 * solve;
        8.0 * entries as f64 + making.max(solves).max(conditioning)
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        let entries = self.factor_entries();
        let what = format!("a factor of {entries} numbers, with the solves for {columns} columns");
        // Every thread maps the buffers of its matrix products once: two of the size of the largest cache.
        let threads = if BUFFERED.load(Relaxed) { 0 } else { rayon::current_num_threads() + 1 };
        let buffers = (2 * threads) as f64 * machine::largest_cache();
        machine::expect_mapped(what, self.memory(a, columns), buffers).map_err(SolveError::FactorMemory)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        Ok(Box::new(Cholesky::new(a, self, progress)?))
    }
}

fn parallelism(entries: usize) -> Par {
    if entries < PARALLEL_ENTRIES { Par::Seq } else { Par::rayon(0) }
}

fn block_width(columns: usize) -> usize {
    (columns / 8).clamp(*BLOCK_COLUMNS.start(), *BLOCK_COLUMNS.end())
}

fn analyse(
    pattern: SymbolicSparseColMatRef<'_, usize>,
    ordering: &Ordering,
) -> Result<SymbolicCholesky<usize>, SolveError> {
    let unknowns = pattern.nrows();
    let permutation = faer::perm::PermRef::new_checked(&ordering.forward, &ordering.inverse, unknowns);
    factorize_symbolic_cholesky(
        pattern,
        Side::Lower,
        SymmetricOrdering::Custom(permutation),
        CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        },
    )
    .map_err(|error| SolveError::Ordering { nodes: unknowns / 3, reason: format!("{error:?}") })
}

/// The numeric factor of A.
struct Cholesky<'a> {
    a: &'a StiffnessMatrix,
    symbolic: &'a Symbolic,
    values: Vec<f64>,
    factor_s: f64,
}

impl<'a> Cholesky<'a> {
    /// A = P L Lᵀ Pᵀ in f64. Errors where A is not positive definite or the factor does not fit into memory.
    fn new(
        a: &'a StiffnessMatrix,
        symbolic: &'a Symbolic,
        progress: &dyn Progress,
    ) -> Result<Cholesky<'a>, SolveError> {
        symbolic.fits(a, 1)?;
        progress.begin("factorization", 0);
        let started = Instant::now();
        let unknowns = 3 * a.nodes();
        let entries = symbolic.factor_entries();
        let no_memory = || {
            let what = format!("a factor of {entries} numbers");
            SolveError::FactorMemory(machine::refused(what, symbolic.memory(a, 1)))
        };

        let numbers = lower_values(a);
        let pattern = SymbolicSparseColMatRef::new_checked(
            unknowns,
            unknowns,
            &symbolic.column_start,
            None,
            &symbolic.row_index,
        );
        let matrix = SparseColMatRef::new(pattern, &numbers);
        let mut values = Vec::new();
        values.try_reserve_exact(entries).map_err(|_reason| no_memory())?;
        values.resize(entries, 0.0);

        let par = parallelism(entries);
        let scratch = symbolic.factor.factorize_numeric_llt_scratch::<f64>(par, Default::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_reason| no_memory())?;
        symbolic
            .factor
            .factorize_numeric_llt(
                &mut values,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                par,
                MemStack::new(&mut memory),
                Default::default(),
            )
            .map_err(|LltError::NonPositivePivot { index }| SolveError::NotPositiveDefinite {
                unknowns,
                pivot: index,
            })?;
        progress.end();
        Ok(Cholesky { a, symbolic, values, factor_s: started.elapsed().as_secs_f64() })
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
        let inverse = |b: &NodeFields| self.substitute(b, &Silent);
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

    /// Forward and backward substitution, each thread its own block of columns.
    fn substitute(&self, b: &NodeFields, progress: &dyn Progress) -> Result<NodeFields, SolveError> {
        let rows = 3 * b.nodes;
        let width = block_width(b.columns);
        let factor = LltRef::new(&self.symbolic.factor, &self.values);
        let blocks = (0..b.columns.div_ceil(width))
            .into_par_iter()
            .map(|block| {
                let first = block * width;
                let count = width.min(b.columns - first);
                let mut x = Mat::from_fn(rows, count, |row, column| b.row(row)[first + column]);
                let scratch = self.symbolic.factor.solve_in_place_scratch::<f64>(count, Par::Seq);
                let mut memory = MemBuffer::try_new(scratch).map_err(|_reason| {
                    let what = format!("a block of {count} columns");
                    SolveError::Memory(machine::refused(what, scratch.size_bytes() as f64))
                })?;
                factor.solve_in_place_with_conj(Conj::No, x.as_mut(), Par::Seq, MemStack::new(&mut memory));
                progress.advance(count as u64);
                Ok(x)
            })
            .collect::<Result<Vec<Mat<f64>>, SolveError>>()?;
        let mut x = NodeFields::zeros(b.nodes, b.columns);
        x.data.par_chunks_mut(b.columns.max(1)).enumerate().with_min_len(256).for_each(|(row, out)| {
            for (column, value) in out.iter_mut().enumerate() {
                *value = blocks[column / width][(row, column % width)];
            }
        });
        Ok(x)
    }
}

impl Factor for Cholesky<'_> {
    /// One substitution, without a look at its residual.
    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.substitute(b, &Silent)
    }

    /// Solves A x = b for all columns, refining where a residual is above 1e-12; errors where one stays above 1e-7.
    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        progress.begin("solves", b.columns as u64);
        let started = Instant::now();
        let mut x = self.substitute(b, progress)?;
        progress.end();
        BUFFERED.store(true, Relaxed);
        let (mut relative, mut r) = residuals(self.a, &x, b);
        for _ in 0..REFINEMENTS {
            if relative.iter().all(|&r| r <= REFINE_ABOVE) {
                break;
            }
            let correction = self.substitute(&r, &Silent)?;
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
            chosen: None,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            ordering_s: self.symbolic.ordering_s,
            symbolic_s: self.symbolic.symbolic_s,
            factor_s: self.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            factor_entries: self.values.len(),
            iterations: 0,
            residuals: relative,
            conditioning: None,
        };
        Ok((x, stats))
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

/// Column starts and row indices of the lower triangle of A as a scalar matrix.
fn lower_pattern(a: &StiffnessMatrix) -> (Vec<usize>, Vec<usize>) {
    let mut column_start = vec![0];
    let mut row_index = Vec::with_capacity(6 * a.nodes() + 9 * a.blocks.len());
    for node in 0..a.nodes() {
        for axis in 0..3 {
            row_index.extend((axis..3).map(|row| 3 * node + row));
            for edge in &a.edges[a.edge_start[node]..a.edge_start[node + 1]] {
                row_index.extend((0..3).map(|row| 3 * edge[1] as usize + row));
            }
            column_start.push(row_index.len());
        }
    }
    (column_start, row_index)
}

/// The numbers in the order of [`lower_pattern`]; block K_ij with i < j stands in the lower triangle as K_ijᵀ.
fn lower_values(a: &StiffnessMatrix) -> Vec<f64> {
    let mut values = Vec::with_capacity(6 * a.nodes() + 9 * a.blocks.len());
    for node in 0..a.nodes() {
        for axis in 0..3 {
            values.extend((axis..3).map(|row| a.diagonal[node][(row, axis)]));
            for block in &a.blocks[a.edge_start[node]..a.edge_start[node + 1]] {
                values.extend((0..3).map(|row| block[(axis, row)]));
            }
        }
    }
    values
}
