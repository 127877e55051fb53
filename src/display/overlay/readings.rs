//! The readings of the overlay, plain values that are taken from a world, and the times that the steps of the last frames
//! took.

use crate::base::plates::Words;
use crate::deform::{ControlPose, Doubt, ErrorsAt, StateAge, Wrench};
use crate::track::Signal;
use crate::track::tracker_set::TrackerReport;
use crate::world::flow::StylusFields;
use crate::world::{
    BodyFrame, Highlight, PlacedBody, TurnLimits, World, WrenchError, why_unknown, wrench_error,
};
use egui::Color32;
use std::collections::VecDeque;

/// The readings that the overlay shows beside times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Readings {
    pub stage: String,
    pub device: String,
    /// Words about where bodies are deformed.
    pub deformation: String,
    /// The input that moves head and styli where no tracker does.
    pub source: String,
    pub sensors: Vec<SensorReading>,
    /// The rows of each device of an effect.
    pub devices: Vec<Vec<Words>>,
    /// The mode of the hands: how held elements move.
    pub mode: String,
    pub hands: Vec<HandReading>,
    /// Numbers of changes that can be undone, and redone.
    pub undo: [usize; 2],
    pub bodies: Vec<BodyReading>,
    /// Warnings with the time since the start, s; newest last.
    pub warnings: Vec<(f64, String)>,
    /// Time of the trackers, s.
    pub time_s: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SensorReading {
    pub name: String,
    pub rate_hz: f64,
    pub age_s: f64,
    pub signal: Signal,
    /// Whether it ever reported.
    pub heard: bool,
}

/// A stylus, as the stage names it.
#[derive(Clone, Debug, PartialEq)]
pub struct HandReading {
    pub name: String,
    pub does: HandDoes,
}

/// Body and control element as `tube.right`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum HandDoes {
    Holds(String),
    PointsAt(String),
    Nothing,
    Lost,
}

#[derive(Clone, Debug, PartialEq)]
pub struct BodyReading {
    pub name: String,
    pub model: String,
    pub effects: Vec<String>,
    pub controls: Vec<ControlReading>,
    /// The turn that its limits refer to, rad.
    pub turn: f64,
    pub limits: TurnLimits,
    /// The reason not to trust its state, whatever its turn.
    pub doubt: Option<Doubt>,
    /// The age of its state, if its model computes in the background.
    pub age: Option<StateAge>,
    /// Strain energy, J, where the scene asks for forces.
    pub energy: Option<f64>,
    /// Errors to expect here, of a body that shows forces or was measured.
    pub errors: Option<ErrorReading>,
}

/// Errors to expect of a body in its pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorReading {
    /// Errors of the model in the body's pose; `None` if the model is static equilibrium itself.
    pub model: Option<ErrorsAt>,
    /// The part of forces that the mesh adds.
    pub mesh: Option<f64>,
    /// The reason why the error of the forces, or of the model, is unknown in this pose.
    pub unknown: Option<&'static str>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ControlReading {
    pub name: String,
    pub pose: ControlPose,
    pub held: bool,
    /// Present if the scene asks for forces.
    pub force: Option<ForceReading>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceReading {
    pub wrench: Wrench,
    /// The possible error, if it is known.
    pub error: Option<WrenchError>,
}

impl SensorReading {
    /// The sensors that the stage names.
    pub fn list(reports: &[TrackerReport]) -> Vec<Self> {
        let sensors = reports.iter().flat_map(|report| &report.sensors);
        let named = sensors.filter_map(|sensor| {
            let name = sensor.name.clone()?;
            let (rate_hz, age_s, signal) = (sensor.rate_hz, sensor.age_s, sensor.signal);
            Some(Self { name, rate_hz, age_s, signal, heard: sensor.count > 0 })
        });
        named.collect()
    }
}

impl Readings {
    /// The readings that a world gives; the caller adds those of device and trackers.
    pub fn take(world: &World) -> Self {
        let bodies = world
            .bodies
            .iter()
            .zip(&world.frame.bodies)
            .map(|(body, shown)| body_reading(body, shown))
            .collect();
        Self {
            stage: world.assets.stage.name.clone(),
            mode: world.mode().name() + world.taking_words(),
            hands: hands(world),
            undo: world.undo_depth(),
            bodies,
            time_s: *world.graph.get(world.fields.time),
            ..Self::default()
        }
    }
}

