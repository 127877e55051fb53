//! The mark of a force on a hand or a tool.
//!
//! In: its place in the room, the force, and words. Out: an arrow as long as the force is large, and a plate.

use super::frame::Frame;
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::interact::force_arrow;
use crate::render::{Arrow, Drawable};
use nalgebra::{Point3, Vector3};

/// Radius of an arrow's shaft and length of the longest arrow, against the workspace's radius.
const SHAFT: f64 = 0.012;
const LONGEST: f64 = 0.6;
/// Linear RGB.
pub const COLOR: [f32; 3] = [0.25, 0.85, 0.75];

/// Words for a force of this name whose error is not known, N.
pub fn unknown(name: &str, force_n: f64) -> String {
    format!("{name}: {}, error unknown", quantity(force_n, "N"))
}

/// Marks a force at a place of the room with these words, in a workspace of this radius. The longest arrow is that of `full_n`.
pub fn mark_force(
    (place, force): (&Point3<f64>, &Vector3<f64>),
    full_n: f64,
    words: String,
    (radius_m, frame): (f64, &mut Frame),
) {
    if let Some(arrow) = force_arrow(place, force, full_n, LONGEST * radius_m) {
        frame.draw(Drawable::Arrow(Arrow {
            from: arrow.from.cast(),
            along: arrow.along.cast(),
            radius_m: (SHAFT * radius_m) as f32,
            color: COLOR,
            through: true,
        }));
    }
    frame.draw(Drawable::Plate(Plate::new(Anchor::Place((*place).into()), words)));
}
