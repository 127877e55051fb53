//! The numbers of all blocks, from a factor: first of what forces do at random, then of all columns, strip by strip.
//!
//! In: a factor, the nodes of the surface in the order of a [`Tree`], its blocks. Out: [`Built`]. No more of the inverse than a
//! strip is ever in memory. All is counted in frames that make a node yield by about 1 to a force on itself, so that one
//! tolerance suits bodies that are stiff here or along one axis, and soft elsewhere:
//!
//! ```text
//! W = T⁻¹ (K⁻¹)ₛ T⁻¹      T² = (K⁻¹)_jj at one node j of each leaf
//! N_st = Σ Q_s[i]ᵀ W_ij Q_t[j] over all pairs of nodes i, j of the clusters s and t, with their bases Q
//! ```

use super::basis::{Bases, Samples, bases, levels};
use super::tree::{Block, Tree};
use crate::base::machine::{self, TooLarge};
use crate::fem::NodeFields;
use crate::solve::{Factor, InverseStrip, Progress, SolveError};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;
use std::ops::Range;

/// Samples of random forces, of all and for each leaf at most.
const SAMPLES: usize = 1536;
const SAMPLES_OF_LEAF: usize = 24;
/// Columns that are solved for together.
const TOGETHER: usize = 48;
/// What the bases leave out, in parts of the error that is asked for.
const LEFT_OUT: f64 = 0.04;

type M3 = Matrix3<f64>;

/// Where a surface is compressed.
pub struct Surface<'a> {
    pub factor: &'a dyn Factor,
    /// The nodes of A, in the order of the tree; those in front take forces.
    pub nodes: &'a [u32],
    pub n: usize,
    pub tree: &'a Tree,
    pub blocks: &'a [Block],
}

/// A symmetric frame T, and its inverse.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    pub own: M3,
    pub inverse: M3,
    /// The least and the largest stretch of T².
    pub yields: [f64; 2],
}

/// All blocks, as exact as the bases are.
pub struct Built {
    /// Of every leaf; of other clusters that of their first one.
    pub frames: Vec<Frame>,
    pub bases: Bases,
    /// In the order of the blocks: in the bases of both clusters.
    pub near: Vec<Mat<f32>>,
    pub far: Vec<Mat<f64>>,
    /// What of the error is allowed in a block, for an error of 1 of a pressed node's own displacement.
    pub tolerances: Vec<f64>,
}

#[derive(Debug)]
pub enum BuildError {
    Solve(SolveError),
    Memory(TooLarge),
}

impl From<SolveError> for BuildError {
    fn from(error: SolveError) -> BuildError {
        BuildError::Solve(error)
    }
}

impl From<TooLarge> for BuildError {
    fn from(error: TooLarge) -> BuildError {
        BuildError::Memory(error)
    }
}

impl Frame {
    fn of(compliance: &M3) -> Frame {
        let eigen = SymmetricEigen::new((compliance + compliance.transpose()) * 0.5);
        let largest = eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
        let values = eigen.eigenvalues.map(|value| value.max(1e-9 * largest));
        let made = |of: fn(f64) -> f64| {
            eigen.eigenvectors * M3::from_diagonal(&values.map(of)) * eigen.eigenvectors.transpose()
        };
        Frame {
            own: made(f64::sqrt),
            inverse: made(|value| 1.0 / value.sqrt()),
            yields: [values.min(), values.max()],
        }
    }
}

/// What is needed while it is built beside the blocks far away, whose size is known later, bytes.
fn memory(tree: &Tree, blocks: &[Block]) -> f64 {
    let near = blocks.iter().filter(|block| !block.is_far);
    let near: f64 = near.map(|block| block.of.map(|c| tree.size(c) as f64).iter().product::<f64>()).sum();
    let size = 3.0 * tree.leaf_of.len() as f64;
    let leaves: f64 = tree.leaves().map(|leaf| (tree.size(leaf) as f64).powi(2)).sum();
    // Near blocks; samples and their projections; strips as they are solved and as they are spread; bases twice.
    let strips = 6.0 * 8.0 * 3.0 * 32.0 * size;
    4.0 * near + 1.5 * 4.0 * size * samples_of(tree) as f64 + strips + 16.0 * leaves
}