fn hands(world: &World) -> Vec<HandReading> {
    let hands = &world.graph.get(world.fields.hands).hands;
    let name = |target: usize| {
        let (b, c) = *world.fields.targets.get(target)?;
        let deformer = &world.bodies[b].deformer;
        Some(format!("{}.{}", deformer.body, deformer.controls[c].name))
    };
    let of = |(i, fields): (usize, &StylusFields)| {
        let stylus = world.graph.get(fields.stylus).as_ref()?;
        let hit = world.graph.get(fields.hit).as_ref();
        let held = hands.grip(i).and_then(|grip| name(grip.target));
        let does = match (held, hit.and_then(|hit| name(hit.target))) {
            _ if matches!(stylus.signal, Signal::Lost { .. }) => HandDoes::Lost,
            (Some(held), _) => HandDoes::Holds(held),
            (None, Some(hit)) => HandDoes::PointsAt(hit),
            (None, None) => HandDoes::Nothing,
        };
        Some(HandReading { name: world.fields.stylus_name(i), does })
    };
    world.fields.styli.iter().enumerate().filter_map(of).collect()
}

/// `None` for a body that shows no forces and was not measured.
fn error_reading(
    (body, shown): (&PlacedBody, &BodyFrame),
    forces: Option<(&[Wrench], Option<WrenchError>)>,
) -> Option<ErrorReading> {
    let expected = shown.expected.as_ref().filter(|expected| !expected.moved.is_empty());
    let of_model = expected.filter(|expected| expected.model.law().is_none());
    let model = of_model.and_then(|expected| expected.in_pose(&body.deformer));
    let mesh = expected.and_then(|expected| match forces {
        Some((wrenches, _)) => expected.mesh_at(&body.deformer, wrenches),
        None => Some(expected.mesh()?.wrench),
    });
    let is_unknown = match forces {
        Some((_, error)) => error.is_none(),
        None => of_model.is_some() && model.is_none(),
    };
    let unknown = is_unknown.then(|| why_unknown(body, shown));
    (model.is_some() || mesh.is_some() || is_unknown).then_some(ErrorReading { model, mesh, unknown })
}

pub(super) fn body_reading(body: &PlacedBody, shown: &BodyFrame) -> BodyReading {
    let deformer = &body.deformer;
    // A file may hold S for its model alone; force is shown where the scene asks for it.
    let felt = shown.force_scale.is_some();
    let (wrenches, energy) = deformer.wrenches().filter(|_| felt).unzip();
    let error = wrenches.as_ref().and_then(|wrenches| wrench_error(body, shown, wrenches));
    let force = |c: usize, pose: &ControlPose| {
        // A hand feels the torque about where the element is.
        Some(ForceReading { wrench: wrenches.as_ref()?.get(c)?.about_the_place(pose), error })
    };
    let controls = deformer.controls.iter().zip(&deformer.poses).zip(&shown.highlights).enumerate();
    let (turn, limits) = TurnLimits::of_body(body);
    BodyReading {
        name: deformer.body.clone(),
        model: body.assets.model.name.to_owned(),
        effects: body.assets.effects.clone(),
        controls: controls
            .map(|(c, ((rest, pose), highlight))| ControlReading {
                name: rest.name.clone(),
                pose: *pose,
                held: *highlight == Highlight::Held,
                force: force(c, pose),
            })
            .collect(),
        turn,
        limits,
        doubt: deformer.doubt(),
        age: deformer.age(),
        energy,
        errors: error_reading((body, shown), wrenches.as_deref().map(|wrenches| (wrenches, error))),
    }
}

/// Steps of a frame in their order, as the overlay names them.
pub const STEPS: [&str; 8] =
    ["track", "interact", "deform", "normals", "upload", "encode", "acquire", "present"];
/// Index in [`STEPS`] of the step that waits for the images of the next frame.
pub const ACQUIRE: usize = 6;
/// Colours of [`STEPS`], and of the time that no step accounts for.
pub(super) const COLOURS: [Color32; 9] = [
    Color32::from_rgb(198, 120, 221),
    Color32::from_rgb(97, 175, 239),
    Color32::from_rgb(86, 182, 130),
    Color32::from_rgb(152, 195, 121),
    Color32::from_rgb(229, 192, 123),
    Color32::from_rgb(224, 142, 84),
    Color32::from_rgb(132, 146, 166),
    Color32::from_rgb(92, 106, 128),
    Color32::from_rgb(60, 68, 82),
];
/// Frames that are kept.
pub(super) const FRAMES: usize = 120;

/// The last frames, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Newest last.
    pub frames: VecDeque<FrameSteps>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameSteps {
    /// Times of the [`STEPS`], s.
    pub steps: [f64; 8],
    /// Time from this frame to the next, with the part that no step accounts for, s.
    pub whole_s: f64,
}

impl History {
    pub fn push(&mut self, times: FrameSteps) {
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back(times);
    }

    pub(super) fn mean(&self, of: impl Fn(&FrameSteps) -> f64) -> f64 {
        // A sum of nothing is -0.
        self.frames.iter().map(of).fold(0.0, std::ops::Add::add) / self.frames.len().max(1) as f64
    }

    pub(super) fn worst_s(&self) -> f64 {
        self.frames.iter().map(|frame| frame.whole_s).fold(0.0, f64::max)
    }
}
