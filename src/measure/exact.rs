//! Exact references: errors of a solved mesh against an exact field, and the rate at which they fall.
//!
//! In: a mesh, straight or curved, a [`Solution`] on it and an [`Exact`] field. Out: stress at a node, relative errors in the
//! norms of L2 and of energy, and the order of convergence of a sequence of meshes.

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

/// Relative errors against an exact field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeNorms {
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
    /// Relative errors against `exact`, by a rule of degree 7 on the mesh's own domain.
    pub fn norms(&self, mesh: &TetMesh, element: &Element, lame: Lame, exact: &impl Exact) -> RelativeNorms {
        let dilatations = self.dilatations(mesh, element);
        let energy = |strain: &Matrix3<f64>, dilatation: f64| {
            2.0 * lame.mu * strain.norm_squared() + lame.lambda * dilatation * dilatation
        };
        let (mut error, mut size) = ([0.0; 2], [0.0; 2]);
        for tet in 0..mesh.tets.len() {
            for (at, weight) in tetrahedron_rule() {
                let Some(point) = self::point(mesh, tet, &at) else { continue };
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
        RelativeNorms { l2: (error[0] / size[0]).sqrt(), energy: (error[1] / size[1]).sqrt() }
    }

    /// σ = λ θ I + 2μ ε at a corner: the mean of the stresses that the tetrahedra around it have there, by their volumes.
    pub fn stress_at(&self, mesh: &TetMesh, element: &Element, lame: Lame, corner: usize) -> Matrix3<f64> {
        let dilatations = self.dilatations(mesh, element);
        let (mut sum, mut total) = (Matrix3::zeros(), 0.0);
        for (tet, corners) in mesh.tets.iter().enumerate() {
            let Some(own) = corners.iter().position(|&node| node as usize == corner) else { continue };
            let at = std::array::from_fn(|i| if i == own { 1.0 } else { 0.0 });
            let Some(point) = self::point(mesh, tet, &at) else { continue };
            let strain = symmetric(&self.field(&point).1);
            let stress = Matrix3::from_diagonal_element(lame.lambda * dilatations[tet][own])
                + strain * (2.0 * lame.mu);
            sum += stress * point.determinant;
            total += point.determinant;
        }
        sum / total
    }

    /// u and ∂u_i/∂x_j.
    fn field(&self, point: &Point) -> (Vector3<f64>, Matrix3<f64>) {
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

/// One tetrahedron at one place.
pub struct Point {
    pub x: Vector3<f64>,
    /// det ∂x/∂ξ, six times a straight tetrahedron's volume.
    pub determinant: f64,
    /// Node, N_a, ∇N_a (1/m).
    pub shapes: Vec<(usize, f64, Vector3<f64>)>,
}

/// The four or ten nodes of tetrahedron `tet`.
fn nodes(mesh: &TetMesh, tet: usize) -> Vec<usize> {
    let mids = mesh.mids.get(tet).into_iter().flatten();
    mesh.tets[tet].iter().chain(mids).map(|&node| node as usize).collect()
}

/// Tetrahedron `tet` at barycentric coordinates `at`; `None` where it is folded.
fn point(mesh: &TetMesh, tet: usize, at: &[f64; 4]) -> Option<Point> {
    let (determinant, values, gradients) = if mesh.mids.is_empty() {
        let geometry = tet4::geometry(mesh.corners(tet))?;
        (6.0 * geometry.volume, at.to_vec(), geometry.gradients.to_vec())
    } else {
        let x = quadratic::nodes(mesh, tet).map(|node| mesh.nodes[node as usize]);
        let (determinant, gradients) = tet10::gradients_at(&x, at)?;
        (determinant, quadratic::shapes(at).to_vec(), gradients.to_vec())
    };
    let shapes: Vec<_> = nodes(mesh, tet)
        .into_iter()
        .zip(values)
        .zip(gradients)
        .map(|((node, value), gradient)| (node, value, gradient))
        .collect();
    let x = shapes.iter().map(|&(node, value, _)| mesh.nodes[node] * value).sum();
    Some(Point { x, determinant, shapes })
}

/// One mesh of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Level {
    /// Size of a cell as a part of the body's.
    pub h: f64,
    pub nodes: usize,
    pub value: f64,
    /// Relative.
    pub error: f64,
    /// Time from assembly to displacements, s.
    pub seconds: f64,
}

/// Slope of log(error) over log(h) by least squares, over the levels whose error is more than twice what the reference
/// is `known_to`; smaller errors are those of the reference. `None` with fewer than two such levels, or where an error is
/// 0 or not finite.
pub fn rate(levels: &[Level], known_to: f64) -> Option<f64> {
    let told = levels.iter().filter(|level| level.error.is_nan() || level.error > 2.0 * known_to);
    let points: Vec<(f64, f64)> = told.map(|level| (level.h.ln(), level.error.ln())).collect();
    if points.len() < 2 {
        return None;
    }
    let count = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / count, sum.1 + y / count));
    let product: f64 = points.iter().map(|(x, y)| (x - mean.0) * (y - mean.1)).sum();
    let slope = product / points.iter().map(|(x, _)| (x - mean.0).powi(2)).sum::<f64>();
    slope.is_finite().then_some(slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{ELEMENTS, NodeFields, TET10};
    use crate::measure::body::Body;

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

    fn levels(h: &[f64], error: impl Fn(f64) -> f64) -> Vec<Level> {
        h.iter().map(|&h| Level { h, nodes: 0, value: 0.0, error: error(h), seconds: 0.0 }).collect()
    }

    #[test]
    fn powers_are_found_again() {
        for p in [0.7, 1.0, 2.5, 4.0] {
            let levels = levels(&[1.0, 0.5, 1.0 / 3.0, 0.25], |h| 3.0 * h.powf(p));
            assert!((rate(&levels, 0.0).unwrap() - p).abs() < 1e-12);
        }
    }

    #[test]
    fn errors_below_what_the_reference_is_known_to_are_left_out() {
        let levels = levels(&[1.0, 0.5, 0.25], |h| if h < 0.3 { 0.015 } else { 0.1 * h * h });
        assert!((rate(&levels, 0.01).unwrap() - 2.0).abs() < 1e-12);
        assert_eq!(rate(&levels, 0.03), None);
    }

    #[test]
    fn no_rate_is_made_up() {
        assert_eq!(rate(&levels(&[1.0], |_| 1.0), 0.0), None);
        assert_eq!(rate(&levels(&[1.0, 0.5], |_| f64::NAN), 0.0), None);
        assert_eq!(rate(&levels(&[1.0, 0.5], |_| f64::INFINITY), 0.0), None);
    }
}