fn samples_of(tree: &Tree) -> usize {
    (SAMPLES_OF_LEAF * tree.leaves().count()).min(SAMPLES)
}

/// Builds all blocks; `tightness` divides what the bases leave out.
pub fn build(
    of: &Surface<'_>,
    error: f64,
    tightness: f64,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    let Surface { tree, blocks, .. } = *of;
    let what = "the compressed compliance of the surface";
    machine::expect(what, memory(tree, blocks))?;
    let frames = frames(of, progress)?;
    let tolerances: Vec<f64> = blocks
        .iter()
        .map(|block| {
            let spans = block.of.map(|cluster| spans(tree, &frames, cluster));
            let (least, most) = (spans[0][0].min(spans[1][0]), spans[0][1].max(spans[1][1]));
            (least / most).sqrt()
        })
        .collect();
    let mut tolerance = vec![f64::INFINITY; tree.clusters.len()];
    for (block, own) in blocks.iter().zip(&tolerances).filter(|(block, _)| block.is_far) {
        block.of.into_iter().for_each(|cluster| tolerance[cluster] = tolerance[cluster].min(*own));
    }
    for cluster in 0..tolerance.len() {
        let above = tree.clusters[cluster].parent.map_or(f64::INFINITY, |parent| tolerance[parent]);
        tolerance[cluster] = tolerance[cluster].min(above);
    }
    tolerance.iter_mut().for_each(|own| *own *= LEFT_OUT * error / tightness);
    let bases = bases(tree, blocks, &samples(of, &frames, progress)?, &tolerance);
    let width = |cluster: usize| bases.ranks[cluster] as f64;
    let far = blocks.iter().filter(|block| block.is_far).map(|block| width(block.of[0]) * width(block.of[1]));
    machine::expect(what, 8.0 * far.sum::<f64>())?;
    let sides = |block: &Block| block.of.map(|cluster| bases.width(tree, cluster, block.is_far));
    let near = blocks.iter().filter(|block| !block.is_far).map(sides);
    let near = near.map(|[rows, columns]| Mat::zeros(rows, columns)).collect();
    let far = blocks.iter().filter(|block| block.is_far).map(sides);
    let far = far.map(|[rows, columns]| Mat::zeros(rows, columns)).collect();
    let mut built = Built { frames, bases, near, far, tolerances };
    let levels = levels(tree);
    columns(of, &mut |strip| built.add(of, &levels, strip), progress)?;
    built.turn(of);
    Ok(built)
}

/// The least and the largest yield of a cluster.
fn spans(tree: &Tree, frames: &[Frame], cluster: usize) -> [f64; 2] {
    let nodes = &tree.clusters[cluster].nodes;
    let own = tree.leaf_of[nodes.clone()].iter().map(|&leaf| frames[leaf].yields);
    own.fold([f64::INFINITY, 0.0], |all, own| [all[0].min(own[0]), all[1].max(own[1])])
}

/// The frame of each leaf, from how a node in its middle yields.
fn frames(of: &Surface<'_>, progress: &dyn Progress) -> Result<Vec<Frame>, SolveError> {
    let tree = of.tree;
    let nothing = Frame { own: M3::identity(), inverse: M3::identity(), yields: [1.0; 2] };
    let mut frames = vec![nothing; tree.clusters.len()];
    let leaves: Vec<usize> = tree.leaves().collect();
    progress.begin("how the surface yields", leaves.len() as u64);
    for chunk in leaves.chunks(TOGETHER / 3) {
        let middle = |&leaf: &usize| {
            let nodes = &tree.clusters[leaf].nodes;
            of.nodes[nodes.start + nodes.len() / 2]
        };
        let nodes: Vec<u32> = chunk.iter().map(middle).collect();
        let mut unit = NodeFields::zeros(nodes.len(), 3 * nodes.len());
        (0..3 * nodes.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
        let x = of.factor.solve_at(&nodes, &unit, &nodes)?;
        for (i, &leaf) in chunk.iter().enumerate() {
            frames[leaf] = Frame::of(&M3::from_fn(|axis, force| x.row(3 * i + axis)[3 * i + force]));
        }
        progress.advance(chunk.len() as u64);
    }
    progress.end();
    for cluster in (0..tree.clusters.len()).rev() {
        if let Some([first, _]) = tree.clusters[cluster].children {
            frames[cluster] = frames[first];
        }
    }
    Ok(frames)
}

/// A pseudo-random number of variance 1 about 0, the same on every machine (S. Vigna's splitmix64).
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let unit = ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53);
    12f64.sqrt() * (unit - 0.5)
}

