//! The consistent mass matrix M_ab = ∫ ρ N_a N_b dV I of a mesh, with the shape functions of its elements.
//!
//! In: a mesh and the density of each tetrahedron. Out: M in 3×3 blocks, each a multiple of I, so that ½ vᵀMv is the kinetic
//! energy of every velocity field of the elements (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed., section
//! 17.2). All elements of one order have the same shape functions, hence the same mass.

use super::assembly::{Elements, assemble_elements};
use super::quadrature::tetrahedron_rule;
use super::stiffness::StiffnessMatrix;
use super::tet4;
use super::tet10;
use crate::mesh::{TetMesh, quadratic};
use nalgebra::Matrix3;
use rayon::prelude::*;

/// M, kg, of a mesh whose tetrahedra have these densities, kg/m³.
///
/// Exact: of a straight element by the closed form or a rule of degree 4, of a curved one, whose integrand has degree 7, by the
/// rule of that degree.
pub fn consistent_mass(mesh: &TetMesh, density: &[f64]) -> StiffnessMatrix {
    let masses: Box<dyn Elements> = match mesh.mids.is_empty() {
        true => Box::new(LinearMass::new(mesh, density)),
        false => Box::new(QuadraticMass::new(mesh, density)),
    };
    assemble_elements(mesh.nodes.len(), &[masses])
}

/// Linear tetrahedra: m_ab = ρ V / 20 (1 + δ_ab).
struct LinearMass<'a> {
    mesh: &'a TetMesh,
    /// ρ V / 20 of each tetrahedron, kg.
    scales: Vec<f64>,
}

impl<'a> LinearMass<'a> {
    fn new(mesh: &'a TetMesh, density: &[f64]) -> LinearMass<'a> {
        let volume = |tet| tet4::geometry(mesh.corners(tet)).map_or(0.0, |element| element.volume);
        let scales = density.iter().enumerate().map(|(tet, density)| density * volume(tet) / 20.0).collect();
        LinearMass { mesh, scales }
    }
}

impl Elements for LinearMass<'_> {
    fn count(&self) -> usize {
        self.scales.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.mesh.tets[element]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        for (b, block) in out.iter_mut().enumerate() {
            let share = if a == b { 2.0 } else { 1.0 };
            *block = Matrix3::from_diagonal_element(share * self.scales[element]);
        }
    }
}

/// ∫ N_a N_b dV / V of a straight quadratic tetrahedron, or ∫ ρ N_a N_b dV of a curved one.
type NodeProducts = [[f64; 10]; 10];

/// Quadratic tetrahedra.
struct QuadraticMass {
    nodes: Vec<[u32; 10]>,
    /// ρ V of each straight tetrahedron, kg; of a curved one the products themselves.
    masses: Vec<Result<f64, Box<NodeProducts>>>,
    straight: NodeProducts,
}

impl QuadraticMass {
    fn new(mesh: &TetMesh, density: &[f64]) -> QuadraticMass {
        let rule = tetrahedron_rule();
        let shapes: Vec<[f64; 10]> = rule.iter().map(|(at, _)| quadratic::shapes(at)).collect();
        let sum = |weight: &dyn Fn(usize) -> f64| {
            let mut products = [[0.0; 10]; 10];
            for (q, shapes) in shapes.iter().enumerate() {
                let weight = weight(q);
                for (row, a) in products.iter_mut().zip(shapes) {
                    row.iter_mut().zip(shapes).for_each(|(product, b)| *product += weight * a * b);
                }
            }
            products
        };
        let mass = |tet: usize| {
            let x = quadratic::nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
            let size = |q: usize| {
                let (at, weight) = &rule[q];
                weight * quadratic::jacobian(&x, &quadratic::local_gradients(at)).determinant() / 6.0
            };
            if tet10::is_straight(&x) {
                return Ok(density[tet] * (0..rule.len()).map(size).sum::<f64>());
            }
            Err(Box::new(sum(&|q| density[tet] * size(q))))
        };
        QuadraticMass {
            nodes: (0..mesh.tets.len()).map(|tet| quadratic::nodes(mesh, tet)).collect(),
            masses: (0..mesh.tets.len()).into_par_iter().map(mass).collect(),
            straight: sum(&|q| rule[q].1),
        }
    }
}

