//! The overlay in a picture: where a frame's time goes, how fresh the trackers are, what bends how far, what is wrong.
//!
//! In: a world and the steps of its last frames, as plain [`Readings`] and [`History`]. Out: two columns of small
//! aligned letters at the left and right edge and a strip at the bottom ([`Panel`]); the middle stays free.

mod panel;
mod rows;

pub use panel::Panel;

use super::world::flow::StylusFields;
use super::world::{Mood, PlacedBody, World};
use crate::deform::{ControlPose, Wrench, find_model, local_turn};
use crate::effect::haptics::{Clockwork, Felt};
use crate::track::Signal;
use crate::track::rig::TrackerReport;
use std::collections::VecDeque;
use std::f64::consts::PI;

/// Steps of a frame in their order, as the overlay names them.
pub const STEPS: [&str; 8] =
    ["track", "interact", "deform", "normals", "upload", "encode", "acquire", "present"];
/// Triangles of a body whose turns are looked at.
const PIECES: usize = 256;
/// Which of [`STEPS`] waits for the images of the frame after.
pub const ACQUIRE: usize = 6;
/// Frames that are kept.
const FRAMES: usize = 120;

/// The last frames, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Newest last.
    pub frames: VecDeque<FrameTimes>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// As [`STEPS`], s.
    pub steps: [f64; 8],
    /// From this frame to the next, what no step tells included, s.
    pub whole_s: f64,
}

impl History {
    pub fn push(&mut self, times: FrameTimes) {
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back(times);
    }

    fn mean(&self, of: impl Fn(&FrameTimes) -> f64) -> f64 {
        // A sum of nothing is -0.
        self.frames.iter().map(of).fold(0.0, std::ops::Add::add) / self.frames.len().max(1) as f64
    }

    fn worst_s(&self) -> f64 {
        self.frames.iter().map(|frame| frame.whole_s).fold(0.0, f64::max)
    }
}

/// What the overlay says beside times.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Readings {
    pub stage: String,
    pub device: String,
    /// Where bodies are deformed.
    pub deformation: String,
    /// Who moves head and styli where no tracker does.
    pub source: String,
    pub sensors: Vec<SensorReading>,
    /// Where the stage has force devices and a body is felt.
    pub felt: Vec<HapticReading>,
    /// How held elements move.
    pub mode: String,
    pub hands: Vec<HandReading>,
    /// How much can be undone, and how much done again.
    pub undo: [usize; 2],
    pub bodies: Vec<BodyReading>,
    /// When, in seconds since the start, and what; newest last.
    pub warnings: Vec<(f64, String)>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct SensorReading {
    pub name: String,
    pub rate_hz: f64,
    pub age_s: f64,
    pub signal: Signal,
}

/// A force device and its loop.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticReading {
    pub name: String,
    pub felt: Felt,
    pub clockwork: Clockwork,
    pub max_force_n: f64,
    /// Its stylus holds something that is felt.
    pub holds: bool,
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
    /// As its limits have it, rad.
    pub turn: f64,
    pub limits: TurnLimits,
    /// Strain energy, J, where the handle stiffness is there.
    pub energy: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ControlReading {
    pub name: String,
    pub pose: ControlPose,
    pub held: bool,
    pub wrench: Option<Wrench>,
}

/// Up to which turn a model is good, and up to which it is fair, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnLimits {
    pub good: f64,
    pub fair: f64,
    /// For this very body, by the plan of its accuracy, between two control elements ([`crate::deform::Deformer::largest_turn`]). Else
    /// of any piece of the surface ([`local_turn`]), by the table of [`TurnLimits::of_model`].
    pub is_measured: bool,
}

impl TurnLimits {
    /// Angles at which bent bodies were measured to be off by about 0.2 % and 2 % of their length, RMS, as the model's
    /// entry has them; 0 of an unknown model.
    pub fn of_model(model: &str) -> Self {
        let [good, fair] = find_model(model).map_or([0.0; 2], |entry| entry.turn_limits_deg);
        Self { good: f64::to_radians(good), fair: f64::to_radians(fair), is_measured: false }
    }

    /// The turn of a body, and its limits. Where control elements are more than half a turn apart, which no piece of the
    /// surface tells, it is theirs.
    fn of_body(body: &PlacedBody) -> (f64, Self) {
        let apart = body.deformer.largest_turn();
        match body.range {
            Some(range) => (apart, Self { good: range, fair: range, is_measured: true }),
            None if apart > PI => (apart, Self::of_model(&body.model)),
            None => (local_turn(&body.deformer, PIECES), Self::of_model(&body.model)),
        }
    }
}

impl SensorReading {
    /// The sensors that the stage names.
    pub fn of(reports: &[TrackerReport]) -> Vec<Self> {
        let sensors = reports.iter().flat_map(|report| &report.sensors);
        let named = sensors.filter_map(|sensor| {
            let name = sensor.name.clone()?;
            Some(Self { name, rate_hz: sensor.rate_hz, age_s: sensor.age_s, signal: sensor.signal })
        });
        named.collect()
    }
}

impl Readings {
    /// All that a world tells; device and trackers are for others to add.
    pub fn of(world: &World) -> Self {
        let bodies = world.bodies.iter().map(body_reading).collect();
        Self {
            stage: world.stage.name.clone(),
            mode: world.mode().name(),
            hands: hands(world),
            undo: world.undo_depth(),
            bodies,
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

fn body_reading(body: &PlacedBody) -> BodyReading {
    let deformer = &body.deformer;
    // A file may hold S for its model alone; force is shown where the scene asks for it.
    let felt = body.force_scale.is_some();
    let (wrenches, energy) = match deformer.wrenches().filter(|_| felt) {
        Some((wrenches, energy)) => (wrenches.into_iter().map(Some).collect(), Some(energy)),
        None => (vec![None; deformer.controls.len()], None),
    };
    let controls = deformer.controls.iter().zip(&deformer.poses).zip(&body.controls).zip(wrenches);
    let (turn, limits) = TurnLimits::of_body(body);
    BodyReading {
        name: deformer.body.clone(),
        model: body.model.clone(),
        effects: body.effects.clone(),
        controls: controls
            .map(|(((rest, pose), placed), wrench)| ControlReading {
                name: rest.name.clone(),
                pose: *pose,
                held: placed.mood == Mood::Held,
                wrench,
            })
            .collect(),
        turn,
        limits,
        energy,
    }
}

#[cfg(test)]
mod tests;
