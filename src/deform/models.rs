//! The list of deformation models.

use super::model::{DeformationModel, Kind, ModelEntry, ModelInput};
use super::{equilibria, linear, perturbation, plate, reduced, rod, rotation, statics, substructured};
use crate::fem::LAWS;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

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

/// The model of a body that asks for none.
impl Default for &'static ModelEntry {
    fn default() -> &'static ModelEntry {
        &linear::ENTRY
    }
}

impl Serialize for ModelEntry {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name)
    }
}

impl<'de> Deserialize<'de> for &'static ModelEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<&'static ModelEntry, D::Error> {
        find_model(&String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

/// Makes a model of this kind; the error says why this body cannot have it.
pub fn make_model(kind: &Kind, input: &ModelInput<'_>) -> Result<Box<dyn DeformationModel>, String> {
    match kind {
        Kind::Online(make) => make(input),
        Kind::Background(law) => equilibria::make(law, input),
    }
}
