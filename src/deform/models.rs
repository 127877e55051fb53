//! The list of deformation models.

use super::model::{DeformationModel, Kind, ModelEntry, ModelInput};
use super::{equilibria, linear, perturbation, plate, reduced, rod, rotation, statics, substructured};
use crate::fem::LAWS;

/// The models of the precomputed columns. A new one is a file with an entry, a `mod` line, and a line here.
const ONLINE: &[ModelEntry] = &[
    linear::ENTRY,
    rotation::ENTRY,
    perturbation::ENTRY,
    reduced::ENTRY,
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

/// Makes a model of this kind; the error says why this body cannot have it.
pub fn make_model(kind: &Kind, input: &ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String> {
    match kind {
        Kind::Online(make) => make(input),
        Kind::Background(law) => equilibria::make(law, input),
    }
}
