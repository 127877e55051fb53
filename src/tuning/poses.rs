//! The poses in which a body is measured where the user names none: moments of the scene's script, or random ones.

use crate::base::extent::bounding_box;
use crate::base::failure::Failure;
use crate::deform::ControlPoses;
use crate::fem::TET4;
use crate::green;
use crate::measure::poses::{hardest_first, random};
use crate::mesh::TetMesh;
use crate::prepare::{self, Resolved};
use crate::scene::Scene;
use crate::session::{Playback, Session, open};
use crate::solve::Solver;
use crate::world::World;

/// Poses with their names, and one sentence on where they come from.
pub type NamedPoses = (Vec<(String, ControlPoses)>, String);

/// Angles of the random poses, degrees.
const ANGLES: [f64; 8] = [2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0];
const QUICK_ANGLES: [f64; 3] = [10.0, 30.0, 60.0];
/// Distance by which random poses move across in addition to turning, as a part of the body's size.
const PLAY: f64 = 0.02;
/// Pictures of the script that are taken as poses, and how many of them are kept where time is short.
const SCRIPT_POSES: usize = 12;
const QUICK_SCRIPT_POSES: usize = 4;
const SEED: u64 = 1;

/// Moments of the scene's script; without one, or where a seed is given, random poses.
pub fn scripted_or_random(
    scene: &Resolved,
    name: &str,
    seed: Option<u64>,
    quick: bool,
) -> Result<NamedPoses, Failure> {
    let mut taken = if seed.is_none() { scripted(scene, name)? } else { Vec::new() };
    if taken.is_empty() {
        return drawn(scene, name, seed.unwrap_or(SEED), quick);
    }
    if quick {
        keep_hardest(&mut taken, extent(&green::prepare(scene, name)?.mesh));
    }
    let which = if quick { ", of which the hardest is kept, and some others" } else { "" };
    Ok((taken, format!("{SCRIPT_POSES} moments of the scene's script, those at rest left out{which}")))
}

/// The poses that are not among those taken where time is short: more moments of the script, or other random poses.
pub fn further(scene: &Resolved, name: &str) -> Result<Vec<(String, ControlPoses)>, Failure> {
    let mut all = scripted(scene, name)?;
    let known = match all.is_empty() {
        true => {
            all = drawn(scene, name, SEED, false)?.0;
            drawn(scene, name, SEED, true)?.0
        }
        false => {
            let mut known = all.clone();
            keep_hardest(&mut known, extent(&green::prepare(scene, name)?.mesh));
            known
        }
    };
    all.retain(|(_, pose)| known.iter().all(|(_, other)| other != pose));
    Ok(all)
}

/// Part of a body's radius by which a script moves it before a moment counts: a hand that takes an element turns it by rounding, and
/// the relative error of that is noise.
const STIRRED: f64 = 1e-4;

/// Moments of the scene's script but for those at rest; none without a script.
fn scripted(scene: &Resolved, name: &str) -> Result<Vec<(String, ControlPoses)>, Failure> {
    let mut taken: Vec<(String, ControlPoses)> = Vec::new();
    let Some(script) = open::script(scene, None)? else { return Ok(taken) };
    let file = green::opened(&prepare::precompute(scene, true)?)?;
    let world = World::new(scene, &scene.models(), &file, open::stage(scene, None)?)?;
    let duration_s = script.duration_s;
    let mut session = Session::new(world, Some(script));
    let mut playback = Playback::new(&session, SCRIPT_POSES)?;
    for frame in 0..SCRIPT_POSES {
        playback.step_to(&mut session, frame)?;
        let Some(body) = session.world.bodies.iter().find(|body| body.deformer.body == name) else {
            continue;
        };
        let poses = body.deformer.poses.clone();
        let is_rest = poses.iter().all(|pose| pose.is_rest_within(STIRRED, body.assets.ball.1));
        if !is_rest && taken.iter().all(|(_, other)| *other != poses) {
            let time_s = duration_s * frame as f64 / (SCRIPT_POSES - 1) as f64;
            taken.push((format!("{time_s:.2} s"), poses));
        }
    }
    Ok(taken)
}

/// Random poses.
fn drawn(scene: &Resolved, name: &str, seed: u64, quick: bool) -> Result<NamedPoses, Failure> {
    let mut plain = Scene::clone(scene);
    (plain.body[name].element, plain.body[name].solver) = (&TET4, Solver::default());
    let prepared = green::prepare(&plain, name)?;
    let origins: Vec<_> = prepared.controls.iter().map(|control| control.origin).collect();
    let degrees: &[f64] = if quick { &QUICK_ANGLES } else { &ANGLES };
    let angles: Vec<f64> = degrees.iter().map(|angle| angle.to_radians()).collect();
    let source = format!(
        "random, seed {seed}: all control elements but the first turn about axes of their own, carried along as by a rod \
         of constant curvature and twist, and move across by up to {:.0} % of the body's size",
        100.0 * PLAY
    );
    Ok((random(&origins, &angles, PLAY * extent(&prepared.mesh), seed), source))
}

fn extent(mesh: &TetMesh) -> f64 {
    let (low, high) = bounding_box(&mesh.nodes);
    (high - low).amax()
}

/// Keeps, of the poses of a body of this extent, m, the hardest one and others that lie evenly between it and the easiest, in their
/// order.
fn keep_hardest(poses: &mut Vec<(String, ControlPoses)>, extent: f64) {
    let order = hardest_first(poses, extent);
    if order.len() <= QUICK_SCRIPT_POSES {
        return;
    }
    let kept: Vec<usize> =
        (0..QUICK_SCRIPT_POSES).map(|k| order[k * order.len() / QUICK_SCRIPT_POSES]).collect();
    let mut place = 0..;
    poses.retain(|_| place.next().is_some_and(|i: usize| kept.contains(&i)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::ControlPose;
    use nalgebra::{Rotation3, Vector3};

    /// A script that goes there and back: --quick took four moments by the clock, and the farthest was between two of them.
    #[test]
    fn the_hardest_moment_is_kept() {
        let turned = |degrees: f64| {
            let matrix = *Rotation3::from_axis_angle(&Vector3::x_axis(), degrees.to_radians()).matrix();
            (format!("{degrees}°"), vec![ControlPose::REST, ControlPose { matrix, ..ControlPose::REST }])
        };
        let mut poses: Vec<_> =
            [5.0, 10.0, 20.0, 50.0, 90.0, 70.0, 40.0, 30.0, 1.0].map(turned).into_iter().collect();
        keep_hardest(&mut poses, 1.0);
        let names: Vec<&str> = poses.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["10°", "50°", "90°", "30°"]);
    }
}
