//! A .green file of a body with another surface and other columns, as after a cut.
//!
//! In: a file, and the new surface, columns and stiffness of one of its bodies. Out: a file in memory of this body alone, with the same
//! control elements and storage. Of the families it has the affine columns and the handle stiffness: all others belong to the body
//! before.

use super::bytes::Tensor;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::{AFFINE, STIFFNESS, affine_tensors};
use super::file::GreenFile;
use super::requirements::Requirements;
use crate::base::columns::StoredColumns;
use nalgebra::DMatrix;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The new parts of a body.
pub struct NewSurface {
    /// Places at rest of the nodes beyond those of the file, which keep their numbers; about the body's centre, m.
    pub points: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// New nodes of each control element, ascending.
    pub held: Vec<Vec<u32>>,
    /// Affine columns of the control elements on all nodes: 3 S × 12 K.
    pub columns: DMatrix<f64>,
    /// Handle stiffness: 12 K × 12 K.
    pub stiffness: DMatrix<f64>,
}

/// The file of the body of this name with its new parts.
pub fn resurfaced(base: Arc<GreenFile>, name: &str, new: &NewSurface) -> Result<GreenFile, GreenError> {
    let damaged =
        |reason: String| GreenError::Damaged { path: base.path.clone(), reason: format!("{name}: {reason}") };
    let meta = base.meta.bodies.get(name).ok_or_else(|| damaged("it is not there".to_owned()))?;
    let mut own = meta.clone();
    own.requirements = Requirements::new(&[AFFINE, STIFFNESS]);
    own.fingerprint = format!("{} cut", meta.fingerprint);
    own.surface_nodes = meta.surface_nodes + new.points.len();
    own.surface_triangles = new.triangles.len();
    (own.accuracy.storage_error, own.compliance_nodes, own.compressed) = (0.0, None, None);
    let rest = [base.rest(name), &new.points].concat();
    let mut tags = base.tags(name).to_vec();
    let first = tags.iter().max().map_or(1, |last| last.saturating_add(1));
    tags.extend((first..).take(new.points.len()));
    let mut tensors = BTreeMap::from([
        ("rest".to_owned(), Tensor::new(&[rest.len(), 3], rest.as_flattened().iter().copied())),
        (
            "triangles".to_owned(),
            Tensor::new(&[new.triangles.len(), 3], new.triangles.as_flattened().iter().copied()),
        ),
        ("tags".to_owned(), Tensor::new(&[tags.len()], tags)),
        (
            STIFFNESS.name.to_owned(),
            Tensor::new(&[new.stiffness.ncols(), new.stiffness.nrows()], new.stiffness.iter().copied()),
        ),
    ]);
    for (e, control) in own.controls.iter_mut().enumerate() {
        let more = new.held.get(e).map_or(&[][..], Vec::as_slice);
        let nodes = [base.control(name, &control.name), more].concat();
        control.nodes += more.len();
        tensors.insert(format!("control/{}", control.name), Tensor::new(&[nodes.len()], nodes));
        let column = |k: usize| new.columns.column(FIELDS * e + k).as_slice().to_vec();
        let columns: Vec<Vec<f64>> = (0..FIELDS).map(column).collect();
        let stored = StoredColumns::new(meta.accuracy.storage, &columns);
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        control.storage_errors.clone_from(&stored.errors);
        tensors.extend(affine_tensors(&control.name, rest.len(), meta.accuracy.storage, stored));
    }
    base.clone().with_alone(name, own, tensors)
}
