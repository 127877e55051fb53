//! The displacement field of one setting in one pose, over all nodes.

use super::poses::{about_origins, on_the_way};
use super::variants::moves_inside;
use crate::base::columns::{Storage, StoredColumns};
use crate::base::parts::PartShare;
use crate::deform::{
    BodyState, ControlPose, ControlPoses, DeformationModel, ModelEntry, PoseSlope, Wrench, model_of,
    volume_model_of,
};
use crate::green::{REDUCED_FIELDS, Solution};
use nalgebra::{Isometry3, Point3, Vector3};

/// The output of a model for a pose: coefficients, and the rigid motion about `centre` that it separated from them.
pub struct ModelOutput {
    pub coefficients: Vec<f64>,
    pub motion: Isometry3<f64>,
    pub centre: Vector3<f64>,
    /// Displacements of all nodes, for a model with several parts or with displacements that are no columns.
    pub own: Option<Vec<Vector3<f64>>>,
    /// Displacements of the surface nodes, of a model that does not move the others.
    pub surface: Option<Vec<Vector3<f64>>>,
    /// Wrenches about the origins of the solution's control elements, if the model has an energy.
    pub wrenches: Option<Vec<Wrench>>,
}

pub fn origins(solution: &Solution) -> Vec<Vector3<f64>> {
    solution.controls.iter().map(|control| control.origin).collect()
}

/// Evaluates an online model in poses to which a hand brings it; `None` for other models, for a body that does not suit the
/// model, and where it has no state.
pub fn evaluate(model: &ModelEntry, solution: &Solution, poses: &ControlPoses) -> Option<ModelOutput> {
    let (mut made, centre) = model_of(model, solution).ok()?;
    let state = come_to(&mut *made, poses);
    let mut slopes = vec![PoseSlope::default(); poses.len()];
    let response = made.respond(poses, &mut slopes).filter(|response| response.is_defined);
    let wrench = |(slope, pose)| Wrench::from_slope(slope, pose);
    let wrenches = response.map(|_| slopes.iter().zip(poses).map(wrench).collect());
    let (mut own, mut surface) = (None, None);
    if !moves_inside(model) {
        surface = Some(displacements(&*made, &state, solution, &solution.surface.nodes, &centre));
    } else if state.parts.len() > 1 || made.field().is_some() {
        let (mut made, centre) = volume_model_of(model, solution).ok()?;
        let state = come_to(&mut *made, poses);
        let all: Vec<u32> = (0..solution.mesh.nodes.len() as u32).collect();
        own = Some(displacements(&*made, &state, solution, &all, &centre));
    }
    let motion = state.body_from_surface();
    let output = ModelOutput { coefficients: state.coefficients, motion, centre, own, surface, wrenches };
    (!state.rotation_undefined).then_some(output)
}

fn come_to(model: &mut dyn DeformationModel, poses: &ControlPoses) -> BodyState {
    for between in on_the_way(poses) {
        model.state(&between);
    }
    model.state(poses)
}

/// Displacements of these nodes by a model, with those of its parts and its field.
fn displacements(
    model: &dyn DeformationModel,
    state: &BodyState,
    solution: &Solution,
    over: &[u32],
    centre: &Vector3<f64>,
) -> Vec<Vector3<f64>> {
    let about = |node: u32| solution.mesh.nodes[node as usize] - centre;
    let rest: Vec<[f32; 3]> = over.iter().map(|&node| about(node).cast::<f32>().into()).collect();
    let (weights, field) = (model.part_weights(&rest), model.field());
    let place = |(i, &node): (usize, &u32)| {
        let more = field.map_or_else(Vector3::zeros, |field| Vector3::from(field[i]).cast::<f64>());
        let x = Point3::from(about(node) + sum_at(solution, node as usize, &state.coefficients) + more);
        let moved = match &weights {
            None => (state.body_from_surface() * x).coords,
            Some(weights) => {
                let part = |share: &PartShare| {
                    (state.parts[share.part as usize] * x).coords * f64::from(share.weight)
                };
                weights.at(i).iter().map(part).sum()
            }
        };
        moved - about(node)
    };
    over.iter().enumerate().map(place).collect()
}

