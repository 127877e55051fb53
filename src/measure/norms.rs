//! Norms of displacement fields over the volume of a body, all of them on the finest of its meshes.
//!
//! In: a field of tet4 or tet10 on one of the quadratic meshes Q₀, Q₁, … of a body's refinements. Out: the same field on
//! the finest mesh, so that solutions are compared and not samplings; and its L2 and energy norms there.

use crate::fem::quadrature::tetrahedron_rule;
use crate::fem::{NodeFields, StiffnessMatrix, tet4};
use crate::mesh::{EDGES, TetMesh, quadratic};
use nalgebra::{Matrix3, Vector3};
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

/// The longest vector of a field.
pub fn largest(field: &[Vector3<f64>]) -> f64 {
    field.iter().map(|u| u.norm()).fold(0.0, f64::max)
}

/// Root mean square of an error over that of the field in which it is, at the same nodes.
pub fn relative(error: &[Vector3<f64>], field: &[Vector3<f64>]) -> f64 {
    let square = |field: &[Vector3<f64>]| field.iter().map(|u| u.norm_squared()).sum::<f64>();
    square(error).sqrt() / square(field).sqrt().max(f64::MIN_POSITIVE)
}

/// Q_0 … Q_top. Corners of Q_r come first, then its mids; tetrahedron t of Q_r is cut into 8 t … 8 t + 7 of Q_(r+1),
/// the first four of which keep a corner each ([`crate::mesh::refine`]).
pub struct MeshLadder {
    pub levels: Vec<TetMesh>,
    /// Nodes of the linear mesh of each level.
    corners: Vec<usize>,
}

impl MeshLadder {
    /// Makes the ladder from the linear meshes of the levels. `curve` places the middles.
    pub fn new(linear: Vec<TetMesh>, curve: quadratic::Curve<'_>) -> MeshLadder {
        let corners = linear.iter().map(|mesh| mesh.nodes.len()).collect();
        let levels = linear.into_iter().map(|mesh| quadratic::quadratic(mesh, curve)).collect();
        MeshLadder { levels, corners }
    }

    pub fn top(&self) -> &TetMesh {
        &self.levels[self.levels.len() - 1]
    }

    /// A field of `level`, by its corners or by all its nodes, on the nodes of the finest mesh.
    pub fn raise(&self, level: usize, field: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut field = self.with_mids(level, field);
        for level in level..self.levels.len() - 1 {
            field = self.climb(level, &field);
        }
        field
    }

    /// A linear field's values at the mids too. Where an edge is curved, the mid lies beside its straight middle: the
    /// field goes on there by the mean of the gradients of the tetrahedra around, so that an affine one stays affine.
    pub fn with_mids(&self, level: usize, field: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mesh = &self.levels[level];
        let mut whole = field.to_vec();
        if field.len() == mesh.nodes.len() {
            return whole;
        }
        whole.resize(mesh.nodes.len(), Vector3::zeros());
        let mut around = vec![0.0; mesh.nodes.len()];
        for (tet, (corners, mids)) in mesh.tets.iter().zip(&mesh.mids).enumerate() {
            let gradients = tet4::geometry(mesh.corners(tet)).map_or_else(Default::default, |g| g.gradients);
            let h: Matrix3<f64> =
                corners.iter().zip(&gradients).map(|(&node, g)| field[node as usize] * g.transpose()).sum();
            for ([i, j], &mid) in EDGES.iter().zip(mids) {
                let [a, b] = [corners[*i] as usize, corners[*j] as usize];
                let beside = mesh.nodes[mid as usize] - (mesh.nodes[a] + mesh.nodes[b]) * 0.5;
                whole[mid as usize] += (field[a] + field[b]) * 0.5 + h * beside;
                around[mid as usize] += 1.0;
            }
        }
        for (value, count) in whole.iter_mut().zip(around).filter(|(_, count)| *count > 0.0) {
            *value /= count;
        }
        whole
    }

    /// The field of Q_level at the nodes of the next.
    pub fn climb(&self, level: usize, field: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let (coarse, fine) = (&self.levels[level], &self.levels[level + 1]);
        let mut raised = vec![Vector3::zeros(); fine.nodes.len()];
        for tet in 0..coarse.tets.len() {
            let own = quadratic::nodes(coarse, tet).map(|node| field[node as usize]);
            let value = |at: &[f64; 4]| -> Vector3<f64> {
                quadratic::shapes(at).iter().zip(&own).map(|(shape, u)| u * *shape).sum()
            };
            let places = self.places(level, tet);
            let place =
                |node: u32| places.iter().find(|(known, _)| *known == node).map_or([0.25; 4], |(_, at)| *at);
            for child in 8 * tet..8 * tet + 8 {
                let corners = fine.tets[child].map(place);
                for (node, at) in fine.tets[child].iter().zip(&corners) {
                    raised[*node as usize] = value(at);
                }
                for ([i, j], &mid) in EDGES.iter().zip(&fine.mids[child]) {
                    let at = std::array::from_fn(|l| 0.5 * (corners[*i][l] + corners[*j][l]));
                    raised[mid as usize] = value(&at);
                }
            }
        }
        raised
    }

