//! A model of a body as it was solved, before any of it is written: what measurements compare.

use super::model::{ControlRest, DeformationModel, ModelEntry, ModelInput};
use super::models::make_model;
use crate::green::{AFFINE, Solution};
use crate::mesh::quality;
use nalgebra::{DMatrix, Vector3};

/// The model of a solved body with the tables that were computed of it, and the centre about which it has its lengths, in
/// the mesh's coordinates.
pub fn model_of(
    model: &ModelEntry,
    solution: &Solution,
) -> Result<(Box<dyn DeformationModel>, Vector3<f64>), String> {
    model_over(model, solution, &solution.surface.nodes, &solution.surface.triangles)
}

/// A model over all nodes of the mesh in place of the surface's, without triangles: what a model with parts or a field does
/// inside a body.
pub fn volume_model_of(
    model: &ModelEntry,
    solution: &Solution,
) -> Result<(Box<dyn DeformationModel>, Vector3<f64>), String> {
    let all: Vec<u32> = (0..solution.mesh.nodes.len() as u32).collect();
    model_over(model, solution, &all, &[])
}

fn model_over(
    model: &ModelEntry,
    solution: &Solution,
    over: &[u32],
    triangles: &[[u32; 3]],
) -> Result<(Box<dyn DeformationModel>, Vector3<f64>), String> {
    let (low, high) = quality::bounding_box(&solution.mesh.nodes);
    let centre = low + (high - low) * 0.5;
    let rest = |control: &crate::green::ControlElement| ControlRest {
        name: control.name.clone(),
        origin: control.origin - centre,
        nodes: control.nodes.len(),
    };
    let controls: Vec<ControlRest> = solution.controls.iter().map(rest).collect();
    let place = |&node: &u32| (solution.mesh.nodes[node as usize] - centre).cast::<f32>().into();
    let nodes: Vec<[f32; 3]> = over.iter().map(place).collect();
    let control_nodes = |e: usize| -> Vec<u32> {
        let held = &solution.controls[e].nodes;
        let held = over.iter().enumerate().filter(|(_, node)| held.binary_search(node).is_ok());
        held.map(|(i, _)| i as u32).collect()
    };
    let columns = || {
        let row = |row: usize| 3 * over[row / 3] as usize + row % 3;
        DMatrix::from_fn(3 * over.len(), solution.fields.columns, |r, k| solution.fields.row(row(r))[k])
    };
    let input = ModelInput {
        controls: &controls,
        rest: &nodes,
        triangles,
        control_nodes: &control_nodes,
        table: &|name| match name {
            name if name == AFFINE.name => Some(columns()),
            name => solution.tables.get(name).cloned(),
        },
        loads: None,
    };
    Ok((make_model(&model.kind, &input)?, centre))
}
