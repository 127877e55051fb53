//! The list of deformation models, one file or folder each, and models of bodies as they were solved, before any of it is written:
//! what measurements compare.

#[cfg(test)]
mod fixture;
pub mod helicoidal;
pub mod linear;
pub mod perturbation;
pub mod plate;
pub mod reduced;
pub mod rod;
pub mod rotation;
pub mod substructured;

use super::model::{ControlRest, DeformationModel, Kind, ModelEntry, ModelInput};
use super::statics;
use super::statics::equilibria;
use crate::base::by_name::by_name;
use crate::base::extent::bounding_box;
use crate::fem::{LAWS, Law, STVK};
use crate::green::{AFFINE, Solution};
use nalgebra::{DMatrix, Vector3};

/// The models of the precomputed columns. A new one is a file with an entry, a `mod` line, and a line here.
const ONLINE: &[ModelEntry] = &[
    linear::ENTRY,
    rotation::ENTRY,
    perturbation::ENTRY,
    reduced::ENTRY,
    reduced::NEO_HOOKEAN_ENTRY,
    substructured::ENTRY,
    rod::ENTRY,
    plate::ENTRY,
];

/// All models: those of the precomputed columns, then one for each of [`LAWS`].
pub const MODELS: &[ModelEntry] = &{
    let mut models = [linear::ENTRY; ONLINE.len() + LAWS.len()];
    let mut i = 0;
    while i < models.len() {
        models[i] = if i < ONLINE.len() { ONLINE[i] } else { statics::entry(LAWS[i - ONLINE.len()]) };
        i += 1;
    }
    models
};

/// The model called `name`, or what there is instead.
pub fn find_model(name: &str) -> Result<&'static ModelEntry, String> {
    MODELS
        .iter()
        .find(|entry| entry.name == name)
        .ok_or_else(|| crate::config::unknown_name("model", name, MODELS.iter().map(|entry| entry.name)))
}

/// The law whose equilibrium at large strain the errors of the model called `name` are measured against; St. Venant–Kirchhoff's where
/// no model is called so, which is refused where the body is prepared.
pub fn large_strain_law_of(name: &str) -> &'static Law {
    find_model(name).map_or(&STVK, ModelEntry::large_strain_law)
}

/// The model of a body that asks for none.
impl Default for &'static ModelEntry {
    fn default() -> &'static ModelEntry {
        &linear::ENTRY
    }
}

by_name!(ModelEntry, find_model);

/// Makes a model of this kind; the error says why this body cannot have it.
pub fn make_model(kind: &Kind, input: &ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String> {
    match kind {
        Kind::Online(make) => make(input),
        Kind::Background(law) => equilibria::make(law, input),
    }
}

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
    let (low, high) = bounding_box(&solution.mesh.nodes);
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
