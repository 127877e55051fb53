//! Rounds the blocks as coarsely as the error allows that was asked for.
//!
//! In: a factor. Out: [`Compressed`], with the error that was measured against columns solved anew. It is
//!
//! ```text
//! max ‖E_ij (K⁻¹)_jj⁻¹‖₂      over the nodes j that were solved for and all nodes i,
//! ```
//!
//! the largest displacement that is wrong anywhere where a force, of any direction, moves the node under it by 1.

use super::super::dense::product;
use super::basis::{Bases, WHAT, bases};
use super::build::{BuildError, Built, build, tolerances};
use super::column::Shape;
use super::exact::{Exact, exact};
use super::memory;
use super::packed::{pack, rounded, unpack};
use super::samples::samples;
use super::tree::{Block, Frame, Surface, Tree, frames};
use crate::base::machine;
use crate::base::memory::give_back;
use crate::solve::Progress;
use faer::{Mat, MatRef};
use nalgebra::Matrix3;
use rayon::prelude::*;

/// The part of the asked error that the measured one is to reach: other nodes may err by more.
const AIM: f64 = 0.4;
/// Steps of rounding, in parts of the error of a block: where the trial begins, and how often it is halved or doubled.
const FIRST: f64 = 0.5;
const TRIALS: i32 = 8;
/// Factor by which the steps of a basis are finer than those of blocks.
const FINER: f64 = 0.1;
/// Share of a cluster's samples that the bases may leave out, in parts of the error that is asked for.
const LEFT_OUT: f64 = 0.04;
/// Factors by which the bases are tightened where they leave out too much.
const TIGHTNESS: [f64; 5] = [1.0, 2.5, 6.0, 15.0, 36.0];
/// Most that the bases may leave out of the columns that were solved for, in parts of the error.
const SEEN: f64 = 0.15;

type M3 = Matrix3<f64>;

/// A compressed compliance.
#[derive(Clone, Debug, PartialEq)]
pub struct Compressed {
    /// T of every leaf, row by row.
    pub frames: Vec<f64>,
    pub ranks: Vec<u32>,
    /// The bases, one after the other, and where each ends.
    pub bases: Vec<u8>,
    pub basis_ends: Vec<u64>,
    /// The blocks, one after the other, and where each ends.
    pub values: Vec<u8>,
    pub ends: Vec<u64>,
    /// Measured error, and the number of nodes at which it was measured.
    pub error: f64,
    pub measured: usize,
}

/// The reason why there is no compressed compliance.
#[derive(Debug)]
pub enum Trial {
    Build(BuildError),
    /// The least error that was found.
    Error(f64),
}

/// Builds, measures and rounds.
pub fn compress(of: &Surface<'_>, error: f64, progress: &dyn Progress) -> Result<Compressed, Trial> {
    let failed = |failed| Trial::Build(failed);
    give_back();
    let expected = machine::expect(WHAT, memory::of_bases(of));
    expected.map_err(|refused| failed(refused.into()))?;
    let exact = exact(of, progress).map_err(|solve| failed(solve.into()))?;
    let frames = frames(of, progress).map_err(|solve| failed(solve.into()))?;
    let (mut least, mut tried) = (f64::INFINITY, 0);
    while tried < TIGHTNESS.len() {
        let (at, bases) = fine_enough(of, &frames, &exact, error, tried, progress).map_err(failed)?;
        tried = at + 1;
        let built = build(of, frames.clone(), bases, progress).map_err(failed)?;
        match round(of, &built, &exact, error, progress) {
            Ok(compressed) => return Ok(compressed),
            Err(found) => least = least.min(found),
        }
        if tried < TIGHTNESS.len() {
            progress.tell(&format!(
                "compressed, a displacement is wrong by {least:.1e} of a pressed node's own: retrying with larger bases"
            ));
        }
    }
    Err(Trial::Error(least))
}

