//! A Cholesky factor in f32 as the preconditioner of conjugate gradients in f64: half the memory of the factor.
//!
//! The iteration ends where Cholesky in f64 would: at a residual of 1e-12, or where rounding lets it fall no further. Where
//! the condition number of A comes near 1e7, a factor in f32 fails, or the iteration with it does not end. An estimate of
//! the condition number, which takes a small part of the time of a factor, decides beforehand whether the factor is made in
//! f64 instead; otherwise that happens as soon as the remaining iterations would take longer than a factor in f64. A note
//! reports it. Literature: Higham and Mary, Acta Numerica 31 (2022), 347-414, section 8.

use super::analysis::Analysis;
use super::cholesky::Cholesky;
use super::error::SolveError;
use super::llt::Llt;
use super::refinement::{conditioning, refined};
use super::solver::{Factor, InverseStrip, LinearSolver, Method, SolveResult, SolveStats, spread, strips};
use crate::base::progress::{Progress, Silent};
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Vector3};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

pub const MIXED: Method = Method {
    name: "mixed",
    is_direct: true,
    keeps_factor: false,
    bounds_error: true,
    remedy: "write solver.method = \"cholesky\", and look for slivers and large contrasts of stiffness \
             (`greenstage check`)",
    factor_number: size_of::<f32>(),
    least_seconds: Some(|asked| asked.pattern.least_seconds::<f32>(asked.a, asked.job.columns)),
    analyse: |asked| {
        let analysis = asked.pattern.analysis(asked.a, asked.progress)?;
        Ok(Box::new(Direct { analysis, iterations: OnceLock::new() }))
    },
};

/// Seconds on one thread for each number of a column in an iteration, without the solve.
const VECTORS_S: f64 = 1e-8;
/// Error of a factor in f32 over κ of the matrix: some units of roundoff.
const ROUNDING: f64 = 6e-8;

/// Iterations to [`TOLERANCE`] with a factor in f32 of a matrix with this condition, each of which leaves κ times the roundoff
/// of the residual; infinitely many where that is no small part.
fn expected(condition: f64) -> f64 {
    let left = ROUNDING * condition;
    if left < 0.5 { (TOLERANCE.ln() / left.ln()).max(USUAL) } else { f64::INFINITY }
}

/// Iterations after which the factor is called too inexact, and those that are usual.
const MOST: usize = 25;
const USUAL: f64 = 3.0;
/// Relative residual of the recurrence at which the iteration ends.
const TOLERANCE: f64 = 5e-13;
/// The same for the solves by which the error is estimated.
const ESTIMATE: f64 = 1e-3;
/// The same for columns of the inverse at chosen nodes, which are kept as f32.
const COLUMN: f64 = 1e-10;

const ILL_CONDITIONED: &str = "The stiffness matrix is too ill-conditioned for a factor in f32, or not positive definite: its \
                               factor is made in f64.";

/// All matrices of one graph.
struct Direct {
    analysis: Arc<Analysis>,
    /// Expected number of iterations, once it was asked for.
    iterations: OnceLock<f64>,
}

impl Direct {
    fn iterations(&self, a: &StiffnessMatrix) -> f64 {
        *self.iterations.get_or_init(|| condition(a).map_or(USUAL, expected))
    }

    /// Seconds for the factor and `iterations` iterations.
    fn takes(&self, a: &StiffnessMatrix, columns: usize, iterations: f64) -> f64 {
        let columns = columns as f64 * (iterations + 1.0);
        let vectors = VECTORS_S * 3.0 * a.nodes() as f64 * columns / rayon::current_num_threads() as f64;
        self.analysis.seconds::<f32>(columns as usize) + vectors
    }
}

impl LinearSolver for Direct {
    fn memory(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        self.analysis.memory::<f32>(a, columns)
    }

    fn seconds(&self, a: &StiffnessMatrix, columns: usize) -> f64 {
        let least = self.takes(a, columns, USUAL);
        // A factor in f64 is faster then, whatever the condition, whose estimate takes time too.
        if least >= self.analysis.seconds::<f64>(columns) {
            return least;
        }
        let iterations = self.iterations(a);
        if iterations > MOST as f64 { f64::INFINITY } else { self.takes(a, columns, iterations) }
    }

    fn fits(&self, a: &StiffnessMatrix, columns: usize) -> Result<(), SolveError> {
        self.analysis.fits::<f32>(a, columns)
    }

