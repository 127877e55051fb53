//! Tools: rigid things that touch or cut bodies, on a stylus or at a place in the room.

use super::look::Color;
use crate::mesh::length_unit::LengthUnit;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// `[tool.NAME]`.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Tool {
    pub shape: ToolShape,
    /// The stylus that carries it, by its number from 1; without one, the tool stands in the room.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stylus: Option<usize>,
    /// Origin in the axes of the stylus, whose ray is -z, or of the room; m.
    #[serde(default)]
    pub position: [f64; 3],
    /// Rotation vector (axis times angle) in the same axes, rad.
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Stiffness of the spring by which the hand holds it, N/m; without it, the tool goes where the hand goes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    #[serde(default = "steel")]
    pub color: Color,
}

fn steel() -> Color {
    Color([176, 180, 188])
}

/// The shape of a tool in its own axes, m.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ToolShape {
    /// About the origin.
    Ball { radius: f64 },
    /// A rod with round ends, from its tip's centre at the origin along z, away from where a stylus points.
    Capsule { radius: f64, length: f64 },
    /// A bent rod with round ends, as a hook or a ring: through these points in the axes of the tool.
    Rod { radius: f64, points: Vec<[f64; 3]> },
    /// About the origin, with these sides; its edges are rounded with `radius`, 5 % of the shortest side where that is left out.
    Box { size: [f64; 3], radius: Option<f64> },
    /// All that lies below y = 0.
    Floor,
    /// A blade that cuts bodies which list "cut": its edge begins at its tip, the origin, and goes along z, away from where a stylus points;
    /// its back is higher by `width`, along y.
    Blade { length: f64, width: f64 },
    /// A closed surface, STL, OBJ or PLY, thickened by `radius`, 1 % of its diagonal where that is left out.
    Mesh { file: PathBuf, unit: Option<&'static LengthUnit>, radius: Option<f64> },
}

/// Share of a box's shortest side, and of a mesh's diagonal, by which edges are rounded where nothing is said.
const BOX_ROUNDED: f64 = 0.05;
const MESH_ROUNDED: f64 = 0.01;

impl ToolShape {
    /// The radius with which the edges of a box of these sides are rounded.
    pub fn box_radius(size: &[f64; 3], radius: Option<f64>) -> f64 {
        radius.unwrap_or_else(|| BOX_ROUNDED * size.iter().copied().fold(f64::INFINITY, f64::min))
    }

    /// The radius by which a mesh with this diagonal is thickened.
    pub fn mesh_radius(diagonal: f64, radius: Option<f64>) -> f64 {
        radius.unwrap_or(MESH_ROUNDED * diagonal)
    }

    /// Whether it cuts and touches nothing.
    pub fn is_blade(&self) -> bool {
        matches!(self, ToolShape::Blade { .. })
    }

    fn check(&self) -> Result<(), String> {
        let positive = |what: &str, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(format!("{what} is {value} m: a positive length is needed")),
        };
        match self {
            ToolShape::Ball { radius } => positive("radius", *radius),
            ToolShape::Capsule { radius, length } => {
                positive("radius", *radius)?;
                positive("length", *length)
            }
            ToolShape::Rod { radius, points } => {
                positive("radius", *radius)?;
                if points.len() < 2 || points.iter().flatten().any(|x| !x.is_finite()) {
                    return Err("points: at least two are needed, of finite numbers".to_owned());
                }
                Ok(())
            }
            ToolShape::Box { size, radius } => {
                size.iter().try_for_each(|side| positive("a side of size", *side))?;
                let radius = ToolShape::box_radius(size, *radius);
                positive("radius", radius)?;
                match size.iter().find(|side| **side < 2.0 * radius) {
                    Some(side) => Err(format!(
                        "radius = {radius} m rounds away its side of {side} m: at most half of it"
                    )),
                    None => Ok(()),
                }
            }
            ToolShape::Floor => Ok(()),
            ToolShape::Blade { length, width } => {
                positive("length", *length)?;
                positive("width", *width)
            }
            ToolShape::Mesh { radius, .. } => radius.map_or(Ok(()), |radius| positive("radius", radius)),
        }
    }
}

impl Tool {
    /// A tool that stands in the room, at its origin.
    pub fn new(shape: ToolShape) -> Tool {
        Tool { shape, stylus: None, position: [0.0; 3], rotation: [0.0; 3], stiffness: None, color: steel() }
    }

    /// The error is a key of the tool, and what is wrong with it.
    pub(super) fn check(&self) -> Result<(), (&'static str, String)> {
        self.shape.check().map_err(|message| ("shape", message))?;
        if self.stylus == Some(0) {
            return Err(("stylus", "styli are counted from 1".to_owned()));
        }
        if let Some(number) = self.position.iter().chain(&self.rotation).find(|number| !number.is_finite()) {
            return Err(("position", format!("it and the turn must be finite, and {number} is not")));
        }
        if self.shape.is_blade() && self.stiffness.is_some() {
            return Err((
                "stiffness",
                "a blade feels no force by which a spring would yield: leave it out".to_owned(),
            ));
        }
        match self.stiffness.filter(|k| !(k.is_finite() && *k > 0.0)) {
            Some(stiffness) => Err(("stiffness", format!("{stiffness} N/m: a positive number is needed"))),
            None => Ok(()),
        }
    }
}
