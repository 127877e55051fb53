//! Clusters of nodes that are strongly coupled, gathered into aggregates (Vaněk, Mandel and Brezina, Computing 56, 1996, 179-196).

use super::cluster::Clusters;
use super::rows::{Block, Rows};
use rayon::prelude::*;

/// A node that is coupled so weakly that smoothing alone solves for it.
pub const ALONE: u32 = u32::MAX;

/// Which aggregate each node belongs to, or [`ALONE`].
pub struct Aggregates {
    pub of_node: Vec<u32>,
    pub count: usize,
}

/// ‖A_ij‖² of Frobenius.
fn square<const B: usize>(block: &Block<B>) -> f64 {
    block.iter().flatten().map(|value| value * value).sum()
}

/// The force on a cluster that is shifted; beside it, those on its neighbours, in the order of their first blocks.
fn shifted<const B: usize>(
    rows: &impl Rows<B>,
    clusters: &Clusters,
    cluster_of: &[u32],
    cluster: usize,
    beside: &mut Vec<(u32, Block<B>)>,
) -> Block<B> {
    beside.clear();
    let mut own = [[0.0; B]; B];
    for node in clusters.members(cluster) {
        let mut add = |other: usize, block: &Block<B>| {
            let there = cluster_of[other];
            let sum = if there as usize == cluster {
                &mut own
            } else {
                let known = beside.iter().position(|(known, _)| *known == there);
                let at = known.unwrap_or_else(|| {
                    beside.push((there, [[0.0; B]; B]));
                    beside.len() - 1
                });
                &mut beside[at].1
            };
            sum.iter_mut().flatten().zip(block.iter().flatten()).for_each(|(sum, value)| *sum += value);
        };
        add(node, &rows.diagonal(node));
        rows.each(node, &mut add);
    }
    own
}

impl Aggregates {
    /// Two clusters are strongly coupled where ‖A_ij‖ ≥ `threshold` (‖A_ii‖ ‖A_jj‖)^½, A_ij being the force on cluster i as
    /// cluster j is shifted: the sum of their nodes' blocks.
    ///
    /// A cluster none of whose neighbours belongs to an aggregate makes one of them all; what is left over joins the
    /// aggregate to which it is coupled most.
    pub fn new<const B: usize>(rows: &impl Rows<B>, clusters: &Clusters, threshold: f64) -> Aggregates {
        let cluster_of = clusters.of_nodes();
        let own =
            |cluster: usize| square(&shifted(rows, clusters, &cluster_of, cluster, &mut Vec::new())).sqrt();
        let size: Vec<f64> = (0..clusters.count()).into_par_iter().with_min_len(512).map(own).collect();
        let limit = threshold * threshold;
        // The clusters that each is strongly coupled to, and how much, in parts of their size.
        let strong: Vec<Vec<(u32, f64)>> = (0..clusters.count())
            .into_par_iter()
            .with_min_len(512)
            .map_init(Vec::new, |beside, cluster| {
                shifted(rows, clusters, &cluster_of, cluster, beside);
                let strengths = beside.iter().map(|(other, block)| (*other, square(block)));
                strengths
                    .filter(|&(other, strength)| {
                        strength > 0.0 && strength >= limit * size[cluster] * size[other as usize]
                    })
                    .map(|(other, strength)| (other, strength / size[other as usize]))
                    .collect()
            })
            .collect();

        let mut of_cluster = vec![ALONE; clusters.count()];
        let mut count = 0;
        for (cluster, strong) in strong.iter().enumerate() {
            let is_free = of_cluster[cluster] == ALONE
                && strong.iter().all(|&(other, _)| of_cluster[other as usize] == ALONE);
            if is_free && (!strong.is_empty() || clusters.members(cluster).len() > 1) {
                of_cluster[cluster] = count;
                strong.iter().for_each(|&(other, _)| of_cluster[other as usize] = count);
                count += 1;
            }
        }
        let rooted = of_cluster.clone();
        for cluster in (0..clusters.count()).filter(|&c| rooted[c] == ALONE && !strong[c].is_empty()) {
            let mut best = (0.0, ALONE);
            for &(other, strength) in &strong[cluster] {
                let aggregate = rooted[other as usize];
                if aggregate != ALONE && strength > best.0 {
                    best = (strength, aggregate);
                }
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
