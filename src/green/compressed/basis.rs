//! Nested bases: the fields that forces elsewhere cause in each cluster.
//!
//! In: what random forces on leaves do to all nodes. Out: for each leaf an orthogonal matrix, whose columns in front span, to a
//! tolerance, all that forces far from the leaf do there; for each other cluster those of its parts' fields that forces far
//! from the whole cluster cause (S. Börm, Efficient Numerical Methods for Non-local Operators, EMS 2010, chapters 3 and 5; by
//! random samples: J. Levitt and P.-G. Martinsson, J. Comput. Appl. Math. 2024).

use super::super::dense::{product, symmetric_eigen};
use super::tree::{Block, Tree};
use crate::base::machine::{self, TooLarge};
use faer::{Mat, MatRef};
use rayon::prelude::*;

/// Number of columns for which the sum over all far columns is taken: those near a cluster's border matter most.
const COLUMNS: f64 = 400.0;
/// A basis of more fields than this part of its samples is not trusted.
const TRUSTED: f64 = 0.6;

/// The purpose of the memory, as a refusal names it.
pub const WHAT: &str = "the compressed compliance of the surface";

/// Bytes that the heap takes for each byte in matrices of many sizes; measured as 1.05 to 1.1.
pub const HEAP: f64 = 1.2;

/// The bases of all clusters.
#[derive(Clone, Debug, Default)]
pub struct Bases {
    /// Basis of each cluster: of a leaf, over all components of its nodes, square; of another cluster, over the fields of its
    /// parts.
    pub of: Vec<Mat<f64>>,
    /// The fields, in front, that represent a cluster where it is far away.
    pub ranks: Vec<usize>,
}

impl Bases {
    /// Rows of a cluster's basis, and the most columns it may have, where its parts have these ranks.
    pub fn rows(tree: &Tree, ranks: &[usize], cluster: usize) -> usize {
        match tree.clusters[cluster].children {
            Some(parts) => parts.iter().map(|&part| ranks[part]).sum(),
            None => tree.size(cluster),
        }
    }

    /// Numbers that stand for a cluster in a block.
    pub fn width(&self, tree: &Tree, cluster: usize, is_far: bool) -> usize {
        if is_far { self.ranks[cluster] } else { tree.size(cluster) }
    }

    /// The rows of a cluster's basis that a part of it has, for the part's fields.
    pub fn of_part(&self, tree: &Tree, part: usize) -> Option<MatRef<'_, f64>> {
        let parent = tree.clusters[part].parent?;
        let [left, _] = tree.clusters[parent].children?;
        let first = if part == left { 0 } else { self.ranks[left] };
        let basis = self.of[parent].as_ref();
        Some(basis.subrows(first, self.ranks[part]))
    }
}

/// Clusters that are far from each one.
pub fn partners(tree: &Tree, blocks: &[Block]) -> Vec<Vec<usize>> {
    let mut partners = vec![Vec::new(); tree.clusters.len()];
    for Block { of: [a, b], .. } in blocks.iter().filter(|block| block.is_far) {
        partners[*a].push(*b);
        partners[*b].push(*a);
    }
    partners
}

/// Displacements by random forces.
pub struct Samples {
    /// The leaves that each of them is on.
    pub leaves: Vec<Vec<usize>>,
    /// Components of all nodes, one sample after the other.
    pub values: Vec<f32>,
}

