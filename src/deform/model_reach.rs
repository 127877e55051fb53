//! Reach of a model's forces on one body: the model against the equilibria that the body's file keeps with their wrenches.
//!
//! In: a [`GreenFile`] whose body has the table of equilibria of a reduced model. Out: the error of force and torque in each, and the
//! worst among those turned up to 30°, 60°, 90° and further, and among those pulled and pressed. Some of the equilibria made no field
//! of the model ([`PathKind::HeldOut`]), so that it cannot know them.

use super::deformer::Deformer;
use super::errors_at::percent;
use super::model::ModelEntry;
use super::pose::frame::{ControlPose, Wrench};
use super::pose::se3;
use super::trial::{Deviation, GOOD, PoseResult};
use crate::base::statistics::larger;
use crate::base::table::count;
use crate::green::{EQUILIBRIA, FIELDS, GreenFile, KnownEquilibrium, PathKind};
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3, Vector6};
use serde::Serialize;
use std::sync::Arc;

/// Turns of two control elements against each other up to which errors are told apart, °; a little more, for rounding.
const TURNS: [f64; 4] = [30.5, 60.5, 90.5, 360.0];
/// Largest step of a turn on the way to an equilibrium, °, and the least number of steps: at first, and once more where the error is
/// not good, as slowly as a hand goes, for where a body buckles, a long step may lead to another side.
const LONG: [f64; 2] = [10.0, 4.0];
const SHORT: [f64; 2] = [2.5, 36.0];

/// A model in the equilibria of a body.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ModelReach {
    /// States without tetrahedra inside out.
    pub states: Vec<ComparedState>,
    /// Number of the other states, which no real body has.
    pub inverted: usize,
}

/// A model in one equilibrium.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparedState {
    pub is_stretched: bool,
    /// Whether no field of the model was made of it.
    pub is_held_out: bool,
    /// Turn of the two elements against each other, °.
    pub turn: f64,
    /// Largest error of force and torque over length, as a part of the largest of the equilibrium; infinite without forces.
    pub error: f64,
    /// Energy of the model over that of the equilibrium.
    pub energy: f64,
}

impl ModelReach {
    /// Compares a body's model with its equilibria; `None` where the file has none, or no energy of which the model has forces.
    pub fn measure(
        file: &Arc<GreenFile>,
        body: &str,
        model: &'static ModelEntry,
    ) -> Result<Option<ModelReach>, String> {
        let Some(table) = file.table(body, EQUILIBRIA) else { return Ok(None) };
        let mut deformer = Deformer::new(file.clone(), body, model)?;
        if deformer.respond().is_none() {
            return Ok(None);
        }
        let known = table.column_iter().filter_map(|column| KnownEquilibrium::read(column.as_slice()));
        let (inverted, sound): (Vec<_>, Vec<_>) = known.partition(|known| known.is_inverted);
        let states: Vec<_> = sound.iter().filter_map(|known| compared(&mut deformer, known)).collect();
        Ok((!states.is_empty()).then_some(ModelReach { states, inverted: inverted.len() }))
    }

    /// The farthest turn up to 30°, 60°, 90° and 360° at which there is an equilibrium, °, each with the worst error up to there; ranges
    /// without an equilibrium are left out.
    pub fn turned(&self) -> Vec<(f64, f64)> {
        let turned = || self.states.iter().filter(|state| !state.is_stretched);
        let within = |low: f64, high: f64| turned().any(|state| state.turn > low && state.turn <= high);
        let until = |high: f64, of: fn(&ComparedState) -> f64| {
            turned().filter(|state| state.turn <= high).map(of).fold(0.0, larger)
        };
        let low = std::iter::once(0.0).chain(TURNS);
        low.zip(TURNS)
            .filter(|(low, high)| within(*low, *high))
            .map(|(_, high)| (until(high, |state| state.turn), until(high, |state| state.error)))
            .collect()
    }

    /// The worst error among those that are pulled or pressed.
    pub fn stretched(&self) -> Option<f64> {
        self.states.iter().filter(|state| state.is_stretched).map(|state| state.error).reduce(larger)
    }

