//! A tool in a world: its shape, and where a hand or the scene puts it.

use super::shape::Shape;
use crate::base::failure::Failure;
use crate::render::GhostShape;
use crate::scene::{Scene, Tool as SceneTool};
use crate::stage::Workspace;
use crate::track::{StylusState, usable};
use crate::world::World;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

type V3 = Vector3<f64>;

pub struct Tool {
    pub name: String,
    pub shape: Shape,
    pub drawn: Arc<GhostShape>,
    /// Linear RGB.
    pub color: [f32; 3],
    /// Stylus that carries it.
    pub stylus: Option<usize>,
    /// Pose in the axes of the stylus or of the room.
    pose: Isometry3<f64>,
    /// Stiffness of the spring to the hand, N/m.
    pub stiffness: Option<f64>,
}

impl Tool {
    pub fn new(scene: &Scene, name: &str, tool: &SceneTool) -> Result<Tool, Failure> {
        let shape = Shape::new(scene, name, &tool.shape)?;
        let linear = |byte: u8| (f32::from(byte) / 255.0).powf(2.2);
        Ok(Tool {
            name: name.to_owned(),
            drawn: Arc::new(shape.surface()),
            shape,
            color: tool.color.0.map(linear),
            stylus: tool.stylus.map(|number| number - 1),
            pose: Isometry3::from_parts(
                Translation3::from(V3::from(tool.position)),
                UnitQuaternion::from_scaled_axis(V3::from(tool.rotation)),
            ),
            stiffness: tool.stiffness,
        })
    }

    /// Place to which it is put in this frame; `None` while its stylus is not seen, or has no usable pose.
    pub fn place(&self, world: &World) -> Option<Isometry3<f64>> {
        if self.stylus.is_none() {
            return Some(self.pose);
        }
        Some(hand(self.carrier(world)?, &world.assets.stage.workspace)? * self.pose)
    }

    /// The stylus that carries it, as it is in this frame.
    pub fn carrier<'a>(&self, world: &'a World) -> Option<&'a StylusState> {
        let fields = world.fields.styli.get(self.stylus?)?;
        world.graph.get(fields.stylus).as_ref()
    }
}

/// The pose of the hand. One that starts at the eye, as the mouse's, is at its ray's point abreast of the middle of the workspace.
fn hand(stylus: &StylusState, workspace: &Workspace) -> Option<Isometry3<f64>> {
    let pose = usable(&stylus.room_from_stylus)?;
    if !stylus.from_eye {
        return Some(pose);
    }
    let ahead = pose.rotation.inverse() * (workspace.centre.coords - pose.translation.vector);
    let far = ahead.norm().max(f64::MIN_POSITIVE);
    Some(pose * Translation3::new(0.0, 0.0, -far))
}

/// The pose on the way from one to another.
pub fn pose_between(from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    if share == 1.0 {
        return *to;
    }
    let turn = from.rotation.inverse() * to.rotation;
    let moved = from.translation.vector.lerp(&to.translation.vector, share);
    let turned = from.rotation * UnitQuaternion::from_scaled_axis(turn.scaled_axis() * share);
    Isometry3::from_parts(moved.into(), turned)
}
