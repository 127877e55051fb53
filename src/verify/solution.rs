//! Results of a solved body: displacements, stress, errors in the norms of L2 and of energy.

use super::quadrature;
use crate::fem::quadrature::tetrahedron_rule;
use crate::fem::{Dilatation, Element, Lame, tet4, tet10};
use crate::mesh::{TetMesh, quadratic, quality};
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

pub struct Solution {
    /// Displacement of each node, m.
    pub displacement: Vec<Vector3<f64>>,
    /// uᵀ K u / 2, J.
    pub energy: f64,
    /// Time from assembly to displacements, s.
    pub seconds: f64,
}

/// One quantity on one mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    pub quantity: String,
    pub nodes: usize,
    pub seconds: f64,
    pub value: f64,
    pub reference: f64,
    /// |value - reference| / |reference|, or a relative norm.
    pub error: f64,
    /// The relative accuracy of the reference; 0 where it is exact.
    pub known_to: f64,
    pub bound: Bound,
}

/// The requirement on the finest mesh; none where theory promises nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bound {
    /// Largest relative error.
    pub error: Option<f64>,
    /// Least rate.
    pub rate: Option<f64>,
}

impl Bound {
    pub const NONE: Bound = Bound { error: None, rate: None };

    pub const fn error(most: f64) -> Bound {
        Bound { error: Some(most), rate: None }
    }

    pub const fn rate(least: f64) -> Bound {
        Bound { error: None, rate: Some(least) }
    }
}

/// Relative errors against an exact field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Norms {
    /// ‖u_h - u‖ / ‖u‖ in L2.
    pub l2: f64,
    /// The relative error in the norm of ∫ 2μ |ε|² + λ θ², with the strain ε of the displacement and the θ that the element's
    /// energy has (its `Dilatation`).
    pub energy: f64,
}

/// An exact displacement and its gradient ∂u_i/∂x_j.
pub trait Exact {
    fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64>;
    fn gradient(&self, x: &Vector3<f64>) -> Matrix3<f64>;
}

impl Solution {
    /// A value beside its reference, which is `known_to` a relative accuracy.
    pub fn value(
        &self,
        quantity: impl Into<String>,
        value: f64,
        reference: f64,
        known_to: f64,
        bound: Bound,
    ) -> Measure {
        let error = (value - reference).abs() / reference.abs();
        let quantity = quantity.into();
        let (nodes, seconds) = (self.displacement.len(), self.seconds);
        Measure { quantity, nodes, seconds, value, reference, error, known_to, bound }
    }

    /// A relative error in some norm, whose reference is 0.
    pub fn norm(&self, quantity: impl Into<String>, error: f64, bound: Bound) -> Measure {
        let quantity = quantity.into();
        let (nodes, seconds) = (self.displacement.len(), self.seconds);
        Measure { quantity, nodes, seconds, value: error, reference: 0.0, error, known_to: 0.0, bound }
    }

    /// Relative errors against `exact`, by a rule of degree 7 on the mesh's own domain.
    pub fn norms(&self, mesh: &TetMesh, element: &Element, lame: Lame, exact: &impl Exact) -> Norms {
        let dilatations = self.dilatations(mesh, element);
        let energy = |strain: &Matrix3<f64>, dilatation: f64| {
            2.0 * lame.mu * strain.norm_squared() + lame.lambda * dilatation * dilatation
        };
        let (mut error, mut size) = ([0.0; 2], [0.0; 2]);
        for tet in 0..mesh.tets.len() {
            for (at, weight) in tetrahedron_rule() {
                let Some(point) = quadrature::point(mesh, tet, &at) else { continue };
                let volume = weight * point.determinant / 6.0;
                let (u, h) = self.field(&point);
                let (strain, exact_strain) = (symmetric(&h), symmetric(&exact.gradient(&point.x)));
                let dilatation: f64 = dilatations[tet].iter().zip(at).map(|(corner, l)| corner * l).sum();
                let exact_u = exact.displacement(&point.x);
                error[0] += volume * (u - exact_u).norm_squared();
                size[0] += volume * exact_u.norm_squared();
                let exact_dilatation = exact_strain.trace();
                error[1] += volume * energy(&(strain - exact_strain), dilatation - exact_dilatation);
                size[1] += volume * energy(&exact_strain, exact_dilatation);
            }
        }
        Norms { l2: (error[0] / size[0]).sqrt(), energy: (error[1] / size[1]).sqrt() }
    }

    /// σ = λ θ I + 2μ ε at a corner: the mean of the stresses that the tetrahedra around it have there, by their volumes.
    pub fn stress_at(&self, mesh: &TetMesh, element: &Element, lame: Lame, corner: usize) -> Matrix3<f64> {
        let dilatations = self.dilatations(mesh, element);
        let (mut sum, mut total) = (Matrix3::zeros(), 0.0);
        for (tet, corners) in mesh.tets.iter().enumerate() {
            let Some(own) = corners.iter().position(|&node| node as usize == corner) else { continue };
            let at = std::array::from_fn(|i| if i == own { 1.0 } else { 0.0 });
            let Some(point) = quadrature::point(mesh, tet, &at) else { continue };
            let strain = symmetric(&self.field(&point).1);
            let stress = Matrix3::from_diagonal_element(lame.lambda * dilatations[tet][own])
                + strain * (2.0 * lame.mu);
            sum += stress * point.determinant;
            total += point.determinant;
        }
        sum / total
    }

