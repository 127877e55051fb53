//! The integration points of a body at rest, for energies that are quartic in the displacements.
//!
//! In: an element, a mesh, Lamé's constants. Out: points with the shape gradients of their nodes, where
//! V = Σ vol (λ/2 (tr E)² + μ E:E) with E = sym H + ½ HᵀH, H = Σ u_a ⊗ G_a: one for a linear tetrahedron, four for a
//! straight quadratic one. Elements whose dilatation is not their own tr E have no such sum.

use super::assembly::AssemblyError;
use super::element::{Dilatation, Element};
use super::fields::NodeFields;
use super::lame::Lame;
use super::{tet4, tet10};
use crate::mesh::{TetMesh, quadratic};
use nalgebra::{Matrix3, Vector3};

/// One integration point.
#[derive(Clone, Debug)]
pub struct RestPoint {
    pub nodes: Vec<u32>,
    /// G_a, 1/m.
    pub gradients: Vec<Vector3<f64>>,
    /// Its share of the volume, m³.
    pub volume: f64,
    pub lame: Lame,
}

/// All points of a body.
#[derive(Clone, Debug)]
pub struct RestPoints {
    pub nodes: usize,
    pub points: Vec<RestPoint>,
}

impl RestPoints {
    /// Errors as [`Element::assemble`], and where the element's energy is no sum over points.
    pub fn of(element: &'static Element, mesh: &TetMesh, lame: &[Lame]) -> Result<RestPoints, AssemblyError> {
        element.sets_of(mesh, lame)?;
        let unsuited = AssemblyError::NoQuartic { element: element.name };
        if element.dilatation != Dilatation::Own {
            return Err(unsuited);
        }
        let mut points = Vec::new();
        for (tet, lame) in lame.iter().enumerate() {
            if mesh.mids.is_empty() {
                let Some(own) = tet4::geometry(mesh.corners(tet)) else { return Err(unsuited) };
                points.push(RestPoint {
                    nodes: mesh.tets[tet].to_vec(),
                    gradients: own.gradients.to_vec(),
                    volume: own.volume,
                    lame: *lame,
                });
                continue;
            }
            let nodes = quadratic::nodes(mesh, tet);
            let own = tet10::points(&nodes.map(|node| mesh.nodes[node as usize]));
            let Some(own) = own.filter(|own| tet10::dilatations(own).is_none()) else { return Err(unsuited) };
            points.extend(own.iter().map(|point| RestPoint {
                nodes: nodes.to_vec(),
                gradients: point.gradients.to_vec(),
                volume: point.volume,
                lame: *lame,
            }));
        }
        Ok(RestPoints { nodes: mesh.nodes.len(), points })
    }
}

impl RestPoint {
    /// H of every field, relative to the point's first node.
    pub fn gradients_of(&self, fields: &NodeFields, out: &mut Vec<Matrix3<f64>>) {
        out.clear();
        out.resize(fields.columns, Matrix3::zeros());
        for (&node, g) in self.nodes.iter().zip(&self.gradients).skip(1) {
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
