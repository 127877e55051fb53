//! The interface of linear solvers: settings in a scene, an entry in the list of methods, and three steps.
//!
//! ```text
//! Solver ── analyse(A) → LinearSolver ── factor(A) → Factor ── solve(b) → x, SolveStats
//! ```
//!
//! The first step depends on the graph of A alone and is reused while only the numbers of A change; the second depends on
//! those numbers; the third takes any number of right-hand sides. A body whose nodes are all held has no unknowns, and the
//! solver [`NoUnknowns`].

use super::analysis::SharedAnalysis;
use super::error::SolveError;
use super::kept_factor::KeptFactor;
use crate::base::progress::{Progress, Silent};
use crate::fem::{NodeFields, StiffnessMatrix};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A method with its settings, as a scene asks for it.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields, expecting = "a table like { method = \"pcg\" }")]
pub struct Solver {
    pub method: &'static Method,
    /// Relative residual ‖b - A x‖₂ / ‖b‖₂ at which a column of an iterative method is done.
    pub tolerance: f64,
    pub max_iterations: usize,
}

impl Default for Solver {
    fn default() -> Solver {
        Solver { method: Default::default(), tolerance: 1e-10, max_iterations: 1000 }
    }
}

impl Solver {
    /// The tolerance of an iterative method.
    pub fn tolerance(&self) -> Option<f64> {
        (!self.method.is_direct).then_some(self.tolerance)
    }
}

/// "cholesky", or "pcg 1e-6" with the tolerance; the limit on the iterations is not said.
impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.tolerance() {
            Some(tolerance) => write!(f, "{} {tolerance:e}", self.method.name),
            None => f.write_str(self.method.name),
        }
    }
}

/// Orders solvers by their texts.
impl Ord for Solver {
    fn cmp(&self, other: &Solver) -> std::cmp::Ordering {
        self.to_string()
            .cmp(&other.to_string())
            .then(self.tolerance.total_cmp(&other.tolerance))
            .then(self.max_iterations.cmp(&other.max_iterations))
    }
}

impl PartialOrd for Solver {
    fn partial_cmp(&self, other: &Solver) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Solver {
    fn eq(&self, other: &Solver) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Solver {}

/// The use of a factor.
#[derive(Clone, Copy, Debug)]
pub struct Job {
    /// Right-hand sides that are solved and judged together.
    pub columns: usize,
    /// Whether the factor is needed for more: further solves, the inverse at chosen nodes, or that it is kept.
    pub needs_factor: bool,
}

/// Further solves, as few as those of two control elements.
impl Default for Job {
    fn default() -> Job {
        Job { columns: 24, needs_factor: true }
    }
}

/// The input of a method's analysis.
#[derive(Clone, Copy)]
pub struct AnalysisInput<'a> {
    pub settings: Solver,
    pub a: &'a StiffnessMatrix,
    pub job: Job,
    /// All methods.
    pub methods: &'static [&'static Method],
    /// The pattern of A's factor, which the methods that need one share.
    pub(super) pattern: &'a SharedAnalysis,
    pub progress: &'a dyn Progress,
}