/// The first bases, from `first` of [`TIGHTNESS`] on, that leave out little enough of the columns that were solved for: else the
/// last ones; with their index in [`TIGHTNESS`].
fn fine_enough(
    of: &Surface<'_>,
    frames: &[Frame],
    exact: &Exact,
    error: f64,
    first: usize,
    progress: &dyn Progress,
) -> Result<(usize, Bases), BuildError> {
    let Surface { tree, blocks, .. } = *of;
    let samples = samples(of, frames, progress)?;
    let tolerances = tolerances(tree, blocks, frames);
    let mut shape = Shape {
        tree: tree.clone(),
        blocks: blocks.to_vec(),
        frames: frames.iter().map(|frame| frame.own).collect(),
        bases: Bases::default(),
    };
    let mut at = first;
    loop {
        let tolerance = of_clusters(of, &tolerances, LEFT_OUT * error / TIGHTNESS[at]);
        // Those before are not needed beside these.
        shape.bases = Bases::default();
        shape.bases = bases(tree, blocks, &samples, &tolerance)?;
        if at + 1 == TIGHTNESS.len() || exact.left_out(&shape) <= SEEN * error {
            return Ok((at, shape.bases));
        }
        at += 1;
    }
}

/// Tolerance of the bases of each cluster: the least of what all blocks with it, or with what it is a part of, allow.
fn of_clusters(of: &Surface<'_>, of_blocks: &[f64], by: f64) -> Vec<f64> {
    let Surface { tree, blocks, .. } = *of;
    let mut tolerance = vec![f64::INFINITY; tree.clusters.len()];
    for (block, own) in blocks.iter().zip(of_blocks).filter(|(block, _)| block.is_far) {
        block.of.into_iter().for_each(|cluster| tolerance[cluster] = tolerance[cluster].min(by * own));
    }
    for cluster in 0..tolerance.len() {
        let above = tree.clusters[cluster].parent.map_or(f64::INFINITY, |parent| tolerance[parent]);
        tolerance[cluster] = tolerance[cluster].min(above);
    }
    tolerance
}

/// Steps of everything.
struct Steps {
    /// Exponents of the powers of two in front of every basis' columns.
    exponents: Vec<Vec<i8>>,
    bases: Vec<f64>,
    blocks: Vec<f64>,
}

/// The numbers of the blocks that were built.
struct Numbers<'a> {
    built: &'a Built,
    tree: &'a Tree,
    blocks: &'a [Block],
    /// Place of each block among those near or far.
    at: Vec<usize>,
}

impl Numbers<'_> {
    fn new<'a>(of: &Surface<'a>, built: &'a Built) -> Numbers<'a> {
        let mut next = [0, 0];
        let place = |block: &Block| {
            let next = &mut next[usize::from(block.is_far)];
            *next += 1;
            *next - 1
        };
        let at = of.blocks.iter().map(place).collect();
        Numbers { built, tree: of.tree, blocks: of.blocks, at }
    }

    fn block(&self, block: usize) -> Mat<f64> {
        let at = self.at[block];
        if self.blocks[block].is_far {
            return self.built.far[at].clone();
        }
        let near = &self.built.near[at];
        Mat::from_fn(near.nrows(), near.ncols(), |i, j| f64::from(near[(i, j)]))
    }
}

