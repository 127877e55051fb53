//! Displacements and forces of bodies in a number of poses, as exporters take them.

use super::told::PoseFacts;
use crate::deform::{Deformer, NodeStress, Wrench};
use crate::effect::stress::Peaks;
use crate::mesh::TetMesh;
use nalgebra::Vector3;

/// Results of a scene's bodies in a number of poses.
#[derive(Clone, Debug, Default)]
pub struct ResultSet {
    /// One per body.
    pub geometry: Vec<Geometry>,
    /// Results in the order in which the poses were asked for.
    pub results: Vec<PoseResult>,
    pub missed: Vec<MissedPose>,
}

/// Parts that not all results have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    Nothing,
    Forces,
    Stress,
    /// Poses of control elements that were found.
    Found,
}

/// One body in one pose.
#[derive(Clone, Debug)]
pub struct PoseResult {
    pub pose: String,
    pub body: String,
    /// m, by the order of the geometry's nodes.
    pub displacement: Vec<Vector3<f64>>,
    /// Forces and moments on the control elements, and the strain energy, J, where the body has them.
    pub wrenches: Option<ControlForces>,
    /// Present if the body lists the effect stress.
    pub stress: Option<StressResult>,
    pub told: PoseFacts,
}

impl PoseResult {
    /// A body that no pose moves.
    pub fn at_rest(geometry: &Geometry) -> PoseResult {
        PoseResult {
            pose: format!("{}, at rest", geometry.body),
            body: geometry.body.clone(),
            displacement: vec![Vector3::zeros(); geometry.rest.len()],
            wrenches: None,
            stress: None,
            told: PoseFacts::default(),
        }
    }
}

/// Stress and strain on the surface of a body.
#[derive(Clone, Debug)]
pub struct StressResult {
    /// Values in the order of the geometry's nodes; `None` inside the body and inside control elements.
    pub nodes: Vec<Option<NodeStress>>,
    /// Peaks, whose nodes count as the geometry's.
    pub reached: Peaks,
}

/// Forces and moments on the control elements of a body.
#[derive(Clone, Debug)]
pub struct ControlForces {
    /// Name and wrench, in the scene's order.
    pub controls: Vec<(String, Wrench)>,
    /// Strain energy, J.
    pub energy: f64,
}

/// A pose in which a body has no equilibrium.
#[derive(Clone, Debug)]
pub struct MissedPose {
    pub pose: String,
    pub body: String,
    /// The reason, with both names.
    pub why: String,
}

impl ResultSet {
    /// The name of a result in tables: in a scene of several bodies POSE/BODY, else POSE.
    pub fn label(&self, result: &PoseResult) -> String {
        match self.geometry.len() {
            0 | 1 => result.pose.clone(),
            _ => format!("{}/{}", result.pose, result.body),
        }
    }

    /// The results of one pose.
    pub fn of_pose(&self, pose: &str) -> ResultSet {
        ResultSet {
            geometry: self.geometry.clone(),
            results: self.results.iter().filter(|result| result.pose == pose).cloned().collect(),
            missed: self.missed.iter().filter(|missed| missed.pose == pose).cloned().collect(),
        }
    }

    pub fn has(&self, needs: Needs) -> bool {
        match needs {
            Needs::Nothing => true,
            Needs::Forces => self.has_forces(),
            Needs::Stress => self.has_stress(),
            Needs::Found => self.results.iter().any(|result| !result.told.freedom.is_empty()),
        }
    }

    pub fn has_stress(&self) -> bool {
        self.results.iter().any(|result| result.stress.is_some())
    }

    pub fn has_forces(&self) -> bool {
        self.results.iter().any(|result| result.wrenches.is_some())
    }
}

/// The mesh to which the displacements of one body belong: node tags, rest positions, cells.
#[derive(Clone, Debug)]
pub struct Geometry {
    pub body: String,
    pub tags: Vec<u64>,
    pub rest: Vec<Vector3<f64>>,
    /// Triangles or tetrahedra.
    pub cells: Vec<Vec<u32>>,
}

impl Geometry {
    pub fn surface(body: &Deformer) -> Geometry {
        Geometry {
            body: body.body.clone(),
            tags: body.tags().to_vec(),
            rest: body.rest().iter().map(|x| Vector3::from(*x).cast() + body.centre).collect(),
            cells: body.triangles().iter().map(|triangle| triangle.to_vec()).collect(),
        }
    }

    pub fn volume(name: &str, mesh: &TetMesh) -> Geometry {
        Geometry {
            body: name.to_owned(),
            tags: mesh.tags.clone(),
            rest: mesh.nodes.clone(),
            cells: (0..mesh.tets.len()).map(|tet| vtk_cell(mesh, tet)).collect(),
        }
    }

    /// The mesh of a geometry of tetrahedra.
    pub fn mesh(&self) -> TetMesh {
        let tets = self.cells.iter().filter_map(|cell| cell.first_chunk().copied());
        let mids = self.cells.iter().filter_map(|cell| match cell[..] {
            [_, _, _, _, a, b, c, d, f, e] => Some([a, b, c, d, e, f]),
            _ => None,
        });
        TetMesh {
            nodes: self.rest.clone(),
            tags: self.tags.clone(),
            tets: tets.collect(),
            mids: mids.collect(),
            ..TetMesh::default()
        }
    }
}

/// The nodes of a tetrahedron in VTK's order, whose last two mid-side nodes change places with ours.
fn vtk_cell(mesh: &TetMesh, tet: usize) -> Vec<u32> {
    let mut nodes = mesh.tets[tet].to_vec();
    if let Some(&[a, b, c, d, e, f]) = mesh.mids.get(tet) {
        nodes.extend([a, b, c, d, f, e]);
    }
    nodes
}