impl Elements for QuadraticMass {
    fn count(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.nodes[element]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let (row, scale) = match &self.masses[element] {
            Ok(mass) => (&self.straight[a], *mass),
            Err(products) => (&products[a], 1.0),
        };
        for (block, product) in out.iter_mut().zip(row) {
            *block = Matrix3::from_diagonal_element(scale * product);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::stiffness::NodeFields;
    use super::*;
    use crate::mesh::generate::Tube;
    use crate::mesh::{Block, block, generate};
    use nalgebra::Vector3;

    /// ½ vᵀMv of a turn about z with 1 rad/s, and of a shift with 1 m/s.
    fn energies(mesh: &TetMesh, density: &[f64]) -> [f64; 2] {
        let mut v = NodeFields::zeros(mesh.nodes.len(), 2);
        for (node, x) in mesh.nodes.iter().enumerate() {
            let turn = Vector3::z().cross(x);
            (0..3).for_each(|axis| v.row_mut(3 * node + axis).copy_from_slice(&[turn[axis], 0.0]));
            v.row_mut(3 * node)[1] = 1.0;
        }
        let mut product = NodeFields::zeros(v.nodes, 2);
        consistent_mass(mesh, density).multiply(&v, &mut product);
        let dots = v.dots(&product);
        [0.5 * dots[0], 0.5 * dots[1]]
    }

    /// A block of 2 × 1 × 3 m: mass 6 ρ, moment of inertia about z through its middle 6 ρ (2² + 1²)/12.
    #[test]
    fn rigid_motions_have_the_kinetic_energy_of_the_block() {
        let linear = block(&Block { size: [2.0, 1.0, 3.0], cells: [3, 2, 4] }).unwrap();
        let quadratic = quadratic::quadratic(linear.clone(), &quadratic::straight);
        for mesh in [linear, quadratic] {
            let density = vec![700.0; mesh.tets.len()];
            let [turn, shift] = energies(&mesh, &density);
            assert!((shift / (0.5 * 4200.0) - 1.0).abs() < 1e-13, "{shift}");
            assert!((turn / (0.5 * 4200.0 * 5.0 / 12.0) - 1.0).abs() < 1e-13, "{turn}");
        }
    }

    /// The mean of (N_a)² over a straight tetrahedron is 1/70 at corners and 8/105 between them: 6, 32 of 420 (Zienkiewicz and
    /// Taylor's shape functions, integrated by hand).
    #[test]
    fn quadratic_shapes_have_their_closed_products() {
        let mesh = block(&Block { size: [1.0; 3], cells: [1; 3] }).unwrap();
        let mesh = quadratic::quadratic(mesh, &quadratic::straight);
        let mass = QuadraticMass::new(&mesh, &vec![1.0; mesh.tets.len()]);
        assert!((mass.straight[0][0] - 1.0 / 70.0).abs() < 1e-14, "{}", mass.straight[0][0]);
        assert!((mass.straight[4][4] - 8.0 / 105.0).abs() < 1e-14, "{}", mass.straight[4][4]);
        assert!((mass.straight[0][1] - 1.0 / 420.0).abs() < 1e-14, "{}", mass.straight[0][1]);
    }

    /// A curved tube has the mass of its curved elements, that of the cylinder up to the error of parabolas.
    #[test]
    fn a_curved_tube_weighs_what_the_cylinder_does() {
        let tube = Tube {
            inner_radius: 0.5,
            outer_radius: 1.0,
            length: 2.0,
            radial: 1,
            around: 16,
            along: 2,
            control_length: 0.0,
        };
        let mesh = quadratic::quadratic(generate::tube(&tube).unwrap(), &|a, b| tube.curve(a, b));
        let [_, shift] = energies(&mesh, &vec![3.0; mesh.tets.len()]);
        let exact = 0.5 * 3.0 * std::f64::consts::PI * (1.0 - 0.25) * 2.0;
        assert!((shift / exact - 1.0).abs() < 1e-4, "{shift} {exact}");
    }
}
