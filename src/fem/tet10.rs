//! The quadratic tetrahedron: ten nodes, isoparametric.
//!
//! u(x(ξ)) = Σ N_a(ξ) u_a over the same shape functions as x(ξ) = Σ N_a(ξ) x_a ([`mod@quadratic`]), so edges may be curved
//! (Zienkiewicz and Taylor, The Finite Element Method, vol. 1, 5th ed., sections 8.10 and 9.10). Integrals are sums over
//! points: of a straight element four, which are exact and see all 24 strains of ten nodes; of a curved one eight, exact
//! to degree 3, which the patch test needs: the forces of a constant stress are ∫ ∇N dV. The dilatation of a curved
//! element is first projected onto the linear functions (that of a straight one is linear anyway): near ν = 1/2 eight
//! points would be eight constraints per element and stiffen it; the projection leaves four.

use super::assembly::{AssemblyError, ElementSet, Elements};
use super::element::{Dilatation, Element};
use super::energy::{StrainRows, Strains};
use super::lame::Lame;
use super::quadrature::{CURVED, Rule, STRAIGHT};
use super::stiffness::NodeFields;
use super::strain_points::StrainPoints;
use super::tet4;
use crate::mesh::diagnostics::FLAT;
use crate::mesh::{EDGES, TetMesh, quadratic, quality};
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use rayon::prelude::*;

/// The quadratic tetrahedron.
pub const TET10: Element = Element {
    name: "tet10",
    order: 2,
    dilatation: Dilatation::Own,
    locks: false,
    pairs: [3.0, 6.0, 3.0],
    unknown_cost: 1.0,
    sets: |mesh, lame| Ok(vec![Box::new(Tetrahedra::new(mesh, lame)?)]),
    points: |mesh, lame| Ok(Tetrahedra::new(mesh, lame)?.strain_points()),
};

/// One point of an element: its share of the volume, m³, and the shape gradients there, 1/m; Σ G_a = 0.
#[derive(Clone, Copy, Debug)]
pub struct Point {
    pub volume: f64,
    pub gradients: [Vector3<f64>; 10],
}

/// The rule for an element with nodes `x`.
pub fn rule(x: &[Vector3<f64>; 10]) -> &'static Rule {
    if is_straight(x) { STRAIGHT } else { CURVED }
}

/// Whether the nodes between the corners stand in the middle of the edges.
pub fn is_straight(x: &[Vector3<f64>; 10]) -> bool {
    let size = (x[1] - x[0]).amax().max((x[2] - x[0]).amax());
    let is_middle =
        |(mid, [i, j]): (&Vector3<f64>, &[usize; 2])| ((x[*i] + x[*j]) * 0.5 - mid).amax() <= 1e-9 * size;
    x[4..].iter().zip(&EDGES).all(is_middle)
}

/// The points of an element with nodes `x` in the order of its [`rule`], or `None` where it is folded.
pub fn points(x: &[Vector3<f64>; 10]) -> Option<Vec<Point>> {
    points_of(rule(x), x)
}

fn points_of(rule: &Rule, x: &[Vector3<f64>; 10]) -> Option<Vec<Point>> {
    let point = |(at, weight): &([f64; 4], f64)| {
        let (determinant, gradients) = gradients_at(x, at)?;
        Some(Point { volume: weight * determinant / 6.0, gradients })
    };
    rule.iter().map(point).collect()
}

/// det ∂x/∂ξ and the shape gradients ∇N_a at barycentric coordinates `at` of the element with nodes `x`, or `None`
/// where the map is folded or its numbers are none.
///
/// With J = Σ x_a ⊗ ∂N_a/∂ξ: ∇N_a = J⁻ᵀ ∂N_a/∂ξ.
pub fn gradients_at(x: &[Vector3<f64>; 10], at: &[f64; 4]) -> Option<(f64, [Vector3<f64>; 10])> {
    let local = quadratic::local_gradients(at);
    let jacobian = quadratic::jacobian(x, &local);
    let determinant = jacobian.determinant();
    let inverse = jacobian.try_inverse().filter(|_| determinant > 0.0)?.transpose();
    Some((determinant, local.map(|gradient| inverse * gradient)))
}

/// M = ∫ L Lᵀ dV, L being the barycentric coordinates: what the projection in L2 onto the linear functions of ξ is made
/// of. `points` are of [`CURVED`].
fn linear_mass(points: &[Point]) -> Matrix4<f64> {
    let product = |(point, (at, _)): (&Point, &([f64; 4], f64))| {
        let l = Vector4::from(*at);
        l * point.volume * l.transpose()
    };
    points.iter().zip(CURVED).map(product).sum()
}

