//! Checks the solved columns with rigid motions, whose exact answer is known.
//!
//! In: columns of all control elements at some nodes, of a solution or of a .green file, and S. Out: how far the columns of
//! a shift and of a turn, summed over all control elements, are from that motion in every node, and how far S is from answering
//! rigid motions with nothing. It costs one pass over the columns, and sees errors that no residual shows.

use super::control::{ControlElement, FIELDS};
use super::file::{ControlMeta, GreenFile};
use super::pieces::{Pieces, shares_a_part};
use crate::base::disjoint::DisjointSets;
use crate::base::extent::bounding_box;
use crate::fem::NodeFields;
use crate::mesh::TetMesh;
use nalgebra::{DMatrix, DVector, Vector3};
use std::ops::Range;

/// Errors of rigid motions; all are relative.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RigidMotion {
    /// max |Σ_e u⁽ᵀ⁾ - t| over all nodes for unit shifts t along the axes: displacement per displacement.
    pub shift: f64,
    /// Error of turns of all control elements about the body's middle, over the displacement at half the body's extent.
    pub turn: f64,
    /// The largest force that a shift of all control elements costs one of them, over what it costs to shift that one
    /// alone. `None` without S, or where no two control elements hold one piece.
    pub shift_force: Option<f64>,
    /// The largest force or moment that a shift or turn of all control elements costs one of them, over what it costs to move
    /// that one alone, lengths measured in half the body's extent; at most 1, which means that no digit is left.
    pub turn_force: Option<f64>,
}

/// Columns at some nodes, as the check needs them.
struct Columns<'a> {
    nodes: &'a [Vector3<f64>],
    /// o_e of every control element.
    origins: &'a [Vector3<f64>],
    /// Whether another control element holds nodes of the same part, for each one.
    joined: &'a [bool],
    /// Entry (3 node + axis, 12 e + k).
    value: &'a dyn Fn(usize, usize) -> f64,
    /// The known error of each column by its storage, m per unit; none of f64.
    errors: &'a [f64],
}

impl RigidMotion {
    pub fn new(
        mesh: &TetMesh,
        controls: &[ControlElement],
        fields: &NodeFields,
        stiffness: Option<&DMatrix<f64>>,
    ) -> RigidMotion {
        let origins: Vec<Vector3<f64>> = controls.iter().map(|control| control.origin).collect();
        let joined = Pieces::new(mesh).is_joined(mesh, controls);
        let value = |row: usize, column: usize| fields.row(row)[column];
        let nodes = &mesh.nodes;
        Columns { nodes, origins: &origins, joined: &joined, value: &value, errors: &[] }.check(stiffness)
    }
}

impl GreenFile {
    /// Errors of rigid motions by S and by columns on the surface of a body, entry (3 node + axis, 12 e + k), for some of its
    /// control elements. The parts of the body are found by its surface.
    pub(super) fn rigid_motion_of(
        &self,
        body: &str,
        controls: &[ControlMeta],
        value: &dyn Fn(usize, usize) -> f64,
        stiffness: Option<&DMatrix<f64>>,
    ) -> RigidMotion {
        if controls.is_empty() {
            return RigidMotion::default();
        }
        let nodes: Vec<Vector3<f64>> =
            self.rest(body).iter().map(|&place| Vector3::from(place.map(f64::from))).collect();
        let origins: Vec<Vector3<f64>> = controls.iter().map(|c| Vector3::from(c.origin)).collect();
        let errors: Vec<f64> = controls.iter().flat_map(|c| c.storage_errors.iter().copied()).collect();
        let mut sets = DisjointSets::new(nodes.len());
        for &[a, b, c] in self.triangles(body) {
            sets.join(a, b);
            sets.join(b, c);
        }
        let held = |control: &ControlMeta| {
            self.control(body, &control.name).iter().map(|&node| sets.root(node)).collect()
        };
        let joined = shares_a_part(&controls.iter().map(held).collect::<Vec<_>>());
        let columns = Columns { nodes: &nodes, origins: &origins, joined: &joined, value, errors: &errors };
        columns.check(stiffness)
    }
}

fn larger(most: f64, value: f64) -> f64 {
    if value > most || value.is_nan() { value } else { most }
}

/// A part of a turn's stiffness below which it is rounding, as about the line of a control element of nodes on one line.
const ROUNDING: f64 = 1e-6;

