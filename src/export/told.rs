//! What `deform` tells of a pose beside its numbers: where the control elements ended, how sure the forces are, where
//! the material first yields, where the points of forces went.

use crate::deform::pose_file::PoseLoads;
use crate::deform::{ControlPoses, Freedom, ModelEntry, PointLoad, Pull, Wrench};
use crate::world::WrenchError;
use nalgebra::Vector3;

/// Of one pose of one body.
#[derive(Clone, Debug, Default)]
pub struct Told {
    /// By which the body was deformed.
    pub model: &'static ModelEntry,
    /// Of the control elements, in the body's order.
    pub names: Vec<String>,
    /// Where their origins rest, m, in the mesh's coordinates.
    pub places: Vec<Vector3<f64>>,
    /// Every control element, in the body's order, those that were found too.
    pub control: ControlPoses,
    /// In what they are free; empty where all are held.
    pub freedom: Vec<Freedom>,
    /// What acted beside them.
    pub loads: PoseLoads,
    /// That the body is bent further than its model holds.
    pub beyond: Option<String>,
    /// The forces at points among them.
    pub pushed: Vec<Pushed>,
    /// By how much forces may be wrong, or why that is not known.
    pub error: Sureness,
    /// Where a limit is passed, and the pose goes on from rest; the loads act in full from the beginning.
    pub first_yield: Option<FirstYield>,
    /// Name of the pose that it goes on from.
    pub after: Option<String>,
}

/// How sure forces are.
#[derive(Clone, Debug, PartialEq)]
pub enum Sureness {
    /// As it was measured on the body.
    Measured(WrenchError),
    /// Why not, and what measures it.
    Unknown(String),
}

impl Default for Sureness {
    fn default() -> Sureness {
        Sureness::Unknown(String::new())
    }
}

impl Sureness {
    pub fn measured(&self) -> Option<&WrenchError> {
        match self {
            Sureness::Measured(error) => Some(error),
            Sureness::Unknown(_) => None,
        }
    }
}

/// The first state on the way from rest in which a limit of the material is reached away from the edges of control elements,
/// where stress is a peak that grows with a finer mesh.
#[derive(Clone, Debug)]
pub struct FirstYield {
    /// Of the way.
    pub share: f64,
    /// What part of a limit is reached at the edges there.
    pub at_edges: f64,
    pub control: ControlPoses,
    pub wrenches: Option<Vec<Wrench>>,
    pub error: Option<WrenchError>,
}

/// A force at a point of the surface.
#[derive(Clone, Copy, Debug)]
pub struct Pushed {
    /// N.
    pub force: Vector3<f64>,
    /// Where the point rests, m, in the mesh's coordinates.
    pub rest: Vector3<f64>,
    /// How far it went, under all that acts on the body, m.
    pub moved: Vector3<f64>,
}

impl Pushed {
    /// Of a body whose nodes rest at `rest` and are displaced by `displacement`.
    pub fn of(points: &[PointLoad], rest: &[Vector3<f64>], displacement: &[Vector3<f64>]) -> Vec<Pushed> {
        let one = |point: &PointLoad| {
            let Pull::Force(force) = point.pull else { return None };
            let mean = |all: &[Vector3<f64>]| {
                point.nodes.iter().zip(point.weights).map(|(&node, weight)| all[node as usize] * weight).sum()
            };
            Some(Pushed { force, rest: mean(rest), moved: mean(displacement) })
        };
        points.iter().filter_map(one).collect()
    }
}