    fn factor<'a>(
        &'a self,
        a: &'a StiffnessMatrix,
        progress: &dyn Progress,
    ) -> Result<Box<dyn Factor + 'a>, SolveError> {
        if self.iterations(a) > MOST as f64 && self.analysis.fits::<f64>(a, 1).is_ok() {
            progress.tell(ILL_CONDITIONED);
            return Ok(Box::new(Cholesky::new(a, &self.analysis, progress)?));
        }
        match Llt::new(a, &self.analysis, progress) {
            Ok(llt) => Ok(Box::new(Mixed { a, analysis: &self.analysis, llt, exact: OnceLock::new() })),
            Err(SolveError::NotPositiveDefinite { .. }) => {
                progress.tell(ILL_CONDITIONED);
                Ok(Box::new(Cholesky::new(a, &self.analysis, progress)?))
            }
            Err(error) => Err(error),
        }
    }
}

/// A with its factor.
struct Mixed<'a> {
    a: &'a StiffnessMatrix,
    analysis: &'a Analysis,
    llt: Llt<'a, f32>,
    /// Once the iteration has failed.
    exact: OnceLock<Cholesky<'a>>,
}

/// An iteration whose residual does not fall.
struct Stagnant;

impl Mixed<'_> {
    /// Conjugate gradients from zero, all columns together, to a relative residual. Returns the iterations, too.
    fn iterate(
        &self,
        b: &NodeFields,
        tolerance: f64,
    ) -> Result<Result<(NodeFields, usize), Stagnant>, SolveError> {
        let columns = b.columns;
        let goal: Vec<f64> = b.norms().iter().map(|norm| tolerance * norm).collect();
        let mut x = NodeFields::zeros(b.nodes, columns);
        let mut r = b.clone();
        let mut p = NodeFields::zeros(b.nodes, columns);
        let mut ap = NodeFields::zeros(b.nodes, columns);
        let mut rz = vec![0.0; columns];
        for iteration in 0..=MOST {
            let norms = r.norms();
            let is_active: Vec<bool> =
                norms.iter().zip(&goal).map(|(norm, goal)| norm.is_nan() || norm > goal).collect();
            if !is_active.contains(&true) {
                return Ok(Ok((x, iteration)));
            }
            if iteration > 0
                && self.exact_takes(columns) < self.takes(columns, iteration, &norms, &goal, tolerance)
                || norms.iter().any(|norm| !norm.is_finite())
            {
                break;
            }
            let z = self.llt.substitute(&r, &Silent)?;
            let new_rz = r.dots(&z);
            let beta: Vec<f64> =
                new_rz.iter().zip(&rz).map(|(new, old)| if *old > 0.0 { new / old } else { 0.0 }).collect();
            combine(&mut p, &beta, &z, &vec![1.0; columns]);
            rz = new_rz;
            self.a.multiply(&p, &mut ap);
            let pap = p.dots(&ap);
            let step = |c: usize| if is_active[c] && pap[c] > 0.0 { rz[c] / pap[c] } else { 0.0 };
            let alpha: Vec<f64> = (0..columns).map(step).collect();
            let minus: Vec<f64> = alpha.iter().map(|alpha| -alpha).collect();
            combine(&mut x, &vec![1.0; columns], &p, &alpha);
            combine(&mut r, &vec![1.0; columns], &ap, &minus);
        }
        Ok(Err(Stagnant))
    }

    /// Seconds that the iterations still take, from the decrease of the residuals in the first `iterations` ones.
    fn takes(&self, columns: usize, iterations: usize, norms: &[f64], goal: &[f64], tolerance: f64) -> f64 {
        let left = norms.iter().zip(goal).map(|(norm, goal)| norm / goal);
        let worst = left.fold(1.0, |worst: f64, left| if left > worst { left } else { worst });
        let rate = -(tolerance * worst).ln() / iterations as f64;
        let more = if rate > 0.0 { worst.ln() / rate } else { f64::INFINITY };
        more * self.analysis.solve_seconds::<f32>(columns)
    }

    /// Seconds of a factor in f64 and its solves; infinite where it does not fit into memory.
    fn exact_takes(&self, columns: usize) -> f64 {
        match self.analysis.fits::<f64>(self.a, columns) {
            Ok(()) => self.analysis.seconds::<f64>(columns),
            Err(_) => f64::INFINITY,
        }
    }

    /// A factor in f64, made when it is needed first.
    fn exact(&self, progress: &dyn Progress) -> Result<&Cholesky<'_>, SolveError> {
        if let Some(exact) = self.exact.get() {
            return Ok(exact);
        }
        progress.tell(
            "The stiffness matrix is too ill-conditioned for a factor in f32: another is made in f64. \
             Write solver = { method = \"cholesky\" } to save the time and memory of the first.",
        );
        let made = Cholesky::new(self.a, self.analysis, progress)?;
        Ok(self.exact.get_or_init(|| made))
    }

    /// The solution where the iteration ends, with true residuals.
    fn converge(
        &self,
        b: &NodeFields,
        progress: &dyn Progress,
    ) -> Result<Option<(NodeFields, SolveStats)>, SolveError> {
        progress.begin("solves", b.columns as u64);
        let started = Instant::now();
        let first = self.iterate(b, TOLERANCE)?;
        progress.advance(b.columns as u64);
        progress.end();
        let Ok((x, iterations)) = first else { return Ok(None) };
        // Further iterations for the true residual correct the rounding errors of the recurrence.
        let inverse = |r: &NodeFields| {
            Ok(self
                .iterate(r, TOLERANCE)?
                .map_or_else(|Stagnant| NodeFields::zeros(r.nodes, r.columns), |(d, _)| d))
        };
        let (x, relative) = match refined(self.a, x, b, &inverse) {
            Err(SolveError::Factor { .. }) => return Ok(None),
            other => other?,
        };
        let stats = SolveStats {
            method: &MIXED,
            unknowns: 3 * b.nodes,
            columns: b.columns,
            ordering_s: self.analysis.ordering_s,
            symbolic_s: self.analysis.symbolic_s,
            factor_s: self.llt.factor_s,
            solve_s: started.elapsed().as_secs_f64(),
            factor_entries: self.llt.entries(),
            iterations,
            residuals: relative,
            conditioning: None,
            chosen: None,
        };
        Ok(Some((x, stats)))
    }
}

