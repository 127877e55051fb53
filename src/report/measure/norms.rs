//! Norms of displacement fields over the volume of a body.

use crate::fem::quadrature::tetrahedron_rule;
use crate::fem::{NodeFields, StiffnessMatrix};
use crate::mesh::{TetMesh, quadratic};
use nalgebra::Vector3;
use rayon::prelude::*;

/// L2 and energy norm of fields on the nodes of a quadratic mesh.
pub struct Norms<'a> {
    pub mesh: &'a TetMesh,
    /// K of its elements.
    pub stiffness: StiffnessMatrix,
    /// The upper triangle of ∫ N_a N_b dV of every tetrahedron, row by row, m³.
    mass: Vec<[f64; 55]>,
    /// m³
    volume: f64,
}

impl<'a> Norms<'a> {
    /// Makes the norms of a mesh with its mids and K. Squares of quadratic fields are integrated without error, on elements with
    /// curved edges too: N_a N_b has degree 4, the determinant of the Jacobian 3, and the rule is exact to 7.
    pub fn new(mesh: &'a TetMesh, stiffness: StiffnessMatrix) -> Norms<'a> {
        let points: Vec<_> = tetrahedron_rule()
            .into_iter()
            .map(|(at, weight)| (weight / 6.0, quadratic::shapes(&at), quadratic::local_gradients(&at)))
            .collect();
        let of = |tet: usize| {
            let x = quadratic::nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
            let (mut mass, mut volume) = ([0.0; 55], 0.0);
            for (weight, shapes, gradients) in &points {
                let part = weight * quadratic::jacobian(&x, gradients).determinant();
                volume += part;
                let products = (0..10).flat_map(|a| (a..10).map(move |b| shapes[a] * shapes[b]));
                mass.iter_mut().zip(products).for_each(|(entry, product)| *entry += part * product);
            }
            (mass, volume)
        };
        let (mass, volumes): (Vec<_>, Vec<f64>) =
            (0..mesh.tets.len()).into_par_iter().with_min_len(64).map(of).unzip();
        Norms { mesh, stiffness, mass, volume: volumes.iter().sum() }
    }

    /// (∫ |e|² dV / V)^½, m.
    pub fn l2(&self, e: &[Vector3<f64>]) -> f64 {
        let of = |tet: usize| {
            let own = quadratic::nodes(self.mesh, tet).map(|node| e[node as usize]);
            let pairs = (0..10).flat_map(|a| (a..10).map(move |b| (a, b)));
            // Entries beside the diagonal stand for two.
            let terms = pairs.zip(&self.mass[tet]).map(|((a, b), mass)| {
                let count = if a == b { 1.0 } else { 2.0 };
                count * mass * own[a].dot(&own[b])
            });
            terms.sum::<f64>()
        };
        let terms: Vec<f64> = (0..self.mesh.tets.len()).into_par_iter().with_min_len(256).map(of).collect();
        (terms.iter().sum::<f64>().max(0.0) / self.volume).sqrt()
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
    use crate::fem::{Lame, TET10};
    use crate::mesh::{Block, block};

    /// |e|² = x² + 4 has the mean 1/12 + 4 on a centred unit cube; a uniform stretch ε has W/V = (λ + 2μ) ε²/2.
    #[test]
    fn norms_have_their_closed_forms() {
        let linear = block(&Block { size: [1.0; 3], cells: [2; 3] }).unwrap();
        let mesh = quadratic::quadratic(linear, &quadratic::straight);
        let lame = Lame::from_young_poisson(3.0, 0.2);
        let stiffness = TET10.assemble(&mesh, &vec![lame; mesh.tets.len()]).unwrap();
        let norms = Norms::new(&mesh, stiffness);
        let field: Vec<_> = mesh.nodes.iter().map(|x| Vector3::new(x.x, 2.0, 0.0)).collect();
        assert!((norms.l2(&field) - (1.0 / 12.0 + 4.0f64).sqrt()).abs() < 1e-14);
        let stretch: Vec<_> = mesh.nodes.iter().map(|x| Vector3::new(0.1 * x.x, 0.0, 0.0)).collect();
        let energy = 0.5 * (lame.lambda + 2.0 * lame.mu) * 0.01;
        assert!((norms.energy(&stretch) - energy.sqrt()).abs() < 1e-14);
    }

    /// |x²|² = x⁴ has the mean 1/80 on a centred unit cube, of whatever tetrahedra.
    #[test]
    fn squares_of_quadratic_fields_are_integrated_exactly() {
        let linear = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
        let mesh = quadratic::quadratic(linear, &quadratic::straight);
        let stiffness =
            TET10.assemble(&mesh, &vec![Lame::from_young_poisson(1.0, 0.3); mesh.tets.len()]).unwrap();
        let field: Vec<_> = mesh.nodes.iter().map(|x| Vector3::new(0.0, x.x * x.x, 0.0)).collect();
        let found = Norms::new(&mesh, stiffness).l2(&field);
        assert!((found - (1.0 / 80.0f64).sqrt()).abs() < 1e-14, "{found}");
    }
}
