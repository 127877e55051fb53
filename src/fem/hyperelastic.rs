//! Hyperelasticity at large strain: elements whose forces come from an energy density ψ(F), total Lagrangian.
//!
//! In: a material law, the elements of a mesh at rest and displacements u. Out: energy, nodal forces and the tangent
//! stiffness. With H_q = Σ u_a⊗G_qa and F = I + H at the points q of integration (a linear tetrahedron has one):
//!
//! ```text
//! W = Σ V ψ(H)     f_a = Σ V P G_a     K_ab = Σ V G_aJ C_iJkL G_bL     P = ∂ψ/∂F     C = ∂P/∂F
//! ```
//!
//! (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., sections 6.3, 9.3 and 9.4.)
//! Where an element takes means θ_p = Σ w_pq θ_q of the law's dilatation ([`StrainPoints`]), ψ has μ alone, and the means
//! add λ's part; with π_q = Σ κ_p θ_p w_pq,
//!
//! ```text
//! W += Σ κ_p/2 θ_p²     V P += π ∂θ/∂F     V C += π ∂²θ/∂F²     K_ab += Σ κ_p ∂θ_p/∂u_a ⊗ ∂θ_p/∂u_b
//! ```
//!
//! all of which are derivatives of W, and at rest the element's stiffness matrix of the linear theory. For the
//! neo-Hookean law, θ_p is the volume of a patch of tetrahedra over that at rest, less one: Bonet and Burton's average
//! nodal pressure (Commun. Numer. Meth. Engng. 14, 1998, 437-449).

use super::assembly::{AssemblyError, Elements, Pattern};
use super::element::Element;
use super::lame::Lame;
use super::law::{Law, Tangent};
use super::products::{add_dyad, times};
use super::stiffness::{NodeFields, StiffnessMatrix};
use super::strain_points::StrainPoints;
use crate::mesh::TetMesh;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// λ/μ at ν = 0.45.
const NEARLY_INCOMPRESSIBLE: f64 = 9.0;

/// The elements of a body and their law.
#[derive(Debug)]
pub struct Hyperelastic {
    pub law: &'static Law,
    /// Ratio of the body's length without strain to that of the mesh at rest: warmth.
    free_stretch: f64,
    pub points: StrainPoints,
    pattern: Pattern,
}

impl Hyperelastic {
    /// Errors where a tetrahedron is flat, inverted or folded, or where the mesh lacks the nodes of the element.
    pub fn new(
        element: &Element,
        law: &'static Law,
        mesh: &TetMesh,
        lame: &[Lame],
    ) -> Result<Hyperelastic, AssemblyError> {
        let points = element.points(mesh, lame)?;
        let pattern = Pattern::from_sets(mesh.nodes.len(), &sets(&points, &[], &[]));
        Ok(Hyperelastic { law, free_stretch: 1.0, points, pattern })
    }

    /// A body whose natural shape is the mesh stretched by `free_stretch` to all sides; displacements are still those from the
    /// mesh. F is then I + H over that stretch, and all volumes are those of the natural shape.
    pub fn stretched(
        element: &Element,
        law: &'static Law,
        mesh: &TetMesh,
        lame: &[Lame],
        free_stretch: f64,
    ) -> Result<Hyperelastic, AssemblyError> {
        let mut natural = mesh.clone();
        natural.nodes.iter_mut().for_each(|x| *x *= free_stretch);
        Ok(Hyperelastic { free_stretch, ..Hyperelastic::new(element, law, &natural, lame)? })
    }

    /// Whether λ is so large beside μ that Newton's iteration wants the pressures apart.
    pub fn is_nearly_incompressible(&self) -> bool {
        self.points.lame.iter().any(|lame| lame.lambda > NEARLY_INCOMPRESSIBLE * lame.mu)
    }

    /// H at every point under the displacements `u`, one column over the nodes.
    pub fn gradients(&self, u: &NodeFields) -> Vec<Matrix3<f64>> {
        self.gradients_from(u, self.free_stretch)
    }

    /// H at every point as if the natural shape were the mesh stretched by `free_stretch`.
    pub fn gradients_from(&self, u: &NodeFields, free_stretch: f64) -> Vec<Matrix3<f64>> {
        let mut gradients = self.points.displacement_gradients(u);
        if [free_stretch, self.free_stretch] != [1.0; 2] {
            // The points' gradients are by places of this body's natural shape.
            let (scale, more) = (self.free_stretch / free_stretch, 1.0 / free_stretch - 1.0);
            gradients.iter_mut().for_each(|h| *h = *h * scale + Matrix3::from_diagonal_element(more));
        }
        gradients
    }

