//! Several nodal vector fields in one array, as the solvers use them.

use rayon::prelude::*;

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