impl Columns<'_> {
    fn check(&self, stiffness: Option<&DMatrix<f64>>) -> RigidMotion {
        let (low, high) = bounding_box(self.nodes);
        let (centre, reach) = ((low + high) * 0.5, 0.5 * (high - low).norm());
        let [shift, turn] = [0..3, 3..6]
            .map(|motions| motions.map(|l| self.displacement(l, centre, reach)).fold(0.0, larger));
        let forces = stiffness.filter(|_| self.joined.contains(&true)).map(|s| self.forces(s, centre, reach));
        let [shift_force, turn_force] = [0, 1].map(|k| forces.map(|forces| forces[k]));
        RigidMotion { shift, turn, shift_force, turn_force }
    }

    /// The coefficients of all fields in the motion `l` of these control elements: a shift along an axis, or a turn about an axis
    /// through `about`, of 1/reach.
    fn motion(&self, l: usize, about: Vector3<f64>, elements: Range<usize>, reach: f64) -> DVector<f64> {
        let mut c = DVector::zeros(FIELDS * self.origins.len());
        for e in elements {
            let own = &mut c.as_mut_slice()[FIELDS * e..][..FIELDS];
            if l < 3 {
                own[l] = 1.0;
                continue;
            }
            let turn = Vector3::ith(l - 3, 1.0 / reach);
            own[..3].copy_from_slice(turn.cross(&(self.origins[e] - about)).as_slice());
            let spin = turn.cross_matrix();
            for (field, value) in own[3..].iter_mut().enumerate() {
                *value = spin[(field / 3, field % 3)];
            }
        }
        c
    }

    /// The largest error of the displacements in a motion of all control elements, beyond that of storage.
    fn displacement(&self, l: usize, centre: Vector3<f64>, reach: f64) -> f64 {
        let c = self.motion(l, centre, 0..self.origins.len(), reach);
        let parts: Vec<(usize, f64)> = c.iter().copied().enumerate().filter(|(_, c)| *c != 0.0).collect();
        let known: f64 = parts.iter().map(|(k, c)| c.abs() * self.errors.get(*k).unwrap_or(&0.0)).sum();
        let error = |node: usize| {
            let exact = match l.checked_sub(3) {
                None => Vector3::ith(l, 1.0),
                Some(axis) => Vector3::ith(axis, 1.0 / reach).cross(&(self.nodes[node] - centre)),
            };
            let found = |axis: usize| -> f64 {
                parts.iter().map(|(k, c)| c * (self.value)(3 * node + axis, *k)).sum()
            };
            (0..3).map(|axis| (found(axis) - exact[axis]).abs()).fold(0.0, larger)
        };
        let most = (0..self.nodes.len()).map(error).fold(0.0, larger);
        if most <= known { 0.0 } else { most - known }
    }

    /// `[shift_force, turn_force]`. With the coefficients r_ek of control element e in its own unit motion k (three shifts,
    /// and three turns about its origin over half the body's extent), and r_l of all elements in the body's unit motion l:
    /// max |r_ekᵀ S r_l| / (r_ekᵀ S r_ek).
    fn forces(&self, s: &DMatrix<f64>, centre: Vector3<f64>, reach: f64) -> [f64; 2] {
        let all = 0..self.origins.len();
        let whole: Vec<DVector<f64>> =
            (0..6).map(|l| s * self.motion(l, centre, all.clone(), reach)).collect();
        let mut worst = [0.0; 2];
        for e in all.filter(|&e| self.joined[e]) {
            let own: [DVector<f64>; 6] =
                std::array::from_fn(|k| self.motion(k, self.origins[e], e..e + 1, reach));
            let costs: Vec<f64> = own.iter().map(|own| own.dot(&(s * own))).collect();
            let largest = costs.iter().copied().fold(0.0, larger);
            for (k, own) in own.iter().enumerate() {
                for (l, answer) in whole.iter().enumerate() {
                    let is_shift = k < 3 && l < 3;
                    let force = own.dot(answer).abs();
                    let cost = if k < 3 { costs[k] } else { costs[k].max(ROUNDING * largest) };
                    let part = if force == 0.0 { 0.0 } else { force / cost.abs() };
                    let (at, part) = if is_shift { (0, part) } else { (1, part.min(1.0)) };
                    worst[at] = larger(worst[at], part);
                }
            }
        }
        worst
    }
}
