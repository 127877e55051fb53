//! The coarsest level, solved by a dense Cholesky factor.

use super::rows::Rows;
use super::smooth::Vectors;
use crate::base::lanes::{LANES, lanes};
use nalgebra::DMatrix;

/// L of A = L Lᵀ.
pub struct Dense {
    factor: DMatrix<f64>,
    /// Lᵀ, so that both solves read along memory.
    transposed: DMatrix<f64>,
}

impl Dense {
    /// `None` where the matrix is not positive definite.
    pub fn new<const B: usize>(rows: &impl Rows<B>) -> Option<Dense> {
        let mut matrix = DMatrix::zeros(B * rows.nodes(), B * rows.nodes());
        for node in 0..rows.nodes() {
            let mut put = |other: usize, block: &[[f64; B]; B]| {
                for r in 0..B {
                    for c in 0..B {
                        matrix[(B * node + r, B * other + c)] = block[r][c];
                    }
                }
            };
            put(node, &rows.diagonal(node));
            rows.each(node, put);
        }
        let factor = matrix.cholesky()?.unpack();
        let transposed = factor.transpose();
        Some(Dense { factor, transposed })
    }

    /// x = A⁻¹ b.
    pub fn solve(&self, v: &mut Vectors) {
        let (m, size) = (v.columns, self.factor.nrows());
        for lane in (0..m).step_by(LANES) {
            let mut x: Vec<[f64; LANES]> =
                (0..size).map(|row| lanes::<LANES, f32>(&v.b, row * m + lane).map(f64::from)).collect();
            // Column `row` of Lᵀ is row `row` of L.
            for row in 0..size {
                let (known, rest) = x.split_at_mut(row);
                let along = &self.transposed.as_slice()[row * size..][..size];
                take(&mut rest[0], &along[..row], known, along[row]);
            }
            for row in (0..size).rev() {
                let (unknown, known) = x.split_at_mut(row + 1);
                let along = &self.factor.as_slice()[row * size..][..size];
                take(&mut unknown[row], &along[row + 1..], known, along[row]);
            }
            for (row, x) in x.iter().enumerate() {
                for t in 0..LANES {
                    v.x[row * m + lane + t] = x[t] as f32;
                }
            }
        }
    }
}

/// x ← (x - Σ a_k y_k) / pivot.
fn take(x: &mut [f64; LANES], a: &[f64], y: &[[f64; LANES]], pivot: f64) {
    for (a, y) in a.iter().zip(y) {
        for t in 0..LANES {
            x[t] -= a * y[t];
        }
    }
    x.iter_mut().for_each(|x| *x /= pivot);
}
