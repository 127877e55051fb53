//! The force that a hand feels, shown without a device: an arrow at the held control element, its value, and how wrong it
//! may be.
//!
//! In: bodies whose scene lists an effect with forces, and what is held. Out: [`HeldForce`]s and their arrows, and an
//! estimate of the error of a body's forces and torques, in N and N·m, from its measured errors ([`WrenchError`]). A body
//! without such an effect has no [`ForceScale`], and nothing here is called for it.

use super::body::PlacedBody;
use super::force_scale::ForceScale;
use super::frame::{BodyFrame, HeldForce};
use crate::deform::{ControlPose, Deformer, ExpectedErrors, Freedom, Moved, Wrench, reach};
use crate::interact::force_arrow;
use crate::render::Arrow;
use nalgebra::{Point3, Vector3};

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

/// The possible error of every force and torque of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WrenchError {
    /// N.
    pub force: f64,
    /// N·m.
    pub moment: f64,
    /// Whether the model's part and the mesh's are both in it; else it may be more.
    pub is_whole: bool,
    /// The larger of both, as a part of the largest force, or torque over the length.
    pub part: f64,
    /// The parts of it that are the model's and the mesh's, where it is their sum.
    pub parts: [Option<f64>; 2],
}

/// The possible error of a body's forces and torques. `None` if nothing was measured, the pose is beyond what was, or the model
/// has no forces here.
///
/// In large motions they were measured of model and mesh together ([`ExpectedErrors::whole_at`]), else their parts are summed. The parts
/// of [`ErrorsAt`](crate::deform::ErrorsAt) are those of the largest force, or torque over the length; the mesh's are relative.
pub fn wrench_error(body: &PlacedBody, shown: &BodyFrame, wrenches: &[Wrench]) -> Option<WrenchError> {
    wrench_error_of(shown.expected.as_ref()?, &body.deformer, wrenches, &[])
}

/// [`wrench_error`] for a body that is in no world, whose control elements have this freedom; an empty list frees none. If an end
/// is free except for one shift, or is pushed by a force, and its pose was found, the errors are those measured for such ends.
pub fn wrench_error_of(
    expected: &ExpectedErrors,
    deformer: &Deformer,
    wrenches: &[Wrench],
    freedom: &[Freedom],
) -> Option<WrenchError> {
    if deformer.contribution().exerts_forces() {
        return None;
    }
    let names: Vec<&str> = deformer.controls.iter().map(|control| control.name.as_str()).collect();
    let is_alone = || {
        let others = deformer.poses.iter().zip(freedom).filter(|(_, freedom)| !freedom.is_any());
        others.into_iter().all(|(pose, _)| *pose == ControlPose::REST)
    };
    let hung = expected
        .hung(&names, freedom)
        .filter(|hung| is_alone() && !hung.at.is_empty() && expected.is_under_its_loads(deformer));
    let of_model = match (expected.model.law(), hung) {
        (Some(_), _) => Some([0.0; 2]),
        (None, Some(hung)) => hung.at(reach(deformer)).and_then(|at| Some([at.force?, at.torque?])),
        // What is free in another way was not measured.
        (None, None) if freedom.iter().any(Freedom::is_any) => None,
        (None, None) => expected.in_pose(deformer).and_then(|at| Some([at.force?, at.torque?])),
    };
    let mesh = hung.and_then(|hung| hung.mesh).or_else(|| expected.mesh_at(deformer, wrenches));
    let whole = match freedom.iter().any(Freedom::is_any) {
        true => None,
        false => expected.whole_at(deformer, wrenches),
    };
    // Without the model's part the mesh's alone is not shown.
    let of_both = || of_model.map(|parts| parts.map(|part| part + mesh.unwrap_or(0.0)));
    let is_whole = mesh.is_some() || whole.is_some();
    let [of_force, of_moment] =
        whole.or_else(of_both).filter(|_| is_whole || expected.model.law().is_none())?;
    let origins: Vec<Vector3<f64>> = deformer.controls.iter().map(|control| control.origin).collect();
    let length = |name: &String| {
        let element = deformer.controls.iter().position(|control| control.name == *name)?;
        Moved::new(&origins, element).map(|moved| moved.length)
    };
    let length = expected.moved.iter().filter_map(|moved| length(&moved.control)).reduce(f64::max)?;
    let placed = wrenches.iter().zip(&deformer.poses).map(|(wrench, pose)| wrench.about_the_place(pose));
    let size = placed.map(|w| w.force.norm().max(w.moment.norm() / length)).fold(0.0, f64::max);
    Some(WrenchError {
        force: of_force * size,
        moment: of_moment * size * length,
        is_whole,
        part: of_force.max(of_moment),
        parts: match whole {
            Some(_) => [None; 2],
            None => [of_model.map(|[force, moment]| force.max(moment)), mesh],
        },
    })
}

/// The reason why [`wrench_error`] is `None`, in words that follow "error unknown".
pub fn why_unknown(body: &PlacedBody, shown: &BodyFrame) -> &'static str {
    match &shown.expected {
        _ if body.deformer.contribution().exerts_forces() => "an effect adds forces that were not measured",
        None => "list expected_errors",
        Some(expected) if expected.moved.is_empty() => "not measured on this body",
        Some(_) => "beyond the measured poses",
    }
}
