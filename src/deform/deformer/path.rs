//! The path of a body: whether its state follows from its poses and the way of the hands, and its return to the equilibrium from rest
//! where it does not.
//!
//! In: the poses of every frame, and whether the model had an equilibrium there. A path is lost where the model had none, where
//! control elements were turned by more than half a turn against each other, for which no model is made, and where one jumped from
//! one frame to the next. Out: once the hands hold still, the equilibrium that the model finds on a way from rest, one part of it a
//! frame, so that no frame takes longer than those of a moving hand.
//!
//! Turns that the hands have made stay: a body that they wound is not unwound. A jump by more than [`KNOWN`] may have gone either way
//! round; so many turns as there were jumps are taken for none.

use super::Deformer;
use crate::deform::memory::ModelMemory;
use crate::deform::model::StateAge;
use crate::deform::pose::follow::{FollowedTurn, KNOWN};
use crate::deform::pose::frame::{ControlPose, ControlPoses, same_side};
use crate::deform::pose::screw::from_rest;
use crate::fem::nearest_turn;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, SQRT_2, TAU};

/// Frames in which hands hold still before a lost path is looked for, and parts of the way from rest, one a frame: at 60 frames a
/// second half a second in all.
const CALM: u32 = 15;
const PARTS: u32 = 12;
/// Largest motion of a control element, in rad and in parts of the body's size, of a hand that holds still.
const STILL: f64 = 0.01;
/// Longest shift in a frame that is no jump, in parts of the body's size.
const SHIFT: f64 = 0.25;

/// The path of one body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Path {
    pub(super) is_lost: bool,
    /// Jumps by turns of an unknown direction since the path was lost.
    jumps: u32,
    /// Where the hands hold still, and the frames since they do.
    still: ControlPoses,
    frames: u32,
    /// Parts of the way from rest that were gone, and the model's memory there.
    parts: u32,
    there: Option<Box<ModelMemory>>,
    /// Whether that way led to no equilibrium: it is not gone again to these poses.
    is_vain: bool,
}

/// A reason not to trust the state of a body, whatever its model's accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Doubt {
    /// The poses have no equilibrium, or no frame: an earlier state is shown.
    NoEquilibrium,
    /// Parts of the body are turned inside out.
    Inverted,
    /// The state may be another one than hands reach from rest.
    PathLost,
}

impl Doubt {
    pub fn name(self) -> &'static str {
        match self {
            Doubt::NoEquilibrium => "no equilibrium",
            Doubt::Inverted => "inside out",
            Doubt::PathLost => "path lost",
        }
    }

    pub fn explain(self) -> &'static str {
        match self {
            Doubt::NoEquilibrium => "these poses have no equilibrium; an earlier one is shown",
            Doubt::Inverted => "parts of it are turned inside out",
            Doubt::PathLost => "it may be in another state than from rest; hold still, and it goes back",
        }
    }
}

impl Path {
    /// Takes the step of a frame from the poses `last` to those of now.
    fn follow(&mut self, last: &[ControlPose], now: &[ControlPose], size: f64) {
        for (last, now) in last.iter().zip(now) {
            let turn = chord(last, now);
            let is_turned = turn > 2.0 * (0.5 * KNOWN).sin();
            self.jumps += u32::from(is_turned);
            self.is_lost |= is_turned || (now.translation - last.translation).norm() > SHIFT * size;
        }
        let moves = |(still, now): (&ControlPose, &ControlPose)| {
            chord(still, now).max((now.translation - still.translation).norm() / size) > STILL
        };
        if self.still.len() != now.len() || self.still.iter().zip(now).any(moves) {
            self.still.clear();
            self.still.extend_from_slice(now);
            (self.frames, self.parts, self.there, self.is_vain) = (0, 0, None, false);
        }
    }

    fn is_due(&self) -> bool {
        self.is_lost && !self.is_vain && self.frames > CALM
    }
}

/// Twice the sine of half the turn between two poses, and what stretches add to it.
fn chord(one: &ControlPose, other: &ControlPose) -> f64 {
    (other.matrix - one.matrix).norm() / SQRT_2
}

impl Deformer {
    /// Counts a frame; true where [`Deformer::take`] has to be called though no pose changed, to bring the body home.
    pub fn pass_frame(&mut self) -> bool {
        if !self.has_path || !self.path.is_lost {
            return false;
        }
        self.path.frames = self.path.frames.saturating_add(1);
        self.path_is_due()
    }

    /// A reason not to trust the state that is shown.
    pub fn doubt(&self) -> Option<Doubt> {
        let has_none = self.state.rotation_undefined || self.model.age() == Some(StateAge::Lost);
        if has_none {
            Some(Doubt::NoEquilibrium)
        } else if self.model.is_inverted() {
            Some(Doubt::Inverted)
        } else {
            (self.has_path && self.path.is_lost && self.path.frames > 0).then_some(Doubt::PathLost)
        }
    }

