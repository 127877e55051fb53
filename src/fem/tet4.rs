//! The linear tetrahedron: shape gradients and its 12×12 stiffness in 3×3 blocks.
//!
//! u(x) = Σ N_a(x) u_a with constant gradients G_a = ∇N_a, so strain and stress are constant and one
//! quadrature point is exact (Zienkiewicz and Taylor, vol. 1, 5th ed., section 6.2; mind the sign of the cyclic
//! interchange in its equation 6.5b, which the paper's reference 13 points out).

use super::assembly::{AssemblyError, ElementSet, Elements};
use super::element::{Dilatation, Element};
use super::energy::{StrainRows, Strains};
use super::lame::Lame;
use super::stiffness::NodeFields;
use super::strain_points::StrainPoints;
use crate::mesh::diagnostics::FLAT;
use crate::mesh::{TetMesh, quality};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// The linear tetrahedron.
pub const TET4: Element = Element {
    name: "tet4",
    order: 1,
    dilatation: Dilatation::Own,
    locks: true,
    pairs: [1.0, 0.0, 0.0],
    unknown_cost: 1.0,
    sets: |mesh, lame| Ok(vec![Box::new(Tetrahedra::new(mesh, lame)?)]),
    points: |mesh, lame| Ok(Tetrahedra::new(mesh, lame)?.points(false)),
};

/// Volume and shape gradients of one tetrahedron.
#[derive(Clone, Copy, Debug)]
pub struct Geometry {
    /// Signed volume, m³.
    pub volume: f64,
    /// G_a = ∇N_a, 1/m; Σ G_a = 0.
    pub gradients: [Vector3<f64>; 4],
}

/// Geometry of the tetrahedron `x`, or `None` where its volume is exactly zero or not finite.
///
/// With D = [x₁-x₀, x₂-x₀, x₃-x₀]: V = det D / 6, and the rows of D⁻¹ are G₁, G₂, G₃.
pub fn geometry(x: [Vector3<f64>; 4]) -> Option<Geometry> {
    let (a, b, c) = (x[1] - x[0], x[2] - x[0], x[3] - x[0]);
    let det = a.dot(&b.cross(&c));
    if det == 0.0 || !det.is_finite() {
        return None;
    }
    let (g1, g2, g3) = (b.cross(&c) / det, c.cross(&a) / det, a.cross(&b) / det);
    Some(Geometry { volume: det / 6.0, gradients: [-(g1 + g2 + g3), g1, g2, g3] })
}

/// Block K_ab = V (λ G_a⊗G_b + μ G_b⊗G_a + μ (G_a·G_b) I), N/m.
pub fn stiffness_block(element: &Geometry, lame: Lame, a: usize, b: usize) -> Matrix3<f64> {
    let (ga, gb) = (element.gradients[a], element.gradients[b]);
    let shear = Matrix3::from_diagonal_element(lame.mu * ga.dot(&gb));
    (ga * gb.transpose() * lame.lambda + gb * ga.transpose() * lame.mu + shear) * element.volume
}

/// The linear tetrahedra of a mesh, with Lamé's constants for each.
pub struct Tetrahedra<'a> {
    pub mesh: &'a TetMesh,
    pub lame: Vec<Lame>,
    pub geometry: Vec<Geometry>,
}

impl<'a> Tetrahedra<'a> {
    /// Errors where a tetrahedron is flat or inverted.
    pub fn new(mesh: &'a TetMesh, lame: &[Lame]) -> Result<Tetrahedra<'a>, AssemblyError> {
        let geometry = (0..mesh.tets.len())
            .into_par_iter()
            .map(|index| {
                let x = mesh.corners(index);
                let relative = quality::quality(&x);
                // Written so that a NaN is refused too.
                match geometry(x) {
                    Some(element) if relative >= FLAT => Ok(element),
                    element => Err(AssemblyError::Degenerate {
                        index,
                        tags: mesh.tets[index].map(|node| mesh.tags[node as usize]),
                        volume: element.map_or(0.0, |element| element.volume),
                        relative,
                    }),
                }
            })
            .collect::<Result<_, _>>()?;
        Ok(Tetrahedra { mesh, lame: lame.to_vec(), geometry })
    }

    /// The points at large strain, one for each element; `has_means`: their dilatation will be averaged.
    pub fn points(&self, has_means: bool) -> StrainPoints {
        let mut points = StrainPoints::new(4);
        for ((nodes, lame), element) in self.mesh.tets.iter().zip(&self.lame).zip(&self.geometry) {
            let point = (element.volume, element.gradients.as_slice());
            points.push(nodes, *lame, has_means, std::iter::once(point));
        }
        points
    }
}

impl ElementSet for Tetrahedra<'_> {}

impl Elements for Tetrahedra<'_> {
    fn count(&self) -> usize {
        self.mesh.tets.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.mesh.tets[element]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        for (b, block) in out.iter_mut().enumerate() {
            *block = stiffness_block(&self.geometry[element], self.lame[element], a, b);
        }
    }
}

