//! Points of elements at which a part's strains are taken, and what the energy's terms need there.

use crate::fem::{Lame, NodeFields};
use nalgebra::{DMatrix, Matrix3, Vector3};

/// A point of an element at which strains are taken: a tetrahedron's centre, or a point of its quadrature.
pub struct StrainPoint {
    pub nodes: Vec<u32>,
    /// ∇N of these nodes, 1/m.
    pub gradients: Vec<Vector3<f64>>,
    /// m³.
    pub volume: f64,
    pub lame: Lame,
    /// Whether it belongs to the part itself, not to the surroundings.
    pub is_own: bool,
}

/// λ tr ε I + 2 μ ε of ε = sym H.
pub fn stress(lame: Lame, h: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * (lame.lambda * h.trace()) + (h + h.transpose()) * lame.mu
}

/// H = Σ (u_a - u_0) ⊗ G_a of every field at a point.
pub fn gradients(point: &StrainPoint, fields: &NodeFields) -> Vec<Matrix3<f64>> {
    let mut h = vec![Matrix3::zeros(); fields.columns];
    let Some((&base, others)) = point.nodes.split_first() else { return h };
    for (&node, gradient) in others.iter().zip(&point.gradients[1..]) {
        for axis in 0..3 {
            let (u, u0) = (fields.row(3 * node as usize + axis), fields.row(3 * base as usize + axis));
            for (h, (u, u0)) in h.iter_mut().zip(u.iter().zip(u0)) {
                for j in 0..3 {
                    h[(axis, j)] += (u - u0) * gradient[j];
                }
            }
        }
    }
    h
}

/// Rows of one point: stresses and strains of second order, a column for each pair, then H_iσ_j + H_jσ_i and ∇w.
pub struct QuarticRows {
    left: DMatrix<f64>,
    right: DMatrix<f64>,
}

impl QuarticRows {
    pub fn new(pairs: usize) -> QuarticRows {
        QuarticRows { left: DMatrix::zeros(18, pairs), right: DMatrix::zeros(18, pairs) }
    }

    pub fn set(
        &mut self,
        pair: usize,
        stress: &Matrix3<f64>,
        strain: &Matrix3<f64>,
        turned: &Matrix3<f64>,
        w: &Matrix3<f64>,
    ) {
        let strain = (strain + strain.transpose()) * 0.5;
        let put = |to: &mut DMatrix<f64>, first: &Matrix3<f64>, last: &Matrix3<f64>| {
            let values = first.iter().chain(last.iter());
            to.column_mut(pair).iter_mut().zip(values).for_each(|(to, value)| *to = *value);
        };
        put(&mut self.left, stress, turned);
        put(&mut self.right, &strain, w);
    }

    pub fn add_to(&self, sum: &mut DMatrix<f64>) {
        sum.gemm_tr(1.0, &self.left, &self.right, 1.0);
    }
}
