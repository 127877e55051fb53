//! Rest: bodies that nothing holds and that have lain still for a second stay where they are, until something changes.
//!
//! In: how far bodies with inertia have gone in each frame, and what touches them. Out: whether they go on lying there. What solvers leave
//! open would let them creep: a cube on a cube by 0.8 µm a second. Bodies that are heard do not rest, for their modes ring on.

use super::inertial::Inertias;
use super::touch::Contact;
use super::touched_body::TouchedBody;
use crate::deform::ControlPose;
use nalgebra::Vector3;

type V3 = Vector3<f64>;

/// Frames for which bodies have lain still before they rest.
pub const FRAMES: u32 = 60;
/// Part of a body's edges by which it may move in such a frame.
const STILL: f64 = 1e-4;

/// Whether there are bodies with inertia, each of which lies on something, unheard, while no hand holds a part of it.
pub fn lie(bodies: &[TouchedBody], inertias: &Inertias<'_>, contacts: &[Contact]) -> bool {
    let mut living =
        inertias.iter().enumerate().filter_map(|(number, inertia)| Some((number, inertia.as_ref()?)));
    let touches =
        |number: usize| contacts.iter().any(|contact| contact.sides().any(|(body, ..)| body == number));
    inertias.iter().any(Option::is_some)
        && living.all(|(number, inertia)| {
            let controls = bodies[number].free.poses.len();
            !bodies[number].is_heard && touches(number) && (0..controls).all(|control| inertia.moves(control))
        })
}

/// Whether no body has gone far from the poses of its control elements at the beginning of a frame to those at its end.
pub fn are_still(bodies: &[TouchedBody], before: &[Vec<ControlPose>], after: &[Vec<ControlPose>]) -> bool {
    let is_still = |(body, (before, after)): (&TouchedBody, (&Vec<ControlPose>, &Vec<ControlPose>))| {
        let rest = body.free.rest().iter().map(|x| V3::from(x.map(f64::from)).norm());
        let (radius, most) = (rest.fold(0.0, f64::max), STILL * body.longest_at_rest());
        let way = |(from, to): (&ControlPose, &ControlPose)| {
            (to.translation - from.translation).norm() + (to.matrix - from.matrix).norm() * radius
        };
        before.iter().zip(after).all(|pair| way(pair) <= most)
    };
    bodies.iter().zip(before.iter().zip(after)).all(is_still)
}

/// Number of frames for which bodies have lain still, after one in which they lie there and `changed` says whether anything else has
/// changed; `None` where they move in this frame.
pub fn rested(still: u32, changed: bool) -> Option<u32> {
    // The frame in which they come to rest still differs from the one before.
    (still == FRAMES || (still > FRAMES && !changed)).then_some(FRAMES + 1)
}
