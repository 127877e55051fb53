//! The list of column families.

mod affine;
mod columns;
mod compliance;
mod compressed;
mod cubic;
mod equilibria;
mod found;
mod kept_factor;
mod load_forces;
mod loads;
mod of_effects;
mod perturbation;
mod pressures;
mod reduced;
mod screw_paths;
mod stiffness;
mod substructures;
mod table;
mod tile_layout;
mod tractions;
mod updates;
mod volume;
mod yielding;

pub use affine::AFFINE;
pub(super) use affine::{column_names as names_of_fields, tensors_of as affine_tensors};
pub use compliance::{COMPLIANCE, compliance_size};
pub use compressed::COMPRESSED;
pub use cubic::CUBIC;
pub use equilibria::{KnownEquilibrium, PathKind, has_equilibria};
pub use kept_factor::KEPT_FACTOR;
pub use load_forces::{LOAD_FORCES, LoadForces};
pub use loads::{LOAD_COMPLIANCE, LOAD_FIELDS, LOADS, MOMENTS, REACTION, TORQUES, nodal_forces};
pub(super) use loads::{column_names as names_of_loads, load_tensors};
pub use of_effects::{columns_of_effect, is_column};
pub use perturbation::{PERTURBATION, RADIUS, SERIES};
pub use pressures::MOST_PRESSURES;
pub use reduced::{
    EQUILIBRIA, FIELDS_TABLE as REDUCED_FIELDS, PRESSED_POINTS, QUARTIC, REDUCED, REDUCED_LOADS,
    REDUCED_NEO_HOOKEAN, VOLUME_FORMS, WARMTH,
};
pub use stiffness::STIFFNESS;
pub use substructures::SUBSTRUCTURES;
pub use tractions::Tractions;
pub use updates::UPDATES;
pub use volume::{VOLUME, Volume};
pub use yielding::Compliance;

use super::family::FamilyEntry;
use super::file::GreenFile;
use crate::base::columns::ColumnGroup;

/// All families, in the order in which they are computed and in which their columns are summed; a new one is one file and
/// one line here.
pub const FAMILIES: &[FamilyEntry] = &[
    affine::ENTRY,
    stiffness::ENTRY,
    cubic::ENTRY,
    reduced::ENTRY,
    reduced::NEO_HOOKEAN_ENTRY,
    perturbation::ENTRY,
    substructures::ENTRY,
    volume::ENTRY,
    loads::ENTRY,
    load_forces::ENTRY,
    compliance::ENTRY,
    kept_factor::ENTRY,
    compressed::ENTRY,
    updates::ENTRY,
];

impl GreenFile {
    /// The groups of columns that are summed for a body: of all families that it requires, then of its effects.
    pub fn groups(&self, body: &str) -> Vec<ColumnGroup<'_>> {
        let Some(meta) = self.meta.bodies.get(body) else { return Vec::new() };
        let required = FAMILIES.iter().filter(|entry| meta.requirements.has(entry.family));
        let of_families = required.flat_map(|entry| (entry.groups)(self, body));
        of_families.chain(self.groups_of_effects(body)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_family_stands_behind_those_that_it_is_made_from() {
        for (at, entry) in FAMILIES.iter().enumerate() {
            let is_before = |name: &str| FAMILIES[..at].iter().any(|other| other.family.name == name);
            assert!(entry.family.from.iter().all(|from| is_before(from.name)), "{}", entry.family.name);
            assert!(!is_before(entry.family.name) && !entry.holds.is_empty(), "{}", entry.family.name);
        }
    }
}
