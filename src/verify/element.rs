//! The elements that are compared: a line each.

use super::Bound;
use crate::fem::{self, AssemblyError, Lame, StiffnessMatrix};
use crate::mesh::TetMesh;

/// One way to make K from tetrahedra.
pub struct Element {
    pub name: &'static str,
    /// Degree of the displacement: 1 has nodes at corners, 2 between them too.
    pub order: u32,
    pub assemble: fn(&TetMesh, &[Lame]) -> Result<StiffnessMatrix, AssemblyError>,
    /// Where its dilatation is taken.
    pub dilatation: Dilatation,
}

/// The tr(ε) that λ multiplies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dilatation {
    /// That of the displacement at the same point.
    Pointwise,
    /// The mean over the patch of each node, linear between nodes.
    Nodal,
}

pub const ELEMENTS: &[Element] = &[
    Element { name: "tet4", order: 1, assemble: fem::assemble, dilatation: Dilatation::Pointwise },
    Element { name: "tet4_anp", order: 1, assemble: fem::assemble_anp, dilatation: Dilatation::Nodal },
    Element { name: "tet10", order: 2, assemble: fem::assemble, dilatation: Dilatation::Pointwise },
];

impl Element {
    /// Cells for a problem's `size`: the number of nodes is the same for every order.
    pub fn cells(&self, size: u32) -> u32 {
        2 * size / self.order
    }

    /// Whether it is the plain displacement element of its order, that any other program has too.
    pub fn is_standard(&self) -> bool {
        self.dilatation == Dilatation::Pointwise
    }

    /// The least rates in L2 and in energy where the solution is smooth: order + 1 and order, less what two or three
    /// meshes are short of the limit. Towards ν = 1/2 theory promises linear displacements nothing on any mesh that can
    /// be afforded: they lock.
    pub fn promised(&self, poisson: f64) -> (Bound, Bound) {
        if self.order == 1 && poisson > 0.4 {
            return (Bound::NONE, Bound::NONE);
        }
        let order = f64::from(self.order);
        (Bound::rate(order + 1.0 - SHORT), Bound::rate(order - SHORT))
    }
}

/// What a fitted rate may be short of the promised one.
const SHORT: f64 = 0.2;
