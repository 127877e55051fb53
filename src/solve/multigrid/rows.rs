//! Symmetric matrices of B × B blocks by their rows: those that a level is built from in f64, and those that are smoothed
//! with in f32.

use super::cluster::{self, Clusters};
use crate::fem::StiffnessMatrix;
use nalgebra::{DMatrix, Matrix3};
use rayon::prelude::*;
use std::ops::Range;

/// A block, row by row.
pub type Block<const B: usize> = [[f64; B]; B];

/// Rows of a symmetric matrix.
pub trait Rows<const B: usize>: Sync {
    fn nodes(&self) -> usize;

    fn diagonal(&self, node: usize) -> Block<B>;

    /// Calls `each` with every neighbour of `node` and the block A_(node, neighbour), without the diagonal.
    fn each(&self, node: usize, each: impl FnMut(usize, &Block<B>));
}

/// A stiffness matrix in parts of `unit`, so that its numbers are near 1, in an order of its own.
pub struct Scaled<'a> {
    pub matrix: &'a StiffnessMatrix,
    /// The matrix' node at each place, and the place of each of its nodes.
    pub order: Vec<u32>,
    place: Vec<u32>,
    /// 1 over the mean of the diagonal.
    pub scale: f64,
}

impl<'a> Scaled<'a> {
    pub fn new(matrix: &'a StiffnessMatrix) -> Scaled<'a> {
        let sum: f64 = matrix.diagonal.iter().map(Matrix3::trace).sum();
        let order: Vec<u32> = (0..matrix.nodes() as u32).collect();
        Scaled { matrix, place: order.clone(), order, scale: 3.0 * matrix.nodes() as f64 / sum }
    }

    /// Of the diagonal's blocks; errors with the node whose block is not positive definite.
    pub fn inverses(&self) -> Result<Vec<Block<3>>, usize> {
        let inverse = |node: usize| inverse(&self.diagonal(node)).ok_or(node);
        (0..self.nodes()).into_par_iter().with_min_len(512).map(inverse).collect()
    }

    /// With node `order[i]` at place i.
    pub fn reorder(&mut self, order: Vec<u32>) {
        for (place, &node) in order.iter().enumerate() {
            self.place[node as usize] = place as u32;
        }
        self.order = order;
    }

    /// The place of each of the matrix' nodes, where the order is not theirs.
    pub fn into_places(self) -> Option<[Vec<u32>; 2]> {
        let is_moved = self.order.iter().enumerate().any(|(place, &node)| place != node as usize);
        is_moved.then_some([self.order, self.place])
    }

    #[inline(always)]
    fn block(&self, block: &Matrix3<f64>, is_transposed: bool) -> Block<3> {
        let of = |r: usize, c: usize| self.scale * if is_transposed { block[(c, r)] } else { block[(r, c)] };
        std::array::from_fn(|r| std::array::from_fn(|c| of(r, c)))
    }
}

impl Rows<3> for Scaled<'_> {
    fn nodes(&self) -> usize {
        self.matrix.nodes()
    }

    fn diagonal(&self, node: usize) -> Block<3> {
        self.block(&self.matrix.diagonal[self.order[node] as usize], false)
    }

    #[inline(always)]
    fn each(&self, node: usize, mut each: impl FnMut(usize, &Block<3>)) {
        for (other, edge, is_transposed) in self.matrix.neighbours(self.order[node] as usize) {
            each(self.place[other] as usize, &self.block(&self.matrix.blocks[edge], is_transposed));
        }
    }
}

/// A matrix of a coarse level while the next one is built.
pub struct CoarseRows {
    pub diagonal: Vec<Block<6>>,
    /// Neighbours of node i: `start[i]..start[i + 1]`, ascending.
    pub start: Vec<usize>,
    pub column: Vec<u32>,
    pub block: Vec<Block<6>>,
}

impl CoarseRows {
    /// Numbers that one pass reads.
    pub fn numbers(&self) -> usize {
        36 * (self.diagonal.len() + self.block.len())
    }
}

impl Rows<6> for CoarseRows {
    fn nodes(&self) -> usize {
        self.diagonal.len()
    }

    fn diagonal(&self, node: usize) -> Block<6> {
        self.diagonal[node]
    }

    #[inline(always)]
    fn each(&self, node: usize, mut each: impl FnMut(usize, &Block<6>)) {
        for at in self.start[node]..self.start[node + 1] {
            each(self.column[at] as usize, &self.block[at]);
        }
    }
}

