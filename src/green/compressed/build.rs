//! The numbers of all blocks, from a factor: first the responses to random forces, then all columns, strip by strip.
//!
//! In: a factor, the nodes of the surface in the order of a [`Tree`], its blocks. Out: [`Built`]. No more of the inverse
//! than one [`Strip`], in the order of the tree, is ever in memory. All numbers refer to frames in which a force moves the
//! node under it by about 1, so that one tolerance suits bodies that are stiff in one place or along one axis, and soft
//! elsewhere:
//!
//! ```text
//! W = T⁻¹ (K⁻¹)ₛ T⁻¹      T² = (K⁻¹)_jj at one node j of each leaf
//! N_st = Σ Q_s[i]ᵀ W_ij Q_t[j] over all pairs of nodes i, j of the clusters s and t, with their bases Q
//! ```

use super::super::dense;
use super::basis::{Bases, WHAT, levels};
use super::memory;
use super::tree::{Block, Frame, Surface, TOGETHER, Tree, spans, unit_columns};
use crate::base::machine;
use crate::base::machine::TooLarge;
use crate::base::memory::give_back;
use crate::solve::{InverseStrip, Progress, SolveError};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use nalgebra::Matrix3;
use rayon::prelude::*;
use std::ops::Range;

type M3 = Matrix3<f64>;

/// All blocks, as exact as the bases are.
pub struct Built {
    /// Frame of every leaf; another cluster has that of its first one.
    pub frames: Vec<Frame>,
    pub bases: Bases,
    /// Numbers of the blocks in the bases of both clusters, in the order of the blocks.
    pub near: Vec<Mat<f32>>,
    pub far: Vec<Mat<f64>>,
    /// Tolerance of each block, for an error of 1 of a pressed node's own displacement.
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

/// Tolerance of each block: the part of the error that is allowed in it, for an error of 1 of a pressed node's own displacement.
pub fn tolerances(tree: &Tree, blocks: &[Block], frames: &[Frame]) -> Vec<f64> {
    let of_block = |block: &Block| {
        let spans = block.of.map(|cluster| spans(tree, frames, cluster));
        let (least, most) = (spans[0][0].min(spans[1][0]), spans[0][1].max(spans[1][1]));
        (least / most).sqrt()
    };
    blocks.iter().map(of_block).collect()
}

/// Builds all blocks in these bases.
pub fn build(
    of: &Surface<'_>,
    frames: Vec<Frame>,
    bases: Bases,
    progress: &dyn Progress,
) -> Result<Built, BuildError> {
    let Surface { tree, blocks, .. } = *of;
    give_back();
    machine::expect(WHAT, memory::of_blocks(of, &bases))?;
    let tolerances = tolerances(tree, blocks, &frames);
    let sides = |block: &Block| block.of.map(|cluster| bases.width(tree, cluster, block.is_far));
    let near = blocks.iter().filter(|block| !block.is_far).map(sides);
    let near = near.map(|[rows, columns]| Mat::zeros(rows, columns)).collect();
    let far = blocks.iter().filter(|block| block.is_far).map(sides);
    let far = far.map(|[rows, columns]| Mat::zeros(rows, columns)).collect();
    let mut built = Built { frames, bases, near, far, tolerances };
    let framed = built.framed(tree);
    let (levels, mut own) = (levels(tree), Strip::default());
    let mut add = |strip: &InverseStrip<'_>| {
        own.take(of.nodes.len(), strip);
        built.add(of, &levels, &framed, &own);
    };
    columns(of, &mut add, progress)?;
    built.turn(of);
    Ok(built)
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

fn product(out: MatMut<'_, f64>, accumulate: Accum, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(out, accumulate, a, b, 1.0, Par::Seq);
}

impl Built {
    /// T⁻¹ Q of every leaf: the fields that are seen from afar.
    fn framed(&self, tree: &Tree) -> Vec<Mat<f64>> {
        let of_cluster = |cluster: usize| {
            let basis = self.bases.of[cluster].as_ref().subcols(0, self.bases.ranks[cluster]);
            if tree.clusters[cluster].children.is_some() {
                return Mat::new();
            }
            let inverse = self.frames[cluster].inverse;
            Mat::from_fn(basis.nrows(), basis.ncols(), |i, k| {
                (0..3).map(|axis| inverse[(i % 3, axis)] * basis[(i - i % 3 + axis, k)]).sum()
            })
        };
        (0..tree.clusters.len()).map(of_cluster).collect()
    }

