//! Places of tools on styli or in the room.

use super::frame::Frame;
use super::running::World;
use crate::render::Drawable;
use crate::scene::Tool;
use crate::stage::{Stage, Workspace};
use crate::track::{StylusState, usable};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A tool's place on a stylus or in the room.
#[derive(Clone, Debug)]
pub struct ToolPlace {
    /// Stylus that carries it.
    pub stylus: Option<usize>,
    /// Pose in the axes of the stylus or of the room.
    pose: Isometry3<f64>,
}

impl ToolPlace {
    pub fn new(tool: &Tool) -> ToolPlace {
        ToolPlace {
            stylus: tool.stylus.map(|number| number - 1),
            pose: Isometry3::from_parts(
                Translation3::from(Vector3::from(tool.position)),
                UnitQuaternion::from_scaled_axis(Vector3::from(tool.rotation)),
            ),
        }
    }

    /// Place to which it is put in this frame; `None` while its stylus is not seen, or has no usable pose.
    pub fn pose(&self, world: &World) -> Option<Isometry3<f64>> {
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

    /// Whether a force device of the stage moves the stylus that carries it.
    pub fn has_device(&self, stage: &Stage) -> bool {
        let name = self.stylus.and_then(|stylus| stage.tracking.stylus_names().get(stylus).cloned());
        name.is_some_and(|name| stage.is_felt_in(name))
    }

    /// The stylus that carries it, and room_from_stylus, where the hand is where the tool is: the mouse's stylus starts at the eye.
    pub fn in_hand(&self, world: &World) -> Option<(usize, Isometry3<f64>)> {
        let carrier = self.carrier(world).filter(|stylus| !stylus.from_eye)?;
        Some((self.stylus?, usable(&carrier.room_from_stylus)?))
    }

    /// Warning that the stylus of the tool of this name has not been seen in so many seconds; `None` of a tool that stands in the room.
    pub fn unseen(&self, name: &str, seconds: f64, world: &World) -> Option<String> {
        let stylus = self.stylus? + 1;
        let there = match world.fields.styli.len() {
            0 => "there are no styli".to_owned(),
            1 => "the only stylus is 1".to_owned(),
            count => format!("there are styli 1 to {count}"),
        };
        Some(format!("tool.{name}: stylus {stylus} has not been seen in {seconds} s; {there}"))
    }

    /// Takes away the pen and the ray of the stylus that carries it: the hand holds the tool instead. One that is pressed keeps its ray.
    pub fn hide_pen(&self, world: &World, frame: &mut Frame) {
        let carrier =
            self.carrier(world).map(|stylus| stylus.room_from_stylus.cast::<f64>().to_homogeneous());
        let Some(pen) = carrier.map(|pose| pose.cast::<f32>()) else { return };
        let is_pen = |drawable: &Drawable| {
            drawable
                .stylus()
                .is_some_and(|shape| !shape.pressed && (shape.room_from_stylus - pen).norm() < 1e-5)
        };
        frame.drawables.retain(|drawable| !is_pen(drawable));
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
