//! The force that a hand feels, without a device: an arrow at the control element that is held, and its value.
//!
//! In: bodies whose scene lists an effect that needs the handle stiffness S, and what is held. Out: [`HeldForce`]s and
//! their arrows. A body without such an effect has no [`ForceScale`], and nothing here is called for it.

use super::PlacedBody;
use crate::deform::Deformer;
use crate::effect::any_requires;
use crate::green::{FIELDS, GreenFile, STIFFNESS};
use crate::interact::force_arrow;
use crate::render::Arrow;
use crate::scene::Body;
use nalgebra::{Matrix3, Point3, Vector3};

/// Length of the arrow of a force at full scale, against the workspace's radius.
const LONGEST: f64 = 0.6;
/// A control element carried by this part of its body's radius along its softest direction pulls at full scale.
const FULL_AT: f64 = 0.25;
/// Radius of an arrow's shaft, against the workspace's.
const SHAFT: f64 = 0.012;

/// What the longest arrow stands for.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceScale {
    /// N, per control element.
    pub full_n: Vec<f64>,
}

/// The force of the body on the hand that holds one of its control elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldForce {
    pub body: usize,
    pub control: usize,
    /// N, along the room's axes.
    pub force_n: Vector3<f64>,
    /// The force of the longest arrow, N.
    pub full_n: f64,
}

/// The scale of a body of which the scene wants forces: for a control element with the translational stiffness K (3 × 3
/// of S) and a body of radius r, 0.25 r times the least singular value of K.
pub fn scale(body: &Body, deformer: &Deformer, file: &GreenFile) -> Option<ForceScale> {
    if !any_requires(&body.effects, STIFFNESS) {
        return None;
    }
    let stiffness = file.stiffness(&deformer.body)?;
    let (_, radius) = super::body::ball(deformer);
    let full_n = |e: usize| {
        let k: Matrix3<f64> = stiffness.fixed_view::<3, 3>(FIELDS * e, FIELDS * e).into_owned();
        FULL_AT * radius * k.singular_values().min()
    };
    Some(ForceScale { full_n: (0..deformer.controls.len()).map(full_n).collect() })
}

/// The force on control element `c` of body number `b`: what S c says that the hand must apply, reversed.
pub fn held_force(b: usize, body: &PlacedBody, c: usize) -> Option<HeldForce> {
    let full_n = *body.force_scale.as_ref()?.full_n.get(c)?;
    let (wrenches, _) = body.deformer.wrenches()?;
    let force_n = -(body.room_from_body.isometry.rotation * wrenches[c].force);
    Some(HeldForce { body: b, control: c, force_n, full_n })
}

/// The arrow of a force at `place` of a control element about `origin`: green where it is weak, by yellow to red at full
/// scale. One that pulls outward starts at the place, one that pushes inward ends there: neither is hidden in the body.
pub fn arrow(force: &HeldForce, place: &Point3<f64>, origin: &Point3<f64>, radius_m: f64) -> Option<Arrow> {
    let arrow = force_arrow(place, &force.force_n, force.full_n, LONGEST * radius_m)?;
    let strength = arrow.strength as f32;
    let is_inward = arrow.along.dot(&(place - origin)) < 0.0;
    let from = if is_inward { arrow.from - arrow.along } else { arrow.from };
    Some(Arrow {
        from: from.cast(),
        along: arrow.along.cast(),
        radius_m: (SHAFT * radius_m) as f32,
        color: [(2.0 * strength).min(1.0), (2.0 - 2.0 * strength).min(0.9), 0.05],
    })
}
