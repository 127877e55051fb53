//! The compliance of a cut body's surface.
//!
//! In: nodes of the surface, each a sum of nodes of a base and of copies that move beyond them. Out: displacements of the whole surface for
//! forces there. With f at the nodes of the base and g at the copies,
//!
//! ```text
//! (H - G X) v = g - G A⁻¹ f        u = A⁻¹ (f - Gᵀ v)
//! ```

use super::base::Base;
use super::couplings::FreeRows;
use super::solves::PointField;
use super::system::System;
use crate::fem::NodeFields;
use crate::green::{SolvedCompliance, Yield};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

type V3 = Vector3<f64>;

/// Nodes whose columns are solved together. There are always so many, some of them empty, so that the bits of one do not depend on the
/// others.
const TOGETHER: usize = 4;

/// A node's part in a point of the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Node of the base.
    pub node: u32,
    /// The copy that moves beyond it.
    pub copy: Option<usize>,
    pub share: f64,
}

/// The nodes of which each point of a surface is the sum: one of its own, or the two ends of an edge.
pub type Corners = Vec<Corner>;

pub struct Yielding {
    pub base: Arc<Base>,
    pub system: System,
    /// G.
    pub rows: FreeRows,
    /// The points of the surface.
    pub surface: Vec<Corners>,
    /// The node of the mesh on whose side each of them lies.
    pub sides: Vec<u32>,
    /// Points that take forces.
    pub taking: Vec<u32>,
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
        self.base.free_at.get(node as usize).copied().flatten()
    }

    /// G A⁻¹ f.
    fn lifted(&self, field: &NodeFields) -> DMatrix<f64> {
        let x = |place: usize, axis| field.row(3 * self.rows.at[place] as usize + axis);
        self.rows.times_at(&x, field.columns)
    }

    fn press(&self, point: u32, known: &BTreeMap<u32, PointField>) -> Pressed {
        let mut fields = Vec::new();
        let mut b = DMatrix::zeros(3 * self.rows.count(), 3);
        for Corner { node, copy, share } in self.corners(point) {
            if let Some(copy) = copy {
                (0..3).for_each(|axis| b[(3 * copy + axis, axis)] += share);
            }
            if let Some(field) = self.free(*node).and_then(|free| known.get(&free)) {
                b -= self.lifted(field) * *share;
                fields.push((field.clone(), *share));
            }
        }
        Pressed { fields, v: self.system.solve(&b).0 }
    }

    /// The free nodes that have a part in the surface, ascending.
    fn shown(&self) -> Vec<u32> {
        let mut shown: Vec<u32> =
            self.surface.iter().flatten().filter_map(|corner| self.free(corner.node)).collect();
        shown.sort_unstable();
        shown.dedup();
        shown
    }

    /// -A⁻¹ Gᵀ v of these at these free nodes.
    fn beyond(&self, pressed: &[Pressed], shown: &[u32]) -> Result<NodeFields, String> {
        let columns = 3 * TOGETHER;
        if self.rows.count() == 0 {
            return Ok(NodeFields::zeros(shown.len(), columns));
        }
        let v = DMatrix::from_fn(3 * self.rows.count(), columns, |i, j| {
            pressed.get(j / 3).map_or(0.0, |pressed| pressed.v[(i, j % 3)])
        });
        let b = self.rows.minus_transposed(&v, columns);
        self.base.fields.solve_at(self.rows.at.clone(), b, Some(shown.to_vec()))
    }

    /// The displacement of a point of the surface by axis, for a force along each axis.
    fn moved(
        &self,
        corners: &Corners,
        pressed: &Pressed,
        (shown, beyond, first): (&[u32], &NodeFields, usize),
    ) -> [[f32; 3]; 3] {
        let mut u = [[0.0_f64; 3]; 3];
        for Corner { node, copy, share } in corners {
            if let Some(copy) = copy {
                add(&mut u, |axis, force| share * pressed.v[(3 * copy + axis, force)]);
            }
            let Some(free) = self.free(*node) else { continue };
            for (field, part) in &pressed.fields {
                add(&mut u, |axis, force| share * part * field.row(3 * free as usize + axis)[force]);
            }
            if let Ok(at) = shown.binary_search(&free) {
                add(&mut u, |axis, force| share * beyond.row(3 * at + axis)[first + force]);
            }
        }
        u.map(|row| row.map(|u| u as f32))
    }

    /// The node of the mesh on whose side a point of the surface lies.
    pub fn node_of(&self, point: u32) -> Option<u32> {
        self.sides.get(point as usize).copied()
    }

    /// Displacements of all free nodes by forces at nodes of the mesh, 3 for each; empty without forces.
    pub fn field(&self, forces: &[(u32, V3)]) -> Result<Vec<f64>, String> {
        let fields = self.base.fields.at(forces.iter().filter_map(|(node, _)| self.free(*node)))?;
        let mut pressed: Option<NodeFields> = None;
        for (node, force) in forces {
            let Some(field) = self.free(*node).and_then(|free| fields.get(&free)) else { continue };
            let pressed = pressed.get_or_insert_with(|| NodeFields::zeros(field.nodes, 1));
            let own =
                field.data.chunks_exact(3).map(|row| row[0] * force.x + row[1] * force.y + row[2] * force.z);
            pressed.data.iter_mut().zip(own).for_each(|(u, own)| *u += own);
        }
        let Some(mut pressed) = pressed else { return Ok(Vec::new()) };
        if self.rows.count() > 0 {
            let (v, _) = self.system.solve(&-self.lifted(&pressed));
            let b = self.rows.minus_transposed(&v, 1);
            let beyond = self.base.fields.solve_at(self.rows.at.clone(), b, None)?;
            pressed.data.iter_mut().zip(&beyond.data).for_each(|(u, beyond)| *u += beyond);
        }
        Ok(pressed.data)
    }
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
        let known = self.base.fields.at(corners.filter_map(|corner| self.free(corner.node)))?;
        let shown = self.shown();
        let mut columns = Vec::new();
        for some in nodes.chunks(TOGETHER) {
            let pressed: Vec<Pressed> = some.iter().map(|point| self.press(*point, &known)).collect();
            let beyond = self.beyond(&pressed, &shown)?;
            for (k, pressed) in pressed.iter().enumerate() {
                let of = |corners: &Corners| self.moved(corners, pressed, (&shown, &beyond, 3 * k));
                columns.push(self.surface.iter().map(of).collect());
            }
        }
        Ok(columns)
    }
}

impl fmt::Debug for Yielding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "compliance of a body cut with {} copies", self.rows.count())
    }
}