    /// The energy W, J.
    pub fn energy(&self, gradients: &[Matrix3<f64>]) -> f64 {
        let density = |(q, h): (usize, &Matrix3<f64>)| {
            self.points.volume[q] * (self.law.energy)(h, self.points.own_lame(q))
        };
        let energies: Vec<f64> = gradients.par_iter().enumerate().with_min_len(1024).map(density).collect();
        // One after another, so that the bits do not depend on the number of threads.
        let own: f64 = energies.iter().sum();
        let means = &self.points.means;
        if means.count() == 0 {
            return own;
        }
        let of_mean = |(p, theta): (usize, &f64)| 0.5 * means.stiffness(p) * theta * theta;
        own + means.means(&self.dilatations(gradients)).iter().enumerate().map(of_mean).sum::<f64>()
    }

    /// Largest rounding error of the energy, J: where a body is turned far, the terms of ψ cancel.
    pub fn energy_rounding(&self, gradients: &[Matrix3<f64>]) -> f64 {
        let terms = |(q, h): (usize, &Matrix3<f64>)| {
            let lame = self.points.lame(q);
            self.points.volume[q] * (lame.lambda.abs() + 2.0 * lame.mu) * h.norm_squared()
        };
        8.0 * f64::EPSILON * gradients.iter().enumerate().map(terms).sum::<f64>()
    }

    /// Forces f over all nodes, N, that hold the body in this state: ∂W/∂u.
    pub fn forces(&self, gradients: &[Matrix3<f64>]) -> NodeFields {
        let pressures = self.of_means(|| self.dilatations(gradients));
        let stress = |(q, h): (usize, &Matrix3<f64>)| {
            let own = (self.law.stress)(h, self.points.own_lame(q)) * self.points.volume[q];
            match pressures.get(q) {
                Some(pressure) => own + (self.law.dilatation_slope)(h) * *pressure,
                None => own,
            }
        };
        let stresses: Vec<Matrix3<f64>> =
            gradients.par_iter().enumerate().with_min_len(1024).map(stress).collect();
        let mut forces = NodeFields::zeros(self.pattern.nodes(), 1);
        for (q, stress) in stresses.iter().enumerate() {
            let nodes = self.points.nodes_of(self.points.element_of(q));
            for (&node, gradient) in nodes.iter().zip(self.points.gradients_at(q)) {
                let force = times(stress, gradient);
                for axis in 0..3 {
                    forces.data[3 * node as usize + axis] += force[axis];
                }
            }
        }
        forces
    }

    /// The tangent stiffness K = ∂f/∂u over all nodes, N/m.
    pub fn tangent(&self, gradients: &[Matrix3<f64>]) -> StiffnessMatrix {
        let pressures = self.of_means(|| self.dilatations(gradients));
        let tangent = |(q, h): (usize, &Matrix3<f64>)| {
            let own = (self.law.tangent)(h, self.points.own_lame(q)) * self.points.volume[q];
            match pressures.get(q) {
                Some(pressure) => own + (self.law.dilatation_curvature)(h) * *pressure,
                None => own,
            }
        };
        self.assemble(gradients, gradients.par_iter().enumerate().with_min_len(256).map(tangent).collect())
    }

    /// The tangent with the given pressures V λ θ + π at the points, N m, in place of those of this state.
    pub fn tangent_with(&self, gradients: &[Matrix3<f64>], pressures: &[f64]) -> StiffnessMatrix {
        let tangent = |(q, h): (usize, &Matrix3<f64>)| {
            let (lame, volume) = (self.points.own_lame(q), self.points.volume[q]);
            let more = pressures[q] - volume * lame.lambda * (self.law.dilatation)(h);
            (self.law.tangent)(h, lame) * volume + (self.law.dilatation_curvature)(h) * more
        };
        self.assemble(gradients, gradients.par_iter().enumerate().with_min_len(256).map(tangent).collect())
    }

