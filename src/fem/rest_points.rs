//! The integration points of a body whose strain energy is quartic in the displacements.
//!
//! In: an element, a mesh, Lamé's constants. Out: its [`StrainPoints`], where V = Σ vol (λ/2 (tr E)² + μ E:E) with
//! E = sym H + ½ HᵀH, H = Σ u_a ⊗ G_a. Elements that take means of the dilatation are refused.

use super::assembly::AssemblyError;
use super::element::{Dilatation, Element};
use super::lame::Lame;
use super::stiffness::NodeFields;
use super::strain_points::StrainPoints;
use super::tet10;
use crate::mesh::{TetMesh, quadratic};
use nalgebra::{Matrix3, Vector3};

/// All points of a body.
#[derive(Debug)]
pub struct RestPoints {
    /// Nodes of the mesh.
    pub nodes: usize,
    points: StrainPoints,
}

/// A point of integration.
#[derive(Clone, Copy, Debug)]
pub struct RestPoint<'a> {
    pub nodes: &'a [u32],
    /// G_a, 1/m.
    pub gradients: &'a [Vector3<f64>],
    /// The point's share of the volume, m³.
    pub volume: f64,
    pub lame: Lame,
}

impl RestPoints {
    /// Errors as [`Element::assemble`] and [`RestPoints::suits`].
    pub fn new(element: &Element, mesh: &TetMesh, lame: &[Lame]) -> Result<RestPoints, AssemblyError> {
        RestPoints::suits(element, mesh)?;
        Ok(RestPoints { nodes: mesh.nodes.len(), points: element.points(mesh, lame)? })
    }

    /// Errors where the element's dilatation is a mean, or projected as in curved tetrahedra: its energy is no quartic.
    pub fn suits(element: &Element, mesh: &TetMesh) -> Result<(), AssemblyError> {
        let place = |node: u32| mesh.nodes[node as usize];
        let is_straight = |tet: usize| tet10::is_straight(&quadratic::nodes(mesh, tet).map(place));
        let are_straight = mesh.mids.is_empty() || (0..mesh.tets.len()).all(is_straight);
        match element.dilatation == Dilatation::Own && are_straight {
            true => Ok(()),
            false => Err(AssemblyError::NoQuartic { element: element.name }),
        }
    }

    pub fn count(&self) -> usize {
        self.points.count()
    }

    pub fn at(&self, point: usize) -> RestPoint<'_> {
        RestPoint {
            nodes: self.points.nodes_of(self.points.element_of(point)),
            gradients: self.points.gradients_at(point),
            volume: self.points.volume[point],
            lame: self.points.lame(point),
        }
    }
}

impl RestPoint<'_> {
    /// H of every field, relative to the point's first node.
    pub fn gradients_of(&self, fields: &NodeFields, out: &mut Vec<Matrix3<f64>>) {
        out.clear();
        out.resize(fields.columns, Matrix3::zeros());
        for (&node, g) in self.nodes.iter().zip(self.gradients).skip(1) {
            for axis in 0..3 {
                let u = fields.row(3 * node as usize + axis);
                let first = fields.row(3 * self.nodes[0] as usize + axis);
                for ((h, u), u0) in out.iter_mut().zip(u).zip(first) {
                    let moved = u - u0;
                    h[(axis, 0)] += moved * g.x;
                    h[(axis, 1)] += moved * g.y;
                    h[(axis, 2)] += moved * g.z;
                }
            }
        }
    }

    /// C : ε of a symmetric ε, Pa.
    pub fn stress(&self, strain: &Matrix3<f64>) -> Matrix3<f64> {
        strain * (2.0 * self.lame.mu) + Matrix3::from_diagonal_element(self.lame.lambda * strain.trace())
    }
}
