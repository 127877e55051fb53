//! Facts about a pose that `deform` reports beside its numbers: where the control elements ended, how sure the forces are, where
//! the material first yields, where the points of forces went.

use crate::deform::pose_file::PoseLoads;
use crate::deform::{ControlPoses, Freedom, ModelEntry, PointLoad, Pull, Wrench};
use crate::world::WrenchError;
use nalgebra::Vector3;

/// Facts about one pose of one body.
#[derive(Clone, Debug, Default)]
pub struct PoseFacts {
    /// The model by which the body was deformed.
    pub model: &'static ModelEntry,
    /// Names of the control elements, in the body's order.
    pub names: Vec<String>,
    /// Places of their origins at rest, m, in the mesh's coordinates.
    pub places: Vec<Vector3<f64>>,
    /// Every control element, in the body's order, those that were found too.
    pub control: ControlPoses,
    /// The freedom of the control elements; empty where all are held.
    pub freedom: Vec<Freedom>,
    /// The loads beside them.
    pub loads: PoseLoads,
    /// Warning: bent beyond the model's range.
    pub beyond: Option<String>,
    /// The forces at points among them.
    pub pushed: Vec<PointPush>,
    /// Possible error of the forces, or why it is unknown.
    pub error: Sureness,
    /// Present where a limit is passed, and the pose goes on from rest; the loads act in full from the beginning.
    pub first_yield: Option<FirstYield>,
    /// Name of the pose that it goes on from.
    pub after: Option<String>,
}

/// Certainty of forces.
#[derive(Clone, Debug, PartialEq)]
pub enum Sureness {
    /// The error that was measured on the body.
    Measured(WrenchError),
    /// The reason why it is unknown, and what measures it.
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
    /// Share of the way.
    pub share: f64,
    /// Part of a limit that is reached at the edges there.
    pub at_edges: f64,
    pub control: ControlPoses,
    pub wrenches: Option<Vec<Wrench>>,
    pub error: Option<WrenchError>,
}

/// A force at a point of the surface.
#[derive(Clone, Copy, Debug)]
pub struct PointPush {
    /// N.
    pub force: Vector3<f64>,
    /// Place of the point at rest, m, in the mesh's coordinates.
    pub rest: Vector3<f64>,
    /// Displacement of the point, under all that acts on the body, m.
    pub moved: Vector3<f64>,
}

impl PointPush {
    /// The motions of the points of a body whose nodes rest at `rest` and are displaced by `displacement`.
    pub fn list(
        points: &[PointLoad],
        rest: &[Vector3<f64>],
        displacement: &[Vector3<f64>],
    ) -> Vec<PointPush> {
        let one = |point: &PointLoad| {
            let Pull::Force(force) = point.pull else { return None };
            let mean = |all: &[Vector3<f64>]| {
                point.nodes.iter().zip(point.weights).map(|(&node, weight)| all[node as usize] * weight).sum()
            };
            Some(PointPush { force, rest: mean(rest), moved: mean(displacement) })
        };
        points.iter().filter_map(one).collect()
    }
}
