//! Response of a body with inertia to forces at its nodes, in a step.
//!
//! In: the motion of nodes in the body's coordinates, and their weights ([`Inertia`]). Out: displacements until the end of the step beyond
//! those of the columns.

use crate::deform::Deformer;
use crate::world::inertia::Inertia;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// Response of a body in a step.
#[derive(Default)]
pub struct Response {
    /// r of nodes.
    rows: BTreeMap<u32, Vec<V3>>,
    /// w.
    pub weights: Vec<f64>,
    /// Axes of the columns where the step begins, body_from_columns.
    pub turn: UnitQuaternion<f64>,
    /// Forces at the end of the step under which it has come to where it is, along the axes of the columns.
    pub forces: Vec<(u32, V3)>,
    /// Σ_j w_k r_jkᵀ f_j of these forces, once their rows are there.
    moved: Vec<f64>,
}

impl Response {
    /// r of a spot, given by its nodes and their weights.
    pub fn rows_of(&self, corners: impl Iterator<Item = (u32, f64)>) -> Vec<V3> {
        let mut all = vec![V3::zeros(); self.weights.len()];
        for (node, w) in corners {
            let rows = self.rows.get(&node).into_iter().flatten();
            all.iter_mut().zip(rows).for_each(|(sum, row)| *sum += row * w);
        }
        all
    }

    /// Makes sure that the rows of these nodes are there, and of those at which forces act.
    pub fn fetch(&mut self, inertia: &dyn Inertia, deformer: &Deformer, nodes: impl Iterator<Item = u32>) {
        let pressed = self.forces.iter().map(|(node, _)| *node);
        for node in nodes.chain(pressed) {
            self.rows.entry(node).or_insert_with(|| inertia.rows(deformer, node));
        }
        self.moved.clear();
        self.moved.resize(self.weights.len(), 0.0);
        for (node, force) in &self.forces {
            let of_node = self.moved.iter_mut().zip(&self.rows[node]).zip(&self.weights);
            of_node.for_each(|((sum, row), w)| *sum += w * row.dot(force));
        }
    }

    /// Displacement of a node by the present forces, m.
    pub fn displacement(&self, node: u32) -> V3 {
        let rows = self.rows.get(&node).map_or(&[][..], Vec::as_slice);
        rows.iter().zip(&self.moved).map(|(row, moved)| row * *moved).sum()
    }
}