/// The coarsest rounding with an error that is small enough; else the least error.
fn round(
    of: &Surface<'_>,
    built: &Built,
    exact: &Exact,
    asked: f64,
    progress: &dyn Progress,
) -> Result<Compressed, f64> {
    let numbers = Numbers::new(of, built);
    let unit = steps(&numbers);
    let mut shape = Shape {
        tree: of.tree.clone(),
        blocks: of.blocks.to_vec(),
        frames: built.frames.iter().map(|frame| frame.own).collect(),
        bases: built.bases.clone(),
    };
    progress.begin("rounding", 0);
    let mut trial = |by: f64| {
        shape.bases.of = (0..built.bases.of.len())
            .map(|cluster| rounded_basis(&built.bases, &unit, cluster, by))
            .collect();
        let block = |block: usize| rounded(numbers.block(block).as_ref(), by * unit.blocks[block]);
        exact.error(&shape, &block)
    };
    let mut by = FIRST * asked;
    let mut found = trial(by);
    let grow = if found <= AIM * asked { std::f64::consts::SQRT_2 } else { 0.5 };
    let mut best = (found <= AIM * asked).then_some((by, found));
    for _ in 0..TRIALS {
        if grow < 1.0 && best.is_some() {
            break;
        }
        by *= grow;
        let next = trial(by);
        if next <= AIM * asked {
            best = Some((by, next));
        } else if grow > 1.0 || next > 0.98 * found {
            found = found.min(next);
            break;
        }
        found = next;
    }
    progress.end();
    let Some((by, error)) = best else { return Err(found) };
    Ok(encoded(&numbers, &unit, by, error, exact.places.len()))
}

fn encoded(numbers: &Numbers<'_>, unit: &Steps, by: f64, error: f64, measured: usize) -> Compressed {
    let Numbers { built, tree, .. } = *numbers;
    let join = |parts: Vec<Vec<u8>>| {
        let mut end = 0;
        let ends = parts.iter().map(|part| {
            end += part.len() as u64;
            end
        });
        (ends.collect::<Vec<u64>>(), parts.concat())
    };
    let clusters = 0..built.bases.of.len();
    let bases: Vec<Vec<u8>> = clusters
        .into_par_iter()
        .map(|cluster| {
            let exponents = &unit.exponents[cluster];
            let scaled = scaled(built.bases.of[cluster].as_ref(), exponents, 1);
            let mut bytes: Vec<u8> = exponents.iter().map(|e| e.to_le_bytes()[0]).collect();
            bytes.extend(pack(scaled.as_ref(), by * unit.bases[cluster]));
            bytes
        })
        .collect();
    let blocks: Vec<Vec<u8>> = (0..numbers.blocks.len())
        .into_par_iter()
        .map(|block| pack(numbers.block(block).as_ref(), by * unit.blocks[block]))
        .collect();
    let ((basis_ends, bases), (ends, values)) = (join(bases), join(blocks));
    let frames = tree.leaves().flat_map(|leaf| {
        let own = built.frames[leaf].own;
        (0..9).map(move |i| own[(i / 3, i % 3)])
    });
    Compressed {
        frames: frames.collect(),
        ranks: built.bases.ranks.iter().map(|&rank| rank as u32).collect(),
        bases,
        basis_ends,
        values,
        ends,
        error,
        measured,
    }
}

/// Each column times a power of two.
fn scaled(matrix: MatRef<'_, f64>, exponents: &[i8], sign: i32) -> Mat<f64> {
    let factors: Vec<f64> = exponents.iter().map(|&e| 2f64.powi(sign * i32::from(e))).collect();
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, k| matrix[(i, k)] * factors[k])
}

fn rounded_basis(bases: &Bases, unit: &Steps, cluster: usize, by: f64) -> Mat<f64> {
    let scaled_up = scaled(bases.of[cluster].as_ref(), &unit.exponents[cluster], 1);
    let rounded = rounded(scaled_up.as_ref(), by * unit.bases[cluster]);
    scaled(rounded.as_ref(), &unit.exponents[cluster], -1)
}

/// The frames of all clusters from those of the leaves.
pub fn frames_of(tree: &Tree, numbers: &[f64]) -> Vec<M3> {
    let mut frames = vec![M3::zeros(); tree.clusters.len()];
    for (leaf, own) in tree.leaves().zip(numbers.chunks_exact(9)) {
        frames[leaf] = M3::from_row_slice(own);
    }
    frames
}

