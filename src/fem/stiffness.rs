//! The symmetric stiffness matrix in 3×3 blocks (diagonal blocks on nodes, off-diagonal blocks on edges), and several nodal
//! vector fields in one array, as the solvers use them ([`NodeFields`]).

use crate::base::lanes;
use crate::base::lanes::{Kernel, fused64};
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
    /// Places of the nodes at rest, m, from which the rigid motions follow; empty if they are unknown.
    pub places: Vec<[f64; 3]>,
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
            places: Vec::new(),
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
        /// Nodes that one thread works on at a time.
        const NODES: usize = 64;
        let m = x.columns.max(1);
        y.data.par_chunks_mut(3 * m * NODES).enumerate().for_each(|(part, rows)| {
            lanes::run(Product { matrix: self, first: part * NODES, x, rows });
        });
    }

    /// |K|, entry by entry: |K| |x| are the sizes of the terms of which K x is the sum.
    pub fn magnitudes(&self) -> StiffnessMatrix {
        let mut sizes = self.clone();
        sizes.diagonal.iter_mut().chain(&mut sizes.blocks).for_each(|block| *block = block.abs());
        sizes
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
        if !self.places.is_empty() {
            restricted.places = keep.iter().map(|&node| self.places[node as usize]).collect();
        }
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

/// Rows of K x, of the nodes from `first` on.
struct Product<'a> {
    matrix: &'a StiffnessMatrix,
    first: usize,
    x: &'a NodeFields,
    rows: &'a mut [f64],
}

impl Kernel for Product<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let m = self.x.columns;
        for (number, rows) in self.rows.chunks_exact_mut(3 * m).enumerate() {
            let mut column = 0;
            while column + 8 <= m {
                self.matrix.row::<FUSED, 8>(self.first + number, column, self.x, rows);
                column += 8;
            }
            while column + 4 <= m {
                self.matrix.row::<FUSED, 4>(self.first + number, column, self.x, rows);
                column += 4;
            }
            while column < m {
                self.matrix.row::<FUSED, 1>(self.first + number, column, self.x, rows);
                column += 1;
            }
        }
    }
}

impl StiffnessMatrix {
    /// `T` columns of one node's rows of K x.
    #[inline(always)]
    fn row<const FUSED: bool, const T: usize>(
        &self,
        node: usize,
        column: usize,
        x: &NodeFields,
        rows: &mut [f64],
    ) {
        let m = x.columns;
        let mut sum = [[0.0; T]; 3];
        add_product::<FUSED, false, T>(&self.diagonal[node], &x.data[3 * m * node + column..], m, &mut sum);
        // First those below, whose blocks are transposed, as `neighbours` has them.
        for &(other, edge) in &self.lower[self.lower_start[node]..self.lower_start[node + 1]] {
            let x = &x.data[3 * m * other as usize + column..];
            add_product::<FUSED, true, T>(&self.blocks[edge as usize], x, m, &mut sum);
        }
        let above = self.edge_start[node]..self.edge_start[node + 1];
        for (edge, block) in self.edges[above.clone()].iter().zip(&self.blocks[above]) {
            let x = &x.data[3 * m * edge[1] as usize + column..];
            add_product::<FUSED, false, T>(block, x, m, &mut sum);
        }
        for r in 0..3 {
            *lanes::lanes_mut(rows, r * m + column) = sum[r];
        }
    }
}

/// sum += M x (or Mᵀ x) for `T` columns of x, whose rows are `m` apart.
#[inline(always)]
fn add_product<const FUSED: bool, const TRANSPOSED: bool, const T: usize>(
    block: &Matrix3<f64>,
    x: &[f64],
    m: usize,
    sum: &mut [[f64; T]; 3],
) {
    let numbers = &block.data.0;
    for k in 0..3 {
        let x = lanes::lanes::<T, f64>(x, k * m);
        for r in 0..3 {
            let a = if TRANSPOSED { numbers[r][k] } else { numbers[k][r] };
            for t in 0..T {
                sum[r][t] = fused64::<FUSED>(a, x[t], sum[r][t]);
            }
        }
    }
}

/// `columns` vector fields over `nodes` nodes, row-major: entry (3·node + axis, column).
///
/// All columns of one node are adjacent in memory, so that one pass over a matrix multiplies all of them.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeFields {
    pub nodes: usize,
    pub columns: usize,
    pub data: Vec<f64>,
}

impl NodeFields {
    pub fn zeros(nodes: usize, columns: usize) -> NodeFields {
        NodeFields { nodes, columns, data: vec![0.0; 3 * nodes * columns] }
    }

    /// Unit fields: three columns for each node, 1 along x, y and z.
    pub fn unit(nodes: usize) -> NodeFields {
        let mut unit = NodeFields::zeros(nodes, 3 * nodes);
        (0..3 * nodes).for_each(|i| unit.row_mut(i)[i] = 1.0);
        unit
    }

    /// The `columns` values of unknown `row` = 3·node + axis.
    pub fn row(&self, row: usize) -> &[f64] {
        &self.data[row * self.columns..][..self.columns]
    }

    pub fn row_mut(&mut self, row: usize) -> &mut [f64] {
        &mut self.data[row * self.columns..][..self.columns]
    }

    /// The fields at some nodes, in their order.
    pub fn at(&self, nodes: &[u32]) -> NodeFields {
        let rows = nodes.iter().flat_map(|&node| (0..3).map(move |axis| 3 * node as usize + axis));
        let data = rows.flat_map(|row| self.row(row)).copied().collect();
        NodeFields { nodes: nodes.len(), columns: self.columns, data }
    }

    /// Euclidean norm of every column.
    pub fn norms(&self) -> Vec<f64> {
        self.dots(self).into_iter().map(f64::sqrt).collect()
    }

    /// Dot product of every column with the same column of `other`; summed in blocks of fixed size, so the bits
    /// do not depend on the number of threads.
    pub fn dots(&self, other: &NodeFields) -> Vec<f64> {
        const ROWS: usize = 4096;
        let chunk = ROWS * self.columns.max(1);
        let partial: Vec<Vec<f64>> = self
            .data
            .par_chunks(chunk)
            .zip(other.data.par_chunks(chunk))
            .map(|(a, b)| {
                let mut sums = vec![0.0; self.columns];
                for (x, y) in a.chunks_exact(self.columns).zip(b.chunks_exact(self.columns)) {
                    for c in 0..self.columns {
                        sums[c] += x[c] * y[c];
                    }
                }
                sums
            })
            .collect();
        let mut total = vec![0.0; self.columns];
        for sums in partial {
            for (t, s) in total.iter_mut().zip(sums) {
                *t += s;
            }
        }
        total
    }
}
