//! The force that a hand feels, without a device: an arrow at the control element that is held, and its value.
//!
//! In: bodies whose scene lists an effect that needs the handle stiffness S, and what is held. Out: [`HeldForce`]s and
//! their arrows. A body without such an effect has no [`ForceScale`], and nothing here is called for it.

use super::PlacedBody;
use crate::deform::Deformer;
use crate::effect::find_effect;
use crate::green::{FIELDS, GreenFile};
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
    let wants = |name: &String| find_effect(name).is_ok_and(|effect| effect.needs.stiffness);
    if !body.effects.iter().any(wants) {
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

/// The forces on the control elements `held` of body number `b`: what S c says that the hand must apply, reversed.
pub fn held_forces(b: usize, body: &PlacedBody, held: &[usize]) -> Vec<HeldForce> {
    let Some(scale) = &body.force_scale else { return Vec::new() };
    let Some((wrenches, _)) = body.deformer.wrenches() else { return Vec::new() };
    let force = |&control: &usize| HeldForce {
        body: b,
        control,
        force_n: -(body.room_from_body.isometry.rotation * wrenches[control].force),
        full_n: scale.full_n[control],
    };
    held.iter().map(force).collect()
}

/// The arrow of a force at `place`: green where it is weak, by yellow to red at full scale.
pub fn arrow(force: &HeldForce, place: &Point3<f64>, radius_m: f64) -> Option<Arrow> {
    let arrow = force_arrow(place, &force.force_n, force.full_n, LONGEST * radius_m)?;
    let strength = arrow.strength as f32;
    Some(Arrow {
        from: arrow.from.cast(),
        along: arrow.along.cast(),
        radius_m: (SHAFT * radius_m) as f32,
        color: [(2.0 * strength).min(1.0), (2.0 - 2.0 * strength).min(0.9), 0.05],
    })
}
