//! The list of deformation models.

use super::model::ModelEntry;
use super::{linear, rotation, statics};

/// All models; a new one is one file and one line here.
pub const MODELS: &[ModelEntry] = &[
    linear::ENTRY,
    rotation::ENTRY,
    statics::STVK_ENTRY,
    statics::NEO_HOOKEAN_ENTRY,
    statics::COROTATIONAL_ENTRY,
];

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
