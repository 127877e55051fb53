//! Columns of a family in the .green file: displacements of the surface as the scene stores them.
//!
//! In: fields over all nodes. Out: the tensor of their numbers on the surface and, where they are stored scaled, that of
//! their scales; and the group of columns again.

use super::super::bytes::Tensor;
use super::super::file::GreenFile;
use super::super::numbers::{LARGEST, numbers};
use super::super::solution::Precomputed;
use crate::base::columns::{ColumnGroup, Storage, StoredColumns, half_to_single};
use safetensors::tensor::Dtype;

/// Names of the two tensors within the body.
pub struct Names {
    pub basis: String,
    pub scale: String,
}

/// `count` columns over the surface, `value(row, column)` being that of unknown `row` = 3·node + axis.
pub fn stored(body: &Precomputed, count: usize, value: &dyn Fn(usize, usize) -> f64) -> StoredColumns {
    let nodes = &body.solution.surface.nodes;
    let column = |column: usize| -> Vec<f64> {
        let of_node = |&n: &u32| (0..3).map(move |axis| value(3 * n as usize + axis, column));
        nodes.iter().flat_map(of_node).collect()
    };
    StoredColumns::new(body.storage, &(0..count).map(column).collect::<Vec<_>>())
}

/// The tensors of stored columns.
pub fn write(
    storage: Storage,
    surface_nodes: usize,
    names: Names,
    stored: StoredColumns,
) -> Vec<(String, Tensor)> {
    let mut tensors = Vec::new();
    let count = stored.sizes.len();
    if !stored.scales.is_empty() {
        let scales = stored.scales.iter().copied();
        tensors.push((names.scale, Tensor::new(&[count], scales)));
    }
    let (dtype, shape) = (dtype(storage), vec![count, surface_nodes, 3]);
    tensors.push((names.basis, Tensor { dtype, shape, bytes: stored.into_bytes() }));
    tensors
}

fn dtype(storage: Storage) -> Dtype {
    match storage {
        Storage::F32 => Dtype::F32,
        Storage::F16 => Dtype::F16,
        Storage::Int16 | Storage::Within(_) => Dtype::I16,
    }
}

/// Whether body `body` has `count` columns under these names, of usable numbers.
pub fn check(file: &GreenFile, body: &str, names: &Names, count: usize) -> Result<(), String> {
    let Some(meta) = file.meta.bodies.get(body) else { return Err(format!("body {body} is missing")) };
    let (basis, scale) = (format!("{body}/{}", names.basis), format!("{body}/{}", names.scale));
    let storage = meta.accuracy.storage;
    file.expect(&basis, dtype(storage), &[count, meta.surface_nodes, 3])?;
    if storage != Storage::F32 {
        file.expect(&scale, Dtype::F32, &[count])?;
    }
    let (basis, scale) = (format!("tensor {basis}"), format!("tensor {scale}"));
    let scaled =
        |scales: &[f32], largest: f64| numbers(&scale, scales.iter().map(|&x| x.into()), LARGEST / largest);
    match group(file, body, names) {
        ColumnGroup::F32(values) => numbers(&basis, values.iter().map(|&x| x.into()), LARGEST),
        ColumnGroup::F16 { bits, scales } => {
            // Of magnitude 1 at most; infinite and NaN come out above 6e4.
            numbers(&basis, bits.iter().map(|&bits| half_to_single(bits).into()), 1.0)?;
            scaled(scales, 1.0)
        }
        ColumnGroup::Int16 { scales, .. } => scaled(scales, f64::from(i16::MAX)),
    }
}

/// The columns of a body under these names.
pub fn group<'a>(file: &'a GreenFile, body: &str, names: &Names) -> ColumnGroup<'a> {
    let storage = file.meta.bodies.get(body).map_or(Storage::F32, |meta| meta.accuracy.storage);
    let (basis, scale) = (format!("{body}/{}", names.basis), format!("{body}/{}", names.scale));
    match storage {
        Storage::F32 => ColumnGroup::F32(file.slice(&basis)),
        Storage::F16 => ColumnGroup::F16 { bits: file.slice(&basis), scales: file.slice(&scale) },
        Storage::Int16 | Storage::Within(_) => {
            ColumnGroup::Int16 { values: file.slice(&basis), scales: file.slice(&scale) }
        }
    }
}
