//! Clusters of nodes that lie together, and which pairs of clusters are far from each other.
//!
//! In: places of nodes, of which those in front take forces. Out: an order of them in which every cluster stands together, a
//! binary [`Tree`] of clusters, and its [`blocks`] (W. Hackbusch, Hierarchical Matrices, Springer 2015, chapter 5). Nodes that
//! take forces and nodes that take none have a tree each.
//!
//! [`Surface`] is the surface that is compressed; in the [`Frame`]s of its nodes a force moves the node under it by about 1.

use crate::base::extent::{bounding_box, extent};
use crate::fem::NodeFields;
use crate::solve::{Factor, Progress, SolveError};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::ops::Range;

/// Most nodes of a leaf.
const LEAF: usize = 32;
/// Two clusters are far from each other where the larger one's diameter is at most this many times their distance.
const FAR: f64 = 2.0;

type V3 = Vector3<f64>;

/// Some nodes that stand together.
#[derive(Clone, Debug, PartialEq)]
pub struct Cluster {
    pub nodes: Range<usize>,
    pub children: Option<[usize; 2]>,
    pub parent: Option<usize>,
}

/// All clusters, each behind the one that it is a part of.
#[derive(Clone, Debug, PartialEq)]
pub struct Tree {
    pub clusters: Vec<Cluster>,
    /// Leaf of every node.
    pub leaf_of: Vec<usize>,
}

/// Two clusters; one block of the matrix, and its transposed one, are all forces at the second and displacements of the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub is_far: bool,
    pub of: [usize; 2],
}

impl Tree {
    /// The tree of m nodes of which the n in front take forces. It depends on these numbers alone.
    pub fn new(n: usize, m: usize) -> Tree {
        let mut tree = Tree { clusters: Vec::new(), leaf_of: vec![0; m] };
        tree.add(0..n, None);
        if n < m {
            tree.add(n..m, None);
        }
        tree
    }

    fn add(&mut self, nodes: Range<usize>, parent: Option<usize>) -> usize {
        let own = self.clusters.len();
        self.clusters.push(Cluster { nodes: nodes.clone(), children: None, parent });
        if nodes.len() <= LEAF {
            self.leaf_of[nodes].fill(own);
        } else {
            let parts = halves(nodes).map(|part| self.add(part, Some(own)));
            self.clusters[own].children = Some(parts);
        }
        own
    }

    /// The roots: that of the nodes that take forces, and the other one's.
    pub fn roots(&self) -> impl Iterator<Item = usize> {
        (0..self.clusters.len()).filter(|&cluster| self.clusters[cluster].parent.is_none())
    }

    pub fn leaves(&self) -> impl Iterator<Item = usize> {
        (0..self.clusters.len()).filter(|&cluster| self.clusters[cluster].children.is_none())
    }

    /// The clusters that hold a node, from its leaf to the root.
    pub fn path(&self, node: usize) -> impl Iterator<Item = usize> {
        std::iter::successors(Some(self.leaf_of[node]), |&cluster| self.clusters[cluster].parent)
    }

    /// Components of all nodes of a cluster.
    pub fn size(&self, cluster: usize) -> usize {
        3 * self.clusters[cluster].nodes.len()
    }
}

fn halves(nodes: Range<usize>) -> [Range<usize>; 2] {
    let middle = nodes.start + nodes.len() / 2;
    [nodes.start..middle, middle..nodes.end]
}

/// The order of nodes at these places in which the clusters of [`Tree::new`] are boxes, cut across their longest side.
pub fn order(places: &[V3], n: usize) -> Vec<usize> {
    let mut all: Vec<usize> = (0..places.len()).collect();
    let (front, behind) = all.split_at_mut(n);
    for part in [front, behind] {
        sort(places, part);
    }
    all
}

fn sort(places: &[V3], nodes: &mut [usize]) {
    if nodes.len() <= LEAF {
        return;
    }
    let (low, high) = extent(nodes.iter().map(|&node| places[node])).unwrap_or_default();
    let axis = (high - low).imax();
    nodes.sort_by(|&a, &b| places[a][axis].total_cmp(&places[b][axis]).then(a.cmp(&b)));
    let (left, right) = nodes.split_at_mut(nodes.len() / 2);
    sort(places, left);
    sort(places, right);
}

/// All blocks for nodes at these places, in the order of the tree: each pair of nodes of which one takes forces is in one.
pub fn blocks(tree: &Tree, places: &[V3]) -> Vec<Block> {
    let boxes: Vec<(V3, V3)> =
        tree.clusters.iter().map(|cluster| bounding_box(&places[cluster.nodes.clone()])).collect();
    let mut found = Vec::new();
    for root in tree.roots() {
        divide(tree, &boxes, [root, 0], &mut found);
    }
    found
}

fn divide(tree: &Tree, boxes: &[(V3, V3)], of: [usize; 2], found: &mut Vec<Block>) {
    let [a, b] = of;
    let [(low_a, high_a), (low_b, high_b)] = of.map(|cluster| boxes[cluster]);
    let sizes = [high_a - low_a, high_b - low_b].map(|side| side.norm());
    let gap = (low_a - high_b).sup(&(low_b - high_a)).map(|gap| gap.max(0.0)).norm();
    if a != b && gap > 0.0 && sizes[0].max(sizes[1]) <= FAR * gap {
        return found.push(Block { is_far: true, of });
    }
    match (tree.clusters[a].children, tree.clusters[b].children) {
        (None, None) => found.push(Block { is_far: false, of }),
        (Some([left, right]), _) if a == b => {
            for part in [[left, left], [left, right], [right, right]] {
                divide(tree, boxes, part, found);
            }
        }
        (Some(parts), other) if other.is_none() || sizes[0] >= sizes[1] => {
            parts.into_iter().for_each(|part| divide(tree, boxes, [part, b], found));
        }
        (_, Some(parts)) => parts.into_iter().for_each(|part| divide(tree, boxes, [a, part], found)),
        (Some(parts), None) => parts.into_iter().for_each(|part| divide(tree, boxes, [part, b], found)),
    }
}

