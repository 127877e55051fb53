//! The mutual strain energies of displacement fields, S_ij = a(u_i, u_j), element by element.
//!
//! In: elements and fields over all nodes. Out: the symmetric matrix
//!
//! ```text
//! S_ij = Σ_e Σ_q w_q s_q(u_i) s_q(u_j)        s_q(u) = Σ_a g_a · (u_a - u_0)        N/m for fields without unit
//! ```
//!
//! with the strains s_q of element e and the stiffness w_q that belongs to each. It equals u_iᵀ K u_j, but is computed
//! from the motion of an element's nodes relative to one of them, which is exactly zero where a part is only shifted.
//! In u_iᵀ K u_j that zero is the difference of sums of the size of K. Where u_i and u_j are equilibria for prescribed
//! nodes, the errors δ of their free nodes enter as a(δ_i, δ_j) alone, the square of what they do to a force K u: a(u,
//! δ) = 0 (Galerkin's orthogonality; Strang and Fix, An Analysis of the Finite Element Method, chapter 1).

use super::stiffness::NodeFields;
use nalgebra::{DMatrix, DMatrixView, Vector3};
use rayon::prelude::*;

/// A set of elements whose strains can be computed.
pub trait Strains: Sync {
    fn elements(&self) -> usize;

    /// Appends the strains of one element in all fields.
    fn strains(&self, element: usize, fields: &NodeFields, out: &mut StrainRows);
}

/// Strains of some elements: `values` holds one row after another, with one number per field; `weights` holds the
/// stiffness that belongs to each row.
#[derive(Default)]
pub struct StrainRows {
    pub weights: Vec<f64>,
    pub values: Vec<f64>,
}

impl StrainRows {
    /// Appends Σ_a g_a · (u_a - u_0), u_0 being that of the first node.
    pub fn push(&mut self, weight: f64, nodes: &[u32], gradients: &[Vector3<f64>], fields: &NodeFields) {
        let start = self.row(weight, fields.columns);
        let own = &mut self.values[start..];
        let Some((&first, others)) = nodes.split_first() else { return };
        for (&node, gradient) in others.iter().zip(&gradients[1..]) {
            for axis in 0..3 {
                let (u, u0) = (fields.row(3 * node as usize + axis), fields.row(3 * first as usize + axis));
                for ((own, u), u0) in own.iter_mut().zip(u).zip(u0) {
                    *own += gradient[axis] * (u - u0);
                }
            }
        }
    }

    /// Appends the six strains at a point with shape gradients `gradients`, and their trace: together
    /// V (λ tr ε tr ε + 2 μ ε:ε), where `lambda` and `mu` are λ V and μ V, N m.
    pub fn push_point(
        &mut self,
        (lambda, mu): (f64, f64),
        nodes: &[u32],
        gradients: &[Vector3<f64>],
        fields: &NodeFields,
    ) {
        let m = fields.columns;
        let start = self.values.len();
        for weight in [2.0 * mu, 2.0 * mu, 2.0 * mu, mu, mu, mu, lambda] {
            self.row(weight, m);
        }
        let own = &mut self.values[start..];
        let Some((&first, others)) = nodes.split_first() else { return };
        for (&node, gradient) in others.iter().zip(&gradients[1..]) {
            for axis in 0..3 {
                let (u, u0) = (fields.row(3 * node as usize + axis), fields.row(3 * first as usize + axis));
                // Of ∂u_axis/∂x_j: the normal strain, or its share in one of γ_12, γ_13, γ_23.
                for j in 0..3 {
                    let strain = if j == axis { axis } else { 2 + axis + j };
                    let row = &mut own[strain * m..][..m];
                    for ((row, u), u0) in row.iter_mut().zip(u).zip(u0) {
                        *row += gradient[j] * (u - u0);
                    }
                }
            }
        }
        let (normal, rest) = own.split_at_mut(3 * m);
        for (c, trace) in rest[3 * m..].iter_mut().enumerate() {
            *trace = normal[c] + normal[m + c] + normal[2 * m + c];
        }
    }

    /// Appends a row of zeros, and returns where it starts.
    fn row(&mut self, weight: f64, columns: usize) -> usize {
        let start = self.values.len();
        self.weights.push(weight);
        self.values.resize(start + columns, 0.0);
        start
    }

    /// Adds Σ_q w_q s_q s_qᵀ to `sum` and clears the strains.
    fn add_to(&mut self, sum: &mut DMatrix<f64>) {
        let (m, n) = (sum.nrows(), self.weights.len());
        let strains = DMatrixView::from_slice(&self.values, m, n);
        let stresses = DMatrix::from_fn(n, m, |q, c| self.weights[q] * self.values[q * m + c]);
        sum.gemm(1.0, &strains, &stresses, 1.0);
        self.weights.clear();
        self.values.clear();
    }
}

