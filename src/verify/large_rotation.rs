//! Forces and shapes of every model of the .green file at large rotations, against static equilibrium.
//!
//! In: a hollow tube, a slender beam and a thin plate, held at both ends and moved from 1° to 180°. Out: [`HeldPose`]s with the wrench of the
//! equilibrium on the same mesh under the law that a model stands for, and for each model how far its wrench, energy and shape are from it,
//! and the time of a frame. A model is judged as a session uses it: from a .green file, in single precision.

use crate::base::failure::Failure;
use crate::base::progress::Silent;
use crate::deform::{Deviation, GOOD, ModelEntry, Motion, Moved, Trial, Truth, in_session, trials};
use crate::fem::{LAWS, STVK};
use crate::green;
use crate::measure::online;
use crate::scene::{Grab, Scene};
use serde::Serialize;
use std::path::Path;

/// A body with at least two control elements, one of which is moved against the others.
#[derive(Clone)]
pub struct TriedBody {
    /// Name in the tables.
    pub title: String,
    pub scene: Scene,
    pub body: String,
    pub motions: &'static [Motion],
}

/// The bodies of the manual's tables: title, generator, and the groups at both ends.
const BODIES: [(&str, &str, [&str; 2]); 3] = [
    (
        "tube",
        "tube = { inner_radius = 0.07, outer_radius = 0.1, length = 1.0, radial = 2, around = 20, along = 40, control_length = 0.1 }",
        ["left", "right"],
    ),
    ("beam", "block = { size = [0.1, 0.1, 1.0], cells = [3, 3, 30] }", ["zmin", "zmax"]),
    // It is bent out of its plane.
    ("plate", "block = { size = [0.03, 0.4, 1.0], cells = [2, 8, 20] }", ["zmin", "zmax"]),
];

/// One pose of one body.
#[derive(Clone, Debug, Serialize)]
pub struct HeldPose {
    pub body: String,
    pub pose: String,
    /// Force and torque of the moved element in equilibrium, N and N·m about its place, and the strain energy, J.
    pub force_n: f64,
    pub torque_nm: f64,
    pub energy_j: f64,
    pub models: Vec<ModelAtPose>,
}

/// The result of a model for a pose.
#[derive(Clone, Debug, Serialize)]
pub struct ModelAtPose {
    pub model: &'static str,
    #[serde(flatten)]
    pub deviation: Deviation,
    /// Deviation from another stable equilibrium, where the model is within [`GOOD`] of that one alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beside: Option<Deviation>,
    /// Median time from poses to the deformed surface with its forces, s.
    pub frame_s: f64,
}

/// Motions of the right end against the left one.
const MOTIONS: [Motion; 16] = [
    Motion::Bend(1.0),
    Motion::Bend(10.0),
    Motion::Bend(30.0),
    Motion::Bend(60.0),
    Motion::Bend(90.0),
    Motion::Bend(180.0),
    Motion::Twist(10.0),
    Motion::Twist(30.0),
    Motion::Twist(60.0),
    Motion::Twist(90.0),
    Motion::Twist(180.0),
    Motion::Shift([0.0, 0.05]),
    Motion::Shift([0.0, 0.1]),
    Motion::Shift([0.05, 0.0]),
    Motion::Shift([0.1, 0.0]),
    Motion::Mixed(35.0, 0.12),
];

/// Motions of bodies of other scenes.
const OTHER_MOTIONS: [Motion; 14] = [
    Motion::Bend(1.0),
    Motion::Bend(30.0),
    Motion::Bend(60.0),
    Motion::Bend(90.0),
    Motion::Turn([0, 0, 1], 30.0),
    Motion::Turn([0, 0, 1], 60.0),
    Motion::Turn([0, 0, 1], 90.0),
    Motion::Twist(1.0),
    Motion::Twist(30.0),
    Motion::Twist(60.0),
    Motion::Twist(90.0),
    Motion::Turn([1, 1, 1], 60.0),
    Motion::Shift([0.1, 0.0]),
    Motion::Shift([-0.05, 0.0]),
];

/// The bodies of the manual's tables.
pub fn own_bodies() -> Result<Vec<TriedBody>, Failure> {
    let scene = |&(title, generate, [left, right]): &(&str, &str, [&str; 2])| {
        let text = format!(
            "[body.b]\ngenerate = {{ {generate} }}\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\n\
             control.left = {{ nodes = {{ group = \"{left}\" }}, grab = \"fixed\" }}\n\
             control.right = {{ nodes = {{ group = \"{right}\" }}, grab = \"dragger\" }}\n"
        );
        let scene = Scene::parse(&text, Path::new("large-rotation.toml")).map_err(Failure::request)?;
        Ok(TriedBody { title: title.to_owned(), scene, body: "b".to_owned(), motions: &MOTIONS })
    };
    BODIES.iter().map(scene).collect()
}

