//! Checks the solved columns with rigid motions, whose exact answer is known.
//!
//! In: the fields of all control elements over the mesh, and S. Out: how far the columns of a shift, summed over all
//! control elements, are from 1 in every node (a partition of unity), and how far S is from answering rigid motions
//! with nothing. It costs one pass over the columns, and sees errors that no residual shows.

use super::control::{ControlElement, FIELDS};
use super::pieces::Pieces;
use crate::fem::NodeFields;
use crate::mesh::{TetMesh, quality};
use nalgebra::{DMatrix, DVector, Vector3};

/// Errors of rigid motions; all are relative.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RigidMotion {
    /// max |Σ_e u⁽ᵀ⁾ - t| over all nodes for unit shifts t along the axes: displacement per displacement.
    pub shift: f64,
    /// The largest force that a shift of all control elements costs one of them, over what it costs to shift that one
    /// alone. `None` without S, or where no two control elements hold one piece.
    pub shift_force: Option<f64>,
    /// The same where forces and moments of shifts and turns are taken together, lengths measured in half the body's
    /// extent; at most 1, which says that no digit is left.
    pub turn_force: Option<f64>,
}

impl RigidMotion {
    pub fn of(
        mesh: &TetMesh,
        controls: &[ControlElement],
        fields: &NodeFields,
        stiffness: Option<&DMatrix<f64>>,
    ) -> RigidMotion {
        let shift = shift_error(fields, controls.len());
        let joined = Pieces::of(mesh).is_joined(mesh, controls);
        let forces = stiffness.filter(|_| joined.contains(&true)).map(|s| forces(mesh, controls, &joined, s));
        RigidMotion {
            shift,
            shift_force: forces.map(|[shift, _]| shift),
            turn_force: forces.map(|[_, turn]| turn),
        }
    }
}

fn larger(most: f64, value: f64) -> f64 {
    if value > most || value.is_nan() { value } else { most }
}

fn shift_error(fields: &NodeFields, controls: usize) -> f64 {
    let error = |row: usize, axis: usize| {
        let values = fields.row(row);
        let sum: f64 = (0..controls).map(|e| values[FIELDS * e + axis]).sum();
        (sum - if row % 3 == axis { 1.0 } else { 0.0 }).abs()
    };
    (0..3 * fields.nodes)
        .flat_map(|row| (0..3).map(move |axis| (row, axis)))
        .map(|(row, axis)| error(row, axis))
        .fold(0.0, larger)
}

/// A part of a turn's stiffness below which it is rounding, as about the line of a control element of nodes on one line.
const ROUNDING: f64 = 1e-6;

/// `[shift_force, turn_force]`. With the coefficients r_ek of control element e in its own unit motion k (three shifts, and
/// three turns about its origin over half the body's extent), and r_l of all elements in the body's unit motion l:
/// max |r_ekᵀ S r_l| / (r_ekᵀ S r_ek).
fn forces(mesh: &TetMesh, controls: &[ControlElement], joined: &[bool], s: &DMatrix<f64>) -> [f64; 2] {
    let (low, high) = quality::bounding_box(&mesh.nodes);
    let (centre, reach) = ((low + high) * 0.5, 0.5 * (high - low).norm());
    let motion = |about: Vector3<f64>, elements: std::ops::Range<usize>, k: usize| {
        let mut c = DVector::zeros(s.ncols());
        for e in elements {
            let own = &mut c.as_mut_slice()[FIELDS * e..][..FIELDS];
            if k < 3 {
                own[k] = 1.0;
                continue;
            }
            let turn = Vector3::ith(k - 3, 1.0 / reach);
            own[..3].copy_from_slice(turn.cross(&(controls[e].origin - about)).as_slice());
            let spin = turn.cross_matrix();
            for (field, value) in own[3..].iter_mut().enumerate() {
                *value = spin[(field / 3, field % 3)];
            }
        }
        c
    };
    let whole: Vec<DVector<f64>> = (0..6).map(|l| s * motion(centre, 0..controls.len(), l)).collect();
    let mut worst = [0.0; 2];
    for e in (0..controls.len()).filter(|&e| joined[e]) {
        let own: [DVector<f64>; 6] = std::array::from_fn(|k| motion(controls[e].origin, e..e + 1, k));
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
