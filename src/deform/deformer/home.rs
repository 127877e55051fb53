//! The way home of a body whose [`BodyPath`] was lost, a part of it a frame.

use super::Deformer;
use crate::deform::model::StateAge;
use crate::deform::path::{BodyPath, Doubt, PARTS};
use crate::deform::pose::follow::FollowedTurn;
use crate::deform::pose::frame::{ControlPose, same_side};
use crate::deform::pose::screw::from_rest;
use crate::fem::nearest_turn;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

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
                // The way from rest leads to a state inside out: no other is looked for.
                let is_inverted = self.model.is_inverted();
                let still = std::mem::take(&mut self.path.still);
                self.path =
                    BodyPath { still, is_lost: is_inverted, is_vain: is_inverted, ..BodyPath::default() };
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
            None => {
                self.leave_for_rest(&turns.first().map_or_else(Vec::new, |first| vec![*first; turns.len()]))
            }
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
