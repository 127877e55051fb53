//! Symmetric matrices of B × B blocks by their rows, from which a level is built, f64.

use crate::fem::StiffnessMatrix;
use nalgebra::{DMatrix, Matrix3};
use rayon::prelude::*;

/// A block, row by row.
pub type Block<const B: usize> = [[f64; B]; B];

/// Rows of a symmetric matrix.
pub trait Rows<const B: usize>: Sync {
    fn nodes(&self) -> usize;

    fn diagonal(&self, node: usize) -> Block<B>;

    /// Calls `each` with every neighbour of `node` and the block A_(node, neighbour), without the diagonal.
    fn each(&self, node: usize, each: impl FnMut(usize, &Block<B>));
}

/// A stiffness matrix in parts of `unit`, so that its numbers are near 1, in its own order of nodes.
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

    /// Inverses of the diagonal's blocks; errors with the node whose block is not positive definite.
    pub fn inverses(&self) -> Result<Vec<Block<3>>, usize> {
        let inverse = |node: usize| inverse(&self.diagonal(node)).ok_or(node);
        (0..self.nodes()).into_par_iter().with_min_len(512).map(inverse).collect()
    }

    /// Puts node `order[i]` at place i.
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

/// The inverse of a symmetric block; `None` where it is not positive definite.
pub fn inverse<const B: usize>(block: &Block<B>) -> Option<Block<B>> {
    let inverse = DMatrix::from_fn(B, B, |r, c| block[r][c]).cholesky()?.inverse();
    Some(std::array::from_fn(|r| std::array::from_fn(|c| inverse[(r, c)])))
}
