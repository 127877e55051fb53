//! The displacement field of one setting in one pose, over all nodes.

use crate::base::columns::{Storage, StoredColumns};
use crate::base::parts::PartShare;
use crate::deform::{ControlPose, ControlPoses, ModelEntry, PoseSlope, Wrench, model_of, volume_model_of};
use crate::green::Solution;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// The output of a model for a pose: coefficients, and the rigid motion about `centre` that it separated from them.
pub struct ModelOutput {
    pub coefficients: Vec<f64>,
    pub motion: Isometry3<f64>,
    pub centre: Vector3<f64>,
    /// Displacements of all nodes, of a model with several parts or a field of its own.
    pub own: Option<Vec<Vector3<f64>>>,
    /// About the origins of the solution's control elements, where the model has an energy.
    pub wrenches: Option<Vec<Wrench>>,
}

/// The same affine motions about the origins of another discretisation, whose control elements hold other nodes:
/// o + T + M (x - o) = o' + T' + M (x - o') with T' = T + (M - I)(o' - o).
fn moved_origins(poses: &ControlPoses, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> ControlPoses {
    let shifted = |((pose, from), to): ((&ControlPose, &Vector3<f64>), &Vector3<f64>)| ControlPose {
        translation: pose.translation + (pose.matrix - Matrix3::identity()) * (to - from),
        matrix: pose.matrix,
    };
    poses.iter().zip(from).zip(to).map(shifted).collect()
}

pub fn origins(solution: &Solution) -> Vec<Vector3<f64>> {
    solution.controls.iter().map(|control| control.origin).collect()
}

/// Evaluates an online model; `None` for other models, and where its mean rotation is not defined.
pub fn evaluate(model: &ModelEntry, solution: &Solution, poses: &ControlPoses) -> Option<ModelOutput> {
    let (mut made, centre) = model_of(model, solution).ok()?;
    let state = made.state(poses);
    let mut slopes = vec![PoseSlope::default(); poses.len()];
    let response = made.respond(poses, &mut slopes).filter(|response| response.is_defined);
    let wrench = |(slope, pose)| Wrench::of(slope, pose);
    let wrenches = response.map(|_| slopes.iter().zip(poses).map(wrench).collect());
    let motion = state.body_from_surface();
    let is_own = state.parts.len() > 1 || made.field().is_some();
    let own = if is_own { Some(own_displacements(model, solution, poses)?) } else { None };
    (!state.rotation_undefined).then_some(ModelOutput {
        coefficients: state.coefficients,
        motion,
        centre,
        own,
        wrenches,
    })
}

/// Where a model with several parts or a field of its own moves all nodes.
fn own_displacements(
    model: &ModelEntry,
    solution: &Solution,
    poses: &ControlPoses,
) -> Option<Vec<Vector3<f64>>> {
    let (mut made, centre) = volume_model_of(model, solution).ok()?;
    let state = made.state(poses);
    let nodes = &solution.mesh.nodes;
    let rest: Vec<[f32; 3]> = nodes.iter().map(|x| (x - centre).cast::<f32>().into()).collect();
    let (weights, field) = (made.part_weights(&rest), made.field());
    let place = |n: usize| {
        let c = &state.coefficients;
        let sum = |axis| solution.fields.row(3 * n + axis).iter().zip(c).map(|(u, c)| u * c).sum::<f64>();
        let more = field.map_or_else(Vector3::zeros, |field| Vector3::from(field[n]).cast::<f64>());
        let x = Point3::from(nodes[n] - centre + Vector3::from_fn(|axis, _| sum(axis)) + more);
        let moved = match &weights {
            None => (state.body_from_surface() * x).coords,
            Some(weights) => {
                let part = |share: &PartShare| {
                    (state.parts[share.part as usize] * x).coords * f64::from(share.weight)
                };
                weights.of(n).iter().map(part).sum()
            }
        };
        moved - (nodes[n] - centre)
    };
    Some((0..nodes.len()).map(place).collect())
}

/// The same for poses about the origins `about`.
pub fn evaluate_about(
    model: &ModelEntry,
    solution: &Solution,
    poses: &ControlPoses,
    about: &[Vector3<f64>],
) -> Option<ModelOutput> {
    evaluate(model, solution, &moved_origins(poses, about, &origins(solution)))
}

/// Σ cₖ u⁽ᵏ⁾ at all nodes, before the rigid motion.
pub fn superposed(solution: &Solution, output: &ModelOutput) -> Vec<Vector3<f64>> {
    let c = &output.coefficients;
    let value = |row: usize| solution.fields.row(row).iter().zip(c).map(|(u, c)| u * c).sum::<f64>();
    (0..solution.mesh.nodes.len()).map(|n| Vector3::from_fn(|axis, _| value(3 * n + axis))).collect()
}

/// The whole displacement R (X + u) + t - X, or the model's own.
pub fn displaced(solution: &Solution, output: &ModelOutput, u: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    if let Some(own) = &output.own {
        return own.clone();
    }
    let (rotation, shift) = (output.motion.rotation, output.motion.translation.vector);
    let displacement = |(x, u): (&Vector3<f64>, &Vector3<f64>)| {
        let x = x - output.centre;
        rotation * x - x + rotation * u + shift
    };
    solution.mesh.nodes.iter().zip(u).map(displacement).collect()
}

/// The columns of `solution` as a .green file stores them, at all nodes, as if the inner ones were stored too.
pub fn stored(solution: &Solution, storage: Storage) -> Vec<Vec<f64>> {
    (0..solution.fields.columns)
        .map(|column| {
            let exact: Vec<f64> =
                (0..3 * solution.fields.nodes).map(|row| solution.fields.row(row)[column]).collect();
            StoredColumns::rounded(storage, &exact)
        })
        .collect()
}

/// Σ cₖ (stored u⁽ᵏ⁾ - u⁽ᵏ⁾).
pub fn storage_error(solution: &Solution, stored: &[Vec<f64>], output: &ModelOutput) -> Vec<Vector3<f64>> {
    let c = &output.coefficients;
    let value = |row: usize| -> f64 {
        stored.iter().zip(c).zip(solution.fields.row(row)).map(|((s, c), u)| c * (s[row] - u)).sum()
    };
    (0..solution.mesh.nodes.len()).map(|n| Vector3::from_fn(|axis, _| value(3 * n + axis))).collect()
}

/// Wrenches with moments about where the poses bring the points `about`, which they are about.
pub fn wrenches_about(
    solution: &Solution,
    output: &ModelOutput,
    poses: &ControlPoses,
    about: &[Vector3<f64>],
) -> Option<Vec<Wrench>> {
    let moved = |(e, wrench): (usize, &Wrench)| {
        let arm = solution.controls[e].origin - about[e] - poses[e].translation;
        Wrench { force: wrench.force, moment: wrench.moment + arm.cross(&wrench.force) }
    };
    Some(output.wrenches.as_ref()?.iter().enumerate().map(moved).collect())
}

/// a - b, node by node.
pub fn difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