impl Strains for Tetrahedra<'_> {
    fn elements(&self) -> usize {
        self.mesh.tets.len()
    }

    fn strains(&self, element: usize, fields: &NodeFields, out: &mut StrainRows) {
        let (Geometry { volume, gradients }, lame) = (&self.geometry[element], self.lame[element]);
        let stiffness = (lame.lambda * volume, lame.mu * volume);
        out.push_point(stiffness, &self.mesh.tets[element], gradients, fields);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit() -> [Vector3<f64>; 4] {
        [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()]
    }

    /// Closed form of the unit tetrahedron with E = 1, ν = 1/4 (λ = μ = 2/5, V = 1/6):
    /// K₀₀ has λ+3μ+… = 1/3 on its diagonal and (λ+μ)/6 = 2/15 off it.
    #[test]
    fn unit_tetrahedron_matches_its_closed_form() {
        let element = geometry(unit()).unwrap();
        let lame = Lame::from_young_poisson(1.0, 0.25);
        let k00 = stiffness_block(&element, lame, 0, 0);
        for i in 0..3 {
            for j in 0..3 {
                let expected = if i == j { 1.0 / 3.0 } else { 2.0 / 15.0 };
                assert!((k00[(i, j)] - expected).abs() < 1e-15, "{k00}");
            }
        }
        let k01 = stiffness_block(&element, lame, 0, 1);
        assert!((k01[(0, 0)] + 0.2).abs() < 1e-15 && (k01[(1, 0)] + 1.0 / 15.0).abs() < 1e-15, "{k01}");
    }

    /// K u = dW/du for W = V (λ/2 tr(ε)² + μ ε:ε), by central differences of the energy.
    #[test]
    fn stiffness_is_the_second_derivative_of_the_energy() {
        let x = [
            Vector3::new(0.1, -0.2, 0.3),
            Vector3::new(1.2, 0.1, -0.1),
            Vector3::new(0.2, 0.9, 0.2),
            Vector3::new(-0.1, 0.3, 1.4),
        ];
        let element = geometry(x).unwrap();
        let lame = Lame::from_young_poisson(2.5, 0.37);
        let energy = |u: &[Vector3<f64>; 4]| {
            let h: Matrix3<f64> = (0..4).map(|a| u[a] * element.gradients[a].transpose()).sum();
            let strain = (h + h.transpose()) * 0.5;
            element.volume * (0.5 * lame.lambda * strain.trace().powi(2) + lame.mu * strain.dot(&strain))
        };
        let u: [Vector3<f64>; 4] = std::array::from_fn(|a| {
            Vector3::new(0.3 - 0.1 * a as f64, 0.2 * a as f64, (a as f64 - 1.5).powi(2) * 0.1)
        });
        for a in 0..4 {
            let force: Vector3<f64> = (0..4).map(|b| stiffness_block(&element, lame, a, b) * u[b]).sum();
            for i in 0..3 {
                let (mut plus, mut minus) = (u, u);
                plus[a][i] += 1e-4;
                minus[a][i] -= 1e-4;
                let slope = (energy(&plus) - energy(&minus)) / 2e-4;
                assert!((force[i] - slope).abs() < 1e-10, "node {a} axis {i}: {} against {slope}", force[i]);
            }
        }
    }

    #[test]
    fn flat_tetrahedron_has_no_geometry() {
        assert!(
            geometry([Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::x() + Vector3::y()]).is_none()
        );
    }
}
