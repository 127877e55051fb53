//! Displacements of all nodes by a force at one node, from the blocks that its clusters are in.
//!
//! In: [`Shape`], and blocks one by one. Out: displacements. A force at a node of the leaf t has the coefficients Q_tᵀ T_t f in
//! its clusters, from the leaf to the root; each block turns them into coefficients of another cluster; and all these together
//! become displacements on the way from the roots to the leaves. The cost is that of the blocks, and a few numbers times rank
//! for every node.

use super::super::dense::product;
use super::basis::Bases;
use super::tree::{Block, Tree};
use faer::{Accum, Mat, MatRef, Par};
use nalgebra::Matrix3;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// All but the numbers of the blocks.
#[derive(Clone, Debug)]
pub struct Shape {
    pub tree: Tree,
    pub blocks: Vec<Block>,
    /// The frame T of every leaf; of other clusters nothing.
    pub frames: Vec<Matrix3<f64>>,
    pub bases: Bases,
}

/// The shapes of the bodies of a file.
#[derive(Debug, Default)]
pub struct Shapes(Mutex<BTreeMap<String, Arc<Shape>>>);

impl Shapes {
    pub fn keep(&self, body: &str, shape: Shape) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).insert(body.to_owned(), Arc::new(shape));
    }

    pub fn get(&self, body: &str) -> Option<Arc<Shape>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(body).cloned()
    }
}

fn add(out: &mut Mat<f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    faer::linalg::matmul::matmul(out.as_mut(), Accum::Add, a, b, 1.0, Par::Seq);
}

impl Shape {
    /// Rows and columns of a block.
    pub fn sides(&self, block: usize) -> [usize; 2] {
        let Block { is_far, of } = self.blocks[block];
        of.map(|cluster| self.bases.width(&self.tree, cluster, is_far))
    }

    /// The blocks of the clusters that hold a node.
    pub fn touched(&self, place: usize) -> Vec<usize> {
        let mut holds = vec![false; self.tree.clusters.len()];
        self.tree.path(place).for_each(|cluster| holds[cluster] = true);
        let is_touched = |index: &usize| self.blocks[*index].of.iter().any(|&cluster| holds[cluster]);
        (0..self.blocks.len()).filter(is_touched).collect()
    }

