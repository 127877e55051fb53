//! The compliance of a cut body's surface.
//!
//! In: nodes of the surface, each a sum of nodes of the mesh and of their copies. Out: displacements of the whole surface for forces there.
//! With f at the nodes of the mesh and g at the copies,
//!
//! ```text
//! (H - G X) v = g - Xᵀ f        u = A⁻¹ f - X v
//! ```

use super::point_fields::PointFields;
use super::solves::PointField;
use super::system::System;
use crate::green::{SolvedCompliance, Yield};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use nalgebra::{DMatrix, DVector, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Nodes whose columns are multiplied together. There are always so many, some of them empty, so that the bits of one do not depend on the
/// others.
const TOGETHER: usize = 4;

/// Rows of X that one thread multiplies.
const ROWS: usize = 768;

/// A node's part in a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    pub node: u32,
    /// The copy that moves beyond the node.
    pub copy: Option<usize>,
    pub share: f64,
}

/// The nodes of which each point of a surface is the sum: one of its own, or the two ends of an edge.
pub type Corners = Vec<Corner>;

pub struct Yielding {
    pub fields: Arc<PointFields>,
    /// Place of each node among the free ones.
    pub free_at: Arc<Vec<Option<u32>>>,
    /// X of each copy, 3 free nodes × 3.
    pub x: Vec<Arc<DMatrix<f32>>>,
    pub system: System,
    /// The points of the surface.
    pub surface: Vec<Corners>,
    /// Points that take forces.
    pub taking: Vec<u32>,
    /// Empty where nothing asks for columns.
    pub rows: Rows,
}

/// The free nodes of the mesh that have a part in a surface, and X of all copies at each: 3 × 3 copies.
pub struct Rows {
    pub of: BTreeMap<u32, usize>,
    pub x: Mat<f32>,
}

impl Default for Rows {
    fn default() -> Rows {
        Rows { of: BTreeMap::new(), x: Mat::zeros(0, 0) }
    }
}

/// Forces along x, y and z at a point of the surface, and the answer of the copies.
struct Pressed {
    fields: Vec<(PointField, f64)>,
    /// v of each force, 3 copies × 3.
    v: DMatrix<f64>,
}

impl Yielding {
    fn corners(&self, point: u32) -> &[Corner] {
        self.surface.get(point as usize).map_or(&[], Vec::as_slice)
    }

    /// Place of a node among the free ones.
    fn free(&self, node: u32) -> Option<u32> {
        self.free_at.get(node as usize).copied().flatten()
    }

    fn press(&self, point: u32, known: &BTreeMap<u32, PointField>) -> Pressed {
        let mut fields = Vec::new();
        let mut b = DMatrix::zeros(3 * self.x.len(), 3);
        for Corner { node, copy, share } in self.corners(point) {
            if let Some(copy) = copy {
                (0..3).for_each(|axis| b[(3 * copy + axis, axis)] += share);
            }
            let Some(free) = self.free(*node) else { continue };
            for (j, x) in self.x.iter().enumerate() {
                let own = x.fixed_view::<3, 3>(3 * free as usize, 0).transpose().cast::<f64>();
                let mut block = b.fixed_view_mut::<3, 3>(3 * j, 0);
                block -= own * *share;
            }
            fields.extend(known.get(&free).map(|field| (field.clone(), *share)));
        }
        Pressed { fields, v: self.system.solve(&b).0 }
    }

    /// -X v of these, at the nodes that have a part in the surface.
    fn beyond(&self, pressed: &[Pressed]) -> Mat<f32> {
        let v = Mat::<f32>::from_fn(self.rows.x.ncols(), 3 * TOGETHER, |i, j| {
            pressed.get(j / 3).map_or(0.0, |pressed| pressed.v[(i, j % 3)] as f32)
        });
        let mut product = Mat::<f32>::zeros(self.rows.x.nrows(), v.ncols());
        if v.nrows() > 0 {
            matmul(product.as_mut(), Accum::Replace, self.rows.x.as_ref(), v.as_ref(), -1.0, Par::Seq);
        }
        product
    }

