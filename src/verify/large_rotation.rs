//! Forces and shapes of every model of the .green file at large rotations, against static equilibrium.
//!
//! In: a hollow tube, a slender beam and a thin plate, held at both ends and moved from 1° to 180°. Out: [`HeldPose`]s with the wrench of the
//! St. Venant–Kirchhoff equilibrium on the same mesh, and for each model how far its wrench, energy and shape are from it,
//! and the time of a frame. A model is judged as a session uses it: from a .green file, in single precision.

use crate::base::failure::Failure;
use crate::base::progress::Silent;
use crate::deform::{Deviation, LINEAR, ModelEntry, Motion, Moved, Trial, Truth, in_session, trials};
use crate::green;
use crate::measure::online;
use crate::scene::Scene;
use serde::Serialize;
use std::path::Path;

/// A body that is held at both ends.
struct HeldBody {
    name: &'static str,
    generate: &'static str,
    ends: [&'static str; 2],
}

const BODIES: [HeldBody; 3] = [
    HeldBody {
        name: "tube",
        generate: "tube = { inner_radius = 0.07, outer_radius = 0.1, length = 1.0, radial = 2, around = 20, along = 40, control_length = 0.1 }",
        ends: ["left", "right"],
    },
    HeldBody {
        name: "beam",
        generate: "block = { size = [0.1, 0.1, 1.0], cells = [3, 3, 30] }",
        ends: ["zmin", "zmax"],
    },
    // It is bent out of its plane.
    HeldBody {
        name: "plate",
        generate: "block = { size = [0.03, 0.4, 1.0], cells = [2, 8, 20] }",
        ends: ["zmin", "zmax"],
    },
];

/// The control element that moves.
const RIGHT: usize = 1;

/// One pose of one body.
#[derive(Clone, Debug, Serialize)]
pub struct HeldPose {
    pub body: &'static str,
    pub pose: String,
    /// Force and torque of the right end in equilibrium, N and N·m about its place, and the strain energy, J.
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

/// All poses of all bodies for all models that have forces, body by body; `told` is called with the reason why one is left out.
pub fn run(told: &mut dyn FnMut(String)) -> Result<Vec<HeldPose>, Failure> {
    let mut rows = Vec::new();
    for body in &BODIES {
        let plain = scene(body, &LINEAR)?;
        let mut statics = Truth::SameMesh.statics(&plain, "b", &Silent).map_err(Failure::work)?;
        let origins = [statics.controls[0].origin, statics.controls[1].origin];
        let moved = Moved::new(&origins, RIGHT).ok_or_else(|| Failure::wrong("the ends are in one place"))?;
        let mut left_out =
            |motion: Motion, why: String| told(format!("{} {}: {why}", body.name, motion.name()));
        let held = trials(&mut statics, &moved, &MOTIONS, &Silent, &mut left_out).map_err(Failure::work)?;
        let first = rows.len();
        rows.extend(held.iter().map(|trial| row(body.name, trial)));
        for model in online().filter(|model| model.energy.is_some()) {
            let made = green::precompute(&scene(body, model)?, "b", &model.with_energy(), &Silent);
            let deformer = made.and_then(|made| in_session(&made, model));
            let mut deformer = match deformer.map_err(|error| error.to_string()).and_then(|made| made) {
                Ok(deformer) => deformer,
                Err(why) => {
                    told(format!("{} {}: {why}", body.name, model.name));
                    continue;
                }
            };
            let nodes = Trial::surface_nodes(&statics, &deformer);
            for (row, trial) in rows[first..].iter_mut().zip(&held) {
                let deviation = trial.deviation(&mut deformer, &nodes);
                let frame_s = trial.frame_time(&mut deformer);
                row.models.push(ModelAtPose { model: model.name, deviation, frame_s });
            }
        }
    }
    Ok(rows)
}

fn scene(body: &HeldBody, model: &ModelEntry) -> Result<Scene, Failure> {
    let [left, right] = body.ends;
    let text = format!(
        "[body.b]\ngenerate = {{ {} }}\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"{}\"\n\
         control.left = {{ nodes = {{ group = \"{left}\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"{right}\" }}, grab = \"dragger\" }}\n",
        body.generate, model.name
    );
    Scene::parse(&text, Path::new("large-rotation.toml")).map_err(Failure::request)
}

fn row(body: &'static str, trial: &Trial) -> HeldPose {
    let right = trial.settled.wrenches[RIGHT].about_the_place(&trial.poses[RIGHT]);
    HeldPose {
        body,
        pose: trial.motion.name(),
        force_n: right.force.norm(),
        torque_nm: right.moment.norm(),
        energy_j: trial.settled.energy,
        models: Vec::new(),
    }
}