/// The matrix that a level is smoothed with, f32, both triangles, the diagonal with the rest.
pub struct Smoothed<const B: usize> {
    /// Blocks of node i: `start[i]..start[i + 1]`.
    pub start: Vec<usize>,
    pub column: Vec<u32>,
    /// B² numbers a block, column by column.
    pub value: Vec<f32>,
    /// Nodes of cluster c: `clusters[c]..clusters[c + 1]`.
    pub clusters: Vec<u32>,
    /// Inverses of the clusters' blocks, column by column, one after the other.
    pub inverse: Vec<f32>,
    /// What is worked on together.
    pub parts: Vec<Part>,
}

/// Whole clusters, of about [`PART`] nodes, and where their inverses begin.
pub struct Part {
    pub clusters: Range<usize>,
    pub nodes: Range<usize>,
    pub inverse: usize,
}

fn parts_of<const B: usize>(clusters: &Clusters) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut inverse = 0;
    for cluster in 0..clusters.count() {
        let nodes = clusters.members(cluster);
        match parts.last_mut() {
            Some(part) if nodes.end - part.nodes.start <= PART => {
                part.clusters.end = cluster + 1;
                part.nodes.end = nodes.end;
            }
            _ => parts.push(Part { clusters: cluster..cluster + 1, nodes: nodes.clone(), inverse }),
        }
        inverse += (B * nodes.len()).pow(2);
    }
    parts
}

impl<const B: usize> Smoothed<B> {
    /// Of `rows`; errors with a node of a cluster whose block is not positive definite.
    pub fn new(rows: &impl Rows<B>, clusters: &Clusters) -> Result<Smoothed<B>, usize> {
        let nodes = rows.nodes();
        let mut start = vec![0; nodes + 1];
        start[1..].par_iter_mut().enumerate().with_min_len(512).for_each(|(node, count)| {
            *count = 1;
            rows.each(node, |_, _| *count += 1);
        });
        for node in 0..nodes {
            start[node + 1] += start[node];
        }
        let blocks = start[nodes];
        let (mut column, mut value) = (vec![0; blocks], vec![0.0; B * B * blocks]);
        let mut parts = Vec::with_capacity(nodes.div_ceil(PART));
        let (mut columns, mut values) = (column.as_mut_slice(), value.as_mut_slice());
        for first in (0..nodes).step_by(PART) {
            let count = start[(first + PART).min(nodes)] - start[first];
            let (own, rest) = columns.split_at_mut(count);
            let (own_values, rest_values) = values.split_at_mut(B * B * count);
            (columns, values) = (rest, rest_values);
            parts.push((first, own, own_values));
        }
        parts.into_par_iter().for_each(|(first, columns, values)| {
            let mut slots = columns.iter_mut().zip(values.chunks_exact_mut(B * B));
            let mut put = |other: usize, block: &Block<B>| {
                if let Some((column, value)) = slots.next() {
                    *column = other as u32;
                    for c in 0..B {
                        for r in 0..B {
                            value[c * B + r] = block[r][c] as f32;
                        }
                    }
                }
            };
            for node in first..(first + PART).min(nodes) {
                put(node, &rows.diagonal(node));
                rows.each(node, &mut put);
            }
        });
        let inverse: Vec<f32> = (0..clusters.count())
            .into_par_iter()
            .with_min_len(512)
            .map(|cluster| {
                let members = clusters.members(cluster);
                let first = members.start;
                let inverse = cluster::inverse(rows, members).ok_or(first)?;
                Ok(inverse.iter().map(|value| *value as f32).collect::<Vec<_>>())
            })
            .collect::<Result<Vec<_>, usize>>()?
            .concat();
        Ok(Smoothed {
            start,
            column,
            value,
            clusters: clusters.start.clone(),
            inverse,
            parts: parts_of::<B>(clusters),
        })
    }

    pub fn nodes(&self) -> usize {
        self.start.len() - 1
    }

    /// Numbers that one pass reads.
    pub fn numbers(&self) -> usize {
        self.value.len()
    }
}

/// Nodes that one thread works on at a time.
pub const PART: usize = 256;

/// The inverse of a symmetric block; `None` where it is not positive definite.
pub fn inverse<const B: usize>(block: &Block<B>) -> Option<Block<B>> {
    let inverse = DMatrix::from_fn(B, B, |r, c| block[r][c]).cholesky()?.inverse();
    Some(std::array::from_fn(|r| std::array::from_fn(|c| inverse[(r, c)])))
}
