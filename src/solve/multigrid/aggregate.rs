//! Clusters of nodes that are strongly coupled, gathered into aggregates (Vaněk, Mandel and Brezina, Computing 56, 1996, 179-196).

use super::cluster::Clusters;
use super::rows::{Block, Rows};
use rayon::prelude::*;

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
