//! Forces and shapes of every model of the .green file at large rotations, against static equilibrium.
//!
//! In: a hollow tube and a slender beam, held at both ends and moved from 1° to 180°. Out: [`HeldPose`]s with the wrench of the
//! St. Venant–Kirchhoff equilibrium on the same mesh, and for each model how far its wrench, energy and shape are from it,
//! and the time of a frame. A model is judged as a session uses it: from a .green file, in single precision.

use crate::base::failure::Failure;
use crate::base::progress::Silent;
use crate::base::statistics::median;
use crate::deform::{
    ControlPose, ControlPoses, Deformer, EquilibriumResult, Kind, MODELS, ModelEntry, Screw, Statics,
    StaticsError, Wrench,
};
use crate::fem::STVK;
use crate::green::{self, GreenFile, Requirements};
use crate::scene::Scene;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// A body that is held at both ends.
struct HeldBody {
    name: &'static str,
    generate: &'static str,
    ends: [&'static str; 2],
}

const BODIES: [HeldBody; 2] = [
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
];

/// One pose of one body.
#[derive(Clone, Debug, Serialize)]
pub struct HeldPose {
    pub body: &'static str,
    pub pose: String,
    /// Of the right end in equilibrium, N and N·m about where it is, and the strain energy, J.
    pub force_n: f64,
    pub torque_nm: f64,
    pub energy_j: f64,
    pub models: Vec<ModelAtPose>,
}

/// What a model makes of a pose.
#[derive(Clone, Debug, Serialize)]
pub struct ModelAtPose {
    pub model: &'static str,
    /// Largest error of an end's force, and of its torque over the length between the ends, as parts of the largest force or
    /// torque over length of the equilibrium; `None` where the model says that it has none.
    pub force: Option<f64>,
    pub torque: Option<f64>,
    /// V over that of the equilibrium.
    pub energy: Option<f64>,
    /// Root mean square of the surface nodes' errors, as a part of the length.
    pub shape: f64,
    /// Median time from poses to the deformed surface with its forces, s.
    pub frame_s: f64,
}

/// How the right end moves against the left one, at rest on the axis x at the distance `length`.
#[derive(Clone, Copy)]
enum Motion {
    /// Along a circular arc that keeps its length, °.
    Bend(f64),
    /// About the axis, °.
    Twist(f64),
    /// By parts of the length, along and across.
    Shift([f64; 2]),
    /// Turned across the axis, °, and shifted across it.
    Mixed(f64, f64),
}

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

impl Motion {
    fn name(self) -> String {
        match self {
            Motion::Bend(degrees) => format!("bent by {degrees}°"),
            Motion::Twist(degrees) => format!("twisted by {degrees}°"),
            Motion::Shift([0.0, across]) => format!("across by {} %", 100.0 * across),
            Motion::Shift([along, _]) => format!("along by {} %", 100.0 * along),
            Motion::Mixed(degrees, across) => {
                format!("turned by {degrees}°, across by {} %", 100.0 * across)
            }
        }
    }

