//! Nodes that are strongly coupled, gathered into aggregates (Vaněk, Mandel and Brezina, Computing 56, 1996, 179-196).

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

impl Aggregates {
    /// Two nodes are strongly coupled where ‖A_ij‖ ≥ `threshold` (‖A_ii‖ ‖A_jj‖)^½.
    ///
    /// A node none of whose neighbours belongs to an aggregate makes one of them all; what is left over joins the
    /// aggregate to which it is coupled most.
    pub fn new<const B: usize>(rows: &impl Rows<B>, threshold: f64) -> Aggregates {
        let nodes = rows.nodes();
        let size: Vec<f64> = (0..nodes).map(|node| square(&rows.diagonal(node)).sqrt()).collect();
        let limit = threshold * threshold;
        let strong: Vec<Vec<u32>> = (0..nodes)
            .into_par_iter()
            .with_min_len(512)
            .map(|node| {
                let mut strong = Vec::new();
                rows.each(node, |other, block| {
                    let strength = square(block);
                    if strength > 0.0 && strength >= limit * size[node] * size[other] {
                        strong.push(other as u32);
                    }
                });
                strong
            })
            .collect();

        let mut of_node = vec![ALONE; nodes];
        let mut count = 0;
        for (node, strong) in strong.iter().enumerate() {
            let is_free =
                of_node[node] == ALONE && strong.iter().all(|&other| of_node[other as usize] == ALONE);
            if is_free && !strong.is_empty() {
                of_node[node] = count;
                strong.iter().for_each(|&other| of_node[other as usize] = count);
                count += 1;
            }
        }
        let rooted = of_node.clone();
        for node in (0..nodes).filter(|&node| rooted[node] == ALONE && !strong[node].is_empty()) {
            let mut best = (0.0, ALONE);
            rows.each(node, |other, block| {
                let strength = square(block) / size[other];
                if rooted[other] != ALONE && strength > best.0 && strong[node].contains(&(other as u32)) {
                    best = (strength, rooted[other]);
                }
            });
            of_node[node] = best.1;
        }
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
