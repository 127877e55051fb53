//! What a solved body is asked: displacements, stress, errors in the norms of L2 and of energy.

use super::element::Dilatation;
use super::{Body, Element, quadrature};
use crate::fem::Lame;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;

pub struct Solution {
    /// Per node, m.
    pub displacement: Vec<Vector3<f64>>,
    /// uᵀ K u / 2, J.
    pub energy: f64,
    /// From assembly to displacements.
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
    /// How well the reference is known, relatively; 0 where it is exact.
    pub known_to: f64,
    pub bound: Bound,
}

/// What is required on the finest mesh; nothing where theory promises nothing.
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
    /// The same of ∫ 2μ |ε|² + λ θ², with the θ that the element's energy has: ε and θ = tr ε of the displacement, or
    /// patches' means.
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

    /// Relative errors against `exact`, by a rule of degree 5 on the mesh's own domain.
    pub fn norms(&self, body: &Body, element: Element, lame: Lame, exact: &impl Exact) -> Norms {
        let nodal = self.nodal_dilatation(body, element);
        let energy = |strain: &Matrix3<f64>, dilatation: f64| {
            2.0 * lame.mu * strain.norm_squared() + lame.lambda * dilatation * dilatation
        };
        let (mut error, mut size) = ([0.0; 2], [0.0; 2]);
        for tet in 0..body.mesh.tets.len() {
            for (at, weight) in quadrature::tetrahedron_rule() {
                let Some(point) = quadrature::point(&body.mesh, tet, &at) else { continue };
                let volume = weight * point.determinant / 6.0;
                let (u, h) = self.field(&point);
                let (strain, exact_strain) = (symmetric(&h), symmetric(&exact.gradient(&point.x)));
                let dilatation = match &nodal {
                    Some(nodal) => {
                        body.mesh.tets[tet].iter().zip(at).map(|(&n, l)| nodal[n as usize] * l).sum()
                    }
                    None => strain.trace(),
                };
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
    pub fn stress_at(&self, body: &Body, element: Element, lame: Lame, corner: usize) -> Matrix3<f64> {
        let nodal = self.nodal_dilatation(body, element);
        let (mut sum, mut total) = (Matrix3::zeros(), 0.0);
        for (tet, corners) in body.mesh.tets.iter().enumerate() {
            let Some(own) = corners.iter().position(|&node| node as usize == corner) else { continue };
            let at = std::array::from_fn(|i| if i == own { 1.0 } else { 0.0 });
            let Some(point) = quadrature::point(&body.mesh, tet, &at) else { continue };
            let strain = symmetric(&self.field(&point).1);
            let dilatation = nodal.as_ref().map_or(strain.trace(), |nodal| nodal[corner]);
            let stress = Matrix3::from_diagonal_element(lame.lambda * dilatation) + strain * (2.0 * lame.mu);
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

    /// θ_p = Σ V_e tr ε_e / Σ V_e over the tetrahedra around each node, for elements whose energy has it.
    fn nodal_dilatation(&self, body: &Body, element: Element) -> Option<Vec<f64>> {
        if element.dilatation() == Dilatation::Pointwise {
            return None;
        }
        let mut sums = vec![(0.0, 0.0); self.displacement.len()];
        for (tet, corners) in body.mesh.tets.iter().enumerate() {
            let Some(point) = quadrature::point(&body.mesh, tet, &[0.25; 4]) else { continue };
            let dilatation = self.field(&point).1.trace();
            for &corner in corners {
                let sum = &mut sums[corner as usize];
                *sum = (sum.0 + point.determinant * dilatation, sum.1 + point.determinant);
            }
        }
        Some(sums.into_iter().map(|(sum, total)| sum / total).collect())
    }
}

fn symmetric(h: &Matrix3<f64>) -> Matrix3<f64> {
    (h + h.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for element in Element::ALL {
            let body = Body::new(element, [2, 1, 1], |place| *place).unwrap();
            for part in [1.0, 0.5, 0.0] {
                let displacement = body.mesh.nodes.iter().map(|x| Shear.displacement(x) * part).collect();
                let solution = Solution { displacement, energy: 0.0, seconds: 0.0 };
                let norms = solution.norms(&body, element, lame, &Shear);
                assert!((norms.l2 - (1.0 - part)).abs() < 1e-14, "{}: {norms:?}", element.name());
                assert!((norms.energy - (1.0 - part)).abs() < 1e-14, "{}: {norms:?}", element.name());
            }
        }
    }
}
