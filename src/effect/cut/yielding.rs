//! The compliance of a cut body's surface.
//!
//! In: nodes of the surface, each a sum of nodes of a base and of copies that move beyond them. Out: displacements of the whole surface for
//! forces there. With f at the nodes of the base and g at the copies,
//!
//! ```text
//! (H - G X) v = g - G A⁻¹ f        u = A⁻¹ (f - Gᵀ v)
//! ```
//!
//! u of nodes that are pressed is kept at all free nodes: a blade asks where they are in every frame.

use super::base::Base;
use super::couplings::FreeRows;
use super::point_fields::PointFields;
use super::system::System;
use crate::fem::NodeFields;
use crate::green::{SolvedCompliance, Yield};
use nalgebra::{DMatrix, Vector3};
use std::collections::{BTreeMap, BTreeSet};
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

impl Corner {
    /// Corner at a single node that is no copy.
    pub fn of(node: u32) -> Corner {
        Corner { node, copy: None, share: 1.0 }
    }
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
    /// u of nodes of the mesh that were pressed.
    pub fields: PointFields,
}

/// Unit forces along x, y and z at some points, and the answer to them.
struct Pressed {
    /// v, 3 copies × 3 for each point.
    v: DMatrix<f64>,
    /// u at all free nodes, 3 for each point.
    u: NodeFields,
}

impl Pressed {
    /// u for the point of this number.
    fn field(&self, number: usize) -> Arc<Yield> {
        let row = |row: usize| {
            let u = &self.u.row(row)[3 * number..];
            [u[0], u[1], u[2]].map(|u| u as f32)
        };
        Arc::new(
            (0..self.u.nodes).map(|node| [row(3 * node), row(3 * node + 1), row(3 * node + 2)]).collect(),
        )
    }
}

impl Yielding {
    fn corners(&self, point: u32) -> &[Corner] {
        self.surface.get(point as usize).map_or(&[], Vec::as_slice)
    }

    /// Place of a node among the free ones.
    fn free(&self, node: u32) -> Option<u32> {
        self.base.free_at.get(node as usize).copied().flatten()
    }

    /// Presses [`TOGETHER`] points at most.
    fn press(&self, points: &[&[Corner]]) -> Result<Pressed, String> {
        let (columns, solves) = (3 * TOGETHER, &self.base.solves);
        let pressed = points.iter().copied().flatten().filter_map(|corner| self.free(corner.node));
        let at: Vec<u32> = pressed.collect::<BTreeSet<u32>>().into_iter().collect();
        let all: BTreeSet<u32> = at.iter().chain(&self.rows.at).copied().collect();
        let all: Vec<u32> = all.into_iter().collect();
        let place = |free: u32, of: &[u32]| of.partition_point(|other| *other < free);
        let mut f = NodeFields::zeros(at.len(), columns);
        let mut v = DMatrix::zeros(3 * self.rows.count(), columns);
        for (k, Corner { node, copy, share }) in
            points.iter().enumerate().flat_map(|(k, corners)| corners.iter().map(move |corner| (k, corner)))
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
        Ok(Pressed { v, u: solves.solve_at(all, b, None)? })
    }

    /// The displacement of a point of the surface by axis, for a force along each axis at the pressed point of this number.
    fn moved(&self, corners: &Corners, pressed: &Pressed, number: usize) -> [[f32; 3]; 3] {
        let mut u = [[0.0_f64; 3]; 3];
        for Corner { node, copy, share } in corners {
            if let Some(copy) = copy {
                add(&mut u, |axis, force| share * pressed.v[(3 * copy + axis, 3 * number + force)]);
            }
            if let Some(free) = self.free(*node) {
                add(&mut u, |axis, force| {
                    share * pressed.u.row(3 * free as usize + axis)[3 * number + force]
                });
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
        let fields = self.fields_of(forces.iter().map(|(node, _)| *node))?;
        let mut sum = Vec::new();
        for (node, force) in forces {
            let Some(field) = fields.get(node) else { continue };
            sum.resize(3 * field.len(), 0.0);
            let along = |row: &[f32; 3]| row.iter().zip(force).map(|(u, f)| f64::from(*u) * f).sum::<f64>();
            sum.iter_mut().zip(field.as_flattened()).for_each(|(sum, row)| *sum += along(row));
        }
        Ok(sum)
    }

    /// Displacements of all free nodes by unit forces at each of these nodes of the mesh that is free.
    fn fields_of(&self, nodes: impl Iterator<Item = u32>) -> Result<BTreeMap<u32, Arc<Yield>>, String> {
        let nodes: BTreeSet<u32> = nodes.filter(|node| self.free(*node).is_some()).collect();
        let mut found = self.fields.known(&nodes);
        let missing: Vec<u32> = nodes.into_iter().filter(|node| !found.contains_key(node)).collect();
        for some in missing.chunks(TOGETHER) {
            let corners: Vec<[Corner; 1]> = some.iter().map(|node| [Corner::of(*node)]).collect();
            let pressed = self.press(&corners.iter().map(|corner| &corner[..]).collect::<Vec<_>>())?;
            for (number, node) in some.iter().enumerate() {
                let field = pressed.field(number);
                self.fields.keep(*node, field.clone());
                found.insert(*node, field);
            }
        }
        Ok(found)
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
        let mut columns = Vec::new();
        for some in nodes.chunks(TOGETHER) {
            let corners: Vec<&[Corner]> = some.iter().map(|point| self.corners(*point)).collect();
            let pressed = self.press(&corners)?;
            for (number, corners) in corners.iter().enumerate() {
                // Blades will ask for it as soon as a force acts there.
                if let [corner] = corners
                    && *corner == Corner::of(corner.node)
                {
                    self.fields.keep(corner.node, pressed.field(number));
                }
                columns
                    .push(self.surface.iter().map(|corners| self.moved(corners, &pressed, number)).collect());
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