    /// u and ∂u_i/∂x_j.
    fn field(&self, point: &quadrature::Point) -> (Vector3<f64>, Matrix3<f64>) {
        let mut field = (Vector3::zeros(), Matrix3::zeros());
        for (node, value, gradient) in &point.shapes {
            field.0 += self.displacement[*node] * *value;
            field.1 += self.displacement[*node] * gradient.transpose();
        }
        field
    }

    /// θ at the corners of each tetrahedron, as its energy has it; linear between them, 0 in a folded one.
    fn dilatations(&self, mesh: &TetMesh, element: &Element) -> Vec<[f64; 4]> {
        let own = |tet: usize| {
            if mesh.mids.is_empty() {
                let corners = mesh.tets[tet].map(|node| self.displacement[node as usize]);
                let geometry = tet4::geometry(mesh.corners(tet))?;
                let terms = geometry.gradients.iter().zip(&corners).map(|(gradient, u)| gradient.dot(u));
                return Some([terms.sum(); 4]);
            }
            let nodes = quadratic::nodes(mesh, tet).map(|node| node as usize);
            tet10::dilatation(&nodes.map(|n| mesh.nodes[n]), &nodes.map(|n| self.displacement[n]))
        };
        let own: Vec<[f64; 4]> = (0..mesh.tets.len()).map(|tet| own(tet).unwrap_or_default()).collect();
        match element.dilatation {
            Dilatation::Own => own,
            Dilatation::Nodal => self.patch_means(mesh, &own),
        }
    }

    /// θ_p = Σ V_e θ_e / Σ V_e over the tetrahedra around each node p.
    fn patch_means(&self, mesh: &TetMesh, own: &[[f64; 4]]) -> Vec<[f64; 4]> {
        let mut sums = vec![(0.0, 0.0); self.displacement.len()];
        for (tet, corners) in mesh.tets.iter().enumerate() {
            let volume = quality::signed_volume(&mesh.corners(tet));
            for &corner in corners {
                let sum = &mut sums[corner as usize];
                *sum = (sum.0 + volume * own[tet][0], sum.1 + volume);
            }
        }
        let mean = |node: u32| sums[node as usize].0 / sums[node as usize].1;
        mesh.tets.iter().map(|corners| corners.map(mean)).collect()
    }
}

fn symmetric(h: &Matrix3<f64>) -> Matrix3<f64> {
    (h + h.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{ELEMENTS, NodeFields, TET10};
    use crate::verify::Body;

    struct Shear;

    impl Exact for Shear {
        fn displacement(&self, x: &Vector3<f64>) -> Vector3<f64> {
            Vector3::new(0.1 * x.x + 0.2 * x.y, 0.0, -0.3 * x.z)
        }

        fn gradient(&self, _: &Vector3<f64>) -> Matrix3<f64> {
            Matrix3::new(0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.3)
        }
    }

    /// An affine field has no error in any element, none at all is wrong by the whole, and half of it by half.
    #[test]
    fn norms_are_relative() {
        let lame = Lame::from_young_poisson(1.0, 0.3);
        for &element in ELEMENTS {
            let body = Body::new(element, [2, 1, 1], |place| *place).unwrap();
            for part in [1.0, 0.5, 0.0] {
                let displacement = body.mesh.nodes.iter().map(|x| Shear.displacement(x) * part).collect();
                let solution = Solution { displacement, energy: 0.0, seconds: 0.0 };
                let norms = solution.norms(&body.mesh, element, lame, &Shear);
                assert!((norms.l2 - (1.0 - part)).abs() < 1e-14, "{}: {norms:?}", element.name);
                assert!((norms.energy - (1.0 - part)).abs() < 1e-14, "{}: {norms:?}", element.name);
            }
        }
    }

    /// A curved mesh of ten nodes with λ alone has more motions without energy than rigid ones: none of them is an error in
    /// energy.
    #[test]
    fn the_norm_of_energy_is_that_of_the_elements() {
        let lame = Lame { lambda: 1.0, mu: 0.0 };
        let element = &TET10;
        let bulge = |x: &Vector3<f64>| x + Vector3::new(0.2 * x.y * x.y, 0.1 * x.x * x.z, 0.2 * x.x * x.y);
        let body = Body::kuhn(element, [1, 1, 1], bulge).unwrap();
        let k = element.assemble(&body.mesh, &vec![lame; body.mesh.tets.len()]).unwrap();
        let size = 3 * body.mesh.nodes.len();
        let mut columns = NodeFields::zeros(body.mesh.nodes.len(), size);
        (0..size).for_each(|i| columns.data[i * size + i] = 1.0);
        let mut product = NodeFields::zeros(body.mesh.nodes.len(), size);
        k.multiply(&columns, &mut product);
        let eigen = nalgebra::DMatrix::from_row_slice(size, size, &product.data).symmetric_eigen();
        let largest = eigen.eigenvalues.amax();
        let free: Vec<usize> = (0..size).filter(|&i| eigen.eigenvalues[i].abs() < 1e-12 * largest).collect();
        assert!(free.len() > 6, "{} motions", free.len());
        for i in free {
            let motion = eigen.eigenvectors.column(i);
            let displaced = |(n, x): (usize, &Vector3<f64>)| {
                Shear.displacement(x) + Vector3::from_fn(|axis, _| motion[3 * n + axis])
            };
            let displacement = body.mesh.nodes.iter().enumerate().map(displaced).collect();
            let norms =
                Solution { displacement, energy: 0.0, seconds: 0.0 }.norms(&body.mesh, element, lame, &Shear);
            assert!(norms.energy < 1e-6, "{}", norms.energy);
        }
    }
}