    /// The pressures V λ θ + π after a further displacement `d`, to first order in d.
    pub fn pressures_after(&self, gradients: &[Matrix3<f64>], d: &NodeFields) -> Vec<f64> {
        let after = |(h, change): (&Matrix3<f64>, &Matrix3<f64>)| {
            (self.law.dilatation)(h) + (self.law.dilatation_slope)(h).dot(change)
        };
        let changes = self.points.displacement_gradients(d);
        let dilatations: Vec<f64> =
            gradients.par_iter().zip(&changes).with_min_len(1024).map(after).collect();
        let mut pressures = self.of_means(|| dilatations.clone());
        pressures.resize(dilatations.len(), 0.0);
        for (q, (pressure, dilatation)) in pressures.iter_mut().zip(&dilatations).enumerate() {
            *pressure += self.points.volume[q] * self.points.own_lame(q).lambda * dilatation;
        }
        pressures
    }

    fn dilatations(&self, gradients: &[Matrix3<f64>]) -> Vec<f64> {
        gradients.par_iter().with_min_len(1024).map(self.law.dilatation).collect()
    }

    /// π at every point, N m, of the dilatations there; nothing where there are no means.
    fn of_means(&self, dilatations: impl FnOnce() -> Vec<f64>) -> Vec<f64> {
        let means = &self.points.means;
        if means.count() == 0 {
            return Vec::new();
        }
        let dilatations = dilatations();
        means.pressures(&means.means(&dilatations), dilatations.len())
    }

    /// K of V C + π ∂²θ/∂F² at every point.
    fn assemble(&self, gradients: &[Matrix3<f64>], tangents: Vec<Tangent>) -> StiffnessMatrix {
        let means = if self.points.means.count() == 0 {
            Vec::new()
        } else {
            let slopes: Vec<Matrix3<f64>> =
                gradients.par_iter().with_min_len(1024).map(self.law.dilatation_slope).collect();
            self.points.means.gradients(&self.points, &slopes)
        };
        self.pattern.assemble(&sets(&self.points, &tangents, &means))
    }
}

/// The elements in one state, given V C at each point, and their means, given ∂θ_p/∂u_a.
fn sets<'a>(
    points: &'a StrainPoints,
    tangents: &'a [Tangent],
    means: &'a [Vector3<f64>],
) -> [Box<dyn Elements + 'a>; 2] {
    [Box::new(Strained { points, tangents }), Box::new(Averaged { points, gradients: means })]
}

struct Strained<'a> {
    points: &'a StrainPoints,
    tangents: &'a [Tangent],
}

impl Elements for Strained<'_> {
    fn count(&self) -> usize {
        self.points.elements()
    }

    fn nodes(&self, element: usize) -> &[u32] {
        self.points.nodes_of(element)
    }

    fn row(&self, element: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let nodes = self.nodes(element);
        out.fill(Matrix3::zeros());
        for q in self.points.points_of(element) {
            let (c, gradients) = (&self.tangents[q], self.points.gradients_at(q));
            let g = gradients[a];
            // Column k + 3 L of the three rows i of V G_aJ C_iJkL. By single numbers, because views of columns are not optimised away,
            // and this is the innermost loop of every equilibrium.
            let mut rows = [[0.0; 3]; 9];
            for (row, c) in rows.iter_mut().zip(&c.data.0) {
                for i in 0..3 {
                    row[i] = c[i] * g.x + c[3 + i] * g.y + c[6 + i] * g.z;
                }
            }
            for ((block, g), node) in out.iter_mut().zip(gradients).zip(nodes) {
                if *node < nodes[a] {
                    continue;
                }
                for (k, column) in block.data.0.iter_mut().enumerate() {
                    for i in 0..3 {
                        column[i] += rows[k][i] * g.x + rows[3 + k][i] * g.y + rows[6 + k][i] * g.z;
                    }
                }
            }
        }
    }
}

struct Averaged<'a> {
    points: &'a StrainPoints,
    gradients: &'a [Vector3<f64>],
}

