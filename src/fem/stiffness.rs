//! The symmetric stiffness matrix in 3×3 blocks: diagonal blocks on nodes, off-diagonal blocks on edges.

use super::fields::NodeFields;
use nalgebra::Matrix3;
use rayon::prelude::*;

/// K of K u = f, N/m, over `diagonal.len()` nodes (the paper's figure 4).
///
/// Edges i < j are sorted by (i, j); those of node i are `edges[edge_start[i]..edge_start[i + 1]]`, and block e
/// holds K_ij; K_ji is its transpose.
#[derive(Clone, Debug, PartialEq)]
pub struct StiffnessMatrix {
    pub diagonal: Vec<Matrix3<f64>>,
    pub edges: Vec<[u32; 2]>,
    pub blocks: Vec<Matrix3<f64>>,
    pub edge_start: Vec<usize>,
    /// Edges that end in node j: (i, edge), i < j, ascending; `lower[lower_start[j]..lower_start[j + 1]]`.
    lower: Vec<(u32, u32)>,
    lower_start: Vec<usize>,
}

impl StiffnessMatrix {
    /// The zero matrix on a graph; `edges` sorted, unique, i < j < `nodes`.
    pub fn zeros(nodes: usize, edges: Vec<[u32; 2]>) -> StiffnessMatrix {
        let edge_start = starts(nodes, edges.iter().map(|edge| edge[0]));
        let lower_start = starts(nodes, edges.iter().map(|edge| edge[1]));
        let mut next = lower_start.clone();
        let mut lower = vec![(0, 0); edges.len()];
        for (e, edge) in edges.iter().enumerate() {
            let slot = &mut next[edge[1] as usize];
            lower[*slot] = (edge[0], e as u32);
            *slot += 1;
        }
        let blocks = vec![Matrix3::zeros(); edges.len()];
        StiffnessMatrix {
            diagonal: vec![Matrix3::zeros(); nodes],
            edges,
            blocks,
            edge_start,
            lower,
            lower_start,
        }
    }

    pub fn nodes(&self) -> usize {
        self.diagonal.len()
    }

    /// Stored numbers if written out as a full symmetric scalar matrix.
    pub fn scalar_entries(&self) -> usize {
        9 * (self.diagonal.len() + 2 * self.blocks.len())
    }

    /// Neighbours of `node`: first those below, then those above, both ascending, each with K_(node, neighbour)'s
    /// edge and whether the stored block is to be transposed.
    pub fn neighbours(&self, node: usize) -> impl Iterator<Item = (usize, usize, bool)> + '_ {
        let below = self.lower[self.lower_start[node]..self.lower_start[node + 1]]
            .iter()
            .map(|&(i, e)| (i as usize, e as usize, true));
        let above =
            (self.edge_start[node]..self.edge_start[node + 1]).map(|e| (self.edges[e][1] as usize, e, false));
        below.chain(above)
    }

    /// y = K x for all columns at once; each row is gathered by one thread, so the bits do not depend on their
    /// number.
    pub fn multiply(&self, x: &NodeFields, y: &mut NodeFields) {
        let m = x.columns;
        y.data.par_chunks_mut(3 * m).enumerate().with_min_len(64).for_each(|(node, rows)| {
            rows.fill(0.0);
            add_block_product(&self.diagonal[node], false, &x.data[3 * m * node..][..3 * m], rows, m);
            for (other, edge, transposed) in self.neighbours(node) {
                add_block_product(&self.blocks[edge], transposed, &x.data[3 * m * other..][..3 * m], rows, m);
            }
        });
    }

    /// The principal submatrix on `keep` (ascending node indices), numbered in that order.
    pub fn restrict(&self, keep: &[u32]) -> StiffnessMatrix {
        let mut index = vec![u32::MAX; self.nodes()];
        for (new, &old) in keep.iter().enumerate() {
            index[old as usize] = new as u32;
        }
        let kept: Vec<usize> = (0..self.edges.len())
            .filter(|&e| self.edges[e].iter().all(|&node| index[node as usize] != u32::MAX))
            .collect();
        let edges = kept.iter().map(|&e| self.edges[e].map(|node| index[node as usize])).collect();
        let mut restricted = StiffnessMatrix::zeros(keep.len(), edges);
        for (new, &old) in keep.iter().enumerate() {
            restricted.diagonal[new] = self.diagonal[old as usize];
        }
        for (new, &old) in kept.iter().enumerate() {
            restricted.blocks[new] = self.blocks[old];
        }
        restricted
    }
}

fn starts(nodes: usize, keys: impl Iterator<Item = u32>) -> Vec<usize> {
    let mut start = vec![0; nodes + 1];
    for key in keys {
        start[key as usize + 1] += 1;
    }
    for i in 0..nodes {
        start[i + 1] += start[i];
    }
    start
}

/// y += M x (or Mᵀ x) for 3 × m row-major x and y.
fn add_block_product(block: &Matrix3<f64>, transposed: bool, x: &[f64], y: &mut [f64], m: usize) {
    for r in 0..3 {
        let row = if transposed { block.column(r).transpose() } else { block.row(r).clone_owned() };
        let out = &mut y[r * m..][..m];
        for c in 0..m {
            out[c] += row[0] * x[c] + row[1] * x[m + c] + row[2] * x[2 * m + c];
        }
    }
}