/// M of [`linear_mass`] and ∫ L ⊗ G_a dV.
fn linear_moments(points: &[Point]) -> (Matrix4<f64>, [[Vector3<f64>; 10]; 4]) {
    let mut moments = [[Vector3::zeros(); 10]; 4];
    for (point, (at, _)) in points.iter().zip(CURVED) {
        let l = Vector4::from(*at) * point.volume;
        for (moment, l) in moments.iter_mut().zip(&l) {
            for (moment, gradient) in moment.iter_mut().zip(&point.gradients) {
                *moment += gradient * *l;
            }
        }
    }
    (linear_mass(points), moments)
}

/// Weights w_mq of the four modes m of a dilatation θ, such that ∫ (P θ)² dV = Σₘ (Σ_q w_mq θ_q)², √m³, P being the
/// projection in L2 onto the linear functions of ξ.
///
/// With M = C Cᵀ of [`linear_mass`]: w_q = C⁻¹ L_q V_q. Constant dilatations are kept, so the patch test is
/// (Zienkiewicz and Taylor, vol. 1, 5th ed., section 12.5: mixed forms and reduced integration). `None` where M is
/// singular, as of a folded element. `points` are of [`CURVED`].
fn modes(points: &[Point]) -> Option<[[f64; 8]; 4]> {
    let inverse = linear_mass(points).cholesky()?.l().try_inverse()?;
    let weights =
        CURVED.iter().zip(points).map(|((at, _), point)| inverse * Vector4::from(*at) * point.volume);
    let mut modes = [[0.0; 8]; 4];
    for (q, weights) in weights.enumerate() {
        modes.iter_mut().zip(&weights).for_each(|(mode, weight)| mode[q] = *weight);
    }
    Some(modes)
}

/// D_a of the four [`modes`] of the divergence, (P div u)ₘ = Σ_a D_a⁽ᵐ⁾·u_a, √m³/m.
fn projected_dilatation(points: &[Point]) -> Option<[[Vector3<f64>; 10]; 4]> {
    let gradient = |mode: &[f64; 8], a: usize| {
        mode.iter().zip(points).map(|(weight, point)| point.gradients[a] * *weight).sum()
    };
    Some(modes(points)?.map(|mode| std::array::from_fn(|a| gradient(&mode, a))))
}

/// D_a at each of the points of a curved element: P div u = Σ_a D_a·u_a there; `None` for a straight one, whose dilatation is
/// the divergence itself.
pub fn dilatations(points: &[Point]) -> Option<Vec<[Vector3<f64>; 10]>> {
    if points.len() != CURVED.len() {
        return None;
    }
    let (mass, moments) = linear_moments(points);
    let inverse = mass.cholesky()?.inverse();
    let at_point = |(at, _): &([f64; 4], f64)| {
        let weights = inverse * Vector4::from(*at);
        std::array::from_fn(|a| (0..4).map(|i| moments[i][a] * weights[i]).sum())
    };
    Some(CURVED.iter().map(at_point).collect())
}

/// P div u at the corners of the element with nodes `x` and displacements `u`, linear in ξ between them: the dilatation
/// that its energy has. Of a straight element it is div u itself. `None` where it is folded.
pub fn dilatation(x: &[Vector3<f64>; 10], u: &[Vector3<f64>; 10]) -> Option<[f64; 4]> {
    let (mass, moments) = linear_moments(&points_of(CURVED, x)?);
    let moment = |moment: &[Vector3<f64>; 10]| moment.iter().zip(u).map(|(d, u)| d.dot(u)).sum::<f64>();
    Some(mass.cholesky()?.solve(&Vector4::from(moments.each_ref().map(moment))).into())
}

/// K_ab = ∫ μ G_b⊗G_a + μ (G_a·G_b) I dV + λ Σₘ D_a⊗D_b, N/m, for one a and all b; of a straight element the last term
/// is ∫ λ G_a⊗G_b dV.
pub fn stiffness_row(points: &[Point], lame: Lame, a: usize, out: &mut [Matrix3<f64>]) {
    let projected = if points.len() == CURVED.len() { projected_dilatation(points) } else { None };
    for (b, block) in out.iter_mut().enumerate() {
        *block = match &projected {
            Some(modes) => modes.iter().map(|mode| mode[a] * mode[b].transpose()).sum(),
            None => {
                let dilatation =
                    |point: &Point| point.gradients[a] * point.gradients[b].transpose() * point.volume;
                points.iter().map(dilatation).sum()
            }
        };
        *block *= lame.lambda;
        for point in points {
            let (ga, gb) = (point.gradients[a], point.gradients[b]);
            let shear = gb * ga.transpose() + Matrix3::from_diagonal_element(ga.dot(&gb));
            *block += shear * (lame.mu * point.volume);
        }
    }
}

