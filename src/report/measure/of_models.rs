//! The deformation models that settings have.
//!
//! In: the list of models. Out: those of the .green file ([`online`]), those among them that are made from what every
//! candidate has ([`is_common`]), and what they need.

use crate::deform::{MODELS, ModelEntry};
use crate::green::{AFFINE, CUBIC, Family, Requirements, STIFFNESS};

/// Column families of every candidate.
const COMMON: &[Family] = &[AFFINE, STIFFNESS, CUBIC];

/// Column families that these models and their energies need.
pub fn families(models: &[&ModelEntry]) -> Requirements {
    let of = |model: &&ModelEntry| {
        Requirements::of(model.requirements).and(Requirements::of(model.energy.unwrap_or_default()))
    };
    models.iter().map(of).fold(Requirements::default(), Requirements::and)
}

/// The models that are evaluated in every frame.
pub fn online() -> impl Iterator<Item = &'static ModelEntry> {
    MODELS.iter().filter(|model| model.law().is_none())
}

/// Whether it is made from what every candidate has.
pub fn is_common(model: &ModelEntry) -> bool {
    let made = Requirements::of(COMMON);
    model.requirements.iter().all(|family| made.has(*family))
}

/// The models of the affine columns alone: they suit every body, and where one of them is not defined nothing is measured.
pub fn of_affine_columns() -> impl Iterator<Item = &'static ModelEntry> {
    online().filter(|model| model.requirements.iter().all(|family| family.name == AFFINE.name))
}

/// Whether the model moves the nodes inside the body too, which are in no .green file: those that sum the affine columns do.
/// Others, such as `substructured` and `plate`, have displacements of the surface alone.
pub fn moves_inside(model: &ModelEntry) -> bool {
    model.requirements.iter().any(|family| family.name == AFFINE.name)
}
