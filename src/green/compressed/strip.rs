//! A strip of the inverse in the order of the tree.
//!
//! In: a strip as the factor gives it. Out: its columns over all nodes of the tree, cluster by cluster.

use super::tree::Tree;
use crate::solve::InverseStrip;
use faer::MatRef;
use rayon::prelude::*;
use std::ops::Range;

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
