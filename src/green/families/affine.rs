//! The family `affine`: for each control element the displacements that its twelve unit affine motions cause.
//!
//! In: the solved fields. Out: `basis/NAME` (12 × nodes × 3), and `scale/NAME` (12) where they are stored scaled. From the
//! paper's "Elastic deformation using control elements".

use super::super::control::FIELDS;
use super::super::family::FamilyEntry;
use super::super::file::{BodyMeta, ControlMeta, GreenFile};
use super::super::numbers::{LARGEST, numbers};
use super::super::requirements::Family;
use super::super::solution::Precomputed;
use super::super::tensor::Tensor;
use crate::base::columns::{ColumnGroup, Storage, StoredColumns, half_to_single};
use safetensors::tensor::Dtype;

pub const AFFINE: Family = Family { name: "affine", from: &[] };

pub(super) const ENTRY: FamilyEntry = FamilyEntry {
    family: AFFINE,
    holds: "displacements of the surface for the twelve unit affine motions of each control element",
    compute: None,
    solves: false,
    write,
    check,
    groups,
    fixed_bytes: |_| 0,
};

fn write(body: &Precomputed, meta: &mut BodyMeta) -> Vec<(String, Tensor)> {
    let nodes = &body.solution.surface.nodes;
    let mut tensors = Vec::new();
    for (e, control) in body.solution.controls.iter().enumerate() {
        let stored = stored(body, e);
        let name = &control.name;
        meta.accuracy.storage_error = meta.accuracy.storage_error.max(stored.relative_error());
        meta.controls[e].storage_errors.clone_from(&stored.errors);
        if !stored.scales.is_empty() {
            let scales = stored.scales.iter().copied();
            tensors.push((format!("scale/{name}"), Tensor::new(&[FIELDS], scales)));
        }
        let (dtype, shape) = (dtype(body.storage), vec![FIELDS, nodes.len(), 3]);
        tensors.push((format!("basis/{name}"), Tensor { dtype, shape, bytes: stored.into_bytes() }));
    }
    tensors
}

/// The twelve columns of control element `e` over the surface.
fn stored(body: &Precomputed, e: usize) -> StoredColumns {
    let (nodes, fields) = (&body.solution.surface.nodes, &body.solution.fields);
    let column = |column: usize| -> Vec<f64> {
        let of_node = |&n: &u32| (0..3).map(move |axis| fields.row(3 * n as usize + axis)[column]);
        nodes.iter().flat_map(of_node).collect()
    };
    let columns: Vec<Vec<f64>> = (FIELDS * e..FIELDS * (e + 1)).map(column).collect();
    StoredColumns::new(body.storage, &columns)
}

fn dtype(storage: Storage) -> Dtype {
    match storage {
        Storage::F32 => Dtype::F32,
        Storage::F16 => Dtype::F16,
        Storage::Int16 => Dtype::I16,
    }
}

fn check(file: &GreenFile, name: &str, body: &BodyMeta) -> Result<(), String> {
    for control in &body.controls {
        let called = &control.name;
        let storage = body.accuracy.storage;
        file.expect(&format!("{name}/basis/{called}"), dtype(storage), &[FIELDS, body.surface_nodes, 3])?;
        if storage != Storage::F32 {
            file.expect(&format!("{name}/scale/{called}"), Dtype::F32, &[FIELDS])?;
        }
        check_columns(file, name, control)?;
    }
    Ok(())
}

fn check_columns(file: &GreenFile, name: &str, control: &ControlMeta) -> Result<(), String> {
    let called = &control.name;
    let errors = format!("bodies.{name}.controls: {called}: storage_errors");
    numbers(&errors, control.storage_errors.iter().copied(), f64::MAX)?;
    let (basis, scale) = (format!("tensor {name}/basis/{called}"), format!("tensor {name}/scale/{called}"));
    let scaled =
        |scales: &[f32], largest: f64| numbers(&scale, scales.iter().map(|&x| x.into()), LARGEST / largest);
    match file.basis(name, called) {
        ColumnGroup::F32(values) => numbers(&basis, values.iter().map(|&x| x.into()), LARGEST),
        ColumnGroup::F16 { bits, scales } => {
            // Of magnitude 1 at most; infinite and NaN come out above 6e4.
            numbers(&basis, bits.iter().map(|&bits| half_to_single(bits).into()), 1.0)?;
            scaled(scales, 1.0)
        }
        ColumnGroup::Int16 { scales, .. } => scaled(scales, f64::from(i16::MAX)),
    }
}

/// A group for each control element.
fn groups<'a>(file: &'a GreenFile, body: &str) -> Vec<ColumnGroup<'a>> {
    let controls = file.meta.bodies.get(body).map_or(&[][..], |meta| &meta.controls);
    controls.iter().map(|control| file.basis(body, &control.name)).collect()
}

impl GreenFile {
    /// The twelve columns of one control element.
    pub fn basis(&self, body: &str, control: &str) -> ColumnGroup<'_> {
        let storage = self.meta.bodies.get(body).map_or(Storage::F32, |meta| meta.accuracy.storage);
        let (basis, scale) = (format!("{body}/basis/{control}"), format!("{body}/scale/{control}"));
        match storage {
            Storage::F32 => ColumnGroup::F32(self.slice(&basis)),
            Storage::F16 => ColumnGroup::F16 { bits: self.slice(&basis), scales: self.slice(&scale) },
            Storage::Int16 => ColumnGroup::Int16 { values: self.slice(&basis), scales: self.slice(&scale) },
        }
    }
}
