//! The family `affine`: for each control element the displacements that its twelve unit affine motions cause.
//!
//! In: the solved fields. Out: `basis/NAME` (12 × nodes × 3), and `scale/NAME` (12) where they are stored scaled. From the
//! paper's "Elastic deformation using control elements".

use super::super::bytes::Tensor;
use super::super::control::{FIELD_NAMES, FIELDS};
use super::super::family::{ColumnName, ColumnSource, FamilyEntry};
use super::super::file::{BodyMeta, GreenFile};
use super::super::numbers::numbers;
use super::super::requirements::Family;
use super::super::solution::Precomputed;
use super::columns::{self, Names};
use crate::base::columns::{ColumnGroup, Storage, StoredColumns};
use nalgebra::DMatrix;

pub const AFFINE: Family = Family { name: "affine", from: &[] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: AFFINE,
    holds: "displacements of the surface for the twelve unit affine motions of each control element",
    suits: None,
    compute: None,
    solves: false,
    write,
    check,
    groups,
    fixed_bytes: |_| 0,
    is_derived: true,
    column_names: Some(|meta| column_names(meta.controls.iter().map(|control| control.name.as_str()))),
};

fn names(control: &str) -> Names {
    Names { basis: format!("basis/{control}"), scale: format!("scale/{control}") }
}

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let fields = &body.solution.fields;
    let mut tensors = Vec::new();
    for (e, control) in body.solution.controls.iter().enumerate() {
        let stored = columns::stored(body, FIELDS, &|row, column| fields.row(row)[FIELDS * e + column]);
        meta.accuracy.storage_error = meta.accuracy.storage_error.max(stored.relative_error());
        meta.controls[e].storage_errors.clone_from(&stored.errors);
        let surface_nodes = body.solution.surface.nodes.len();
        tensors.extend(tensors_of(&control.name, surface_nodes, body.storage, stored));
    }
    tensors
}

/// The tensors of one control element.
pub fn tensors_of(
    control: &str,
    surface_nodes: usize,
    storage: Storage,
    stored: StoredColumns,
) -> Vec<(String, Tensor)> {
    columns::write(storage, surface_nodes, names(control), stored)
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    for control in &body.controls {
        let called = &control.name;
        columns::check(file, name, &names(called), FIELDS)?;
        let errors = format!("bodies.{name}.controls: {called}: storage_errors");
        numbers(&errors, control.storage_errors.iter().copied(), f64::MAX)?;
    }
    Ok(())
}

/// Names of the columns of these control elements.
pub fn column_names<'a>(controls: impl Iterator<Item = &'a str>) -> Vec<ColumnName> {
    let of = |(e, name): (usize, &'a str)| {
        FIELD_NAMES.into_iter().enumerate().map(move |(k, field)| ColumnName {
            name: format!("{name}.{field}"),
            unit: if k < 3 { "m" } else { "1" }.into(),
            source: ColumnSource::Field { control: e, field: k },
        })
    };
    controls.enumerate().flat_map(of).collect()
}

/// A group for each control element.
fn groups<'a>(file: &'a GreenFile, body: &str) -> Vec<ColumnGroup<'a>> {
    let controls = file.meta.bodies.get(body).map_or(&[][..], |meta| &meta.controls);
    controls.iter().map(|control| file.basis(body, &control.name)).collect()
}

impl GreenFile {
    /// The columns of all control elements as one matrix: a row for each axis of each surface node.
    pub fn affine_columns(&self, body: &str) -> Option<DMatrix<f64>> {
        let meta = self.meta.bodies.get(body).filter(|meta| meta.requirements.has(AFFINE))?;
        let (nodes, groups) = (meta.surface_nodes, groups(self, body));
        let value = |row: usize, column: usize| groups[column / FIELDS].value(nodes, column % FIELDS, row);
        Some(DMatrix::from_fn(3 * nodes, FIELDS * groups.len(), |row, column| value(row, column).into()))
    }

    /// The twelve columns of one control element.
    pub fn basis(&self, body: &str, control: &str) -> ColumnGroup<'_> {
        columns::group(self, body, &names(control))
    }
}
