//! The part of a factor A = P L Lᵀ Pᵀ that depends on the graph of A alone: its pattern, which is reused while only numbers
//! change, and predictions of its memory and time.
//!
//! In: A's graph. Out: an [`Analysis`], or, before there is one, [`SharedAnalysis::least_seconds`].
//!
//! The ordering is nested dissection of the node graph by METIS (Karypis and Kumar, SIAM J. Sci. Comput. 20, 1998).

use super::dense::{Real, SCRATCH};
use super::error::SolveError;
use super::fronts::Fronts;
use super::substitution::{block_width, scratch};
use crate::base::machine;
use crate::base::progress::Progress;
use crate::fem::StiffnessMatrix;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
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
pub struct SharedAnalysis(Arc<SharedResults>);

#[derive(Default)]
struct SharedResults {
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

    pub(super) fn analysis(
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

/// METIS uses the C library's global random sequence, so that only one ordering may run at a time.
static METIS: Mutex<()> = Mutex::new(());

/// A fill-reducing permutation of nodes: node i of the permuted matrix is node `forward[i]` of the original;
/// `inverse[forward[i]] = i`.
#[derive(Clone, Debug, PartialEq)]
pub struct Ordering {
    pub forward: Vec<u32>,
    pub inverse: Vec<u32>,
}

/// Bytes that ordering and finding the factor's pattern take: 200 for each pair of coupled nodes (A's pattern, a permuted
/// copy of it, METIS' graphs) and 1000 for each node.
pub fn ordering_memory(matrix: &StiffnessMatrix) -> f64 {
    200.0 * matrix.edges.len() as f64 + 1000.0 * matrix.nodes() as f64
}

/// Orders the graph of nodes, whose three unknowns stay together.
///
/// METIS' seed is fixed: the same matrix gives the same ordering on every run.
pub fn nested_dissection(matrix: &StiffnessMatrix) -> Result<Ordering, SolveError> {
    let nodes = matrix.nodes();
    let failed = |reason: String| SolveError::Ordering { nodes, reason };
    let mut start = vec![0i32];
    let mut neighbours: Vec<i32> = Vec::with_capacity(2 * matrix.edges.len());
    for node in 0..nodes {
        neighbours.extend(matrix.neighbours(node).map(|(other, _, _)| other as i32));
        start.push(i32::try_from(neighbours.len()).map_err(|error| failed(error.to_string()))?);
    }
    let mut count = i32::try_from(nodes).map_err(|error| failed(error.to_string()))?;
    let mut permutation = vec![0i32; nodes];
    let mut inverse = vec![0i32; nodes];
    if !neighbours.is_empty() {
        let mut options = [-1i32; metis_sys::METIS_NOPTIONS as usize];
        options[metis_sys::moptions_et_METIS_OPTION_NUMBERING as usize] = 0;
        options[metis_sys::moptions_et_METIS_OPTION_SEED as usize] = 1;
        let _alone = METIS.lock().unwrap_or_else(PoisonError::into_inner);
        // SAFETY: the graph is a symmetric adjacency without self-loops in METIS' format (`start` has nodes + 1
        // entries, `neighbours` start[nodes]), both outputs hold `nodes` entries, weights may be null, and METIS
        // keeps no pointer.
        let status = unsafe {
            metis_sys::METIS_NodeND(
                &mut count,
                start.as_mut_ptr(),
                neighbours.as_mut_ptr(),
                std::ptr::null_mut(),
                options.as_mut_ptr(),
                permutation.as_mut_ptr(),
                inverse.as_mut_ptr(),
            )
        };
        if status == metis_sys::rstatus_et_METIS_ERROR_MEMORY {
            let refusal = machine::refused(format!("ordering {nodes} nodes"), ordering_memory(matrix));
            return Err(SolveError::FactorMemory(refusal));
        }
        if status != metis_sys::rstatus_et_METIS_OK {
            return Err(failed(format!("METIS returned status {status}")));
        }
    } else {
        permutation.iter_mut().zip(0..).for_each(|(p, i)| *p = i);
    }
    let forward: Vec<u32> = permutation.iter().map(|&node| node as u32).collect();
    let mut inverse = vec![0; nodes];
    forward.iter().zip(0..).for_each(|(&old, new)| inverse[old as usize] = new);
    Ok(Ordering { forward, inverse })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordering_of_a_chain_is_a_permutation_and_repeats() {
        let matrix = StiffnessMatrix::zeros(50, (0..49).map(|i| [i, i + 1]).collect());
        let ordering = nested_dissection(&matrix).unwrap();
        let mut sorted = ordering.forward.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, (0..50).collect::<Vec<_>>());
        assert!((0..50).all(|new| ordering.inverse[ordering.forward[new] as usize] == new as u32));
        assert_eq!(ordering, nested_dissection(&matrix).unwrap());
    }

    #[test]
    fn orderings_made_at_once_are_the_same() {
        let side = 12;
        let at = |x: u32, y: u32| x * side + y;
        let mut edges: Vec<[u32; 2]> = (0..side)
            .flat_map(|x| (0..side).map(move |y| (x, y)))
            .flat_map(|(x, y)| [[at(x, y), at(x + 1, y)], [at(x, y), at(x, y + 1)]])
            .filter(|[_, b]| *b < side * side)
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let matrix = StiffnessMatrix::zeros((side * side) as usize, edges);
        let alone = nested_dissection(&matrix).unwrap();
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8)
                .map(|_| scope.spawn(|| (0..50).all(|_| nested_dissection(&matrix).unwrap() == alone)))
                .collect();
            assert!(threads.into_iter().all(|thread| thread.join().unwrap()));
        });
    }

    #[test]
    fn single_node_needs_no_metis() {
        let ordering = nested_dissection(&StiffnessMatrix::zeros(1, vec![])).unwrap();
        assert_eq!(ordering.forward, [0]);
    }
}
