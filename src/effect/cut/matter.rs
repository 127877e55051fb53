//! Mesh, materials and control elements of a body, whatever is cut.
//!
//! In: the volume of a .green file. Out: its mesh with materials and masses, and the motions that its control elements prescribe.

use crate::fem::{Lame, NodeFields, tet4};
use crate::green::{ControlElement, FIELDS};
use crate::mesh::split::{CutEdges, Split, Splitter};
use nalgebra::Vector3;

type V3 = Vector3<f64>;

pub struct Matter {
    pub splitter: Splitter,
    pub lame: Vec<Lame>,
    /// kg/m³ of each tetrahedron; empty where nothing is heavy.
    pub density: Vec<f64>,
    pub controls: Vec<ControlElement>,
    /// Control element that holds each node.
    pub held: Vec<Option<usize>>,
    /// Mesh coordinates of the origin of the .green file's lengths, m.
    pub centre: V3,
}

impl Matter {
    pub fn new(
        splitter: Splitter,
        lame: Vec<Lame>,
        density: Vec<f64>,
        controls: Vec<ControlElement>,
        centre: V3,
    ) -> Matter {
        let mut held = vec![None; splitter.mesh.nodes.len()];
        for (e, control) in controls.iter().enumerate() {
            control.nodes.iter().for_each(|node| held[*node as usize] = Some(e));
        }
        Matter { splitter, lame, density, controls, held, centre }
    }

    pub fn nodes(&self) -> usize {
        self.splitter.mesh.nodes.len()
    }

    /// The mesh after these cuts, which go on from an earlier split.
    pub fn split(&self, cut: &CutEdges, earlier: &Split) -> Split {
        self.splitter.split(cut, &self.held, earlier)
    }

    /// Number of the columns that control elements prescribe.
    pub fn affine(&self) -> usize {
        FIELDS * self.controls.len()
    }

    /// The affine fields at what is held, before `more` columns that are 0 there, over so many nodes.
    pub fn prescribed(&self, nodes: usize, more: usize) -> NodeFields {
        let mut fields = NodeFields::zeros(nodes, self.affine() + more);
        for (e, control) in self.controls.iter().enumerate() {
            control.prescribe(&self.splitter.mesh.nodes, FIELDS * e, &mut fields);
        }
        fields
    }

    /// Mass of a tetrahedron, kg; 0 where nothing is heavy.
    pub fn mass(&self, tet: u32) -> f64 {
        let of = tet4::geometry(self.splitter.mesh.corners(tet as usize));
        let volume = of.map_or(0.0, |geometry| geometry.volume.abs());
        self.density.get(tet as usize).map_or(0.0, |density| density * volume)
    }
}
