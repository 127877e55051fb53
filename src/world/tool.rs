//! A tool in a world: its shape, and where a hand or the scene puts it.

use super::tool_place::ToolPlace;
use super::tool_shape::Shape;
use crate::base::failure::Failure;
use crate::render::GhostShape;
use crate::scene::{Scene, Tool as SceneTool};
use nalgebra::{Isometry3, UnitQuaternion};
use std::sync::Arc;

pub struct Tool {
    pub name: String,
    pub shape: Shape,
    pub drawn: Arc<GhostShape>,
    /// Linear RGB.
    pub color: [f32; 3],
    pub place: ToolPlace,
    /// Stiffness of the spring to the hand, N/m.
    pub stiffness: Option<f64>,
}

impl Tool {
    pub fn new(scene: &Scene, name: &str, tool: &SceneTool) -> Result<Tool, Failure> {
        let shape = Shape::new(scene, name, &tool.shape)?;
        Ok(Tool {
            name: name.to_owned(),
            drawn: Arc::new(shape.surface()),
            shape,
            color: tool.color.linear(),
            place: ToolPlace::new(tool),
            stiffness: tool.stiffness,
        })
    }
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
