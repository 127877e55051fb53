//! Hyperelasticity at large strain: linear tetrahedra whose forces come from an energy density ψ(F), total Lagrangian.
//!
//! In: a material law, a mesh at rest and displacements u. Out: energy, nodal forces and the tangent stiffness. With
//! H = Σ u_a⊗G_a and F = I + H, constant in a tetrahedron of volume V:
//!
//! ```text
//! W = Σ V ψ(H)     f_a = Σ V P G_a     K_ab = Σ V G_aJ C_iJkL G_bL     P = ∂ψ/∂F     C = ∂P/∂F
//! ```
//!
//! (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., sections 6.3, 9.3 and 9.4.)

use super::assembly::{Elements, assemble_elements};
use super::fields::NodeFields;
use super::lame::Lame;
use super::stiffness::StiffnessMatrix;
use super::tet4::Geometry;
use nalgebra::{Matrix3, SMatrix, Vector3};
use rayon::prelude::*;

/// C = ∂P/∂F, Pa: row 3 J + i belongs to P_iJ, column 3 L + k to F_kL, as nalgebra stores a 3×3 matrix.
pub type Tangent = SMatrix<f64, 9, 9>;

/// A material law. Its functions take H = F - I instead of F, so that small strains keep their digits.
#[derive(Debug)]
pub struct Law {
    /// As a scene's `model` names it.
    pub name: &'static str,
    /// The method of the paper that it belongs to, and what it is good for.
    pub summary: &'static str,
    /// What to do where a body of this material has no equilibrium.
    pub remedy: &'static str,
    /// ψ, J/m³; 0 at rest.
    pub energy: fn(&Matrix3<f64>, Lame) -> f64,
    /// First Piola–Kirchhoff stress P = ∂ψ/∂F, Pa; at rest 0, and for small H that of Hooke's law.
    pub stress: fn(&Matrix3<f64>, Lame) -> Matrix3<f64>,
    pub tangent: fn(&Matrix3<f64>, Lame) -> Tangent,
}

/// The tetrahedra of a body and their law.
#[derive(Clone, Copy)]
pub struct Hyperelastic<'a> {
    pub law: &'static Law,
    pub tets: &'a [[u32; 4]],
    /// Geometry of the tetrahedra at rest.
    pub geometry: &'a [Geometry],
    pub lame: &'a [Lame],
}

impl Hyperelastic<'_> {
    /// H of every tetrahedron under the displacements `u`, one column over the nodes.
    pub fn gradients(&self, u: &NodeFields) -> Vec<Matrix3<f64>> {
        let at = |node: u32| Vector3::from_column_slice(&u.data[3 * node as usize..][..3]);
        let gradient = |(nodes, element): (&[u32; 4], &Geometry)| {
            // Relative to corner 0, so that a body far from where it rested keeps its strain.
            let origin = at(nodes[0]);
            (1..4).map(|a| (at(nodes[a]) - origin) * element.gradients[a].transpose()).sum()
        };
        self.tets.par_iter().zip(self.geometry).with_min_len(1024).map(gradient).collect()
    }

    /// The energy W, J.
    pub fn energy(&self, gradients: &[Matrix3<f64>]) -> f64 {
        let energies: Vec<f64> = gradients
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(e, h)| self.geometry[e].volume * (self.law.energy)(h, self.lame[e]))
            .collect();
        // One after another, so that the bits do not depend on the number of threads.
        energies.iter().sum()
    }

    /// How large the rounding error of the energy may be, J: where a body is turned far, the terms of ψ cancel.
    pub fn energy_rounding(&self, gradients: &[Matrix3<f64>]) -> f64 {
        let terms = |(e, h): (usize, &Matrix3<f64>)| {
            self.geometry[e].volume * (self.lame[e].lambda.abs() + 2.0 * self.lame[e].mu) * h.norm_squared()
        };
        8.0 * f64::EPSILON * gradients.iter().enumerate().map(terms).sum::<f64>()
    }

    /// Forces f over `nodes` nodes, N, that hold the body in this state: ∂W/∂u.
    pub fn forces(&self, gradients: &[Matrix3<f64>], nodes: usize) -> NodeFields {
        let stresses: Vec<Matrix3<f64>> = gradients
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(e, h)| (self.law.stress)(h, self.lame[e]) * self.geometry[e].volume)
            .collect();
        let mut forces = NodeFields::zeros(nodes, 1);
        for ((corners, element), stress) in self.tets.iter().zip(self.geometry).zip(&stresses) {
            for (&node, gradient) in corners.iter().zip(&element.gradients) {
                let force = stress * gradient;
                for axis in 0..3 {
                    forces.data[3 * node as usize + axis] += force[axis];
                }
            }
        }
        forces
    }

    /// The tangent stiffness K = ∂f/∂u over `nodes` nodes, N/m.
    pub fn tangent(&self, gradients: &[Matrix3<f64>], nodes: usize) -> StiffnessMatrix {
        assemble_elements(nodes, &[Box::new(Displaced { body: self, gradients })])
    }
}