/// Some of so many, different ones, from `count` on the first.
pub fn some(all: usize, count: usize, seed: u64) -> Vec<usize> {
    let mut state = seed;
    let mut numbers: Vec<(f64, usize)> = (0..all).map(|i| (random(&mut state), i)).collect();
    numbers.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut chosen: Vec<usize> = numbers.into_iter().take(count).map(|(_, i)| i).collect();
    chosen.sort_unstable();
    chosen
}

/// What random forces do to the whole surface. Every second sample has them on one leaf, for clusters that are far from few
/// leaves; the others on 2, 4, 8 and so on, which tell the more, the more leaves are far.
fn samples(of: &Surface<'_>, frames: &[Frame], progress: &dyn Progress) -> Result<Samples, SolveError> {
    let tree = of.tree;
    let leaves: Vec<usize> = tree.leaves().collect();
    let count = samples_of(tree);
    let classes = (leaves.len() / 8).checked_ilog2().unwrap_or(0) as usize;
    let on = |sample: usize| -> Vec<usize> {
        if sample.is_multiple_of(2) || classes == 0 {
            return vec![leaves[sample * leaves.len() / count]];
        }
        let how_many = 2 << (sample / 2 % classes);
        some(leaves.len(), how_many, sample as u64).into_iter().map(|i| leaves[i]).collect()
    };
    let size = 3 * of.nodes.len();
    let mut samples = Samples { leaves: (0..count).map(on).collect(), values: vec![0.0; size * count] };
    let mut state = 1;
    progress.begin("samples of the surface", count as u64);
    for (chunk, out) in samples.leaves.chunks(TOGETHER).zip(samples.values.chunks_mut(TOGETHER * size)) {
        let mut loaded: Vec<usize> = chunk.concat();
        loaded.sort_unstable();
        loaded.dedup();
        let places: Vec<usize> = loaded.iter().flat_map(|&leaf| tree.clusters[leaf].nodes.clone()).collect();
        let mut forces = NodeFields::zeros(places.len(), chunk.len());
        for (column, on) in chunk.iter().enumerate() {
            for (i, &place) in places.iter().enumerate() {
                let leaf = tree.leaf_of[place];
                if on.contains(&leaf) {
                    let force = nalgebra::Vector3::from_fn(|_, _| random(&mut state));
                    let force = frames[leaf].inverse * force;
                    (0..3).for_each(|axis| forces.row_mut(3 * i + axis)[column] = force[axis]);
                }
            }
        }
        let nodes: Vec<u32> = places.iter().map(|&place| of.nodes[place]).collect();
        let x = of.factor.solve_at(&nodes, &forces, of.nodes)?;
        out.par_chunks_mut(size).enumerate().for_each(|(column, out)| {
            for (place, out) in out.chunks_exact_mut(3).enumerate() {
                let moved = nalgebra::Vector3::from_fn(|axis, _| x.row(3 * place + axis)[column]);
                let moved = frames[tree.leaf_of[place]].inverse * moved;
                out.iter_mut().zip(&moved).for_each(|(out, moved)| *out = *moved as f32);
            }
        });
        progress.advance(chunk.len() as u64);
    }
    progress.end();
    Ok(samples)
}