/// The bases from their bytes; `None` where these are not theirs.
pub fn unpack_bases(tree: &Tree, ranks: &[usize], bytes: &[u8], ends: &[u64]) -> Option<Bases> {
    let mut bases = Bases { of: Vec::new(), ranks: ranks.to_vec() };
    let mut start = 0;
    for (cluster, &end) in ends.iter().enumerate() {
        let end = usize::try_from(end).ok()?;
        let rows = Bases::rows(tree, ranks, cluster);
        let columns = if tree.clusters[cluster].children.is_some() { ranks[cluster] } else { rows };
        let (exponents, rest) = bytes.get(start..end)?.split_at_checked(columns)?;
        let exponents: Vec<i8> = exponents.iter().map(|&e| i8::from_le_bytes([e])).collect();
        bases.of.push(scaled(unpack(rest, rows, columns)?.as_ref(), &exponents, -1));
        start = end;
    }
    (start == bytes.len()).then_some(bases)
}

/// The steps for an error of 1: of a block by its tolerance and by how strongly a coefficient shows at one node; of a basis,
/// column by column, by the numbers that it stands before.
fn steps(all: &Numbers<'_>) -> Steps {
    let Numbers { built, tree, .. } = *all;
    let bases = &built.bases;
    let shows = shows(tree, bases);
    let step = |(block, tolerance): (&Block, &f64)| match (block.is_far, block.of) {
        (true, [a, b]) => tolerance / (shows[a] * shows[b]),
        (false, _) => *tolerance,
    };
    let blocks: Vec<f64> = all.blocks.iter().zip(&built.tolerances).map(step).collect();
    let mut finest = vec![f64::INFINITY; tree.clusters.len()];
    let mut before: Vec<Vec<f64>> = bases.of.iter().map(|basis| vec![0.0; basis.ncols()]).collect();
    for (block, step) in blocks.iter().enumerate() {
        let numbers = all.block(block);
        let [a, b] = all.blocks[block].of;
        for (cluster, numbers) in [(a, numbers.as_ref()), (b, numbers.transpose())] {
            finest[cluster] = finest[cluster].min(*step);
            for (i, before) in before[cluster].iter_mut().enumerate().take(numbers.nrows()) {
                *before = before.max(numbers.row(i).norm_l2() / (numbers.ncols().max(1) as f64).sqrt());
            }
        }
    }
    for cluster in 0..tree.clusters.len() {
        let Some(parent) = tree.clusters[cluster].parent else { continue };
        finest[cluster] = finest[cluster].min(finest[parent]);
        let Some(basis) = bases.of_part(tree, cluster) else { continue };
        for i in 0..basis.nrows() {
            let from: f64 = (0..basis.ncols()).map(|k| (basis[(i, k)] * before[parent][k]).powi(2)).sum();
            before[cluster][i] = before[cluster][i].max(from.sqrt());
        }
    }
    let exponent = |before: &f64| before.max(1e-30).log2().ceil().clamp(-100.0, 100.0) as i8;
    Steps {
        exponents: before.iter().map(|own| own.iter().map(exponent).collect()).collect(),
        bases: finest.iter().map(|step| FINER * if step.is_finite() { *step } else { 1.0 }).collect(),
        blocks,
    }
}

/// The largest displacement of a node's component by coefficients of size 1 of each cluster.
fn shows(tree: &Tree, bases: &Bases) -> Vec<f64> {
    let of_node = |node: usize| {
        let leaf = tree.leaf_of[node];
        let first = 3 * (node - tree.clusters[leaf].nodes.start);
        let mut rows = bases.of[leaf].as_ref().submatrix(first, 0, 3, bases.ranks[leaf]).to_owned();
        let mut found = Vec::new();
        for cluster in tree.path(node) {
            found.push((cluster, (0..3).map(|i| rows.row(i).norm_l2()).fold(0.0, f64::max)));
            if let Some(basis) = bases.of_part(tree, cluster) {
                rows = product(rows.as_ref(), basis);
            }
        }
        found
    };
    let all: Vec<_> = (0..tree.leaf_of.len()).into_par_iter().map(of_node).collect();
    let mut shows = vec![1e-3_f64; tree.clusters.len()];
    for (cluster, of_node) in all.into_iter().flatten() {
        shows[cluster] = shows[cluster].max(of_node);
    }
    shows
}