/// The solver, with its settings, for all matrices with the graph of one.
pub type Analyse = fn(&AnalysisInput<'_>) -> Result<Box<dyn LinearSolver>, SolveError>;

/// A way to solve A x = b: an entry of the list of methods.
#[derive(Debug)]
pub struct Method {
    /// The name in scenes, results and .green files.
    pub name: &'static str,
    /// Whether it factorises A, so that no tolerance ends it.
    pub is_direct: bool,
    /// Whether its factor can be kept ([`Factor::kept`]), or may be one that can.
    pub keeps_factor: bool,
    /// Whether its forward error is a bound; an estimate otherwise.
    pub bounds_error: bool,
    /// Advice where the forward error is too large.
    pub remedy: &'static str,
    /// Bytes of a number of its factor; 0 of a method that makes none, or that may.
    pub factor_number: usize,
    /// Lower estimate of the seconds for the job, from the graph of A before it is analysed; `None` for a method that `auto`
    /// leaves out.
    pub least_seconds: Option<fn(&AnalysisInput<'_>) -> f64>,
    pub analyse: Analyse,
}

/// A solver of all matrices of one graph.
pub trait LinearSolver: Send + Sync {
    /// Bytes that the factor, and the solves for `columns` right-hand sides after it, take at most.
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64;

    /// Seconds that the factor, the solves for `columns` right-hand sides and their judgement will take on an idle machine.
    fn seconds(&self, a: &StiffnessMatrix, columns: usize) -> f64;

    /// Errors where they take more memory than is left.
    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError>;

    /// Whether [`Factor::kept`] will give something, with `columns` right-hand sides solved before.
    fn keeps(&self, _a: &StiffnessMatrix, _columns: usize) -> bool {
        false
    }

    /// Prepares the solves with the numbers of `a`. Errors where it is not positive definite.
    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError>;

    /// [`LinearSolver::factor`], whose solves end with [`SolveError::Slow`] as soon as they foresee to take longer than `seconds`
    /// of [`LinearSolver::seconds`].
    fn factor_within<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        _seconds: f64,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        self.factor(a, progress)
    }
}

/// x of A x = b, and how it was found.
pub type SolveResult = Result<(NodeFields, SolveStats), SolveError>;

/// A part of the symmetric matrix (A⁻¹)ₛ over a list of nodes S: 3·rows × 3·columns numbers.
pub struct InverseStrip<'a> {
    /// Places in the list of nodes.
    pub rows: &'a [u32],
    pub columns: &'a [u32],
    /// Column after column: entry (3·row + axis, 3·column + axis).
    pub values: &'a [f64],
}

/// Nodes whose columns [`Factor::inverse_block`] solves together by default.
const STRIP_NODES: usize = 32;
/// Fields of all columns that an iteration in f64 with a factor in f32 holds at once.
const FIELDS: f64 = 9.0;

/// A matrix that is ready to be solved with.
pub trait Factor {
    /// Nodes of A, each with three unknowns.
    fn nodes(&self) -> usize;

    /// Solves A x = b for all columns; errors where a true residual stays too large.
    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult;

    /// Approximates A⁻¹ b, by the shortest way: for a preconditioner, which need not be exact.
    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.solve(b, &Silent).map(|(x, _)| x)
    }

    /// The rows `asked` of x of A x = b, with b given at the nodes `loaded` and zero at all others: nodes in any order, none
    /// twice. Of a direct solver the cost follows the ways from those nodes to the root of the elimination tree; its result
    /// is as exact as the factor, without refinement.
    fn solve_at(&self, loaded: &[u32], b: &NodeFields, asked: &[u32]) -> Result<NodeFields, SolveError> {
        self.solve(&spread(self.nodes(), loaded, b), &Silent).map(|(x, _)| x.at(asked))
    }

    /// Number of columns that are solved together: the bits of a column do not depend on those of other such groups. A direct
    /// method solves all together.
    fn columns_together(&self) -> usize {
        usize::MAX
    }

    /// (A⁻¹)ₛ over `nodes`, in any order, none twice: calls `take` with strips, always the same ones in the same order. Each
    /// pair of nodes stands in a strip at least once, (i, j) or (j, i); where both stand, both are in one strip.
    fn inverse_block(
        &self,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        self.inverse_block_from(0, nodes, take, progress)
    }

    /// [`Factor::inverse_block`] without its `first` strips.
    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        strips(&|own, b, asked| self.solve_at(own, b, asked), first, nodes, take, progress)
    }

    /// Bytes that [`Factor::solve_at`] takes for `columns` columns, with its result at no more than `asked` nodes.
    fn solve_memory(&self, columns: usize, _asked: usize) -> f64 {
        FIELDS * 24.0 * (self.nodes() * columns) as f64
    }

    /// The most columns of nodes in a strip.
    fn strip_nodes(&self) -> usize {
        STRIP_NODES
    }

    /// Bytes that [`Factor::inverse_block`] over `nodes` nodes takes beside what its caller makes of the strips.
    fn strip_memory(&self, nodes: usize) -> f64 {
        self.solve_memory(3 * STRIP_NODES, nodes) + 2.0 * 72.0 * (STRIP_NODES * nodes) as f64
    }

    /// The part of the factor that solves between these nodes, to be kept; `None` for a method that makes no factor, or none that
    /// is exact enough.
    fn kept(&self, _nodes: &[u32], _progress: &dyn Progress) -> Result<Option<KeptFactor>, SolveError> {
        Ok(None)
    }

    /// The factor behind one that keeps its solves, for solves too large to be kept.
    fn unkept(&self, _progress: &dyn Progress) -> Result<Option<&dyn Factor>, SolveError> {
        Ok(None)
    }

    /// [`Factor::solve`], and how exact the solution is: [`SolveStats::conditioning`].
    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult;
}