/// The bases that leave out what is below `tolerance`, which every cluster has its own.
pub fn bases(tree: &Tree, blocks: &[Block], samples: &Samples, tolerance: &[f64]) -> Result<Bases, TooLarge> {
    let partners = partners(tree, blocks);
    let count = tree.clusters.len();
    let mut is_far = vec![Vec::new(); count];
    for cluster in 0..count {
        let parent = tree.clusters[cluster].parent;
        let mut far = parent.map_or_else(|| vec![false; count], |parent| is_far[parent].clone());
        for &partner in &partners[cluster] {
            let all = &tree.clusters[partner].nodes;
            let is_in = |leaf: &usize| all.contains(&tree.clusters[*leaf].nodes.start);
            tree.leaves().filter(is_in).for_each(|leaf| far[leaf] = true);
        }
        is_far[cluster] = far;
    }
    let size = 3 * tree.leaf_of.len();
    let mut bases = Bases { of: vec![Mat::new(); count], ranks: vec![0; count] };
    let mut projected: Vec<Mat<f32>> = vec![Mat::new(); count];
    for level in levels(tree).into_iter().rev() {
        machine::expect(WHAT, level_memory(tree, &bases.ranks, &level, samples))?;
        let mut of_parts = |cluster: usize| {
            tree.clusters[cluster]
                .children
                .map(|parts| parts.map(|part| std::mem::replace(&mut projected[part], Mat::new())))
        };
        let parts: Vec<(usize, Option<[Mat<f32>; 2]>)> =
            level.into_iter().map(|cluster| (cluster, of_parts(cluster))).collect();
        let of_cluster = |(cluster, parts): (usize, Option<[Mat<f32>; 2]>)| {
            let is_leaf = parts.is_none();
            let rows = match parts {
                None => {
                    let nodes = &tree.clusters[cluster].nodes;
                    let value =
                        |i: usize, s: usize| f64::from(samples.values[s * size + 3 * nodes.start + i]);
                    Mat::from_fn(3 * nodes.len(), samples.leaves.len(), value)
                }
                Some([left, right]) => {
                    let split = left.nrows();
                    Mat::from_fn(split + right.nrows(), samples.leaves.len(), |i, s| {
                        f64::from(if i < split { left[(i, s)] } else { right[(i - split, s)] })
                    })
                }
            };
            let (basis, rank) = basis(&rows, samples, &is_far[cluster], tolerance[cluster]);
            let fields = basis.as_ref().subcols(0, rank);
            let kept = product(fields.transpose(), rows.as_ref());
            let kept = Mat::from_fn(rank, kept.ncols(), |i, s| kept[(i, s)] as f32);
            let basis = if is_leaf { basis } else { fields.to_owned() };
            (cluster, basis, rank, kept)
        };
        let made: Vec<_> = parts.into_par_iter().map(of_cluster).collect();
        for (cluster, basis, rank, kept) in made {
            (bases.of[cluster], bases.ranks[cluster], projected[cluster]) = (basis, rank, kept);
        }
    }
    Ok(bases)
}

/// Bytes of the bases of a level, where each has as many fields as rows, of what they see, and of making them.
fn level_memory(tree: &Tree, ranks: &[usize], level: &[usize], samples: &Samples) -> f64 {
    let rows = level.iter().map(|&cluster| Bases::rows(tree, ranks, cluster) as f64);
    let [all, squares, most] = rows
        .fold([0.0; 3], |[all, squares, most], own| [all + own, squares + own * own, f64::max(most, own)]);
    let count = samples.leaves.len() as f64;
    let making = rayon::current_num_threads() as f64 * 8.0 * most * (3.0 * most + 2.0 * count);
    HEAP * (8.0 * squares + 4.0 * all * count + making)
}

/// The clusters by their distance from a root.
pub fn levels(tree: &Tree) -> Vec<Vec<usize>> {
    let mut depth = vec![0; tree.clusters.len()];
    let mut levels: Vec<Vec<usize>> = Vec::new();
    for (cluster, of) in tree.clusters.iter().enumerate() {
        depth[cluster] = of.parent.map_or(0, |parent| depth[parent] + 1);
        if levels.len() == depth[cluster] {
            levels.push(Vec::new());
        }
        levels[depth[cluster]].push(cluster);
    }
    levels
}

/// The eigenvectors of the Gram matrix of those samples all of whose forces are far away, the largest first, and how many of
/// them are above the tolerance.
fn basis(rows: &Mat<f64>, samples: &Samples, is_far: &[bool], tolerance: f64) -> (Mat<f64>, usize) {
    let size = rows.nrows();
    let identity = |rank: usize| (Mat::identity(size, size), rank);
    let far_leaves = is_far.iter().filter(|is_far| **is_far).count();
    if far_leaves == 0 {
        return identity(0);
    }
    let usable: Vec<usize> =
        (0..samples.leaves.len()).filter(|&s| samples.leaves[s].iter().all(|&leaf| is_far[leaf])).collect();
    let own = Mat::from_fn(size, usable.len(), |i, s| rows[(i, usable[s])]);
    let forces: usize = usable.iter().map(|&s| samples.leaves[s].len()).sum();
    let gram = product(own.as_ref(), own.transpose());
    let Some((values, vectors)) = symmetric_eigen(gram.as_ref()) else { return identity(size) };
    // Forces on each leaf count once, however many samples have some there.
    let often = forces as f64 / far_leaves as f64;
    let least = COLUMNS * often * tolerance * tolerance;
    let rank = values.iter().filter(|value| **value > least).count();
    if rank as f64 > TRUSTED * usable.len() as f64 {
        return identity(size);
    }
    (Mat::from_fn(size, size, |i, k| vectors[(i, size - 1 - k)]), rank)
}