/// Number of partial sums that are computed in parallel. It is fixed, so that the result has the same bits on every
/// number of threads.
const PARTS: usize = 64;
/// Rows of strains that are collected before they are multiplied.
const ROWS: usize = 512;

/// S_ij of all fields over all sets of elements.
pub fn mutual_energies<S: Strains + ?Sized>(sets: &[Box<S>], fields: &NodeFields) -> DMatrix<f64> {
    let m = fields.columns;
    let mut total = DMatrix::zeros(m, m);
    for set in sets {
        let width = set.elements().div_ceil(PARTS).max(1);
        let parts: Vec<DMatrix<f64>> = (0..set.elements().div_ceil(width))
            .into_par_iter()
            .map(|part| {
                let (mut sum, mut rows) = (DMatrix::zeros(m, m), StrainRows::default());
                for element in part * width..((part + 1) * width).min(set.elements()) {
                    set.strains(element, fields, &mut rows);
                    if rows.weights.len() >= ROWS {
                        rows.add_to(&mut sum);
                    }
                }
                rows.add_to(&mut sum);
                sum
            })
            .collect();
        parts.iter().for_each(|part| total += part);
    }
    (&total + total.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, StiffnessMatrix, TET4, TET4_ANP, TET10};
    use crate::mesh::{Block, TetMesh, block, quadratic};

    fn body() -> (TetMesh, Vec<Lame>) {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [2, 2, 2] }).unwrap();
        let soft =
            |tet: usize| Lame::from_young_poisson(1.0 + (tet % 3) as f64, 0.37 - 0.4 * (tet % 2) as f64);
        let lame = (0..mesh.tets.len()).map(soft).collect();
        (mesh, lame)
    }

    fn some_fields(nodes: usize) -> NodeFields {
        let mut fields = NodeFields::zeros(nodes, 7);
        fields.data.iter_mut().enumerate().for_each(|(i, u)| *u = (1.7 * i as f64).sin());
        fields
    }

    fn by_matrix(k: &StiffnessMatrix, fields: &NodeFields) -> DMatrix<f64> {
        let mut force = NodeFields::zeros(fields.nodes, fields.columns);
        k.multiply(fields, &mut force);
        let dense = |f: &NodeFields| DMatrix::from_row_slice(3 * f.nodes, f.columns, &f.data);
        dense(fields).transpose() * dense(&force)
    }

    /// The energies agree with uᵀ K u for every element and any fields.
    #[test]
    fn energies_are_those_of_the_stiffness_matrix() {
        let (mesh, lame) = body();
        let bulged = |a: &Vector3<f64>, b: &Vector3<f64>| (a + b) * 0.5 + (a - b).cross(&Vector3::x()) * 0.05;
        let straight = quadratic::quadratic(mesh.clone(), &quadratic::straight);
        let curved = quadratic::quadratic(mesh.clone(), &bulged);
        let cases = [(&TET4, &mesh), (&TET4_ANP, &mesh), (&TET10, &straight), (&TET10, &curved)];
        for (element, mesh) in cases {
            let fields = some_fields(mesh.nodes.len());
            let expected = by_matrix(&element.assemble(mesh, &lame).unwrap(), &fields);
            let found = element.energies(mesh, &lame, &fields).unwrap();
            assert!((&found - &expected).amax() < 1e-13 * expected.amax(), "{found}{expected}");
        }
    }

    /// A translation has exactly no energy, and a rotation the square of a rounding error, however stiff the body is.
    #[test]
    fn rigid_motions_cost_nothing() {
        let (mesh, _) = body();
        let lame = vec![Lame::from_young_poisson(1e20, 0.3); mesh.tets.len()];
        let mut fields = NodeFields::zeros(mesh.nodes.len(), 2);
        for (node, x) in mesh.nodes.iter().enumerate() {
            for axis in 0..3 {
                let turned = Vector3::new(0.3, -0.5, 0.7).cross(x)[axis];
                fields.row_mut(3 * node + axis).copy_from_slice(&[1.1, turned]);
            }
        }
        for element in [&TET4, &TET4_ANP] {
            let found = element.energies(&mesh, &lame, &fields).unwrap();
            assert!(found[(0, 0)] == 0.0 && found[(1, 1)].abs() < 1e-10, "{found}");
        }
    }
}
