//! The list of deformation models.

use super::model::ModelEntry;
use super::{linear, perturbation, reduced, rod, rotation, statics};
use crate::fem::LAWS;

/// The models of the precomputed columns. A new one is a file with an entry, a `mod` line, and a line here.
const ONLINE: &[ModelEntry] =
    &[linear::ENTRY, rotation::ENTRY, reduced::ENTRY, perturbation::ENTRY, rod::ENTRY];

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

/// Why a model of [`super::Kind::Static`] cannot be shown, and the remedy.
pub fn not_online(model: &str) -> String {
    format!(
        "\"{model}\" is solved anew for every pose, which takes longer than a frame: `greenstage deform` alone takes it; \
         write model = \"rotation\" or \"linear\" to see and move the body"
    )
}