impl Elements for Averaged<'_> {
    fn count(&self) -> usize {
        self.points.means.count()
    }

    fn nodes(&self, mean: usize) -> &[u32] {
        self.points.means.nodes_of(mean)
    }

    fn row(&self, mean: usize, a: usize, out: &mut [Matrix3<f64>]) {
        let gradients = &self.gradients[self.points.means.span(mean)];
        let own = gradients[a] * self.points.means.stiffness(mean);
        // Ascending nodes: those from a on.
        for (block, gradient) in out.iter_mut().zip(gradients).skip(a) {
            *block = Matrix3::zeros();
            add_dyad(block, &own, gradient);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{LAWS, TET4, TET4_ANP, TET10};
    use crate::mesh::{Block, block, quadratic};
    use nalgebra::Rotation3;

    /// An irregular block of two materials, linear, with straight and with bulged edges.
    fn meshes() -> [(&'static Element, TetMesh); 4] {
        let mut mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [2, 2, 2] }).unwrap();
        for (node, x) in mesh.nodes.iter_mut().enumerate() {
            *x += Vector3::from_fn(|axis, _| (1.3 * node as f64 + 2.1 * axis as f64).sin()) * 0.04;
        }
        let bulged = |a: &Vector3<f64>, b: &Vector3<f64>| (a + b) * 0.5 + (a - b).cross(&Vector3::x()) * 0.03;
        let straight = quadratic::quadratic(mesh.clone(), &quadratic::straight);
        let curved = quadratic::quadratic(mesh.clone(), &bulged);
        [(&TET4, mesh.clone()), (&TET4_ANP, mesh), (&TET10, straight), (&TET10, curved)]
    }

    fn two_materials(mesh: &TetMesh) -> Vec<Lame> {
        let of = |tet| Lame { lambda: [2.0, 40.0][tet % 2], mu: [1.0, 1.5][tet % 2] };
        (0..mesh.tets.len()).map(of).collect()
    }

    fn bodies() -> impl Iterator<Item = (String, Hyperelastic, &'static Element, TetMesh)> {
        LAWS.iter().flat_map(|law| {
            meshes().into_iter().map(move |(element, mesh)| {
                let body = Hyperelastic::new(element, law, &mesh, &two_materials(&mesh)).unwrap();
                let points = body.points.count() / mesh.tets.len();
                (format!("{} {} of {points} points", law.name, element.name), body, element, mesh)
            })
        })
    }

    /// X ↦ Q (F X + waves) - X.
    fn strained(mesh: &TetMesh, turn: &Matrix3<f64>, waves: f64) -> NodeFields {
        let f = Matrix3::new(1.2, 0.1, -0.05, 0.2, 0.9, 0.15, -0.1, 0.05, 1.1);
        let mut u = NodeFields::zeros(mesh.nodes.len(), 1);
        for (node, x) in mesh.nodes.iter().enumerate() {
            let wave = Vector3::from_fn(|axis, _| (2.3 * node as f64 + 1.9 * axis as f64).sin()) * waves;
            let moved = turn * (f * x + wave) - x;
            u.data[3 * node..][..3].copy_from_slice(moved.as_slice());
        }
        u
    }

    #[test]
    fn at_rest_the_tangent_is_the_linear_stiffness() {
        for (what, body, element, mesh) in bodies() {
            let rest = NodeFields::zeros(mesh.nodes.len(), 1);
            let found = body.tangent(&body.gradients(&rest));
            let linear = element.assemble(&mesh, &two_materials(&mesh)).unwrap();
            assert_eq!(found.edges, linear.edges, "{what}");
            let size = linear.diagonal.iter().map(|block| block.amax()).fold(0.0, f64::max);
            let both = found.blocks.iter().zip(&linear.blocks);
            for (found, linear) in both.chain(found.diagonal.iter().zip(&linear.diagonal)) {
                assert!((found - linear).amax() < 1e-14 * size, "{what}: {found}{linear}");
            }
        }
    }

    #[test]
    fn forces_and_tangent_are_the_derivatives_of_the_energy() {
        for (what, body, _, mesh) in bodies() {
            let u = strained(&mesh, &Matrix3::identity(), 0.02);
            let (state, step) = (body.gradients(&u), 3e-6);
            let (forces, tangent) = (body.forces(&state), body.tangent(&state));
            let size = forces.data.iter().fold(0.0f64, |size, f| size.max(f.abs()));
            for unknown in (0..u.data.len()).step_by(7) {
                let moved = |by: f64| {
                    let mut moved = u.clone();
                    moved.data[unknown] += by;
                    body.gradients(&moved)
                };
                let (plus, minus) = (moved(step), moved(-step));
                let slope = (body.energy(&plus) - body.energy(&minus)) / (2.0 * step);
                let off = slope - forces.data[unknown];
                assert!(off.abs() < 1e-8 * size, "{what}: force {unknown} off by {off:e} of {size:e}");

                let (plus, minus) = (body.forces(&plus), body.forces(&minus));
                let mut unit = NodeFields::zeros(u.nodes, 1);
                unit.data[unknown] = 1.0;
                let mut column = NodeFields::zeros(u.nodes, 1);
                tangent.multiply(&unit, &mut column);
                let size = column.data.iter().fold(0.0f64, |size, k| size.max(k.abs()));
                for (row, k) in column.data.iter().enumerate() {
                    let off = (plus.data[row] - minus.data[row]) / (2.0 * step) - k;
                    assert!(
                        off.abs() < 1e-7 * size,
                        "{what}: K({row}, {unknown}) off by {off:e} of {size:e}"
                    );
                }
            }
        }
    }

    /// W = ∫ ψ(F) where F is the same everywhere, and the forces on the surface are those of P(F), inside none; and so in a body
    /// turned by 170°.
    #[test]
    fn a_homogeneous_strain_has_the_laws_energy_and_stress() {
        let turn = *Rotation3::new(Vector3::new(0.3, -0.5, 0.8).normalize() * 170f64.to_radians()).matrix();
        for (what, _, element, mesh) in bodies() {
            for law in LAWS {
                let lame = Lame { lambda: 20.0, mu: 1.0 };
                let body = Hyperelastic::new(element, law, &mesh, &vec![lame; mesh.tets.len()]).unwrap();
                let volume: f64 = body.points.volume.iter().sum();
                for turn in [Matrix3::identity(), turn] {
                    let state = body.gradients(&strained(&mesh, &turn, 0.0));
                    let h = state[0];
                    assert!(state.iter().all(|found| (found - h).amax() < 1e-13), "{what}");
                    let energy = volume * (law.energy)(&h, lame);
                    assert!((body.energy(&state) - energy).abs() < 1e-13 * energy, "{what} {}", law.name);
                    // Σ f⊗X = ∫ P dV.
                    let forces = body.forces(&state);
                    let force = |node: usize| Vector3::from_column_slice(&forces.data[3 * node..][..3]);
                    let terms = mesh.nodes.iter().enumerate().map(|(node, x)| force(node) * x.transpose());
                    let p = (law.stress)(&h, lame) * volume;
                    let off = terms.sum::<Matrix3<f64>>() - p;
                    assert!(off.amax() < 1e-13 * p.amax(), "{what} {}: {off}", law.name);
                    // The node in the block's middle, and those around it in a quadratic mesh.
                    let inside = mesh.nodes.iter().position(|x| x.norm() < 0.15).unwrap();
                    assert!(force(inside).amax() < 1e-13 * p.amax(), "{what}: {}", force(inside));
                }
            }
        }
    }

    #[test]
    fn a_turn_by_170_degrees_costs_nothing_and_turns_the_forces() {
        let turn = *Rotation3::new(Vector3::new(0.3, -0.5, 0.8).normalize() * 170f64.to_radians()).matrix();
        for (what, body, _, mesh) in bodies() {
            let mut rigid = NodeFields::zeros(mesh.nodes.len(), 1);
            for (node, x) in mesh.nodes.iter().enumerate() {
                rigid.data[3 * node..][..3].copy_from_slice((turn * x - x).as_slice());
            }
            let state = body.gradients(&rigid);
            let force = body.forces(&state).data.into_iter().fold(0.0f64, |most, f| most.max(f.abs()));
            assert!(body.energy(&state).abs() < 1e-13 && force < 1e-13, "{what}: {force:e}");

            let straight = body.gradients(&strained(&mesh, &Matrix3::identity(), 0.02));
            let turned = body.gradients(&strained(&mesh, &turn, 0.02));
            let (one, other) = (body.energy(&straight), body.energy(&turned));
            assert!((one - other).abs() < 1e-13 * one, "{what}: {one} {other}");
            let (one, other) = (body.forces(&straight), body.forces(&turned));
            let size = one.norms()[0];
            for (a, b) in one.data.chunks(3).zip(other.data.chunks(3)) {
                let off = turn * Vector3::from_column_slice(a) - Vector3::from_column_slice(b);
                assert!(off.amax() < 1e-13 * size, "{what}: {off}");
            }
        }
    }
}
