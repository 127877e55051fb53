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
    /// Cells for a problem's `size`: that many of quadratic elements, twice as many of linear ones, so that both have
    /// about as many nodes.
    pub fn cells(&self, size: u32) -> u32 {
        2 * size / self.order
    }

    /// Whether it is the plain displacement element of its order, that any other program has too.
    pub fn is_standard(&self) -> bool {
        self.dilatation == Dilatation::Pointwise
    }

    /// The least rates in L2 and in energy that theory promises where the solution is smooth, less [`SHORT`].
    ///
    /// In energy the plain elements of order p come as near as any of their fields, h^p at every ν, with a constant that
    /// grows as √λ. In L2 it is h^(p+1) while ν is well below 1/2. Near it linear elements lock, and quadratic ones lose
    /// one order (Babuška and Suri, Numer. Math. 62, 1992, 439-463, on triangles). For mean pressures nothing is proven
    /// there.
    pub fn promised(&self, poisson: f64) -> (Bound, Bound) {
        let order = f64::from(self.order);
        let is_near_half = poisson > 0.4;
        let l2 = match (is_near_half, self.order) {
            (false, _) => Bound::rate(order + 1.0 - SHORT),
            (true, 2) => Bound::rate(order - SHORT),
            (true, _) => Bound::NONE,
        };
        let energy =
            if is_near_half && !self.is_standard() { Bound::NONE } else { Bound::rate(order - SHORT) };
        (l2, energy)
    }
}

/// What a rate fitted to two to four meshes may be short of the limit.
pub const SHORT: f64 = 0.2;