impl Factor for Mixed<'_> {
    fn nodes(&self) -> usize {
        self.a.nodes()
    }

    /// One substitution in f32.
    fn precondition(&self, b: &NodeFields) -> Result<NodeFields, SolveError> {
        self.llt.substitute(b, &Silent)
    }

    fn inverse_block_from(
        &self,
        first: usize,
        nodes: &[u32],
        take: &mut dyn FnMut(&InverseStrip<'_>),
        progress: &dyn Progress,
    ) -> Result<(), SolveError> {
        if let Some(exact) = self.exact.get() {
            return exact.inverse_block_from(first, nodes, take, progress);
        }
        progress.tell(
            "A factor in f32 takes ten times as long for the inverse as solver = { method = \"cholesky\" }, \
             and half the memory.",
        );
        let column = |own: &[u32], b: &NodeFields, asked: &[u32]| {
            let b = spread(self.a.nodes(), own, b);
            match self.iterate(&b, COLUMN)? {
                Ok((x, _)) => Ok(x.at(asked)),
                Err(Stagnant) => self.exact(&Silent)?.solve(&b, &Silent).map(|(x, _)| x.at(asked)),
            }
        };
        strips(&column, first, nodes, take, progress)
    }

    fn solve(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        if self.exact.get().is_none()
            && let Some(solved) = self.converge(b, progress)?
        {
            return Ok(solved);
        }
        self.exact(progress)?.solve(b, progress)
    }

    fn solve_and_judge(&self, b: &NodeFields, progress: &dyn Progress) -> SolveResult {
        let (x, mut stats) = self.solve(b, progress)?;
        if let Some(exact) = self.exact.get() {
            stats.conditioning = Some(exact.judge(&x, b, progress)?);
            return Ok((x, stats));
        }
        // An estimate needs few digits.
        let inverse = |b: &NodeFields| match self.iterate(b, ESTIMATE)? {
            Ok((x, _)) => Ok(x),
            Err(Stagnant) => self.llt.substitute(b, &Silent),
        };
        stats.conditioning = Some(conditioning(self.a, &x, b, &inverse, progress)?);
        Ok((x, stats))
    }
}

/// x ← s x + t y, column by column.
fn combine(x: &mut NodeFields, s: &[f64], y: &NodeFields, t: &[f64]) {
    let columns = s.len().max(1);
    for (x, y) in x.data.chunks_exact_mut(columns).zip(y.data.chunks_exact(columns)) {
        for c in 0..columns {
            x[c] = s[c] * x[c] + t[c] * y[c];
        }
    }
}