/// The quadratic tetrahedra of a mesh. Their gradients are computed anew for each row: kept, they would be a kilobyte
/// an element.
pub struct Tetrahedra<'a> {
    mesh: &'a TetMesh,
    lame: &'a [Lame],
    nodes: Vec<[u32; 10]>,
}

impl<'a> Tetrahedra<'a> {
    /// Errors where a tetrahedron is flat, inverted or folded by its curved edges.
    pub fn new(mesh: &'a TetMesh, lame: &'a [Lame]) -> Result<Tetrahedra<'a>, AssemblyError> {
        let nodes = (0..mesh.tets.len())
            .into_par_iter()
            .map(|index| {
                let corners = mesh.corners(index);
                let relative = quality::quality(&corners).min(quadratic::least_jacobian(mesh, index));
                let volume = tet4::geometry(corners).map_or(0.0, |element| element.volume);
                let nodes = quadratic::nodes(mesh, index);
                if relative >= FLAT
                    && volume > 0.0
                    && points(&nodes.map(|node| mesh.nodes[node as usize])).is_some()
                {
                    return Ok(nodes);
                }
                let tags = mesh.tets[index].map(|node| mesh.tags[node as usize]);
                Err(AssemblyError::Degenerate { index, tags, volume, relative })
            })
            .collect::<Result<_, _>>()?;
        Ok(Tetrahedra { mesh, lame, nodes })
    }

    /// The points at large strain: straight elements with a dilatation at each of four points, curved ones with the means that
    /// project it.
    fn strain_points(&self) -> StrainPoints {
        let mut all = StrainPoints::new(10);
        for (nodes, lame) in self.nodes.iter().zip(self.lame) {
            // `new` has seen that no point is folded.
            let points = points(&nodes.map(|node| self.mesh.nodes[node as usize])).unwrap_or_default();
            let modes = if points.len() == CURVED.len() { modes(&points) } else { None };
            let first = all.count() as u32;
            let terms = points.iter().map(|point| (point.volume, point.gradients.as_slice()));
            all.push(nodes, *lame, modes.is_some(), terms);
            for mode in modes.iter().flatten() {
                let terms: Vec<(u32, f64)> = (first..).zip(mode.iter().copied()).collect();
                all.push_mean(lame.lambda, &terms);
            }
        }
        all
    }
}

impl ElementSet for Tetrahedra<'_> {}

impl Elements for Tetrahedra<'_> {
    fn count(&self) -> usize {
        self.nodes.len()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        &self.nodes[element]
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let x = self.nodes[element].map(|node| self.mesh.nodes[node as usize]);
        // `new` has seen that no point is folded.
        stiffness_row(&points(&x).unwrap_or_default(), self.lame[element], a, out);
    }
}

