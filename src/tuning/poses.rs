//! The poses in which a body is measured where the user names none: moments of the scene's script, or random ones.

use crate::base::failure::Failure;
use crate::deform::{ControlPose, ControlPoses};
use crate::fem::TET4;
use crate::green::{self, GreenFile};
use crate::measure::poses::random;
use crate::mesh::quality::bounding_box;
use crate::prepare::{self, Resolved};
use crate::scene::Scene;
use crate::session::{Playback, Session, open};
use crate::solve::Solver;
use crate::world::World;
use std::sync::Arc;

/// Poses with their names, and one sentence on where they come from.
pub type NamedPoses = (Vec<(String, ControlPoses)>, String);

/// Angles of the random poses, degrees.
const ANGLES: [f64; 8] = [2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0];
const QUICK_ANGLES: [f64; 3] = [10.0, 30.0, 60.0];
/// Distance by which random poses move across in addition to turning, as a part of the body's size.
const PLAY: f64 = 0.02;
/// Pictures of the script that are taken as poses.
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
    if let (None, Some(script)) = (seed, open::script(scene, None)?) {
        let count = if quick { QUICK_SCRIPT_POSES } else { SCRIPT_POSES };
        let folder = tempfile::tempdir().map_err(Failure::work)?;
        let path = folder.path().join("script.green");
        green::write(&path, &prepare::precompute(scene, true)?)?;
        let file = Arc::new(GreenFile::open(&path)?);
        let world = World::new(scene, &scene.models(), &file, open::stage(scene, None)?)?;
        let duration_s = script.duration_s;
        let mut session = Session::new(world, Some(script));
        let mut playback = Playback::new(&session, count)?;
        let mut taken: Vec<(String, ControlPoses)> = Vec::new();
        for frame in 0..count {
            playback.step_to(&mut session, frame)?;
            let of_body = session.world.bodies.iter().find(|body| body.deformer.body == name);
            let Some(poses) = of_body.map(|body| body.deformer.poses.clone()) else { continue };
            let is_rest = poses.iter().all(|pose| *pose == ControlPose::REST);
            if !is_rest && taken.iter().all(|(_, other)| *other != poses) {
                let time_s = duration_s * frame as f64 / (count - 1) as f64;
                taken.push((format!("{time_s:.2} s"), poses));
            }
        }
        if !taken.is_empty() {
            return Ok((taken, format!("{count} moments of the scene's script, those at rest left out")));
        }
    }
    let seed = seed.unwrap_or(SEED);
    let mut plain = Scene::clone(scene);
    (plain.body[name].element, plain.body[name].solver) = (&TET4, Solver::default());
    let prepared = green::prepare(&plain, name)?;
    let origins: Vec<_> = prepared.controls.iter().map(|control| control.origin).collect();
    let (low, high) = bounding_box(&prepared.mesh.nodes);
    let degrees: &[f64] = if quick { &QUICK_ANGLES } else { &ANGLES };
    let angles: Vec<f64> = degrees.iter().map(|angle| angle.to_radians()).collect();
    let source = format!(
        "random, seed {seed}: all control elements but the first turn about axes of their own, carried along as by a rod \
         of constant curvature and twist, and move across by up to {:.0} % of the body's size",
        100.0 * PLAY
    );
    Ok((random(&origins, &angles, PLAY * (high - low).amax(), seed), source))
}