    /// The displacements of all nodes for forces along x, y and z at the node at `place`, `[node][axis][force]`.
    pub fn column<E>(
        &self,
        place: usize,
        mut numbers: impl FnMut(usize) -> Result<Mat<f64>, E>,
    ) -> Result<Vec<[[f64; 3]; 3]>, E> {
        let Shape { tree, bases, .. } = self;
        let count = tree.clusters.len();
        let leaf = tree.leaf_of[place];
        let own = place - tree.clusters[leaf].nodes.start;
        let frame = self.frames[leaf];
        let frame = Mat::from_fn(3, 3, |i, j| frame[(i, j)]);
        // What the force is in each cluster that holds the node; of the leaf in all of its basis.
        let mut forces: Vec<Option<Mat<f64>>> = vec![None; count];
        let mut force = product(bases.of[leaf].as_ref().subrows(3 * own, 3).transpose(), frame.as_ref());
        for cluster in tree.path(place) {
            let up = bases
                .of_part(tree, cluster)
                .map(|basis| product(basis.transpose(), force.as_ref().subrows(0, bases.ranks[cluster])));
            forces[cluster] = Some(std::mem::replace(&mut force, up.unwrap_or_else(Mat::new)));
        }
        let mut moved: Vec<Mat<f64>> = (0..count).map(|cluster| Mat::zeros(self.width(cluster), 3)).collect();
        for (index, Block { of: [a, b], .. }) in self.blocks.iter().enumerate() {
            let (at_a, at_b) = (&forces[*a], &forces[*b]);
            if at_a.is_none() && at_b.is_none() {
                continue;
            }
            let numbers = numbers(index)?;
            let [rows, columns] = self.sides(index);
            let mut spread = |to: usize, numbers: MatRef<'_, f64>, force: &Mat<f64>| {
                let to = moved[to].as_mut().subrows_mut(0, numbers.nrows());
                let force = force.as_ref().subrows(0, numbers.ncols());
                faer::linalg::matmul::matmul(to, Accum::Add, numbers, force, 1.0, Par::Seq);
            };
            debug_assert_eq!((rows, columns), (numbers.nrows(), numbers.ncols()));
            if let Some(force) = at_b {
                spread(*a, numbers.as_ref(), force);
            }
            if let Some(force) = at_a.as_ref().filter(|_| a != b) {
                spread(*b, numbers.transpose(), force);
            }
        }
        Ok(self.displacements(moved))
    }

    /// Displacements of all nodes, from the coefficients of every cluster.
    pub fn displacements(&self, mut moved: Vec<Mat<f64>>) -> Vec<[[f64; 3]; 3]> {
        let Shape { tree, bases, .. } = self;
        let mut all = vec![[[0.0; 3]; 3]; tree.leaf_of.len()];
        for cluster in 0..tree.clusters.len() {
            let rank = bases.ranks[cluster];
            if let (Some(basis), Some(parent)) = (bases.of_part(tree, cluster), tree.clusters[cluster].parent)
            {
                let down = basis * moved[parent].as_ref();
                let mut into = moved[cluster].as_mut().subrows_mut(0, rank);
                into += down.as_ref();
            }
            if tree.clusters[cluster].children.is_some() {
                continue;
            }
            let mut displacements = Mat::zeros(tree.size(cluster), 3);
            add(&mut displacements, bases.of[cluster].as_ref(), moved[cluster].as_ref());
            let frame = self.frames[cluster];
            for (i, node) in tree.clusters[cluster].nodes.clone().enumerate() {
                let own = Matrix3::from_fn(|axis, force| displacements[(3 * i + axis, force)]);
                let own = frame * own;
                all[node] = [0, 1, 2].map(|axis| [0, 1, 2].map(|force| own[(axis, force)]));
            }
        }
        all
    }

    /// A column as the bases see it: what is far from its node has nothing but their fields.
    pub fn seen(&self, place: usize, column: &[[[f64; 3]; 3]]) -> Vec<[[f64; 3]; 3]> {
        let Shape { tree, bases, .. } = self;
        let count = tree.clusters.len();
        let mut holds = vec![false; count];
        tree.path(place).for_each(|cluster| holds[cluster] = true);
        let mut is_far = vec![false; count];
        for Block { of: [a, b], .. } in self.blocks.iter().filter(|block| block.is_far) {
            is_far[*a] |= holds[*b];
            is_far[*b] |= holds[*a];
        }
        let mut own: Vec<Mat<f64>> = vec![Mat::new(); count];
        for cluster in (0..count).rev() {
            let rank = bases.ranks[cluster];
            own[cluster] = if let Some(parts) = tree.clusters[cluster].children {
                let mut sum = Mat::zeros(rank, 3);
                for part in parts {
                    bases
                        .of_part(tree, part)
                        .iter()
                        .for_each(|basis| add(&mut sum, basis.transpose(), own[part].as_ref()));
                }
                sum
            } else {
                let nodes = &tree.clusters[cluster].nodes;
                let frame = self.frames[cluster].try_inverse().unwrap_or_else(Matrix3::zeros);
                let mut moved = Mat::zeros(3 * nodes.len(), 3);
                for (i, of_node) in column[nodes.clone()].iter().enumerate() {
                    let of_node = frame * Matrix3::from_fn(|axis, force| of_node[axis][force]);
                    (0..9).for_each(|k| moved[(3 * i + k / 3, k % 3)] = of_node[(k / 3, k % 3)]);
                }
                product(bases.of[cluster].as_ref().subcols(0, rank).transpose(), moved.as_ref())
            };
        }
        let coefficients = |cluster: usize| {
            let mut all = Mat::zeros(self.width(cluster), 3);
            if is_far[cluster] {
                all.as_mut().subrows_mut(0, bases.ranks[cluster]).copy_from(own[cluster].as_ref());
            }
            all
        };
        let mut seen = self.displacements((0..count).map(coefficients).collect());
        for cluster in 0..count {
            is_far[cluster] |= tree.clusters[cluster].parent.is_some_and(|parent| is_far[parent]);
        }
        let near = (0..seen.len()).filter(|&node| !is_far[tree.leaf_of[node]]);
        near.for_each(|node| seen[node] = column[node]);
        seen
    }

    /// Coefficients that a cluster may get: those of a leaf near by too.
    fn width(&self, cluster: usize) -> usize {
        match self.tree.clusters[cluster].children {
            Some(_) => self.bases.ranks[cluster],
            None => self.tree.size(cluster),
        }
    }
}
