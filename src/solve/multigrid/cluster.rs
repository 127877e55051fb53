//! Clusters: the few nodes of the finest level that are coupled so tightly that they are smoothed and gathered as one, such
//! as those of a line through a thin wall, or those of a stiff element that hangs on a corner.
//!
//! In: A and the inverses of its diagonal blocks. Out: an order of the nodes in which every cluster stands together.
//!
//! Node by node, the smoother damps what runs through the wall and hardly what runs along it, and smoothing the prolongator
//! does as little for the bending; with the line's block in place of its nodes', both see the wall as a surface.
//!
//! [`Aggregates`] gathers the strongly coupled clusters (Vaněk, Mandel and Brezina, Computing 56, 1996, 179-196).

use super::rows::{Block, Rows};
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::ops::Range;

/// Nodes of a cluster at most.
pub const MOST: usize = 4;
/// Coupling from which on two nodes belong together. Of two nodes of a cube's mesh it is some 0.3; the largest possible, of a
/// single direction, is 1.
const TIGHT: f64 = 0.7;

/// Clusters of nodes: those of cluster c are `start[c]..start[c + 1]`. Most clusters are one node.
pub struct Clusters {
    pub start: Vec<u32>,
}

impl Clusters {
    /// Every node alone.
    pub fn alone(nodes: usize) -> Clusters {
        Clusters { start: (0..=nodes as u32).collect() }
    }

    pub fn count(&self) -> usize {
        self.start.len() - 1
    }

    pub fn members(&self, cluster: usize) -> Range<usize> {
        self.start[cluster] as usize..self.start[cluster + 1] as usize
    }

    /// The cluster of each node.
    pub fn of_nodes(&self) -> Vec<u32> {
        (0..self.count()).flat_map(|cluster| self.members(cluster).map(move |_| cluster as u32)).collect()
    }

    /// Pairs are joined that are coupled by ‖D_i^-½ A_ij D_j^-½‖ ≥ [`TIGHT`] (Frobenius), the tightest first, up to [`MOST`]
    /// nodes; also the node that stands at each place of the new order. `inverse`: the D_i⁻¹.
    pub fn new<const B: usize>(rows: &impl Rows<B>, inverse: &[Block<B>]) -> (Clusters, Vec<u32>) {
        let nodes = rows.nodes();
        let pairs: Vec<Vec<(f64, u32, u32)>> = (0..nodes)
            .into_par_iter()
            .with_min_len(512)
            .map(|node| {
                let mut tight = Vec::new();
                rows.each(node, |other, block| {
                    let is_tight = |square: &f64| *square >= TIGHT * TIGHT;
                    if other > node
                        && let Some(square) =
                            Some(coupling(&inverse[node], block, &inverse[other])).filter(is_tight)
                    {
                        tight.push((square, node as u32, other as u32));
                    }
                });
                tight
            })
            .collect();
        let mut pairs: Vec<_> = pairs.into_iter().flatten().collect();
        pairs.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        // Those of a cluster, under its lowest node.
        let mut members: Vec<Vec<u32>> = (0..nodes as u32).map(|node| vec![node]).collect();
        let mut lowest: Vec<u32> = (0..nodes as u32).collect();
        for (_, a, b) in pairs {
            let (a, b) = (lowest[a as usize], lowest[b as usize]);
            let (a, b) = (a.min(b) as usize, a.max(b) as usize);
            if a != b && members[a].len() + members[b].len() <= MOST {
                let joining = std::mem::take(&mut members[b]);
                joining.iter().for_each(|&node| lowest[node as usize] = a as u32);
                members[a].extend(joining);
            }
        }
        let mut start = vec![0];
        let mut order = Vec::with_capacity(nodes);
        for own in members.iter().filter(|own| !own.is_empty()) {
            order.extend(own);
            start.push(order.len() as u32);
        }
        (Clusters { start }, order)
    }
}

/// ‖D_i^-½ A_ij D_j^-½‖² = tr(D_i⁻¹ A_ij D_j⁻¹ A_ji).
fn coupling<const B: usize>(own: &Block<B>, block: &Block<B>, other: &Block<B>) -> f64 {
    let mut sum = 0.0;
    for r in 0..B {
        for c in 0..B {
            let left: f64 = (0..B).map(|k| own[r][k] * block[k][c]).sum();
            let right: f64 = (0..B).map(|k| block[r][k] * other[k][c]).sum();
            sum += left * right;
        }
    }
    sum
}

/// Condition (largest entries of a block and its inverse, multiplied) above which f32 cannot hold a cluster's inverse.
const CONDITION: f64 = 4e6;

