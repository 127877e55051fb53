//! The family `cubic`: the cubic part of the strain energy of the affine fields.
//!
//! In: the affine fields of all control elements. Out: `cubic`, n (n + 1)(n + 2)/6 numbers θ_pqr of n = 12E fields
//! ([`cubic_energy`]).

use super::super::control::FIELDS;
use super::super::error::GreenError;
use super::super::family::{Assembled, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::requirements::Family;
use super::super::solution::Solution;
use super::affine::AFFINE;
use super::table;
use crate::fem::cubic_energy;
use crate::solve::Progress;
use nalgebra::DMatrix;

pub const CUBIC: Family = Family { name: "cubic", from: &[AFFINE] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: CUBIC,
    holds: "the cubic part of the strain energy of the affine fields, for forces at large rotations",
    suits: None,
    compute: Some(compute),
    solves: false,
    write: |body, _| table::write(body, CUBIC.name),
    check,
    groups: |_, _| Vec::new(),
    fixed_bytes: |control_elements| 8 * numbers_of(control_elements),
    is_derived: false,
    column_names: None,
};

/// θ_pqr with p ≤ q ≤ r.
fn numbers_of(control_elements: usize) -> usize {
    let n = FIELDS * control_elements;
    n * (n + 1) * (n + 2) / 6
}

fn compute(
    assembled: &Assembled<'_>,
    solution: &mut Solution,
    progress: &dyn Progress,
) -> Result<(), GreenError> {
    progress.begin("cubic energy", 0);
    let unfit = |source| GreenError::Assembly { body: assembled.place.to_owned(), source };
    let Solution { element, mesh, fields, .. } = &*solution;
    let theta = cubic_energy(element, mesh, assembled.lame, fields).map_err(unfit)?;
    solution.tables.insert(CUBIC.name, DMatrix::from_vec(theta.len(), 1, theta));
    progress.end();
    Ok(())
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    table::check(file, name, CUBIC.name, [numbers_of(body.controls.len()), 1]).map(drop)
}
