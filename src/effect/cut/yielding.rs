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
use super::system::System;
use crate::fem::NodeFields;
use crate::green::{SolvedCompliance, Yield};
use nalgebra::{DMatrix, Vector3};
use std::collections::BTreeSet;
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

/// Unit forces along x, y and z at some points, and the answer to them.
struct Pressed {
    /// v, 3 copies × 3 for each point.
    v: DMatrix<f64>,
    /// u at the free nodes that have a part in the surface.
    u: NodeFields,
}

impl Yielding {
    fn corners(&self, point: u32) -> &[Corner] {
        self.surface.get(point as usize).map_or(&[], Vec::as_slice)
    }

    /// Place of a node among the free ones.
    fn free(&self, node: u32) -> Option<u32> {
        self.base.free_at.get(node as usize).copied().flatten()
    }

    /// G A⁻¹ f of fields at all free nodes.
    fn lifted(&self, field: &NodeFields) -> DMatrix<f64> {
        let x = |place: usize, axis| field.row(3 * self.rows.at[place] as usize + axis);
        self.rows.times_at(&x, field.columns)
    }

    /// Presses [`TOGETHER`] points at most, and finds u at the free nodes `shown`.
    fn press(&self, points: &[u32], shown: &[u32]) -> Result<Pressed, String> {
        let (columns, solves) = (3 * TOGETHER, &self.base.fields.solves);
        let corners = |point: &u32| self.corners(*point).iter();
        let pressed = points.iter().flat_map(corners).filter_map(|corner| self.free(corner.node));
        let at: Vec<u32> = pressed.collect::<BTreeSet<u32>>().into_iter().collect();
        let all: BTreeSet<u32> = at.iter().chain(&self.rows.at).copied().collect();
        let all: Vec<u32> = all.into_iter().collect();
        let place = |free: u32, of: &[u32]| of.partition_point(|other| *other < free);
        let mut f = NodeFields::zeros(at.len(), columns);
        let mut v = DMatrix::zeros(3 * self.rows.count(), columns);
        for (k, Corner { node, copy, share }) in
            points.iter().enumerate().flat_map(|(k, point)| corners(point).map(move |corner| (k, corner)))
        {
            for axis in 0..3 {
                copy.iter().for_each(|copy| v[(3 * copy + axis, 3 * k + axis)] += share);
                if let Some(free) = self.free(*node) {
                    f.row_mut(3 * place(free, &at) + axis)[3 * k + axis] += share;
                }
            }
        }
        let mut b = NodeFields::zeros(all.len(), columns);
        let mut add = |of: &[u32], more: &NodeFields| {
            for (from, free) in of.iter().enumerate() {
                for axis in 0..3 {
                    let sums = b.row_mut(3 * place(*free, &all) + axis).iter_mut();
                    sums.zip(more.row(3 * from + axis)).for_each(|(sum, more)| *sum += more);
                }
            }
        };
        add(&at, &f);
        if self.rows.count() > 0 {
            v -= self.rows.times(&solves.solve_at(at, f, Some(self.rows.at.clone()))?);
            for k in 0..points.len() {
                let own = self.system.solve(&v.columns(3 * k, 3).into_owned()).0;
                v.columns_mut(3 * k, 3).copy_from(&own);
            }
            add(&self.rows.at, &self.rows.minus_transposed(&v, columns));
        }
        Ok(Pressed { v, u: solves.solve_at(all, b, Some(shown.to_vec()))? })
    }

    /// The free nodes that have a part in the surface, ascending.
    fn shown(&self) -> Vec<u32> {
        let mut shown: Vec<u32> =
            self.surface.iter().flatten().filter_map(|corner| self.free(corner.node)).collect();
        shown.sort_unstable();
        shown.dedup();
        shown
    }

    /// The displacement of a point of the surface by axis, for a force along each axis at the pressed point of this number.
    fn moved(&self, corners: &Corners, pressed: &Pressed, (shown, number): (&[u32], usize)) -> [[f32; 3]; 3] {
        let mut u = [[0.0_f64; 3]; 3];
        for Corner { node, copy, share } in corners {
            if let Some(copy) = copy {
                add(&mut u, |axis, force| share * pressed.v[(3 * copy + axis, 3 * number + force)]);
            }
            if let Some(at) = self.free(*node).and_then(|free| shown.binary_search(&free).ok()) {
                add(&mut u, |axis, force| share * pressed.u.row(3 * at + axis)[3 * number + force]);
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
            let beyond = self.base.fields.solves.solve_at(self.rows.at.clone(), b, None)?;
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
        let shown = self.shown();
        let mut columns = Vec::new();
        for some in nodes.chunks(TOGETHER) {
            let pressed = self.press(some, &shown)?;
            for number in 0..some.len() {
                let of = |corners: &Corners| self.moved(corners, &pressed, (&shown, number));
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