/// Fields over all nodes from those at the nodes `loaded`, zero at the others.
pub(super) fn spread(nodes: usize, loaded: &[u32], b: &NodeFields) -> NodeFields {
    let mut all = NodeFields::zeros(nodes, b.columns);
    let part = 3 * b.columns;
    for (&node, own) in loaded.iter().zip(b.data.chunks_exact(part.max(1))) {
        all.data[part * node as usize..][..part].copy_from_slice(own);
    }
    all
}

/// [`Factor::solve_at`], with the nodes loaded, their right-hand sides, and the nodes asked.
pub(super) type SolveAt<'a> = &'a dyn Fn(&[u32], &NodeFields, &[u32]) -> Result<NodeFields, SolveError>;

/// [`Factor::inverse_block_from`] by solves for the nodes' own columns.
pub(super) fn strips(
    solve_at: SolveAt<'_>,
    first: usize,
    nodes: &[u32],
    take: &mut dyn FnMut(&InverseStrip<'_>),
    progress: &dyn Progress,
) -> Result<(), SolveError> {
    let places: Vec<u32> = (0..nodes.len() as u32).collect();
    progress.begin("inverse at chosen nodes", nodes.len() as u64);
    for (columns, own) in places.chunks(STRIP_NODES).zip(nodes.chunks(STRIP_NODES)).skip(first) {
        let first = columns[0] as usize;
        let x = solve_at(own, &NodeFields::unit(own.len()), &nodes[first..])?;
        let values: Vec<f64> =
            (0..x.columns).flat_map(|c| x.data.iter().skip(c).step_by(x.columns)).copied().collect();
        take(&InverseStrip { rows: &places[first..], columns, values: &values });
        progress.advance(own.len() as u64);
    }
    progress.end();
    Ok(())
}

/// The work and the quality of a solver's solution, for the closing table and the .green file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SolveStats {
    pub method: &'static Method,
    /// The reason for this method, where `auto` took it.
    pub chosen: Option<String>,
    pub unknowns: usize,
    pub columns: usize,
    pub ordering_s: f64,
    pub symbolic_s: f64,
    pub factor_s: f64,
    pub solve_s: f64,
    /// Numbers held by the factor (supernodal: its explicit zeros counted), 0 of an iterative method.
    pub factor_entries: usize,
    /// Iterations of the slowest column, 0 where a factor alone solves.
    pub iterations: usize,
    /// ‖b - A x‖₂ / ‖b‖₂ of every column, computed from A after the solve; 0 where b = 0.
    pub residuals: Vec<f64>,
    /// The conditioning, if it was asked for.
    pub conditioning: Option<Conditioning>,
}

impl SolveStats {
    pub fn worst_residual(&self) -> f64 {
        self.residuals.iter().copied().fold(0.0, f64::max)
    }

    /// Adds those of further columns.
    pub fn join(&mut self, more: SolveStats) {
        if self.columns == 0 {
            *self = more;
            return;
        }
        self.columns += more.columns;
        self.solve_s += more.solve_s;
        self.iterations = self.iterations.max(more.iterations);
        self.residuals.extend(more.residuals);
        if let (Some(all), Some(more)) = (&mut self.conditioning, more.conditioning) {
            if more.forward_error > all.forward_error || more.forward_error.is_nan() {
                all.forward_error = more.forward_error;
            }
            all.seconds += more.seconds;
        }
    }
}

/// Bounds on the distance of a solution from the exact one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Conditioning {
    /// Estimate of κ₂ of A scaled by its diagonal; `None` for conjugate gradients, which stop before they have seen the
    /// least eigenvalue.
    pub scaled_condition: Option<f64>,
    /// Cholesky: bound on max |x̂ - x| / max |x| of the column with the largest residual. PCG: the largest ‖x̂ - x‖_A /
    /// ‖x̂‖_A of all columns, whose errors are solved for.
    pub forward_error: f64,
    pub seconds: f64,
}

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