    /// Adds what a strip has to all blocks; those near are in the nodes' own components yet.
    fn add(&mut self, of: &Surface<'_>, levels: &[Vec<usize>], framed: &[Mat<f64>], strip: &Strip) {
        let Surface { tree, blocks, .. } = *of;
        let nodes = |cluster: usize| &tree.clusters[cluster].nodes;
        let within: Vec<Range<usize>> =
            tree.clusters.iter().map(|cluster| strip.within(&cluster.nodes)).collect();
        let has_rows = strip.has_rows(tree);

        let frames = &self.frames;
        let near = blocks.iter().filter(|block| !block.is_far).collect::<Vec<_>>();
        self.near.par_iter_mut().zip(near).for_each(|(numbers, Block { of: [a, b], .. })| {
            let [first_a, first_b] = [*a, *b].map(|cluster| nodes(cluster).start);
            let [of_a, of_b] = [*a, *b].map(|cluster| frames[cluster].inverse);
            for place in within[*b].clone().take_while(|_| has_rows[*a]) {
                let from = strip.part(nodes(*a), &(place..place + 1));
                let column = 3 * (strip.nodes[place] - first_b);
                for row in (0..from.nrows()).step_by(3) {
                    let entry = of_a * M3::from_fn(|axis, force| from[(row + axis, force)]) * of_b;
                    (0..9).for_each(|k| numbers[(row + k % 3, column + k / 3)] += entry[k] as f32);
                }
            }
            for place in within[*a].clone().take_while(|_| has_rows[*b]) {
                let from = strip.part(nodes(*b), &(place..place + 1));
                let row = 3 * (strip.nodes[place] - first_a);
                // The pair of a node with itself is there already.
                for column in (0..from.nrows()).step_by(3).filter(|&column| a != b || column != row) {
                    let entry = of_b * M3::from_fn(|axis, force| from[(column + axis, force)]) * of_a;
                    (0..9).for_each(|k| numbers[(row + k / 3, column + k % 3)] += entry[k] as f32);
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
                let width = if has_rows[cluster] { 3 * strip.nodes.len() } else { 0 };
                let (mut to, mut at) = (Mat::zeros(rank, width), Mat::zeros(3 * within[cluster].len(), rank));
                match tree.clusters[cluster].children {
                    None => {
                        let basis = framed[cluster].as_ref();
                        if has_rows[cluster] {
                            let all = strip.part(nodes(cluster), &(0..strip.nodes.len()));
                            product(to.as_mut(), Accum::Replace, basis.transpose(), all);
                        }
                        for (i, place) in within[cluster].clone().enumerate() {
                            let node = strip.nodes[place] - nodes(cluster).start;
                            at.as_mut().subrows_mut(3 * i, 3).copy_from(basis.subrows(3 * node, 3));
                        }
                    }
                    Some(parts) => {
                        let mut row = 0;
                        for part in parts {
                            let Some(basis) = bases.of_part(tree, part) else { continue };
                            if has_rows[part] {
                                product(to.as_mut(), Accum::Add, basis.transpose(), rows[part].as_ref());
                            }
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
            if has_rows[*a] && !within[*b].is_empty() {
                product(numbers.as_mut(), Accum::Add, of_columns(*a, *b), own[*b].as_ref());
            }
            if has_rows[*b] && !within[*a].is_empty() {
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
            let turned = dense::product(dense::product(a.transpose(), wide.as_ref()).as_ref(), b);
            *numbers = Mat::from_fn(turned.nrows(), turned.ncols(), |i, j| turned[(i, j)] as f32);
        });
    }
}

/// A strip in the order of the tree: the columns of some nodes over all nodes, each pair of nodes once.
#[derive(Default)]
pub struct Strip {
    /// Ascending.
    pub nodes: Vec<usize>,
    /// Whether a node has rows.
    rows: Vec<bool>,
    /// Column after column over all components; 0 where it has nothing.
    values: Vec<f64>,
    size: usize,
}

impl Strip {
    /// Takes the place of the last one.
    pub fn take(&mut self, all: usize, strip: &InverseStrip<'_>) {
        self.size = 3 * all;
        let mut from: Vec<usize> = (0..strip.columns.len()).collect();
        from.sort_unstable_by_key(|&c| strip.columns[c]);
        self.nodes = from.iter().map(|&c| strip.columns[c] as usize).collect();
        self.rows = vec![false; all];
        strip.rows.iter().for_each(|&row| self.rows[row as usize] = true);
        self.values.resize(3 * self.size * self.nodes.len(), 0.0);
        let (size, nodes) = (self.size, &self.nodes);
        self.values.par_chunks_mut(3 * size).zip(&from).for_each(|(out, &c)| {
            out.fill(0.0);
            let j = strip.columns[c] as usize;
            let height = 3 * strip.rows.len();
            let own = &strip.values[3 * c * height..][..3 * height];
            for (out, own) in out.chunks_exact_mut(size).zip(own.chunks_exact(height)) {
                for (three, &i) in own.as_chunks::<3>().0.iter().zip(strip.rows) {
                    out[3 * i as usize..][..3].copy_from_slice(three);
                }
                // Both (i, j) and (j, i) stand here: the one with the lower row is taken.
                nodes.iter().take_while(|&&i| i < j).for_each(|&i| out[3 * i..][..3].fill(0.0));
            }
        });
    }

    /// Whether there are rows of each cluster.
    pub fn has_rows(&self, tree: &Tree) -> Vec<bool> {
        tree.clusters.iter().map(|cluster| self.rows[cluster.nodes.clone()].contains(&true)).collect()
    }

    /// The places in the strip of the nodes of a cluster.
    pub fn within(&self, nodes: &Range<usize>) -> Range<usize> {
        let place = |node: usize| self.nodes.partition_point(|&own| own < node);
        place(nodes.start)..place(nodes.end)
    }

    fn matrix(&self) -> MatRef<'_, f64> {
        MatRef::from_column_major_slice(&self.values, self.size, 3 * self.nodes.len())
    }

    pub fn part(&self, rows: &Range<usize>, columns: &Range<usize>) -> MatRef<'_, f64> {
        let own = self.matrix().subcols(3 * columns.start, 3 * columns.len());
        own.subrows(3 * rows.start, 3 * rows.len())
    }
}
