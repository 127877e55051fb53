//! The list of deformation models.

use super::model::ModelEntry;
use super::{linear, rotation, statics};
use crate::fem::LAWS;

/// All models: those of the precomputed columns, each one file and one line here, then one for each of [`LAWS`].
pub const MODELS: &[ModelEntry] = &{
    const ONLINE: usize = 2;
    let mut models = [linear::ENTRY; ONLINE + LAWS.len()];
    models[1] = rotation::ENTRY;
    let mut law = 0;
    while law < LAWS.len() {
        models[ONLINE + law] = statics::entry(LAWS[law]);
        law += 1;
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