/// The columns that are summed online, of one axis of one node: those of the affine motions, then those of `reduced`.
fn columns_at(solution: &Solution, row: usize) -> impl Iterator<Item = f64> {
    let more = solution.tables.get(REDUCED_FIELDS);
    let more = more.into_iter().flat_map(move |table| (0..table.ncols()).map(move |k| table[(row, k)]));
    solution.fields.row(row).iter().copied().chain(more)
}

/// Σ cₖ u⁽ᵏ⁾ of one node.
fn sum_at(solution: &Solution, node: usize, c: &[f64]) -> Vector3<f64> {
    let sum = |axis| columns_at(solution, 3 * node + axis).zip(c).map(|(u, c)| u * c).sum();
    Vector3::from_fn(|axis, _| sum(axis))
}

/// [`evaluate`] for poses about the origins `about`.
pub fn evaluate_about(
    model: &ModelEntry,
    solution: &Solution,
    poses: &ControlPoses,
    about: &[Vector3<f64>],
) -> Option<ModelOutput> {
    evaluate(model, solution, &about_origins(poses, about, &origins(solution)))
}

/// Σ cₖ u⁽ᵏ⁾ at all nodes, before the rigid motion.
fn superposed(solution: &Solution, output: &ModelOutput) -> Vec<Vector3<f64>> {
    (0..solution.mesh.nodes.len()).map(|n| sum_at(solution, n, &output.coefficients)).collect()
}

/// The whole displacement R (X + u) + t - X, or the model's own.
pub fn displaced(solution: &Solution, output: &ModelOutput) -> Vec<Vector3<f64>> {
    if let Some(own) = &output.own {
        return own.clone();
    }
    let u = superposed(solution, output);
    let (rotation, shift) = (output.motion.rotation, output.motion.translation.vector);
    let displacement = |(x, u): (&Vector3<f64>, &Vector3<f64>)| {
        let x = x - output.centre;
        rotation * x - x + rotation * u + shift
    };
    solution.mesh.nodes.iter().zip(&u).map(displacement).collect()
}

/// The columns of `solution` as a .green file stores them, at all nodes, as if the inner ones were stored too.
pub fn stored(solution: &Solution, storage: Storage) -> Vec<Vec<f64>> {
    let more = solution.tables.get(REDUCED_FIELDS);
    let own = (0..solution.fields.columns).map(|column| {
        (0..3 * solution.fields.nodes).map(|row| solution.fields.row(row)[column]).collect::<Vec<f64>>()
    });
    let more =
        more.into_iter().flat_map(|table| table.column_iter().map(|column| column.iter().copied().collect()));
    own.chain(more).map(|exact| StoredColumns::rounded(storage, &exact)).collect()
}

/// Σ cₖ (stored u⁽ᵏ⁾ - u⁽ᵏ⁾).
pub fn storage_error(solution: &Solution, stored: &[Vec<f64>], output: &ModelOutput) -> Vec<Vector3<f64>> {
    let c = &output.coefficients;
    let value = |row: usize| -> f64 {
        stored.iter().zip(c).zip(columns_at(solution, row)).map(|((s, c), u)| c * (s[row] - u)).sum()
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
    Some(placed(output.wrenches.as_ref()?, &origins(solution), about, poses))
}

/// Wrenches about where `origins` rested, about where the poses bring the points `about` of the same control elements.
pub fn placed(
    wrenches: &[Wrench],
    origins: &[Vector3<f64>],
    about: &[Vector3<f64>],
    poses: &[ControlPose],
) -> Vec<Wrench> {
    let place = |(e, wrench): (usize, &Wrench)| wrench.about(&(origins[e] - about[e]), &poses[e]);
    wrenches.iter().enumerate().map(place).collect()
}

/// a - b, control element by control element.
pub fn less(a: &[Wrench], b: &[Wrench]) -> Vec<Wrench> {
    let less = |(a, b): (&Wrench, &Wrench)| Wrench { force: a.force - b.force, moment: a.moment - b.moment };
    a.iter().zip(b).map(less).collect()
}

/// a - b, node by node.
pub fn difference(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
