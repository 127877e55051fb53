//! The force that a hand feels, without a device: an arrow at the control element that is held, and its value.
//!
//! In: bodies whose scene lists an effect with forces, and what is held. Out: [`HeldForce`]s and
//! their arrows. A body without such an effect has no [`ForceScale`], and nothing here is called for it.

use super::body::PlacedBody;
use super::force_scale::ForceScale;
use super::frame::HeldForce;
use crate::interact::force_arrow;
use crate::render::Arrow;
use nalgebra::Point3;

/// Length of the arrow of a force at full scale, against the workspace's radius.
const LONGEST: f64 = 0.6;
/// Radius of an arrow's shaft, against the workspace's.
const SHAFT: f64 = 0.012;

/// The force on control element `c` of body number `b`: the negative of the force that the hand must apply.
pub fn held_force(b: usize, body: &PlacedBody, scale: &ForceScale, c: usize) -> Option<HeldForce> {
    let full_n = *scale.full_n.get(c)?;
    let (wrenches, _) = body.deformer.wrenches()?;
    let force_n = -(body.room_from_body.isometry.rotation * wrenches[c].force);
    Some(HeldForce { body: b, control: c, force_n, full_n })
}

/// The arrow of a force: from the place where the hand holds the element, the way the body pulls the hand there; green where
/// it is weak, by yellow to red at full scale. It is shown through the body, into which it may point.
///
/// A hand that holds at a distance, along a ray, grips at the ray's end: there the force acts, and there the arrow starts.
pub fn arrow(force: &HeldForce, place: &Point3<f64>, radius_m: f64) -> Option<Arrow> {
    let arrow = force_arrow(place, &force.force_n, force.full_n, LONGEST * radius_m)?;
    let strength = arrow.strength as f32;
    Some(Arrow {
        from: arrow.from.cast(),
        along: arrow.along.cast(),
        radius_m: (SHAFT * radius_m) as f32,
        color: [(2.0 * strength).min(1.0), (2.0 - 2.0 * strength).min(0.9), 0.05],
        through: true,
    })
}