/// All strips of the inverse: of all nodes, or of those in front.
fn columns(
    of: &Surface<'_>,
    take: &mut dyn FnMut(&InverseStrip<'_>),
    progress: &dyn Progress,
) -> Result<(), SolveError> {
    if of.n == of.nodes.len() {
        return of.factor.inverse_block(of.nodes, take, progress);
    }
    let places: Vec<u32> = (0..of.nodes.len() as u32).collect();
    progress.begin("compliance of the surface", of.n as u64);
    for first in (0..of.n).step_by(TOGETHER / 3) {
        let own = first..(first + TOGETHER / 3).min(of.n);
        let x = unit_columns(of, &own.clone().collect::<Vec<_>>(), first)?;
        let column = |c: usize| x.data.iter().skip(c).step_by(x.columns);
        let values: Vec<f64> = (0..x.columns).flat_map(column).copied().collect();
        take(&InverseStrip { rows: &places[first..], columns: &places[own.clone()], values: &values });
        progress.advance(own.len() as u64);
    }
    progress.end();
    Ok(())
}

/// What unit forces at these places do from a place on.
pub fn unit_columns(of: &Surface<'_>, places: &[usize], from: usize) -> Result<NodeFields, SolveError> {
    let nodes: Vec<u32> = places.iter().map(|&place| of.nodes[place]).collect();
    let mut unit = NodeFields::zeros(nodes.len(), 3 * nodes.len());
    (0..3 * nodes.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
    of.factor.solve_at(&nodes, &unit, &of.nodes[from..])
}

/// A strip in the frames: the columns of some nodes over all nodes, each pair of nodes once.
struct Strip {
    /// Ascending.
    nodes: Vec<usize>,
    /// Column after column over all components; 0 where it has nothing.
    values: Vec<f64>,
    size: usize,
}

impl Strip {
    fn of(all: usize, frames: &[Frame], leaf_of: &[usize], strip: &InverseStrip<'_>) -> Strip {
        let size = 3 * all;
        let mut from: Vec<usize> = (0..strip.columns.len()).collect();
        from.sort_unstable_by_key(|&c| strip.columns[c]);
        let nodes: Vec<usize> = from.iter().map(|&c| strip.columns[c] as usize).collect();
        let mut values = vec![0.0; 3 * size * nodes.len()];
        values.par_chunks_mut(3 * size).zip(&from).for_each(|(out, &c)| {
            let j = strip.columns[c] as usize;
            let height = 3 * strip.rows.len();
            let own = &strip.values[3 * c * height..][..3 * height];
            for (row, &i) in strip.rows.iter().enumerate() {
                let i = i as usize;
                // Both (i, j) and (j, i) stand here: the one with the lower row is taken.
                if i < j && nodes.binary_search(&i).is_ok() {
                    continue;
                }
                let entry = M3::from_fn(|axis, force| own[force * height + 3 * row + axis]);
                let entry = frames[leaf_of[i]].inverse * entry * frames[leaf_of[j]].inverse;
                for force in 0..3 {
                    let to = &mut out[force * size + 3 * i..][..3];
                    to.copy_from_slice(entry.column(force).as_slice());
                }
            }
        });
        Strip { nodes, values, size }
    }

    /// The places in the strip of the nodes of a cluster.
    fn within(&self, nodes: &Range<usize>) -> Range<usize> {
        let place = |node: usize| self.nodes.partition_point(|&own| own < node);
        place(nodes.start)..place(nodes.end)
    }

    fn matrix(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.size, 3 * self.nodes.len())
    }

    fn part(&self, rows: &Range<usize>, columns: &Range<usize>) -> MatRef<'_, f64> {
        let own = self.matrix().subcols(3 * columns.start, 3 * columns.len());
        own.subrows(3 * rows.start, 3 * rows.len())
    }
}

fn product(out: MatMut<'_, f64>, accumulate: Accum, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(out, accumulate, a, b, 1.0, Par::Seq);
}

