//! Loads, other effects, hands and time, which act on touched bodies beside contact.

use super::inertial::Inertias;
use super::touched_body::TouchedBody;
use crate::deform::{Contribution, ControlPose};
use crate::world::World;
use crate::world::inertia::Coming;

/// The poses of a body's control elements in this frame, without what inertia changes of them.
pub fn poses_of(world: &World, b: usize) -> Vec<ControlPose> {
    world.fields.bodies[b].poses.iter().map(|pose| *world.graph.get(*pose)).collect()
}

/// Takes what acts on the bodies in this frame; one for which time stands is held as one without inertia. True if anything has changed,
/// and the length of the frame, s, where time goes on.
pub fn take(
    bodies: &mut [TouchedBody],
    world: &World,
    contributions: &[Contribution],
    inertias: &mut Inertias<'_>,
) -> (bool, Option<f64>) {
    let time_s = *world.graph.get(world.fields.time);
    let (mut changed, mut frame_s) = (false, None);
    for (body, slot) in bodies.iter_mut().zip(inertias) {
        if let Some(inertia) = slot {
            body.follow(&**inertia, &inertia.now());
        }
        let placed = &world.bodies[body.b];
        let mut loads = placed.deformer.acting();
        // Those of effects stand last.
        let of_effects = placed.deformer.contribution().points.len();
        loads.points.truncate(loads.points.len().saturating_sub(of_effects));
        changed |= body.free.apply(&loads);
        changed |= slot.is_some() && body.others != contributions[body.b];
        body.others.clone_from(&contributions[body.b]);
        match slot {
            Some(inertia) => {
                body.free.respond();
                let poses = poses_of(world, body.b);
                let carried = (0..poses.len()).map(|control| world.is_carried(body.b, control)).collect();
                let begun = inertia.begin(Coming { time_s, poses, carried }, &body.free);
                frame_s = begun.or(frame_s);
                if begun.is_none() {
                    let now = inertia.now();
                    changed |= body.follow(&**inertia, &now);
                    *slot = None;
                }
            }
            None => {
                changed |= *body.free.contribution() != body.others;
                body.free.contribute(&body.others);
            }
        }
        body.set_inertia(slot.as_deref());
    }
    (changed, frame_s)
}