/// Columns that are solved for together.
pub const TOGETHER: usize = 48;

type M3 = Matrix3<f64>;

/// The surface that is compressed, and the factor that solves for its columns.
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

impl Frame {
    fn from_compliance(compliance: &M3) -> Frame {
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

/// The least and the largest yield of a cluster.
pub fn spans(tree: &Tree, frames: &[Frame], cluster: usize) -> [f64; 2] {
    let nodes = &tree.clusters[cluster].nodes;
    let own = tree.leaf_of[nodes.clone()].iter().map(|&leaf| frames[leaf].yields);
    own.fold([f64::INFINITY, 0.0], |all, own| [all[0].min(own[0]), all[1].max(own[1])])
}

/// The frame of each leaf, from how a node in its middle yields.
pub fn frames(of: &Surface<'_>, progress: &dyn Progress) -> Result<Vec<Frame>, SolveError> {
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
            frames[leaf] =
                Frame::from_compliance(&M3::from_fn(|axis, force| x.row(3 * i + axis)[3 * i + force]));
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

/// Displacements by unit forces at these places, at all places from `from` on.
pub fn unit_columns(of: &Surface<'_>, places: &[usize], from: usize) -> Result<NodeFields, SolveError> {
    let nodes: Vec<u32> = places.iter().map(|&place| of.nodes[place]).collect();
    let mut unit = NodeFields::zeros(nodes.len(), 3 * nodes.len());
    (0..3 * nodes.len()).for_each(|i| unit.row_mut(i)[i] = 1.0);
    of.factor.solve_at(&nodes, &unit, &of.nodes[from..])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each pair of nodes of which one takes forces is in one block, and far blocks are as far apart as they must be.
    #[test]
    fn every_pair_is_in_one_block() {
        for (n, m) in [(1, 1), (33, 33), (300, 300), (40, 300), (250, 300)] {
            let place = |i: usize| V3::new((0.7 * i as f64).cos(), (0.7 * i as f64).sin(), 0.02 * i as f64);
            let places: Vec<V3> = (0..m).map(place).collect();
            let order = order(&places, n);
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(sorted.iter().copied().eq(0..m) && order[..n].iter().all(|&node| node < n));
            let places: Vec<V3> = order.iter().map(|&node| places[node]).collect();
            let tree = Tree::new(n, m);
            let mut count = vec![0; m * m];
            for Block { of: [a, b], is_far } in blocks(&tree, &places) {
                let [rows, columns] = [a, b].map(|cluster| tree.clusters[cluster].nodes.clone());
                for (i, j) in rows.flat_map(|i| columns.clone().map(move |j| (i, j))) {
                    count[i * m + j] += 1;
                    if a != b {
                        count[j * m + i] += 1;
                    }
                    assert!(!is_far || (places[i] - places[j]).norm() > 0.0);
                }
            }
            for (i, j) in (0..m).flat_map(|i| (0..m).map(move |j| (i, j))) {
                assert_eq!(count[i * m + j], usize::from(i < n || j < n), "{i} {j} of {n} {m}");
            }
            for (node, &leaf) in tree.leaf_of.iter().enumerate() {
                assert!(tree.path(node).all(|cluster| tree.clusters[cluster].nodes.contains(&node)));
                assert!(tree.clusters[leaf].nodes.len() <= LEAF);
            }
        }
    }

    /// Of two far clusters, neither box has a diagonal above twice the gap between the boxes.
    #[test]
    fn far_clusters_are_small_beside_the_gap_between_them() {
        let place = |i: usize| V3::new((0.7 * i as f64).cos(), (0.7 * i as f64).sin(), 0.02 * i as f64);
        let places: Vec<V3> = (0..700).map(place).collect();
        let places: Vec<V3> = order(&places, 600).iter().map(|&node| places[node]).collect();
        let tree = Tree::new(600, 700);
        let far = blocks(&tree, &places).into_iter().filter(|block| block.is_far);
        let mut count = 0;
        for Block { of, .. } in far {
            let [a, b] = of.map(|cluster| &places[tree.clusters[cluster].nodes.clone()]);
            let range = |of: &[V3], axis: usize| {
                let values = || of.iter().map(|place| place[axis]);
                (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
            };
            let mut squares = [0.0; 3];
            for axis in 0..3 {
                let ((low_a, high_a), (low_b, high_b)) = (range(a, axis), range(b, axis));
                let gap = (low_a - high_b).max(low_b - high_a).max(0.0);
                let parts = [high_a - low_a, high_b - low_b, gap].map(|length| length * length);
                squares = [0, 1, 2].map(|k| squares[k] + parts[k]);
            }
            let [of_a, of_b, gap] = squares.map(f64::sqrt);
            assert!(of_a.max(of_b) <= 2.0 * gap, "{of_a} and {of_b} m, {gap} m apart");
            count += 1;
        }
        assert!(count > 10, "{count}");
    }
}