    /// The displacement of a point of the surface by axis, for a force along each axis.
    fn moved(&self, corners: &Corners, pressed: &Pressed, beyond: &Mat<f32>, first: usize) -> [[f32; 3]; 3] {
        let mut u = [[0.0_f64; 3]; 3];
        for Corner { node, copy, share } in corners {
            if let Some(copy) = copy {
                add(&mut u, |axis, force| share * pressed.v[(3 * copy + axis, force)]);
            }
            let Some(free) = self.free(*node) else { continue };
            for (field, part) in &pressed.fields {
                let at = |axis, force| f64::from(field[(3 * free as usize + axis, force)]);
                add(&mut u, |axis, force| share * part * at(axis, force));
            }
            if let Some(row) = self.rows.of.get(node) {
                add(&mut u, |axis, force| share * f64::from(beyond[(3 * row + axis, first + force)]));
            }
        }
        u.map(|row| row.map(|u| u as f32))
    }

    /// The node of the mesh on whose side a point of the surface lies.
    pub fn node_of(&self, point: u32) -> Option<u32> {
        let corners = self.corners(point);
        let own = corners.iter().find(|corner| corner.copy.is_none()).or(corners.first());
        own.map(|corner| corner.node)
    }

    /// Displacements of all free nodes by forces at nodes of the mesh, 3 for each.
    pub fn field(&self, forces: &[(u32, V3)]) -> Result<Vec<f32>, String> {
        let fields = self.fields.at(forces.iter().filter_map(|(node, _)| self.free(*node)))?;
        let mut pressed = DVector::<f32>::zeros(0);
        let mut b = DMatrix::<f64>::zeros(3 * self.x.len(), 1);
        for (node, force) in forces {
            let Some(free) = self.free(*node) else { continue };
            for (j, x) in self.x.iter().enumerate() {
                let mut block = b.fixed_view_mut::<3, 1>(3 * j, 0);
                block -= x.fixed_view::<3, 3>(3 * free as usize, 0).into_owned().cast::<f64>().tr_mul(force);
            }
            let Some(field) = fields.get(&free) else { continue };
            if pressed.is_empty() {
                pressed = DVector::zeros(field.nrows());
            }
            pressed.gemv(1.0, &**field, &force.cast::<f32>(), 1.0);
        }
        let (v, _) = self.system.solve(&b);
        let mut u = apart(&self.x, &v, pressed.len());
        u.iter_mut().zip(&pressed).for_each(|(u, pressed)| *u += pressed);
        Ok(u)
    }
}

/// -X w at this many rows, row after row.
pub fn apart(x: &[Arc<DMatrix<f32>>], w: &DMatrix<f64>, rows: usize) -> Vec<f32> {
    let (w, columns) = (w.map(|w| w as f32), w.ncols());
    let mut all = vec![0.0; rows * columns];
    all.par_chunks_mut((ROWS * columns).max(1)).enumerate().for_each(|(block, to)| {
        let (first, count) = (ROWS * block, to.len() / columns);
        // It stays in the nearest cache while all copies pass.
        let mut part = DMatrix::<f32>::zeros(count, columns);
        for (j, x) in x.iter().enumerate() {
            for (k, mut sum) in part.column_iter_mut().enumerate() {
                (0..3).for_each(|axis| {
                    sum.axpy(-w[(3 * j + axis, k)], &x.column(axis).rows(first, count), 1.0)
                });
            }
        }
        for (to, row) in to.chunks_exact_mut(columns).zip(part.row_iter()) {
            to.iter_mut().zip(row.iter()).for_each(|(to, u)| *to = *u);
        }
    });
    all
}

fn add(u: &mut [[f64; 3]; 3], more: impl Fn(usize, usize) -> f64) {
    for (axis, row) in u.iter_mut().enumerate() {
        row.iter_mut().enumerate().for_each(|(force, u)| *u += more(axis, force));
    }
}

impl SolvedCompliance for Yielding {
    fn nodes(&self) -> &[u32] {
        &self.taking
    }

    fn columns(&self, nodes: &[u32]) -> Result<Vec<Yield>, String> {
        let corners = nodes.iter().flat_map(|point| self.corners(*point));
        let known = self.fields.at(corners.filter_map(|corner| self.free(corner.node)))?;
        let mut columns = Vec::new();
        for some in nodes.chunks(TOGETHER) {
            let pressed: Vec<Pressed> = some.iter().map(|point| self.press(*point, &known)).collect();
            let beyond = self.beyond(&pressed);
            for (k, pressed) in pressed.iter().enumerate() {
                let of = |corners: &Corners| self.moved(corners, pressed, &beyond, 3 * k);
                columns.push(self.surface.iter().map(of).collect());
            }
        }
        Ok(columns)
    }
}

impl fmt::Debug for Yielding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "compliance of a body cut with {} copies", self.x.len())
    }
}