    /// Whether the control elements are wound against each other by no more than half a turn, as far as that is known.
    fn is_unwound(&self) -> bool {
        let turn = self.largest_turn();
        turn <= PI || (turn / TAU).round() <= f64::from(self.path.jumps)
    }

    /// Largest distance of two control elements at rest, m.
    fn size(&self) -> f64 {
        let first = self.controls.first().map_or_else(Vector3::zeros, |control| control.origin);
        let size = self.controls.iter().map(|control| (control.origin - first).norm()).fold(0.0, f64::max);
        if size > 0.0 { size } else { f64::INFINITY }
    }

    /// Whether the next part of the way home is to be gone in this frame.
    pub(super) fn path_is_due(&self) -> bool {
        self.has_path && self.path.is_due() && self.is_unwound()
    }

    /// Follows the path on to the poses of now from the last ones, from which they differ.
    pub(super) fn follow_path(&mut self) {
        if self.has_path {
            let size = self.size();
            self.path.follow(&self.last, &self.poses, size);
            self.path.is_lost |= self.largest_turn() > PI;
        }
    }

    /// Goes a part of the way home where the state that was just made has a lost path.
    pub(super) fn go_home(&mut self) {
        let has_none = self.state.rotation_undefined || self.model.age() == Some(StateAge::Lost);
        self.path.is_lost |= self.has_path && (has_none || self.model.is_inverted());
        if !self.path_is_due() {
            return;
        }
        let turns = shortest(&self.poses);
        let is_found = match self.model.age() {
            None => self.go_a_part(&turns),
            Some(age) => self.follow_behind(age, &turns),
        };
        match is_found {
            None => {}
            Some(false) => self.path.is_vain = true,
            Some(true) => {
                self.turns = turns.into_iter().map(FollowedTurn::new).collect();
                self.path = Path { still: std::mem::take(&mut self.path.still), ..Path::default() };
                self.homecomings += 1;
            }
        }
    }

    /// Goes a part of the way from rest, beside the state that is shown; whether there is an equilibrium at its end, once it is
    /// reached. The model is then in it, and otherwise as it was.
    fn go_a_part(&mut self, turns: &[UnitQuaternion<f64>]) -> Option<bool> {
        let kept = self.model.memory();
        match self.path.there.take() {
            Some(there) => self.model.set_memory(&there).ok()?,
            None => self.leave_for_rest(&vec![turns[0]; turns.len()]),
        }
        self.path.parts += 1;
        let is_end = self.path.parts >= PARTS;
        let poses = match is_end {
            true => self.poses.clone(),
            false => {
                let origins: Vec<Vector3<f64>> = self.controls.iter().map(|control| control.origin).collect();
                from_rest(&origins, &self.poses, turns, f64::from(self.path.parts) / f64::from(PARTS))
            }
        };
        let state = self.model.state(&poses);
        let is_found = is_end.then_some(!state.rotation_undefined);
        if is_found == Some(true) {
            self.state = state;
        } else {
            self.path.there = (!is_end).then(|| Box::new(self.model.memory()));
            // A model takes back its own memory.
            self.model.set_memory(&kept).ok()?;
        }
        is_found
    }

    /// Lets a model that computes in the background go from rest.
    fn follow_behind(&mut self, age: StateAge, turns: &[UnitQuaternion<f64>]) -> Option<bool> {
        let age = if self.path.parts > 0 {
            age
        } else {
            self.path.parts = 1;
            self.leave_for_rest(turns);
            self.state = self.model.state(&self.poses);
            self.model.age()?
        };
        match age {
            StateAge::Current => Some(!self.model.is_inverted()),
            StateAge::Lost => Some(false),
            StateAge::Old { .. } => None,
        }
    }

    /// The model at rest; the next poses continue these turns.
    fn leave_for_rest(&mut self, turns: &[UnitQuaternion<f64>]) {
        self.model.forget();
        turns.iter().enumerate().for_each(|(e, turn)| self.model.set_turn(e, *turn));
    }
}

/// The turns of the poses, the first one the shorter of both, the others by less than half a turn against it.
fn shortest(poses: &[ControlPose]) -> Vec<UnitQuaternion<f64>> {
    let turn = |pose: &ControlPose| nearest_turn(&pose.matrix);
    let first = poses.first().map_or_else(UnitQuaternion::identity, turn);
    let first = same_side(&UnitQuaternion::identity(), first);
    poses.iter().map(|pose| same_side(&first, turn(pose))).collect()
}