impl Strains for Tetrahedra<'_> {
    fn elements(&self) -> usize {
        self.nodes.len()
    }

    fn strains(&self, element: usize, fields: &NodeFields, out: &mut StrainRows) {
        let (nodes, lame) = (&self.nodes[element], self.lame[element]);
        // `new` has seen that no point is folded.
        let points = points(&nodes.map(|node| self.mesh.nodes[node as usize])).unwrap_or_default();
        let projected = if points.len() == CURVED.len() { projected_dilatation(&points) } else { None };
        // As in `stiffness_row`: the dilatation of a curved element is the projected one.
        let lambda = if projected.is_some() { 0.0 } else { lame.lambda };
        for point in &points {
            out.push_point((lambda * point.volume, lame.mu * point.volume), nodes, &point.gradients, fields);
        }
        for mode in projected.iter().flatten() {
            out.push(lame.lambda, nodes, mode, fields);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight() -> [Vector3<f64>; 10] {
        let corners =
            [[0.1, -0.2, 0.3], [1.2, 0.1, -0.1], [0.2, 0.9, 0.2], [-0.1, 0.3, 1.4]].map(Vector3::from);
        std::array::from_fn(|a| match a {
            0..4 => corners[a],
            _ => EDGES[a - 4].iter().map(|&corner| corners[corner] / 2.0).sum(),
        })
    }

    fn curved() -> [Vector3<f64>; 10] {
        let mut x = straight();
        for (a, x) in x.iter_mut().enumerate().skip(4) {
            *x += Vector3::new((a as f64).sin(), (2.0 * a as f64).cos(), (3.0 * a as f64).sin()) * 0.04;
        }
        x
    }

    fn matrix(x: &[Vector3<f64>; 10], lame: Lame) -> Vec<[Matrix3<f64>; 10]> {
        let points = points(x).unwrap();
        (0..10)
            .map(|a| {
                let mut row = [Matrix3::zeros(); 10];
                stiffness_row(&points, lame, a, &mut row);
                row
            })
            .collect()
    }

    /// Ascending.
    fn eigenvalues(k: &[[Matrix3<f64>; 10]]) -> Vec<f64> {
        let dense = nalgebra::DMatrix::from_fn(30, 30, |i, j| k[i / 3][j / 3][(i % 3, j % 3)]);
        let mut values: Vec<f64> = dense.symmetric_eigenvalues().iter().copied().collect();
        values.sort_by(f64::total_cmp);
        values
    }

    #[test]
    fn points_fill_the_volume() {
        let x = straight();
        let volume: f64 = points(&x).unwrap().iter().map(|point| point.volume).sum();
        assert!((volume - quality::signed_volume(&[x[0], x[1], x[2], x[3]])).abs() < 1e-15);
        assert_eq!((rule(&x).len(), rule(&curved()).len()), (4, 8));
    }

    /// An affine motion has its own strain at every point, straight or curved; a quadratic one where it is straight.
    #[test]
    fn gradients_are_exact_for_affine_and_quadratic_fields() {
        let h = Matrix3::new(0.01, -0.02, 0.005, 0.03, 0.004, -0.01, 0.002, 0.015, -0.02);
        for x in [straight(), curved()] {
            for point in points(&x).unwrap() {
                let found: Matrix3<f64> = (0..10).map(|a| h * x[a] * point.gradients[a].transpose()).sum();
                assert!((found - h).amax() < 1e-15, "{found}");
            }
        }
        let x = straight();
        let at = [0.4, 0.3, 0.2, 0.1];
        let (_, gradients) = gradients_at(&x, &at).unwrap();
        let position: Vector3<f64> = (0..4).map(|i| x[i] * at[i]).sum();
        let slope: Vector3<f64> = (0..10).map(|a| gradients[a] * x[a].x * x[a].y).sum();
        assert!((slope - Vector3::new(position.y, position.x, 0.0)).amax() < 1e-14);
    }

    /// ∫ (div x)² dV = 9 V, though the element is curved; and λ alone holds no more than four motions.
    #[test]
    fn the_projected_dilatation_keeps_constants_and_is_four_constraints() {
        let x = curved();
        let points = points(&x).unwrap();
        let volume: f64 = points.iter().map(|point| point.volume).sum();
        let modes = projected_dilatation(&points).unwrap();
        let square = |mode: &[Vector3<f64>; 10]| (0..10).map(|a| mode[a].dot(&x[a])).sum::<f64>().powi(2);
        assert!((modes.iter().map(square).sum::<f64>() - 9.0 * volume).abs() < 1e-13 * volume);
        let values = eigenvalues(&matrix(&x, Lame { lambda: 1.0, mu: 0.0 }));
        assert!(values[25].abs() < 1e-13 * values[29] && values[26] > 1e-3 * values[29], "{values:?}");
    }

    /// Corner values are those of the linear field whose square the energy has, and div u where the element is straight.
    #[test]
    fn the_dilatation_is_that_of_the_energy() {
        let u: [Vector3<f64>; 10] =
            std::array::from_fn(|a| Vector3::new((2.0 * a as f64).cos(), (a as f64).sin(), 0.1 * a as f64));
        for x in [straight(), curved()] {
            let corners = Vector4::from(dilatation(&x, &u).unwrap());
            let mass = linear_mass(&points_of(CURVED, &x).unwrap());
            let k = matrix(&x, Lame { lambda: 1.0, mu: 0.0 });
            let energy: f64 = (0..10)
                .flat_map(|a| (0..10).map(move |b| (a, b)))
                .map(|(a, b)| u[a].dot(&(k[a][b] * u[b])))
                .sum();
            let found = corners.dot(&(mass * corners));
            assert!((found / energy - 1.0).abs() < 1e-13, "{found} {energy}");
        }
        let x = straight();
        let corners = dilatation(&x, &u).unwrap();
        for (corner, found) in corners.into_iter().enumerate() {
            let at = std::array::from_fn(|i| if i == corner { 1.0 } else { 0.0 });
            let (_, gradients) = gradients_at(&x, &at).unwrap();
            let expected: f64 = gradients.iter().zip(&u).map(|(g, u)| g.dot(u)).sum();
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        }
    }

    /// Six rigid motions and no other: four points see the 24 strains that are left of thirty unknowns.
    #[test]
    fn the_matrix_has_rank_24() {
        let values = eigenvalues(&matrix(&curved(), Lame::from_young_poisson(1.0, 0.3)));
        assert!(values[5].abs() < 1e-12 * values[29] && values[6] > 1e-3 * values[29], "{values:?}");
    }
}
