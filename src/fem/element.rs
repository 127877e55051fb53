//! An entry of the list of elements: everything that the program knows of a kind of element.
//!
//! In: a mesh with the element's nodes, Lamé's constants for each tetrahedron, displacement fields. Out: the stiffness
//! matrix and the strain energies, summed over the sets of elements that the entry makes of the mesh.

use super::assembly::{AssemblyError, ElementSet, assemble_elements};
use super::energy::mutual_energies;
use super::lame::Lame;
use super::stiffness::{NodeFields, StiffnessMatrix};
use super::strain_points::StrainPoints;
use crate::mesh::TetMesh;
use nalgebra::DMatrix;

/// The sets of elements of a mesh, whose contributions are added up.
pub type ElementSets<'a> = Vec<Box<dyn ElementSet + 'a>>;

/// A kind of element.
#[derive(Debug)]
pub struct Element {
    /// The name in scenes.
    pub name: &'static str,
    /// Degree of the displacement: 1 has nodes at corners, 2 between them too.
    pub order: u32,
    pub dilatation: Dilatation,
    /// Whether it locks near Poisson's ratio 1/2: it is too stiff on every mesh that is small enough to be solved.
    pub locks: bool,
    /// Pairs of nodes with an element in common for each edge, face and tetrahedron of the mesh: the stiffness matrix has a block
    /// for each.
    pub pairs: [f64; 3],
    /// Time to solve for one unknown, against one of tet4.
    pub unknown_cost: f64,
    /// Errors where a tetrahedron is flat, inverted or folded.
    pub sets: for<'a> fn(&'a TetMesh, &'a [Lame]) -> Result<ElementSets<'a>, AssemblyError>,
    /// The points of the elements at large strain. Errors as `sets`.
    pub points: fn(&TetMesh, &[Lame]) -> Result<StrainPoints, AssemblyError>,
}

/// The dilatation θ whose square λ multiplies in an element's energy; linear in each tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Dilatation {
    /// The divergence of the displacement. In a curved quadratic tetrahedron, where it is not linear, it is projected in
    /// L2 onto the linear functions.
    Own,
    /// The mean of the divergence over the patch around each node, interpolated linearly between the nodes.
    Nodal,
}

impl Element {
    /// K = Σ_e K_e with Lamé's constants `lame[e]` per tetrahedron.
    ///
    /// Errors where a tetrahedron is flat or inverted, or where the mesh lacks the nodes of this element.
    pub fn assemble(&self, mesh: &TetMesh, lame: &[Lame]) -> Result<StiffnessMatrix, AssemblyError> {
        let mut matrix = assemble_elements(mesh.nodes.len(), &self.sets_of(mesh, lame)?);
        matrix.places = mesh.nodes.iter().map(|place| (*place).into()).collect();
        Ok(matrix)
    }

    /// S_ij = a(u_i, u_j) of all fields, element by element ([`mutual_energies`]). Errors as [`Element::assemble`].
    pub fn energies(
        &self,
        mesh: &TetMesh,
        lame: &[Lame],
        fields: &NodeFields,
    ) -> Result<DMatrix<f64>, AssemblyError> {
        Ok(mutual_energies(&self.sets_of(mesh, lame)?, fields))
    }

    /// The elements at large strain, for [`super::Hyperelastic`]. Errors as [`Element::assemble`].
    pub fn points(&self, mesh: &TetMesh, lame: &[Lame]) -> Result<StrainPoints, AssemblyError> {
        self.check_order(mesh)?;
        (self.points)(mesh, lame)
    }

    /// Errors where the mesh or one of its tetrahedra does not suit.
    pub(super) fn sets_of<'a>(
        &self,
        mesh: &'a TetMesh,
        lame: &'a [Lame],
    ) -> Result<ElementSets<'a>, AssemblyError> {
        self.check_order(mesh)?;
        (self.sets)(mesh, lame)
    }

    fn check_order(&self, mesh: &TetMesh) -> Result<(), AssemblyError> {
        let order = if mesh.mids.is_empty() { 1 } else { 2 };
        if order != self.order {
            return Err(AssemblyError::Order { element: self.name, needed: self.order, order });
        }
        Ok(())
    }
}
