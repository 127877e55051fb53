//! A .green file of a body with another surface and other columns, as after a cut.
//!
//! In: a file, and the new surface, columns and stiffness of one of its bodies. Out: a file in memory of this body alone, with the same
//! control elements and storage. Of the families it has the affine columns, the handle stiffness and what gravity does; the compliance
//! of its surface is solved for when it is asked for. All other families belong to the body before.

use super::bytes::Tensor;
use super::control::FIELDS;
use super::error::GreenError;
use super::families::{
    AFFINE, LOAD_COMPLIANCE, LOADS, MOMENTS, REACTION, STIFFNESS, TORQUES, affine_tensors, load_tensors,
};
use super::file::GreenFile;
use super::on_demand::SolvedCompliance;
use super::requirements::Requirements;
use crate::base::columns::StoredColumns;
use nalgebra::{DMatrix, Vector3};
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
    /// The body under gravity, where the file has that.
    pub weight: Option<NewWeight>,
    /// The compliance of its surface, where the file has one.
    pub compliance: Option<Arc<dyn SolvedCompliance>>,
}

/// The answer of a body to gravity: a column for each axis.
pub struct NewWeight {
    /// Displacements of all nodes of the surface: 3 S × 3.
    pub columns: DMatrix<f64>,
    /// UᵀF of the affine fields: 12 K × 3.
    pub reaction: DMatrix<f64>,
    /// FᵀG: 3 × 3.
    pub compliance: DMatrix<f64>,
    /// Forces and moments ([`MOMENTS`]) of what is no part of the body any more: 12 × 3.
    pub lost: DMatrix<f64>,
}

impl NewWeight {
    /// Σ u × f of all fields, then of the columns, for gravity along each axis. With f = m e of mass m at each node it is (Σ m u) × e, and the
    /// components of Σ m u are the work of gravity along each axis.
    fn torques(&self) -> DMatrix<f64> {
        let fields = self.reaction.nrows();
        let work = |column: usize| match column.checked_sub(fields) {
            None => self.reaction.row(column),
            Some(own) => self.compliance.row(own),
        };
        let mut torques = DMatrix::zeros(3 * (fields + 3), 3);
        for column in 0..fields + 3 {
            let moved = work(column).transpose();
            for k in 0..3 {
                let torque = moved.fixed_rows::<3>(0).cross(&Vector3::ith(k, 1.0));
                torques.fixed_view_mut::<3, 1>(3 * column, k).copy_from(&torque);
            }
        }
        torques
    }
}

/// The file of the body of this name with its new parts.
pub fn resurfaced(base: Arc<GreenFile>, name: &str, new: &NewSurface) -> Result<GreenFile, GreenError> {
    let damaged =
        |reason: String| GreenError::Damaged { path: base.path.clone(), reason: format!("{name}: {reason}") };
    let meta = base.meta.bodies.get(name).ok_or_else(|| damaged("it is not there".to_owned()))?;
    let mut own = meta.clone();
    own.requirements = Requirements::new(&[AFFINE, STIFFNESS]);
    own.loads.retain(|_| new.weight.is_some());
    own.fingerprint = format!("{} cut", meta.fingerprint);
    own.surface_nodes = meta.surface_nodes + new.points.len();
    own.surface_triangles = new.triangles.len();
    (own.accuracy.storage_error, own.compressed) = (0.0, None);
    own.compliance_nodes = new.compliance.as_ref().map(|compliance| compliance.nodes().len());
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
    if let Some(weight) = &new.weight {
        own.requirements = Requirements::new(&[AFFINE, STIFFNESS, LOADS]);
        let columns: Vec<Vec<f64>> =
            weight.columns.column_iter().map(|column| column.iter().copied().collect()).collect();
        let stored = StoredColumns::new(meta.accuracy.storage, &columns);
        own.accuracy.storage_error = own.accuracy.storage_error.max(stored.relative_error());
        tensors.extend(load_tensors(rest.len(), meta.accuracy.storage, stored));
        let moments =
            base.table(name, MOMENTS).ok_or_else(|| damaged(format!("table {MOMENTS} is missing")))?;
        if moments.shape() != weight.lost.shape() {
            return Err(damaged(format!("table {MOMENTS} is not that of gravity")));
        }
        let tables = [
            (REACTION, weight.reaction.clone()),
            (LOAD_COMPLIANCE, weight.compliance.clone()),
            (MOMENTS, moments - &weight.lost),
            (TORQUES, weight.torques()),
        ];
        tensors.extend(tables.map(|(name, table)| {
            (name.to_owned(), Tensor::new(&[table.ncols(), table.nrows()], table.iter().copied()))
        }));
    }
    let file = base.clone().with_alone(name, own, tensors)?;
    Ok(GreenFile { solved: new.compliance.clone(), ..file })
}
