//! A model of a body as it was solved, before any of it is written: what measurements compare.

use super::model::{ControlRest, DeformationModel, Kind, ModelEntry, ModelInput};
use super::models::not_online;
use crate::green::Solution;
use crate::mesh::quality;
use nalgebra::Vector3;

/// The model of a solved body with the tables that were computed of it, and the centre about which it has its lengths, in
/// the mesh's coordinates.
pub fn model_of(
    model: &ModelEntry,
    solution: &Solution,
) -> Result<(Box<dyn DeformationModel>, Vector3<f64>), String> {
    let Kind::Online(make) = &model.kind else { return Err(not_online(model.name)) };
    let (low, high) = quality::bounding_box(&solution.mesh.nodes);
    let centre = low + (high - low) * 0.5;
    let rest = |control: &crate::green::ControlElement| ControlRest {
        name: control.name.clone(),
        origin: control.origin - centre,
        nodes: control.nodes.len(),
    };
    let controls: Vec<ControlRest> = solution.controls.iter().map(rest).collect();
    let surface = &solution.surface;
    let place = |&node: &u32| (solution.mesh.nodes[node as usize] - centre).cast::<f32>().into();
    let nodes: Vec<[f32; 3]> = surface.nodes.iter().map(place).collect();
    let control_nodes = |e: usize| -> Vec<u32> {
        let held = &solution.controls[e].nodes;
        let on_surface =
            surface.nodes.iter().enumerate().filter(|(_, node)| held.binary_search(node).is_ok());
        on_surface.map(|(i, _)| i as u32).collect()
    };
    let made = make(&ModelInput {
        controls: &controls,
        rest: &nodes,
        triangles: &surface.triangles,
        control_nodes: &control_nodes,
        table: &|name| solution.tables.get(name).cloned(),
    })?;
    Ok((made, centre))
}