    /// A line about it.
    pub fn text(&self) -> String {
        let mut parts: Vec<String> = self
            .turned()
            .iter()
            .map(|(turn, error)| format!("{} turned to {:.0}°", part_text(*error), turn.round()))
            .collect();
        parts.extend(self.stretched().map(|error| format!("{} pulled or pressed", part_text(error))));
        let (good, all) = (self.states.iter().filter(|state| state.error <= GOOD).count(), self.states.len());
        let inverted = match self.inverted {
            0 => String::new(),
            some => format!("; {} more have tetrahedra inside out", count(some, "state")),
        };
        format!(
            "forces within {}, against {all} equilibria of the same mesh: {good} are within {}, and {} of all did not serve to make \
             the model{inverted}",
            parts.join(", "),
            part_text(GOOD),
            self.states.iter().filter(|state| state.is_held_out).count()
        )
    }

    /// A line for each state, the worst first.
    pub fn details(&self) -> String {
        let mut states: Vec<&ComparedState> = self.states.iter().collect();
        states.sort_by(|a, b| b.error.total_cmp(&a.error));
        let line = |state: &&ComparedState| {
            let kind = if state.is_stretched { ", pulled or pressed" } else { "" };
            let held_out = if state.is_held_out { ", not in the model" } else { "" };
            format!(
                "  turned by {:.0}°{kind}{held_out}: {}, energy {:.3} of the equilibrium's\n",
                state.turn,
                part_text(state.error),
                state.energy
            )
        };
        states.iter().map(line).collect()
    }
}

fn part_text(part: f64) -> String {
    match part {
        part if part.is_finite() => percent(part),
        _ => "an unknown error".to_owned(),
    }
}

/// Compares the deformer with an equilibrium; `None` of other than two elements.
fn compared(deformer: &mut Deformer, known: &KnownEquilibrium) -> Option<ComparedState> {
    let state = compare(deformer, known, LONG)?;
    if state.error <= GOOD { Some(state) } else { compare(deformer, known, SHORT) }
}

/// Takes the deformer to an equilibrium from rest in such steps, and compares.
fn compare(
    deformer: &mut Deformer,
    known: &KnownEquilibrium,
    [step, least]: [f64; 2],
) -> Option<ComparedState> {
    let origins: Vec<Vector3<f64>> = deformer.controls.iter().map(|control| control.origin).collect();
    let screws: Vec<Vector6<f64>> =
        known.coefficients.chunks_exact(FIELDS).zip(&origins).map(|(c, origin)| screw(c, origin)).collect();
    let [low, high] = screws[..] else { return None };
    let turn = (high - low).fixed_rows::<3>(3).norm().to_degrees();
    let steps = (turn / step).ceil().max(least);
    let poses = |share: f64| -> Vec<ControlPose> {
        screws.iter().zip(&origins).map(|(screw, origin)| pose(&se3::exp(&(screw * share)), origin)).collect()
    };
    deformer.forget();
    (1..steps as usize).for_each(|step| {
        deformer.take(&poses(step as f64 / steps));
    });
    deformer.evaluate(&poses(1.0));
    let wrench = |[force, moment]: [Vector3<f64>; 2]| Wrench { force, moment };
    let truth = PoseResult {
        wrenches: Some(known.wrenches.map(wrench).to_vec()),
        energy: known.energy,
        surface: Vec::new(),
    };
    let found = PoseResult { surface: Vec::new(), ..PoseResult::of_model(deformer) };
    let off = Deviation::new(&found, &truth, (origins[1] - origins[0]).norm());
    Some(ComparedState {
        is_stretched: known.kind == PathKind::Stretched,
        is_held_out: known.kind == PathKind::HeldOut,
        turn,
        error: off.worst(),
        energy: off.energy.unwrap_or(f64::INFINITY),
    })
}

/// ξ of the motion with the coefficients c of an element.
fn screw(c: &[f64], origin: &Vector3<f64>) -> Vector6<f64> {
    let matrix = Matrix3::identity() + Matrix3::from_row_slice(&c[3..FIELDS]);
    let turn = UnitQuaternion::from_matrix(&matrix);
    // By less than half a turn.
    let turn = if turn.w < 0.0 { UnitQuaternion::new_unchecked(-turn.into_inner()) } else { turn };
    se3::log(&turn, &(origin + Vector3::from_column_slice(&c[..3]) - turn * origin))
}

/// The pose of an element that goes along with a rigid motion.
fn pose(motion: &Isometry3<f64>, origin: &Vector3<f64>) -> ControlPose {
    let Isometry3 { rotation, translation: Translation3 { vector } } = motion;
    ControlPose {
        translation: vector + rotation * origin - origin,
        matrix: *rotation.to_rotation_matrix().matrix(),
    }
}