/// The tetrahedra in one state.
struct Displaced<'a> {
    body: &'a Hyperelastic<'a>,
    gradients: &'a [Matrix3<f64>],
}

impl Elements for Displaced<'_> {
    fn count(&self) -> usize {
        self.body.tets.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.body.tets[element]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let Geometry { volume, gradients } = &self.body.geometry[element];
        let c = (self.body.law.tangent)(&self.gradients[element], self.body.lame[element]);
        // The three rows i of V G_aJ C_iJkL.
        let rows: SMatrix<f64, 3, 9> =
            (0..3).map(|j| c.fixed_rows::<3>(3 * j) * (volume * gradients[a][j])).sum();
        for (block, gradient) in out.iter_mut().zip(gradients) {
            *block = (0..3).map(|l| rows.fixed_columns::<3>(3 * l) * gradient[l]).sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{LAWS, tet4};
    use nalgebra::Rotation3;

    const LAME: Lame = Lame { lambda: 2.0, mu: 1.0 };

    fn sample() -> Matrix3<f64> {
        Matrix3::new(0.2, 0.1, -0.05, 0.2, -0.1, 0.15, -0.1, 0.05, 0.1)
    }

    #[test]
    fn stress_and_tangent_are_the_derivatives_of_the_energy() {
        for law in LAWS {
            let (h, step) = (sample(), 1e-5);
            let (p, c) = ((law.stress)(&h, LAME), (law.tangent)(&h, LAME));
            assert!((c - c.transpose()).amax() < 1e-14 * c.amax(), "{}: ∂²ψ is symmetric", law.name);
            for entry in 0..9 {
                let (mut plus, mut minus) = (h, h);
                plus[entry] += step;
                minus[entry] -= step;
                let slope = ((law.energy)(&plus, LAME) - (law.energy)(&minus, LAME)) / (2.0 * step);
                assert!(
                    (slope - p[entry]).abs() < 1e-9,
                    "{} P{entry}: {slope} against {}",
                    law.name,
                    p[entry]
                );
                let change = ((law.stress)(&plus, LAME) - (law.stress)(&minus, LAME)) / (2.0 * step);
                for (row, change) in change.iter().enumerate() {
                    let off = change - c[(row, entry)];
                    assert!(off.abs() < 1e-9, "{} C({row}, {entry}): {off:e}", law.name);
                }
            }
        }
    }

    /// ψ(Q F) = ψ(F) and P(Q F) = Q P(F).
    #[test]
    fn turning_the_body_turns_its_stress_and_costs_nothing() {
        let q = *Rotation3::from_scaled_axis(Vector3::new(0.4, -1.1, 2.0)).matrix();
        for law in LAWS {
            let f = Matrix3::identity() + sample();
            let turned = q * f - Matrix3::identity();
            let (before, after) = ((law.energy)(&sample(), LAME), (law.energy)(&turned, LAME));
            assert!((before - after).abs() < 1e-14, "{}: {before} and {after}", law.name);
            let off = (law.stress)(&turned, LAME) - q * (law.stress)(&sample(), LAME);
            assert!(off.amax() < 1e-14, "{}: {off}", law.name);
            let rigid = (law.stress)(&(q - Matrix3::identity()), LAME);
            assert!(rigid.amax() < 1e-14, "{}: {rigid}", law.name);
        }
    }

    #[test]
    fn every_law_is_hookes_law_for_small_strain() {
        let element =
            tet4::geometry([Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::new(0.3, 0.2, 1.0)])
                .unwrap();
        for law in LAWS {
            let body = Hyperelastic { law, tets: &[[0, 1, 2, 3]], geometry: &[element], lame: &[LAME] };
            let k = body.tangent(&[Matrix3::zeros()], 4);
            for (edge, block) in k.edges.iter().zip(&k.blocks) {
                let linear = tet4::stiffness_block(&element, LAME, edge[0] as usize, edge[1] as usize);
                assert!((block - linear).amax() < 1e-14, "{}: {edge:?}", law.name);
            }
        }
    }
}