/// Number of halvings by which groups are made, 2 to this power.
/// Least number of nodes of a group.
const HALVINGS: u32 = 5;
const NODES: usize = 16;
/// Steps of the inverse iteration.
const STEPS: usize = 6;
/// The largest eigenvalue of a stiffness matrix that is scaled by its diagonal.
const LARGEST: f64 = 3.0;

/// Estimate of κ₂(S A S) with S = diag(A)^-1/2, from below and to an order of magnitude; infinite where A is not positive
/// definite, `None` without places.
///
/// The nodes are gathered into a few groups that move as rigid bodies (Rayleigh and Ritz). All strain is then between the
/// groups, in one layer of elements instead of many: the least eigenvalue is too large by as many times as a group has
/// layers.
pub(super) fn condition(a: &StiffnessMatrix) -> Option<f64> {
    if a.places.len() != a.nodes() || a.nodes() == 0 {
        return None;
    }
    let mut nodes: Vec<u32> = (0..a.nodes() as u32).collect();
    let mut groups: Vec<&mut [u32]> = vec![&mut nodes];
    for _ in 0..HALVINGS {
        if groups.iter().any(|group| group.len() < 2 * NODES) {
            break;
        }
        groups = groups.into_iter().flat_map(|group| <[_; 2]>::from(halves(group, &a.places))).collect();
    }
    let mut of_node = vec![0; a.nodes()];
    let mut motion = vec![Matrix3x6::zeros(); a.nodes()];
    for (number, group) in groups.iter().enumerate() {
        let place = |&node: &u32| Vector3::from(a.places[node as usize]);
        let centre = group.iter().map(place).sum::<Vector3<f64>>() / group.len() as f64;
        let size = group.iter().map(|node| (place(node) - centre).norm()).fold(f64::MIN_POSITIVE, f64::max);
        for node in group.iter() {
            of_node[*node as usize] = number;
            let arm = (place(node) - centre) / size;
            let own = &mut motion[*node as usize];
            own.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            own.fixed_view_mut::<3, 3>(0, 3).copy_from(&-arm.cross_matrix());
        }
    }
    let count = 6 * groups.len();
    let (mut stiffness, mut scale) = (DMatrix::zeros(count, count), DMatrix::zeros(count, count));
    for (node, block) in a.diagonal.iter().enumerate() {
        let (of, at) = (&motion[node], 6 * of_node[node]);
        let mut own = stiffness.fixed_view_mut::<6, 6>(at, at);
        own += of.transpose() * block * of;
        let mut own = scale.fixed_view_mut::<6, 6>(at, at);
        own += of.transpose() * Matrix3::from_diagonal(&block.diagonal()) * of;
    }
    let mut between: usize = 0;
    for (&[i, j], block) in a.edges.iter().zip(&a.blocks) {
        let [i, j] = [i as usize, j as usize];
        let part = motion[i].transpose() * block * motion[j];
        let (row, column) = (6 * of_node[i], 6 * of_node[j]);
        between += usize::from(row != column);
        let mut to = stiffness.fixed_view_mut::<6, 6>(row, column);
        to += part;
        let mut to = stiffness.fixed_view_mut::<6, 6>(column, row);
        to += part.transpose();
    }
    let layers = a.edges.len() as f64 / between.max(1) as f64;
    let Some(factor) = stiffness.cholesky() else { return Some(f64::INFINITY) };
    let mut x = DVector::from_fn(count, |i, _| 1.0 + (i as f64).sin());
    let mut softest = 0.0;
    for _ in 0..STEPS {
        let force = &scale * &x;
        let next = factor.solve(&force);
        softest = next.dot(&(&scale * &next)) / next.dot(&force);
        x = &next / next.amax().max(f64::MIN_POSITIVE);
    }
    Some(LARGEST * softest * layers.max(1.0))
}

/// Both halves of a group across its longest side.
fn halves<'a>(group: &'a mut [u32], places: &[[f64; 3]]) -> (&'a mut [u32], &'a mut [u32]) {
    let side = |axis: usize| {
        let along = || group.iter().map(|&node| places[node as usize][axis]);
        along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min)
    };
    let sides = [0, 1, 2].map(side);
    let axis = (0..3).fold(0, |most, axis| if sides[axis] > sides[most] { axis } else { most });
    let middle = group.len() / 2;
    group.select_nth_unstable_by(middle, |&a, &b| {
        places[a as usize][axis].total_cmp(&places[b as usize][axis]).then(a.cmp(&b))
    });
    group.split_at_mut(middle)
}
