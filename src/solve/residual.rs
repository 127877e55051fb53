//! True residuals of solutions, and the backward error of one column.

use crate::fem::{NodeFields, StiffnessMatrix};
use rayon::prelude::*;

/// ‖b - A x‖₂ / ‖b‖₂ of every column, and b - A x itself.
pub fn residuals(a: &StiffnessMatrix, x: &NodeFields, b: &NodeFields) -> (Vec<f64>, NodeFields) {
    let mut r = NodeFields::zeros(b.nodes, b.columns);
    a.multiply(x, &mut r);
    r.data.par_iter_mut().zip(&b.data).with_min_len(4096).for_each(|(r, b)| *r = b - *r);
    let relative = r.norms().iter().zip(b.norms()).map(|(r, b)| if b == 0.0 { 0.0 } else { r / b }).collect();
    (relative, r)
}

/// One column with its residual, and the sizes |A| |x| + |b| of its summands.
pub(super) struct Column {
    pub(super) x: NodeFields,
    pub(super) r: NodeFields,
    pub(super) sizes: NodeFields,
}

impl Column {
    pub(super) fn new(
        a: &StiffnessMatrix,
        x: &NodeFields,
        b: &NodeFields,
        r: &NodeFields,
        column: usize,
    ) -> Column {
        let one = |fields: &NodeFields| NodeFields {
            nodes: fields.nodes,
            columns: 1,
            data: (0..3 * fields.nodes).map(|row| fields.row(row)[column]).collect(),
        };
        let positive = |mut fields: NodeFields| {
            fields.data.iter_mut().for_each(|value| *value = value.abs());
            fields
        };
        let mut matrix = a.clone();
        matrix.diagonal.iter_mut().chain(&mut matrix.blocks).for_each(|block| *block = block.abs());
        let x = one(x);
        let mut sizes = NodeFields::zeros(a.nodes(), 1);
        matrix.multiply(&positive(x.clone()), &mut sizes);
        sizes.data.iter_mut().zip(positive(one(b)).data).for_each(|(size, b)| *size += b);
        Column { x, r: one(r), sizes }
    }

    /// ‖r‖₂ / ‖|A| |x| + |b|‖₂: rounding alone makes it some 1e-16.
    pub(super) fn normwise_error(&self) -> f64 {
        self.r.norms()[0] / self.sizes.norms()[0]
    }

    /// The componentwise backward error max_i |r_i| / (|A| |x| + |b|)_i (Arioli, Demmel and Duff, SIAM J. Matrix Anal.
    /// Appl. 10, 1989): how much A and b must be changed, relatively, for x to be exact.
    pub(super) fn backward_error(&self) -> f64 {
        let ratio = |(r, size): (&f64, &f64)| if *r == 0.0 { 0.0 } else { r.abs() / size };
        self.r
            .data
            .iter()
            .zip(&self.sizes.data)
            .map(ratio)
            .fold(0.0, |worst, ratio| if ratio > worst || ratio.is_nan() { ratio } else { worst })
    }
}