/// The inverse of the block of A on a cluster's nodes, or of those of its nodes one by one where it is too ill-conditioned for
/// f32; `None` where one of them is not positive definite.
pub fn inverse<const B: usize>(rows: &impl Rows<B>, members: Range<usize>) -> Option<DMatrix<f64>> {
    let size = B * members.len();
    let mut matrix = DMatrix::zeros(size, size);
    for node in members.clone() {
        let mut put = |other: usize, block: &Block<B>| {
            if members.contains(&other) {
                for r in 0..B {
                    for c in 0..B {
                        matrix[(B * (node - members.start) + r, B * (other - members.start) + c)] =
                            block[r][c];
                    }
                }
            }
        };
        put(node, &rows.diagonal(node));
        if members.len() > 1 {
            rows.each(node, put);
        }
    }
    let largest = matrix.amax();
    let of_all = matrix.clone().cholesky().map(|factor| factor.inverse());
    let holds = |inverse: &DMatrix<f64>| members.len() == 1 || inverse.amax() * largest <= CONDITION;
    of_all.filter(holds).or_else(|| {
        let mut inverse = DMatrix::zeros(size, size);
        for at in (0..size).step_by(B) {
            let own = matrix.view((at, at), (B, B)).clone_owned().cholesky()?.inverse();
            inverse.view_mut((at, at), (B, B)).copy_from(&own);
        }
        Some(inverse)
    })
}

/// A node that is coupled so weakly that smoothing alone solves for it.
pub const ALONE: u32 = u32::MAX;

/// The aggregate to which each node belongs, or [`ALONE`].
pub struct Aggregates {
    pub of_node: Vec<u32>,
    pub count: usize,
}

/// ‖A_ij‖² of Frobenius.
fn square<const B: usize>(block: &Block<B>) -> f64 {
    block.iter().flatten().map(|value| value * value).sum()
}

impl Aggregates {
    /// Two clusters are strongly coupled where two of their nodes are: ‖A_ij‖ ≥ `threshold` (‖A_ii‖ ‖A_jj‖)^½.
    ///
    /// A cluster none of whose neighbours belongs to an aggregate makes one of them all; what is left over joins the
    /// aggregate to which it is coupled most.
    pub fn new<const B: usize>(rows: &impl Rows<B>, clusters: &Clusters, threshold: f64) -> Aggregates {
        let size: Vec<f64> = (0..rows.nodes()).map(|node| square(&rows.diagonal(node)).sqrt()).collect();
        let limit = threshold * threshold;
        let cluster_of = clusters.of_nodes();
        let strong: Vec<Vec<u32>> = (0..clusters.count())
            .into_par_iter()
            .with_min_len(512)
            .map(|cluster| {
                let mut strong = Vec::new();
                for node in clusters.members(cluster) {
                    rows.each(node, |other, block| {
                        let strength = square(block);
                        let is_strong = strength > 0.0 && strength >= limit * size[node] * size[other];
                        let other = cluster_of[other];
                        if is_strong && other as usize != cluster && !strong.contains(&other) {
                            strong.push(other);
                        }
                    });
                }
                strong
            })
            .collect();

        let mut of_cluster = vec![ALONE; clusters.count()];
        let mut count = 0;
        for (cluster, strong) in strong.iter().enumerate() {
            let is_free = of_cluster[cluster] == ALONE
                && strong.iter().all(|&other| of_cluster[other as usize] == ALONE);
            if is_free && (!strong.is_empty() || clusters.members(cluster).len() > 1) {
                of_cluster[cluster] = count;
                strong.iter().for_each(|&other| of_cluster[other as usize] = count);
                count += 1;
            }
        }
        let rooted = of_cluster.clone();
        for cluster in (0..clusters.count()).filter(|&c| rooted[c] == ALONE && !strong[c].is_empty()) {
            let mut best = (0.0, ALONE);
            for node in clusters.members(cluster) {
                rows.each(node, |other, block| {
                    let strength = square(block) / size[other];
                    let other = cluster_of[other];
                    let aggregate = rooted[other as usize];
                    if aggregate != ALONE && strength > best.0 && strong[cluster].contains(&other) {
                        best = (strength, aggregate);
                    }
                });
            }
            of_cluster[cluster] = best.1;
        }
        let of_node = cluster_of.iter().map(|&cluster| of_cluster[cluster as usize]).collect();
        Aggregates { of_node, count: count as usize }
    }

    /// The nodes of every aggregate, ascending: those of aggregate a are `nodes[start[a]..start[a + 1]]`.
    pub fn members(&self) -> (Vec<usize>, Vec<u32>) {
        let mut start = vec![0; self.count + 1];
        let gathered = || self.of_node.iter().filter(|&&aggregate| aggregate != ALONE);
        gathered().for_each(|&aggregate| start[aggregate as usize + 1] += 1);
        for aggregate in 0..self.count {
            start[aggregate + 1] += start[aggregate];
        }
        let mut next = start.clone();
        let mut nodes = vec![0; start[self.count]];
        for (node, &aggregate) in self.of_node.iter().enumerate() {
            if aggregate != ALONE {
                nodes[next[aggregate as usize]] = node as u32;
                next[aggregate as usize] += 1;
            }
        }
        (start, nodes)
    }
}
