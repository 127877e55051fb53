//! The mark of a force whose error is not known, as of tools on bodies: an arrow with its newtons.

use super::frame::Frame;
use super::running::World;
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::interact::force_arrow;
use crate::render::{Arrow, Drawable};
use nalgebra::{Point3, Vector3};

/// Radius of an arrow's shaft and length of the longest arrow, against the workspace's radius.
const SHAFT: f64 = 0.012;
const LONGEST: f64 = 0.6;
/// Linear.
const COLOR: [f32; 3] = [0.25, 0.85, 0.75];

/// Marks a force of this name at a place of the room. The longest arrow is that of `full_n`.
pub fn mark_force(
    name: &str,
    (place, force): (&Point3<f64>, &Vector3<f64>),
    full_n: f64,
    world: &World,
    frame: &mut Frame,
) {
    let radius_m = world.assets.stage.workspace.radius_m;
    if let Some(arrow) = force_arrow(place, force, full_n, LONGEST * radius_m) {
        frame.drawables.push(Drawable::Arrow(Arrow {
            from: arrow.from.cast(),
            along: arrow.along.cast(),
            radius_m: (SHAFT * radius_m) as f32,
            color: COLOR,
            through: true,
        }));
    }
    let words = format!("{name}: {}, error unknown", quantity(force.norm(), "N"));
    frame.drawables.push(Drawable::Plate(Plate::new(Anchor::Place((*place).into()), words)));
}
