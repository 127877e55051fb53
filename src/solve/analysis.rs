//! The part of a factor A = P L Lᵀ Pᵀ that depends on the graph of A alone: its pattern, which is reused while only numbers
//! change, and predictions of its memory and time.
//!
//! In: A's graph. Out: an [`Analysis`], or, before there is one, [`SharedAnalysis::least_seconds`].

use super::dense::{Real, SCRATCH};
use super::error::SolveError;
use super::fronts::Fronts;
use super::ordering::{nested_dissection, ordering_memory};
use super::substitution::{block_width, scratch};
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::StiffnessMatrix;
use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

/// One block of columns is solved in this many branches of the tree side by side, where the factor has more numbers than this.
const BRANCHES: usize = 4;
const WORTH_BRANCHES: usize = 100_000;

/// Seconds on one thread: for each multiplication of the factor, for each of its numbers while it is made, and for each of
/// them and each column in a solve.
const FACTOR_S: f64 = 5.4e-11;
const ENTRY_S: f64 = 4.8e-9;
const COLUMN_S: f64 = 4.2e-10;
/// The estimates of conditioning in solves of one of many columns.
const JUDGEMENT: f64 = 30.0;

/// Seconds in f64 on all threads for a factor of `work` multiplications and `entries` numbers, and for the solves with it.
pub(super) fn seconds_of(work: f64, entries: f64, columns: usize) -> f64 {
    let columns = columns as f64 + JUDGEMENT;
    (FACTOR_S * work + ENTRY_S * entries + COLUMN_S * entries * columns) / rayon::current_num_threads() as f64
}

/// Numbers of the factor of a compact part of a body over n^{4/3} of its unknowns, and multiplications over its numbers to the
/// power of 3/2.
const FILL: f64 = 20.0;
const WORK: f64 = 0.35;
/// The least time in parts of that of such a body: of cubes, bars, plates and tubes, tet4 and tet10, it was 0.27 to 0.5.
const LEAST: f64 = 0.26;

/// Steps along the graph from one end of a body to the other, where it is in one piece.
fn levels(a: &StiffnessMatrix) -> usize {
    let search = |first: usize| {
        let mut seen = vec![false; a.nodes()];
        let (mut level, mut count) = (vec![first], 0);
        let mut last = first;
        seen[first] = true;
        while let Some(&node) = level.first() {
            (last, count) = (node, count + 1);
            let mut next = Vec::new();
            for node in level {
                for (other, _, _) in a.neighbours(node) {
                    if !std::mem::replace(&mut seen[other], true) {
                        next.push(other);
                    }
                }
            }
            level = next;
        }
        (last, count)
    };
    if a.nodes() == 0 { 1 } else { search(search(0).0).1 }
}

/// The pattern of the factor.
pub(super) struct Analysis {
    pub(super) fronts: Fronts,
    pub(super) branches: Vec<Range<usize>>,
    pub(super) ordering_s: f64,
    pub(super) symbolic_s: f64,
}

impl Analysis {
    /// Orders the graph of `a` and finds the pattern of its factor.
    pub(super) fn new(a: &StiffnessMatrix, progress: &dyn Progress) -> Result<Analysis, SolveError> {
        machine::expect("ordering the unknowns and finding the factor's pattern", ordering_memory(a))
            .map_err(SolveError::FactorMemory)?;
        progress.begin("ordering", 0);
        let started = Instant::now();
        let ordering = nested_dissection(a)?;
        let ordering_s = started.elapsed().as_secs_f64();
        progress.end();
        let started = Instant::now();
        let fronts = Fronts::new(a, &ordering.forward);
        let branches = if fronts.entries() > WORTH_BRANCHES { fronts.branches(BRANCHES) } else { Vec::new() };
        Ok(Analysis { fronts, branches, ordering_s, symbolic_s: started.elapsed().as_secs_f64() })
    }

    /// Bytes of the factor, and of what needs more: making it (the updates of the fronts that are at work at once), the
    /// solves (at most five fields of all columns at once, or eight of an iteration, and a block of columns for each thread), or
    /// the estimate of conditioning (|A|, and some 70 fields of one column).
    pub(super) fn memory<T: Real>(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        let number = size_of::<T>() as f64;
        let threads = rayon::current_num_threads();
        let making = number * self.fronts.update_numbers(threads) as f64 + (threads * SCRATCH) as f64;
        let width = block_width(columns).min(columns);
        let blocks = columns.div_ceil(width.max(1)).min(threads);
        // Of one block, each branch has its scratch, and the rows outside that it adds to.
        let branches = if columns <= width { 2 * self.branches.len() } else { 0 };
        let block = number * (3 * a.nodes() * width + (1 + branches) * scratch(&self.fronts, width)) as f64;
        let field = 24.0 * a.nodes() as f64;
        let fields = if size_of::<T>() < size_of::<f64>() { 8.0 } else { 5.0 };
        let solves = fields * field * columns as f64 + blocks as f64 * block;
        let conditioning = 100.0 * a.edges.len() as f64 + 70.0 * field + 2.0 * block;
        number * self.fronts.entries() as f64 + making.max(solves).max(conditioning)
    }

    /// Seconds on an idle machine of the factor, of the solves for `columns` right-hand sides, and of some twelve solves of
    /// one column for the estimates. Of a box of 28,000 nodes and a plate of 39,000 they are right within a third.
    pub(super) fn seconds<T: Real>(&self, columns: usize) -> f64 {
        let half = size_of::<T>() as f64 / size_of::<f64>() as f64;
        half * seconds_of(self.fronts.work(), self.fronts.entries() as f64, columns)
    }

    /// Seconds on an idle machine for a solve of `columns` columns.
    pub(super) fn solve_seconds<T: Real>(&self, columns: usize) -> f64 {
        let half = size_of::<T>() as f64 / size_of::<f64>() as f64;
        let threads = rayon::current_num_threads() as f64;
        half * COLUMN_S * self.fronts.entries() as f64 * columns as f64 / threads
    }
}

/// Results about one graph that several methods share, found by the one that needs them first.
#[derive(Clone, Default)]
pub struct SharedAnalysis(Arc<Known>);

#[derive(Default)]
struct Known {
    levels: OnceLock<usize>,
    analysis: OnceLock<Arc<Analysis>>,
}

impl SharedAnalysis {
    /// Lower estimate of the seconds for `columns` columns with a factor's numbers of type T, from the graph of `a`: the levels
    /// of a breadth-first search from one end to the other are as large as separators of the body, which is taken as a row of
    /// compact parts.
    pub(super) fn least_seconds<T: Real>(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        let nodes = a.nodes() as f64;
        let width = nodes / *self.0.levels.get_or_init(|| levels(a)) as f64;
        let part = nodes.min(width.powf(1.5)).max(1.0);
        let entries = FILL * (3.0 * part).powf(4.0 / 3.0);
        let parts = nodes / part;
        let half = size_of::<T>() as f64 / size_of::<f64>() as f64;
        LEAST * half * seconds_of(parts * WORK * entries.powf(1.5), parts * entries, columns)
    }

    pub(super) fn of(
        &self,
        a: &StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Arc<Analysis>, SolveError> {
        if let Some(known) = self.0.analysis.get() {
            return Ok(known.clone());
        }
        let made = Arc::new(Analysis::new(a, progress)?);
        Ok(self.0.analysis.get_or_init(|| made).clone())
    }
}