impl Built {
    /// Adds what a strip has to all blocks; those near are in the nodes' own components yet.
    fn add(&mut self, of: &Surface<'_>, levels: &[Vec<usize>], strip: &InverseStrip<'_>) {
        let Surface { tree, blocks, .. } = *of;
        let strip = Strip::of(of.nodes.len(), &self.frames, &tree.leaf_of, strip);
        let nodes = |cluster: usize| &tree.clusters[cluster].nodes;
        let within: Vec<Range<usize>> =
            tree.clusters.iter().map(|cluster| strip.within(&cluster.nodes)).collect();

        let near = blocks.iter().filter(|block| !block.is_far).collect::<Vec<_>>();
        self.near.par_iter_mut().zip(near).for_each(|(numbers, Block { of: [a, b], .. })| {
            let [first_a, first_b] = [*a, *b].map(|cluster| nodes(cluster).start);
            for place in within[*b].clone() {
                let from = strip.part(nodes(*a), &(place..place + 1));
                let column = 3 * (strip.nodes[place] - first_b);
                for (force, i) in (0..3).flat_map(|force| (0..from.nrows()).map(move |i| (force, i))) {
                    numbers[(i, column + force)] += from[(i, force)] as f32;
                }
            }
            for place in within[*a].clone() {
                let from = strip.part(nodes(*b), &(place..place + 1));
                let row = 3 * (strip.nodes[place] - first_a);
                for (force, j) in (0..3).flat_map(|force| (0..from.nrows()).map(move |j| (force, j))) {
                    // The pair of a node with itself is there already.
                    if a != b || !(row..row + 3).contains(&j) {
                        numbers[(row + force, j)] += from[(j, force)] as f32;
                    }
                }
            }
        });

        // Of each cluster: its rows in its basis, and the basis at the strip's own nodes.
        let bases = &self.bases;
        let mut rows: Vec<Mat<f64>> = vec![Mat::new(); tree.clusters.len()];
        let mut own: Vec<Mat<f64>> = vec![Mat::new(); tree.clusters.len()];
        for level in levels.iter().rev() {
            let of_cluster = |&cluster: &usize| {
                let rank = bases.ranks[cluster];
                let width = 3 * strip.nodes.len();
                let (mut to, mut at) = (Mat::zeros(rank, width), Mat::zeros(3 * within[cluster].len(), rank));
                match tree.clusters[cluster].children {
                    None => {
                        let basis = bases.of[cluster].as_ref().subcols(0, rank);
                        let all = strip.part(nodes(cluster), &(0..strip.nodes.len()));
                        product(to.as_mut(), Accum::Replace, basis.transpose(), all);
                        for (i, place) in within[cluster].clone().enumerate() {
                            let node = strip.nodes[place] - nodes(cluster).start;
                            at.as_mut().subrows_mut(3 * i, 3).copy_from(basis.subrows(3 * node, 3));
                        }
                    }
                    Some(parts) => {
                        let mut row = 0;
                        for part in parts {
                            let Some(basis) = bases.of_part(tree, part) else { continue };
                            product(to.as_mut(), Accum::Add, basis.transpose(), rows[part].as_ref());
                            let count = own[part].nrows();
                            let into = at.as_mut().subrows_mut(row, count);
                            product(into, Accum::Replace, own[part].as_ref(), basis);
                            row += count;
                        }
                    }
                }
                (to, at)
            };
            let made: Vec<_> = level.par_iter().map(of_cluster).collect();
            for (&cluster, made) in level.iter().zip(made) {
                (rows[cluster], own[cluster]) = made;
            }
        }
        let far = blocks.iter().filter(|block| block.is_far).collect::<Vec<_>>();
        self.far.par_iter_mut().zip(far).for_each(|(numbers, Block { of: [a, b], .. })| {
            let of_columns = |matrix: usize, cluster: usize| {
                let columns = &within[cluster];
                rows[matrix].as_ref().subcols(3 * columns.start, 3 * columns.len())
            };
            if !within[*b].is_empty() {
                product(numbers.as_mut(), Accum::Add, of_columns(*a, *b), own[*b].as_ref());
            }
            if !within[*a].is_empty() {
                let turned = of_columns(*b, *a).transpose();
                product(numbers.as_mut(), Accum::Add, own[*a].transpose(), turned);
            }
        });
    }

    /// Brings the near blocks into the bases of their leaves.
    fn turn(&mut self, of: &Surface<'_>) {
        let bases = &self.bases;
        let near = of.blocks.iter().filter(|block| !block.is_far).collect::<Vec<_>>();
        self.near.par_iter_mut().zip(near).for_each(|(numbers, block)| {
            let [a, b] = block.of.map(|cluster| bases.of[cluster].as_ref());
            let wide = Mat::from_fn(numbers.nrows(), numbers.ncols(), |i, j| f64::from(numbers[(i, j)]));
            let turned = a.transpose() * wide * b;
            *numbers = Mat::from_fn(turned.nrows(), turned.ncols(), |i, j| turned[(i, j)] as f32);
        });
    }
}
