//! Norms of displacement fields over the volume of a body.

use crate::fem::{NodeFields, StiffnessMatrix, tet10};
use crate::mesh::{TetMesh, quadratic};
use nalgebra::Vector3;
use rayon::prelude::*;

/// L2 and energy norm of fields on the nodes of a quadratic mesh.
pub struct Norms<'a> {
    pub mesh: &'a TetMesh,
    /// K of its elements.
    pub stiffness: StiffnessMatrix,
}

impl Norms<'_> {
    /// (∫ |e|² dV / V)^½, m, by the rule of degree 3 on every tetrahedron.
    pub fn l2(&self, e: &[Vector3<f64>]) -> f64 {
        let terms: Vec<[f64; 2]> = (0..self.mesh.tets.len())
            .into_par_iter()
            .with_min_len(256)
            .map(|tet| {
                let nodes = quadratic::nodes(self.mesh, tet);
                let x = nodes.map(|node| self.mesh.nodes[node as usize]);
                let mut sum = [0.0; 2];
                for (at, weight) in tet10::CURVED {
                    let determinant = quadratic::jacobian(&x, &quadratic::local_gradients(at)).determinant();
                    let value: Vector3<f64> =
                        quadratic::shapes(at).iter().zip(nodes).map(|(n, node)| e[node as usize] * *n).sum();
                    sum[0] += weight * determinant * value.norm_squared();
                    sum[1] += weight * determinant;
                }
                sum
            })
            .collect();
        let sum = terms.iter().fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]]);
        (sum[0] / sum[1]).sqrt()
    }

    /// (½ eᵀ K e)^½, J^½.
    pub fn energy(&self, e: &[Vector3<f64>]) -> f64 {
        let data = e.iter().flat_map(|e| <[f64; 3]>::from(*e)).collect();
        let e = NodeFields { nodes: e.len(), columns: 1, data };
        let mut force = NodeFields::zeros(e.nodes, 1);
        self.stiffness.multiply(&e, &mut force);
        (0.5 * e.dots(&force)[0].max(0.0)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, assemble};
    use crate::mesh::{Block, block};

    /// |e|² = x² + 4 has the mean 1/12 + 4 on a centred unit cube; a uniform stretch ε has W/V = (λ + 2μ) ε²/2.
    #[test]
    fn norms_have_their_closed_forms() {
        let linear = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        let mesh = quadratic::quadratic(linear, &quadratic::straight);
        let lame = Lame::from_young_poisson(3.0, 0.2);
        let stiffness = assemble(&mesh, &vec![lame; mesh.tets.len()]).unwrap();
        let norms = Norms { mesh: &mesh, stiffness };
        let field: Vec<_> = mesh.nodes.iter().map(|x| Vector3::new(x.x, 2.0, 0.0)).collect();
        assert!((norms.l2(&field) - (1.0 / 12.0 + 4.0f64).sqrt()).abs() < 1e-14);
        let stretch: Vec<_> = mesh.nodes.iter().map(|x| Vector3::new(0.1 * x.x, 0.0, 0.0)).collect();
        let energy = 0.5 * (lame.lambda + 2.0 * lame.mu) * 0.01;
        assert!((norms.energy(&stretch) - energy.sqrt()).abs() < 1e-14);
    }
}
