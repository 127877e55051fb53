//! The body of a verification problem: the unit block mapped to its shape, with tractions and supports of single
//! components.
//!
//! Tractions become nodal forces f_a = ∫ N_a t dA on three- and six-node faces, straight or curved. Supports are
//! eliminated exactly, component by component: with K u = f and u_d = g_d prescribed,
//!
//! ```text
//! | K_ff  0    | | u_f |   | f_f - K_fd g |
//! | 0     D_dd | | u_d | = | D_dd g       |     D the diagonal of K
//! ```

use super::exact::Solution;
use crate::fem::{self, AssemblyError, Element, Lame, NodeFields, StiffnessMatrix};
use crate::mesh::{Block, GenerateError, TetMesh, block, outer_faces, quadratic};
use crate::solve::{Silent, SolveError, Solver};
use nalgebra::Vector3;
use std::time::Instant;

/// The reason why one mesh could not be solved.
#[derive(Debug, thiserror::Error)]
pub enum ProblemError {
    #[error(transparent)]
    Mesh(#[from] GenerateError),
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    #[error(transparent)]
    Solve(#[from] SolveError),
    #[error("no node lies at ({0}, {1}, {2}) of the unit block")]
    NoNode(f64, f64, f64),
}

pub struct Body {
    pub mesh: TetMesh,
    /// Place of every node in the unit block.
    pub place: Vec<Vector3<f64>>,
    /// External forces, N.
    pub force: NodeFields,
    /// The prescribed displacement of unknown 3·node + axis, m.
    pub fixed: Vec<Option<f64>>,
}

impl Body {
    /// The unit block [0, 1]³ of `cells`, five tetrahedra each, mapped by `shape`; nodes between corners are mapped too,
    /// so that they lie on curved walls.
    pub fn new(
        element: &Element,
        cells: [u32; 3],
        shape: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Result<Body, ProblemError> {
        Ok(Body::from_block(element, block(&Block { size: [1.0; 3], cells })?, shape))
    }

    /// Makes a body as [`Body::new`] does, with the six tetrahedra of Kuhn's split in each cell, around the diagonal from
    /// (0, 0, 0) to (1, 1, 1).
    pub fn kuhn(
        element: &Element,
        cells: [u32; 3],
        shape: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Result<Body, ProblemError> {
        let mut mesh = block(&Block { size: [1.0; 3], cells })?;
        mesh.tets = kuhn(cells);
        mesh.regions = vec![0; mesh.tets.len()];
        Ok(Body::from_block(element, mesh, shape))
    }

    fn from_block(element: &Element, mesh: TetMesh, shape: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Body {
        let mut mesh =
            if element.order == 2 { quadratic::quadratic(mesh, &quadratic::straight) } else { mesh };
        let place: Vec<_> = mesh.nodes.iter().map(|node| node.add_scalar(0.5)).collect();
        mesh.nodes = place.iter().map(shape).collect();
        let nodes = mesh.nodes.len();
        Body { mesh, place, force: NodeFields::zeros(nodes, 1), fixed: vec![None; 3 * nodes] }
    }

    /// The node at `place` of the unit block.
    pub fn node_at(&self, place: [f64; 3]) -> Result<usize, ProblemError> {
        let wanted = Vector3::from(place);
        let near = |at: &Vector3<f64>| (at - wanted).amax() < 1e-9;
        self.place.iter().position(near).ok_or(ProblemError::NoNode(place[0], place[1], place[2]))
    }

    /// Prescribes component `axis` of all nodes whose place in the unit block is `on`, by the position of the node.
    pub fn fix(
        &mut self,
        on: impl Fn(&Vector3<f64>) -> bool,
        axis: usize,
        value: impl Fn(&Vector3<f64>) -> f64,
    ) {
        for (node, _) in self.place.iter().enumerate().filter(|(_, place)| on(place)) {
            self.fixed[3 * node + axis] = Some(value(&self.mesh.nodes[node]));
        }
    }

    /// Adds the traction t(x, n) in Pa on the faces whose nodes' places in the unit block all are `on`; n is the outward
    /// unit normal.
    pub fn load(
        &mut self,
        on: impl Fn(&Vector3<f64>) -> bool,
        traction: impl Fn(&Vector3<f64>, &Vector3<f64>) -> Vector3<f64>,
    ) {
        let is_on = |face: &Vec<u32>| face.iter().all(|&node| on(&self.place[node as usize]));
        let faces: Vec<Vec<u32>> = outer_faces(&self.mesh).into_iter().filter(is_on).collect();
        let forces = fem::traction(&self.mesh, &faces, &|at| traction(&at.place, &at.normal));
        let own = self.force.data.iter_mut();
        own.zip(forces.iter().flatten()).for_each(|(sum, force)| *sum += force);
    }

    /// Displacements of one material throughout.
    pub fn solve(&self, element: &Element, lame: Lame) -> Result<Solution, ProblemError> {
        let started = Instant::now();
        let k = element.assemble(&self.mesh, &vec![lame; self.mesh.tets.len()])?;
        let constrained = constrain(&k, &self.fixed);
        let solver = Solver::default().analyse(&constrained, &Silent)?;
        let (u, _) = solver
            .factor(&constrained, &Silent)?
            .solve(&right_hand_side(&k, &self.force, &self.fixed), &Silent)?;
        let mut reaction = NodeFields::zeros(u.nodes, 1);
        k.multiply(&u, &mut reaction);
        let energy = 0.5 * u.dots(&reaction)[0];
        let displacement = u.data.chunks_exact(3).map(|u| Vector3::new(u[0], u[1], u[2])).collect();
        Ok(Solution { displacement, energy, seconds: started.elapsed().as_secs_f64() })
    }
}

/// K with the rows and columns of prescribed unknowns cleared but for the diagonal, without blocks that are zero then.
fn constrain(k: &StiffnessMatrix, fixed: &[Option<f64>]) -> StiffnessMatrix {
    let free: Vec<Vector3<f64>> = fixed
        .chunks_exact(3)
        .map(|fixed| Vector3::from_fn(|axis, _| if fixed[axis].is_none() { 1.0 } else { 0.0 }))
        .collect();
    let kept: Vec<usize> = (0..k.edges.len())
        .filter(|&edge| k.edges[edge].iter().all(|&node| free[node as usize] != Vector3::zeros()))
        .collect();
    let edges = kept.iter().map(|&edge| k.edges[edge]).collect();
    let mut constrained = StiffnessMatrix::zeros(k.nodes(), edges);
    for (new, &old) in kept.iter().enumerate() {
        let [i, j] = k.edges[old].map(|node| free[node as usize]);
        constrained.blocks[new] = k.blocks[old].component_mul(&(i * j.transpose()));
    }
    for (node, free) in free.iter().enumerate() {
        let block = k.diagonal[node];
        constrained.diagonal[node] = block.component_mul(&(free * free.transpose()));
        for axis in (0..3).filter(|&axis| free[axis] == 0.0) {
            constrained.diagonal[node][(axis, axis)] = block[(axis, axis)];
        }
    }
    constrained
}

fn right_hand_side(k: &StiffnessMatrix, force: &NodeFields, fixed: &[Option<f64>]) -> NodeFields {
    let mut prescribed = NodeFields::zeros(force.nodes, 1);
    for (value, fixed) in prescribed.data.iter_mut().zip(fixed) {
        *value = fixed.unwrap_or(0.0);
    }
    let mut rhs = NodeFields::zeros(force.nodes, 1);
    k.multiply(&prescribed, &mut rhs);
    for (row, value) in rhs.data.iter_mut().enumerate() {
        *value = match fixed[row] {
            Some(prescribed) => k.diagonal[row / 3][(row % 3, row % 3)] * prescribed,
            None => force.data[row] - *value,
        };
    }
    rhs
}

/// The tetrahedra of each cell: one for each order in which the three axes can be walked from corner 000 to 111.
fn kuhn(cells: [u32; 3]) -> Vec<[u32; 4]> {
    const WALKS: [[usize; 3]; 6] = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    let node = |[i, j, k]: [u32; 3]| (i * (cells[1] + 1) + j) * (cells[2] + 1) + k;
    let mut tets = Vec::new();
    for i in 0..cells[0] {
        for j in 0..cells[1] {
            for k in 0..cells[2] {
                for (walk, axes) in WALKS.iter().enumerate() {
                    let mut at = [i, j, k];
                    let mut tet = [node(at); 4];
                    for (corner, &axis) in axes.iter().enumerate() {
                        at[axis] += 1;
                        tet[corner + 1] = node(at);
                    }
                    // Odd orders are left-handed.
                    if walk >= 3 {
                        tet.swap(1, 2);
                    }
                    tets.push(tet);
                }
            }
        }
    }
    tets
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{ELEMENTS, Partition, TET4};
    use nalgebra::Matrix3;
    use std::f64::consts::FRAC_PI_2;

    const CELLS: [u32; 3] = [2, 3, 2];

    /// A quarter of a cylinder's wall between radii 1 and 2, 1 high.
    fn ring(place: &Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = (FRAC_PI_2 * place.y).sin_cos();
        Vector3::new((1.0 + place.x) * cos, (1.0 + place.x) * sin, place.z)
    }

    fn bodies(element: &Element, shape: fn(&Vector3<f64>) -> Vector3<f64>) -> [Body; 2] {
        [Body::new(element, CELLS, shape).unwrap(), Body::kuhn(element, CELLS, shape).unwrap()]
    }

    /// σ_xx = 2 on one face, three planes that slide: u = (σ/E) (x, -ν y, -ν z) in every element, to rounding.
    #[test]
    fn uniaxial_tension_on_sliding_planes_is_exact() {
        let (young, poisson) = (5.0, 0.3);
        let lame = Lame::from_young_poisson(young, poisson);
        let shape = |place: &Vector3<f64>| Vector3::new(2.0 * place.x, place.y, 0.5 * place.z);
        for &element in ELEMENTS {
            for mut body in bodies(element, shape) {
                for axis in 0..3 {
                    body.fix(|place| place[axis] == 0.0, axis, |_| 0.0);
                }
                body.load(|place| place.x == 1.0, |_, normal| normal * 2.0);
                let solution = body.solve(element, lame).unwrap();
                for (x, u) in body.mesh.nodes.iter().zip(&solution.displacement) {
                    let expected = Vector3::new(x.x, -poisson * x.y, -poisson * x.z) * (2.0 / young);
                    assert!((u - expected).amax() < 1e-13, "{}: {u} at {x}", element.name);
                }
                // W = σ²V/(2E) with V = 1.
                assert!((solution.energy - 0.4).abs() < 1e-13, "{}: {}", element.name, solution.energy);
                let corner = body.node_at([1.0, 1.0, 0.0]).unwrap();
                let stress = solution.stress_at(&body.mesh, element, lame, corner);
                let expected = Matrix3::from_diagonal(&Vector3::new(2.0, 0.0, 0.0));
                assert!((stress - expected).amax() < 1e-12, "{}: {stress}", element.name);
            }
        }
    }

    /// Whole nodes prescribed here and by the offline stage's partition: the same displacement.
    #[test]
    fn elimination_agrees_with_the_partition() {
        let lame = Lame::from_young_poisson(1.0, 0.4);
        let prescribed = |x: &Vector3<f64>, axis: usize| x[(axis + 1) % 3] * x.z - 0.1 * x.x;
        let is_held = |place: &Vector3<f64>| place.y == 0.0 || place.x == 1.0;
        for &element in ELEMENTS {
            for mut body in bodies(element, ring) {
                for axis in 0..3 {
                    body.fix(is_held, axis, |x| prescribed(x, axis));
                }
                let Solution { displacement, .. } = body.solve(element, lame).unwrap();

                let nodes = body.mesh.nodes.len();
                let k = element.assemble(&body.mesh, &vec![lame; body.mesh.tets.len()]).unwrap();
                let held = (0..nodes as u32).filter(|&node| is_held(&body.place[node as usize]));
                let partition = Partition::new(nodes, held);
                let mut fields = NodeFields::zeros(nodes, 1);
                for &node in &partition.controlled {
                    for axis in 0..3 {
                        let row = 3 * node as usize + axis;
                        fields.data[row] = prescribed(&body.mesh.nodes[node as usize], axis);
                    }
                }
                let a = partition.a(&k);
                let solver = Solver::default().analyse(&a, &Silent).unwrap();
                let factor = solver.factor(&a, &Silent).unwrap();
                let (u, _) = factor.solve(&partition.minus_b_times(&k, &fields), &Silent).unwrap();
                partition.insert_free(&u, &mut fields);
                for (node, u) in displacement.iter().enumerate() {
                    for axis in 0..3 {
                        let apart = (u[axis] - fields.data[3 * node + axis]).abs();
                        assert!(apart < 1e-12, "{}: {apart}", element.name);
                    }
                }
            }
        }
    }

    /// Pressure on a wall pushes as the wall's outline says, curved or not: ∫ n dA over a quarter of the inner wall is
    /// -(1, 1, 0) for radius and height 1. The area itself is the curved wall's to the order of the faces.
    #[test]
    fn pressure_on_curved_walls_has_its_resultant() {
        for &element in ELEMENTS {
            for mut body in bodies(element, ring) {
                body.load(|place| place.x == 0.0, |_, normal| *normal);
                let sum = |force: &NodeFields| {
                    force.data.chunks_exact(3).map(|f| Vector3::new(f[0], f[1], f[2])).sum::<Vector3<f64>>()
                };
                assert!((sum(&body.force) + Vector3::new(1.0, 1.0, 0.0)).amax() < 1e-14, "{}", element.name);
                body.force = NodeFields::zeros(body.mesh.nodes.len(), 1);
                body.load(|place| place.x == 0.0, |_, _| Vector3::z());
                let error = (sum(&body.force).z / FRAC_PI_2 - 1.0).abs();
                assert!(error < if element.order == 2 { 4e-4 } else { 0.02 }, "{}: {error}", element.name);
            }
        }
    }

    #[test]
    fn kuhns_tetrahedra_fill_the_block() {
        let body = Body::kuhn(&TET4, CELLS, |place| *place).unwrap();
        let volumes: Vec<f64> = (0..body.mesh.tets.len())
            .map(|tet| crate::mesh::quality::signed_volume(&body.mesh.corners(tet)))
            .collect();
        assert_eq!(volumes.len(), 6 * 12);
        assert!(volumes.iter().all(|volume| (volume * 72.0 - 1.0).abs() < 1e-12));
        assert!(body.node_at([0.4, 0.0, 0.0]).is_err());
    }
}
