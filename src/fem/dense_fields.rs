//! Sums, products and main parts of fields over all nodes.

use super::stiffness::{NodeFields, StiffnessMatrix};
use nalgebra::{DMatrix, DMatrixView};

/// A field whose energy is smaller than this part of the largest is rounding.
const RANK: f64 = 1e-12;

/// A row for each field, where it lies.
pub fn rows(fields: &NodeFields) -> DMatrixView<'_, f64> {
    DMatrixView::from_slice(&fields.data, fields.columns, 3 * fields.nodes)
}

/// Fields times a matrix from the right.
pub fn combined(fields: &NodeFields, by: &DMatrix<f64>) -> NodeFields {
    let product = by.transpose() * rows(fields);
    NodeFields { nodes: fields.nodes, columns: by.ncols(), data: product.data.into() }
}

pub fn add(fields: &mut NodeFields, factor: f64, others: &NodeFields) {
    fields.data.iter_mut().zip(&others.data).for_each(|(a, b)| *a += factor * b);
}

/// The first columns, and the rest.
pub fn split_columns(fields: &NodeFields, at: usize) -> (NodeFields, NodeFields) {
    let part = |columns: std::ops::Range<usize>| NodeFields {
        nodes: fields.nodes,
        columns: columns.len(),
        data: (0..3 * fields.nodes).flat_map(|row| fields.row(row)[columns.clone()].to_vec()).collect(),
    };
    (part(0..at), part(at..fields.columns))
}

/// All columns, one list after the other.
pub fn beside(lists: &[&NodeFields]) -> NodeFields {
    let nodes = lists[0].nodes;
    let columns = lists.iter().map(|list| list.columns).sum();
    let data = (0..3 * nodes).flat_map(|row| lists.iter().flat_map(move |list| list.row(row).to_vec()));
    NodeFields { nodes, columns, data: data.collect() }
}

/// Fᵀ K G.
pub fn products(k: &StiffnessMatrix, f: &NodeFields, g: &NodeFields) -> DMatrix<f64> {
    let mut force = NodeFields::zeros(g.nodes, g.columns);
    k.multiply(g, &mut force);
    rows(f) * rows(&force).transpose()
}

/// The part of `fields` that is orthogonal to the orthonormal `basis`.
pub fn without(k: &StiffnessMatrix, fields: &NodeFields, basis: &NodeFields) -> NodeFields {
    let mut rest = fields.clone();
    // Twice, for the digits that cancel.
    for _ in 0..2 {
        let share = combined(basis, &products(k, basis, &rest));
        add(&mut rest, -1.0, &share);
    }
    rest
}

/// The `most` fields, orthonormal in K, from which the `fields` differ least in energy.
pub fn principal(k: &StiffnessMatrix, fields: &NodeFields, most: usize) -> NodeFields {
    let gram = products(k, fields, fields);
    let eigen = ((&gram + gram.transpose()) * 0.5).symmetric_eigen();
    let mut order: Vec<usize> = (0..fields.columns).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let largest = order.first().map_or(0.0, |&first| eigen.eigenvalues[first]);
    order.truncate(most);
    order.retain(|&i| eigen.eigenvalues[i] > RANK * largest);
    let by = DMatrix::from_fn(fields.columns, order.len(), |row, column| {
        eigen.eigenvectors[(row, order[column])] / eigen.eigenvalues[order[column]].sqrt()
    });
    combined(fields, &by)
}