    /// The corners of the children of tetrahedron `tet` by their barycentric coordinates in it: an old corner's own, and
    /// of a new one the mean of the two old corners whose children have it.
    fn places(&self, level: usize, tet: usize) -> Vec<(u32, [f64; 4])> {
        let (coarse, fine) = (&self.levels[level], &self.levels[level + 1]);
        let is_old = |node: &u32| (*node as usize) < self.corners[level];
        let mut places: Vec<(u32, [f64; 4])> = Vec::with_capacity(10);
        for child in &fine.tets[8 * tet..8 * tet + 4] {
            let own = child.iter().find(|node| is_old(node)).copied().unwrap_or(0);
            let Some(corner) = coarse.tets[tet].iter().position(|&node| node == own) else { continue };
            for &node in child {
                let share = if is_old(&node) { 1.0 } else { 0.5 };
                match places.iter_mut().find(|(known, _)| *known == node) {
                    Some((_, at)) => at[corner] += share,
                    None => {
                        let mut at = [0.0; 4];
                        at[corner] = share;
                        places.push((node, at));
                    }
                }
            }
        }
        places
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, TET10};
    use crate::mesh::generate::RING;
    use crate::mesh::refine::refine;
    use crate::mesh::{Block, Tube, block, tube};

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

    fn ladder(base: &TetMesh, curve: quadratic::Curve<'_>) -> MeshLadder {
        MeshLadder::new((0..3).map(|times| refine(base.clone(), times, curve).unwrap()).collect(), curve)
    }

    /// A quadratic field climbs without loss on straight meshes, a linear one from the corners alone.
    #[test]
    fn quadratic_fields_climb_exactly() {
        let base = block(&Block { size: [1.0, 2.0, 1.5], cells: [2, 1, 2] }).unwrap();
        let ladder = ladder(&base, &quadratic::straight);
        let square = |x: &Vector3<f64>| Vector3::new(x.x * x.y, x.z * x.z - x.x, 1.0 + x.y * x.y);
        let linear = |x: &Vector3<f64>| Vector3::new(2.0 * x.x - x.y, x.z, 0.5);
        for level in 0..3 {
            let nodes = &ladder.levels[level].nodes;
            let raised = ladder.raise(level, &nodes.iter().map(square).collect::<Vec<_>>());
            for (u, x) in raised.iter().zip(&ladder.top().nodes) {
                assert!((u - square(x)).amax() < 1e-13, "level {level}: {u} at {x}");
            }
            let corners = ladder.corners[level];
            let raised = ladder.raise(level, &nodes[..corners].iter().map(linear).collect::<Vec<_>>());
            for (u, x) in raised.iter().zip(&ladder.top().nodes) {
                assert!((u - linear(x)).amax() < 1e-13, "level {level}: {u} at {x}");
            }
        }
    }

    /// A tetrahedron of a round tube turns without an error: what it is not is round.
    #[test]
    fn affine_fields_of_straight_elements_stay_affine_on_curved_ones() {
        let ring = Tube {
            inner_radius: 0.5,
            outer_radius: 1.0,
            length: 1.0,
            radial: 1,
            around: 12,
            along: 4,
            control_length: 0.0,
        };
        let curve = |a: &Vector3<f64>, b: &Vector3<f64>| ring.curve(a, b);
        let ladder = MeshLadder::new(vec![tube(&ring).unwrap()], &curve);
        let affine = |x: &Vector3<f64>| Vector3::new(x.y - x.x, x.z + 0.3 * x.y, 1.0 - 2.0 * x.x);
        let corners = &ladder.top().nodes[..ladder.corners[0]];
        let raised = ladder.raise(0, &corners.iter().map(affine).collect::<Vec<_>>());
        for (u, x) in raised.iter().zip(&ladder.top().nodes) {
            assert!((u - affine(x)).amax() < 1e-13, "{u} at {x}");
        }
    }

    /// Each node of a round tube takes the value of its own material point: the coordinates climb to within what a quadratic can
    /// follow of the circle.
    #[test]
    fn nodes_of_curved_meshes_keep_their_material_points() {
        let ring = Tube { around: 12, ..RING };
        let curve = |a: &Vector3<f64>, b: &Vector3<f64>| ring.curve(a, b);
        let ladder = ladder(&tube(&ring).unwrap(), &curve);
        let raised = ladder.raise(0, &ladder.levels[0].nodes);
        let worst = raised.iter().zip(&ladder.top().nodes).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max);
        assert!(worst < 0.02, "{worst}");
    }
}