    /// For a body whose axis is `axis`, of this length between the ends.
    fn pose(self, axis: &Vector3<f64>, length: f64) -> ControlPose {
        let least = axis.iamin();
        let across = axis.cross(&Vector3::ith(least, 1.0)).normalize();
        let lateral = across.cross(axis);
        let turned = |about: Vector3<f64>, degrees: f64| {
            *Rotation3::from_scaled_axis(about * degrees.to_radians()).matrix()
        };
        let (translation, matrix) = match self {
            Motion::Bend(degrees) => {
                let angle = degrees.to_radians();
                let end = (axis * angle.sin() + lateral * (1.0 - angle.cos())) / angle;
                ((end - axis) * length, turned(across, degrees))
            }
            Motion::Twist(degrees) => (Vector3::zeros(), turned(*axis, degrees)),
            Motion::Shift([along, aside]) => ((axis * along + across * aside) * length, Matrix3::identity()),
            Motion::Mixed(degrees, aside) => (lateral * (aside * length), turned(across, degrees)),
        };
        ControlPose { translation, matrix }
    }
}

/// All poses of all bodies for all models that have forces, body by body; `told` hears why one is left out.
pub fn run(told: &mut dyn FnMut(String)) -> Result<Vec<HeldPose>, Failure> {
    let mut rows = Vec::new();
    for body in &BODIES {
        let scene = scene(body, "linear")?;
        let mut statics = Statics::new(&scene, "b", &STVK, &Silent).map_err(Failure::work)?;
        let ends = [statics.controls[0].origin, statics.controls[1].origin];
        let (axis, length) = ((ends[1] - ends[0]).normalize(), (ends[1] - ends[0]).norm());
        let poses = |motion: &Motion| vec![ControlPose::REST, motion.pose(&axis, length)];
        let mut held = Vec::new();
        for motion in &MOTIONS {
            match statics.solve(&poses(motion), &Silent) {
                Ok(settled) => held.push((motion.name(), poses(motion), settled)),
                Err(StaticsError::Stopped { share, .. }) => {
                    told(format!(
                        "{} {}: no equilibrium beyond {:.0} % of the way",
                        body.name,
                        motion.name(),
                        100.0 * share
                    ));
                }
                Err(error) => return Err(Failure::work(error)),
            }
        }
        let first = rows.len();
        rows.extend(held.iter().map(|(pose, poses, settled)| row(body.name, pose, poses, settled)));
        for model in MODELS.iter().filter(|model| model.energy.is_some()) {
            if !matches!(model.kind, Kind::Online(_)) {
                continue;
            }
            let mut deformer = match deformer(body, model) {
                Ok(deformer) => deformer,
                Err(why) => {
                    told(format!("{} {}: {why}", body.name, model.name));
                    continue;
                }
            };
            let nodes = surface_nodes(&statics, &deformer);
            for (row, (_, poses, settled)) in rows[first..].iter_mut().zip(&held) {
                row.models.push(judge(model, &mut deformer, &nodes, poses, settled, length));
            }
        }
    }
    Ok(rows)
}

fn scene(body: &HeldBody, model: &str) -> Result<Scene, Failure> {
    let [left, right] = body.ends;
    let text = format!(
        "[body.b]\ngenerate = {{ {} }}\nmaterial = {{ young = 1.0e6, poisson = 0.3 }}\nmodel = \"{model}\"\n\
         control.left = {{ nodes = {{ group = \"{left}\" }}, grab = \"fixed\" }}\n\
         control.right = {{ nodes = {{ group = \"{right}\" }}, grab = \"dragger\" }}\n",
        body.generate
    );
    Scene::parse(&text, Path::new("large-rotation.toml")).map_err(Failure::request)
}

/// The body as a session would have it, with the energy of the model.
fn deformer(body: &HeldBody, model: &ModelEntry) -> Result<Deformer, Failure> {
    let scene = scene(body, model.name)?;
    let energy = Requirements::of(model.energy.unwrap_or_default());
    let requirements = Requirements::of(model.requirements).and(energy);
    let made = green::precompute(&scene, "b", &requirements, &Silent).map_err(Failure::work)?;
    let folder = tempfile::tempdir().map_err(Failure::work)?;
    let path = folder.path().join("b.green");
    green::write(&path, &[made]).map_err(Failure::work)?;
    let file = Arc::new(GreenFile::open(&path).map_err(Failure::work)?);
    Deformer::of_model(file, "b", model).map_err(Failure::wrong)
}

/// The mesh node of each surface node.
fn surface_nodes(statics: &Statics, deformer: &Deformer) -> Vec<usize> {
    let place = |tag: &u64| statics.mesh.tags.iter().position(|own| own == tag).unwrap_or(0);
    deformer.tags().iter().map(place).collect()
}

fn row(body: &'static str, pose: &str, poses: &ControlPoses, settled: &EquilibriumResult) -> HeldPose {
    let right = settled.wrenches[1].about_the_place(&poses[1]);
    HeldPose {
        body,
        pose: pose.to_owned(),
        force_n: right.force.norm(),
        torque_nm: right.moment.norm(),
        energy_j: settled.energy,
        models: Vec::new(),
    }
}

/// Evaluations whose median is the time of a frame.
const ROUNDS: usize = 21;

fn judge(
    model: &ModelEntry,
    deformer: &mut Deformer,
    nodes: &[usize],
    poses: &ControlPoses,
    settled: &EquilibriumResult,
    length: f64,
) -> ModelAtPose {
    follow(deformer, poses);
    let held = deformer.wrenches();
    let error = |i: usize| (deformer.displacement(i) - settled.displacement[nodes[i]]).norm_squared();
    let shape = ((0..nodes.len()).map(error).sum::<f64>() / nodes.len() as f64).sqrt() / length;
    let placed = |wrenches: &[Wrench]| -> Vec<Wrench> {
        wrenches.iter().zip(poses).map(|(wrench, pose)| wrench.about_the_place(pose)).collect()
    };
    let truth = placed(&settled.wrenches);
    let size =
        truth.iter().map(|w| w.force.norm().max(w.moment.norm() / length)).fold(f64::MIN_POSITIVE, f64::max);
    let off = |of: &dyn Fn(&Wrench) -> Vector3<f64>| {
        let found = placed(&held.as_ref()?.0);
        Some(found.iter().zip(&truth).map(|(a, b)| (of(a) - of(b)).norm()).fold(0.0, f64::max) / size)
    };
    let (force, torque) = (off(&|w| w.force), off(&|w| w.moment / length));
    let energy = held.as_ref().map(|(_, energy)| energy / settled.energy);
    ModelAtPose { model: model.name, force, torque, energy, shape, frame_s: frame_time(deformer, poses) }
}

/// Comes to the poses in steps from rest, as a hand does.
fn follow(deformer: &mut Deformer, poses: &ControlPoses) {
    const STEPS: u32 = 36;
    deformer.forget();
    for step in 1..STEPS {
        let share = f64::from(step) / f64::from(STEPS);
        let on_the_way = |pose: &ControlPose| Screw::default().towards(&Screw::of(pose), share).pose();
        deformer.take(&poses.iter().map(on_the_way).collect::<Vec<_>>());
    }
    deformer.evaluate(poses);
}

/// Between two poses that are a hundredth of a degree apart.
fn frame_time(deformer: &mut Deformer, poses: &ControlPoses) -> f64 {
    let mut times = Vec::with_capacity(ROUNDS);
    for round in 0..ROUNDS {
        let mut near = poses.clone();
        let sway = Rotation3::from_axis_angle(&Vector3::y_axis(), 1e-4 * (round % 2) as f64);
        near[1].matrix = sway.matrix() * near[1].matrix;
        let started = Instant::now();
        deformer.evaluate(&near);
        times.push(started.elapsed().as_secs_f64());
    }
    median(times)
}
