//! The family `substructures`: the parts of a body, with energies and displacements of their own.
//!
//! In: the mesh, and how the scene's key `parts` cuts it. Out: the tables of [`StoredParts`], which the model `substructured`
//! is made from.

use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::prepare::Prepared;
use super::super::requirements::Family;
use super::super::solution::Solution;
use super::super::substructure::{self, Body, StoredParts, TABLES};
use super::affine::AFFINE;
use super::stiffness::STIFFNESS;
use super::table;
use crate::base::extent::bounding_box;
use crate::scene;
use crate::solve::Progress;

pub const SUBSTRUCTURES: Family = Family { name: "substructures", from: &[AFFINE, STIFFNESS] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: SUBSTRUCTURES,
    holds: "the body's parts: their ends, strain energies to fourth order and displacements to second",
    suits: Some(suits),
    compute: Some(compute),
    solves: false,
    write: |body, _| TABLES.iter().flat_map(|name| table::write(body, name)).collect(),
    check,
    groups: |_, _| Vec::new(),
    // Eight parts in a row: six inside with 6 coordinates, the two at the ends with 12.
    fixed_bytes: |_| 8 * (6 * (36 + 6 * 21 + 21 * 21) + 2 * (144 + 12 * 78 + 21 * 21)),
    is_derived: false,
    column_names: None,
};

fn suits(place: &str, body: &scene::Body, prepared: &Prepared) -> Result<(), GreenError> {
    let failed = |source| GreenError::Parts { body: place.to_owned(), source };
    substructure::suits(body.element, prepared.controls.len()).map_err(failed)
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    let (settings, place) = (assembled.body, assembled.place.to_owned());
    let Solution { element, mesh, surface, controls, .. } = &*solution;
    let failed = |source| GreenError::Parts { body: place.clone(), source };
    let unsolved = |source| GreenError::Solve { body: place.clone(), source };
    let parts = settings.parts.unwrap_or_default();
    let cut = substructure::cut(mesh, controls, parts, &settings.solver, progress).map_err(unsolved)?;
    let lame = assembled.lame;
    let body = Body { element, mesh, surface, lame, controls, cut: &cut, solver: &settings.solver };
    let mut solved = substructure::solve(&body, progress).map_err(failed)?;
    if let Some(stiffness) = solution.stiffness() {
        substructure::fit(&mut solved, controls, stiffness).map_err(failed)?;
    }
    let (low, high) = bounding_box(&mesh.nodes);
    let tables = substructure::tables(&solved, &(low + (high - low) * 0.5));
    solution.tables.extend(tables);
    Ok(())
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    StoredParts::read(&|table| file.table(name, table), body.controls.len(), body.surface_nodes)
        .map(drop)
        .map_err(|fault| format!("body {name}: {fault}"))
}
