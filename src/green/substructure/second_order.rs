//! Fields of first and second order in the coordinates of a part: columns for each coordinate, and for each pair of them.

use super::series::Orders;
use crate::fem::NodeFields;
use nalgebra::{DMatrix, DVector, Vector3};

/// The pairs i ≤ j below `m`.
pub fn pairs(m: usize) -> Vec<(usize, usize)> {
    (0..m).flat_map(|i| (i..m).map(move |j| (i, j))).collect()
}

/// y with 1 added at each of these places.
pub fn unit(m: usize, ones: &[usize]) -> Vec<f64> {
    let mut y = vec![0.0; m];
    ones.iter().for_each(|&k| y[k] += 1.0);
    y
}

/// The vector of one node in one field.
pub fn get(fields: &NodeFields, node: u32, column: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| fields.row(3 * node as usize + axis)[column])
}

/// Writes it.
pub fn set(fields: &mut NodeFields, node: u32, column: usize, u: &Vector3<f64>) {
    for axis in 0..3 {
        fields.row_mut(3 * node as usize + axis)[column] = u[axis];
    }
}

/// u₁ and u₂ of a node at y.
pub fn sum_at(first: &NodeFields, second: &NodeFields, node: u32, y: &[f64]) -> Orders {
    let row =
        |fields: &NodeFields, axis: usize| -> Vec<f64> { fields.row(3 * node as usize + axis).to_vec() };
    let linear = |axis: usize, _| row(first, axis).iter().zip(y).map(|(u, y)| u * y).sum();
    let square = |axis: usize, _| {
        let mut at = second.row(3 * node as usize + axis).iter();
        let mut sum = 0.0;
        for i in 0..y.len() {
            for j in i..y.len() {
                let product = y[i] * y[j] * if i == j { 0.5 } else { 1.0 };
                sum += at.next().map_or(0.0, |w| w * product);
            }
        }
        sum
    };
    [Vector3::from_fn(linear), Vector3::from_fn(square)]
}

/// Every row of the fields times a matrix.
pub fn times(fields: &NodeFields, matrix: &DMatrix<f64>) -> NodeFields {
    let rows = nalgebra::DMatrixView::from_slice(&fields.data, fields.columns, 3 * fields.nodes);
    let product = matrix.transpose() * rows;
    NodeFields { nodes: fields.nodes, columns: matrix.ncols(), data: product.as_slice().to_vec() }
}

/// ∂²q/∂y_i∂y_j of values q that are quadratic in y, a column for each pair: by polarisation.
pub fn polarised(m: usize, q: impl Fn(&DVector<f64>) -> Vec<f64>) -> DMatrix<f64> {
    let at = |ones: &[usize]| DVector::from_vec(q(&DVector::from_vec(unit(m, ones))));
    let alone: Vec<DVector<f64>> = (0..m).map(|k| at(&[k])).collect();
    let rows = alone.first().map_or(0, DVector::len);
    let columns: Vec<DVector<f64>> = pairs(m)
        .into_iter()
        .map(|(i, j)| if i == j { &alone[i] * 2.0 } else { at(&[i, j]) - &alone[i] - &alone[j] })
        .collect();
    if columns.is_empty() { DMatrix::zeros(rows, 0) } else { DMatrix::from_columns(&columns) }
}
