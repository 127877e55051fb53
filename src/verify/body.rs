//! A body to be judged by: the unit block mapped to its shape, with tractions and supports of single components.
//!
//! Tractions become nodal forces f_a = ∫ N_a t dA on three- and six-node faces, straight or curved. Supports are
//! eliminated exactly, component by component: with K u = f and u_d = g_d prescribed,
//!
//! ```text
//! | K_ff  0    | | u_f |   | f_f - K_fd g |
//! | 0     D_dd | | u_d | = | D_dd g       |     D the diagonal of K
//! ```

use super::{Element, Fault, Solution, quadrature};
use crate::fem::{Lame, NodeFields, StiffnessMatrix};
use crate::mesh::{Block, TetMesh, block, quadratic};
use crate::solve::{Cholesky, Silent, Symbolic};
use nalgebra::Vector3;
use std::time::Instant;

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
    ) -> Result<Body, Fault> {
        Ok(Body::from_block(element, block(&Block { size: [1.0; 3], cells })?, shape))
    }

    /// As [`Body::new`], with the six tetrahedra of Kuhn's split around the diagonal from (0, 0, 0) to (1, 1, 1) in each
    /// cell.
    pub fn kuhn(
        element: &Element,
        cells: [u32; 3],
        shape: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Result<Body, Fault> {
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
    pub fn node_at(&self, place: [f64; 3]) -> Result<usize, Fault> {
        let wanted = Vector3::from(place);
        let near = |at: &Vector3<f64>| (at - wanted).amax() < 1e-9;
        self.place.iter().position(near).ok_or(Fault::NoNode(place[0], place[1], place[2]))
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
        for face in quadrature::faces(&self.mesh, |node| on(&self.place[node])) {
            quadrature::visit_face(&self.mesh, &face, |x, normal, shapes| {
                let force = traction(&x, &normal.normalize()) * normal.norm();
                for &(node, value) in shapes {
                    for axis in 0..3 {
                        self.force.data[3 * node + axis] += force[axis] * value;
                    }
                }
            });
        }
    }

    /// Displacements of one material throughout.
    pub fn solve(&self, element: &Element, lame: Lame) -> Result<Solution, Fault> {
        let started = Instant::now();
        let k = (element.assemble)(&self.mesh, &vec![lame; self.mesh.tets.len()])?;
        let constrained = constrain(&k, &self.fixed);
        let symbolic = Symbolic::new(&constrained, &Silent)?;
        let factor = Cholesky::new(&constrained, &symbolic, &Silent)?;
        let (u, _) = factor.solve(&right_hand_side(&k, &self.force, &self.fixed), &Silent)?;
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

/// For each cell one tetrahedron for each order in which the three axes can be walked from corner 000 to 111.
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