/// The bodies of a scene.
pub fn bodies_of(scene: &Scene) -> Vec<TriedBody> {
    let named = |name: &String| TriedBody {
        title: name.clone(),
        scene: scene.clone(),
        body: name.clone(),
        motions: &OTHER_MOTIONS,
    };
    scene.body.keys().map(named).collect()
}

/// All poses of all bodies for all models that have forces, body by body and law by law; `told` is called with the reason why one is
/// left out.
pub fn run(bodies: &[TriedBody], told: &mut dyn FnMut(String)) -> Result<Vec<HeldPose>, Failure> {
    let mut rows = Vec::new();
    let models: Vec<_> = online().filter(|model| model.energy.is_some()).collect();
    for body in bodies {
        for law in LAWS {
            let like: Vec<_> =
                models.iter().copied().filter(|model| model.large_strain_law().name == law.name).collect();
            if let Some(first) = like.first() {
                let title = if law.name == STVK.name {
                    body.title.clone()
                } else {
                    format!("{}, {}", body.title, law.title)
                };
                let mut scene = body.scene.clone();
                scene.body[&body.body].model = first.name.to_owned();
                rows.extend(rows_of(&TriedBody { title, scene, ..body.clone() }, &like, told)?);
            }
        }
    }
    Ok(rows)
}

/// The poses of a body for models of the law of its own model.
fn rows_of(
    tried: &TriedBody,
    models: &[&'static ModelEntry],
    told: &mut dyn FnMut(String),
) -> Result<Vec<HeldPose>, Failure> {
    let TriedBody { title, scene, body, motions } = tried;
    let mut statics = Truth::SameMesh.statics(scene, body, &Silent).map_err(Failure::work)?;
    let origins: Vec<_> = statics.controls.iter().map(|control| control.origin).collect();
    let is_free = |e: &usize| {
        let control = scene.body[body].control.get(&statics.controls[*e].name);
        control.is_some_and(|control| control.grab == Grab::Dragger)
    };
    let Some(moved) = (0..origins.len()).filter(is_free).find_map(|e| Moved::new(&origins, e)) else {
        told(format!("{title}: no control element can be moved against others"));
        return Ok(Vec::new());
    };
    let mut left_out = |motion: Motion, why: String| told(format!("{title} {}: {why}", motion.name()));
    let held = trials(&mut statics, &moved, motions, &Silent, &mut left_out).map_err(Failure::work)?;
    for trial in &held {
        let passed = trial.settled.stability.passed.iter();
        passed.for_each(|critical| {
            told(format!("{title} {}: on the way there {critical}", trial.motion.name()))
        });
    }
    let mut rows: Vec<HeldPose> = held.iter().map(|trial| row(title, trial)).collect();
    for model in models {
        let mut scene = scene.clone();
        scene.body[body].model = model.name.to_owned();
        let made = green::precompute(&scene, body, &model.with_energy(), &Silent);
        let deformer = made.and_then(|made| in_session(&made, model));
        let mut deformer = match deformer.map_err(|error| error.to_string()).and_then(|made| made) {
            Ok(deformer) => deformer,
            Err(why) => {
                told(format!("{title} {}: {why}", model.name));
                continue;
            }
        };
        let nodes = Trial::surface_nodes(&statics, &deformer);
        for (row, trial) in rows.iter_mut().zip(&held) {
            let deviation = trial.deviation(&mut deformer, &nodes);
            let beside = match deviation.worst() > GOOD {
                true => trial.beside(&mut statics, &deformer, &nodes).map_err(Failure::work)?,
                false => None,
            };
            if beside.is_some() {
                let energy = deviation.energy.unwrap_or(f64::NAN);
                let (pose, model) = (trial.motion.name(), model.name);
                told(format!(
                    "{title} {pose}, {model}: in another stable equilibrium than the one from rest, with {energy:.3} of its energy"
                ));
            }
            let frame_s = trial.frame_time(&mut deformer);
            row.models.push(ModelAtPose { model: model.name, deviation, beside, frame_s });
        }
    }
    Ok(rows)
}

fn row(title: &str, trial: &Trial) -> HeldPose {
    let e = trial.moved.element;
    let right = trial.settled.wrenches[e].about_the_place(&trial.poses[e]);
    HeldPose {
        body: title.to_owned(),
        pose: trial.motion.name(),
        force_n: right.force.norm(),
        torque_nm: right.moment.norm(),
        energy_j: trial.settled.energy,
        models: Vec::new(),
    }
}
