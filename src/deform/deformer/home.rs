//! The way home of a body whose [`BodyPath`] was lost, a part of it a frame, and the second way that tells whether there are others.

use super::Deformer;
use crate::deform::model::{BodyState, StateAge};
use crate::deform::path::{BodyPath, Doubt, PARTS};
use crate::deform::pose::follow::FollowedTurn;
use crate::deform::pose::frame::{ControlPose, PoseSlope, same_side};
use crate::deform::pose::screw::{each_from_rest, from_rest};
use crate::fem::nearest_turn;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

impl Deformer {
    /// Counts a frame; true where [`Deformer::take`] has to be called though no pose changed, to bring the body home.
    pub fn pass_frame(&mut self) -> bool {
        if !self.has_path || !self.path.is_open() {
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
            let is_lost = self.path.is_lost && self.path.frames > 0;
            let lost = is_lost.then_some(Doubt::PathLost);
            lost.or(self.path.has_others.then_some(Doubt::Several)).filter(|_| self.has_path)
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
        let age = self.model.age();
        let is_found = match age {
            None if self.path.is_home => return self.go_beside(&turns),
            None => self.go_in_parts(&turns),
            Some(age) => self.follow_behind(age, &turns),
        };
        match is_found {
            None => {}
            Some(false) => self.path.is_vain = true,
            Some(true) => {
                self.turns = turns.into_iter().map(FollowedTurn::new).collect();
                // The way from rest leads to a state inside out: no other is looked for.
                let is_inverted = self.model.is_inverted();
                self.path = BodyPath {
                    still: std::mem::take(&mut self.path.still),
                    frames: self.path.frames,
                    is_lost: is_inverted,
                    is_vain: is_inverted,
                    is_home: !is_inverted && age.is_none(),
                    ..BodyPath::default()
                };
                self.homecomings += 1;
            }
        }
    }

    /// Goes a part of the way home; whether there is an equilibrium at its end, once it is reached. The model is then in it, and otherwise as
    /// it was.
    fn go_in_parts(&mut self, turns: &[UnitQuaternion<f64>]) -> Option<bool> {
        let kept = self.model.memory();
        let end = self.go_a_part(turns);
        match end {
            Some(state) if !state.rotation_undefined => {
                self.state = state;
                Some(true)
            }
            _ => {
                // A model takes back its own memory.
                self.model.set_memory(&kept).ok()?;
                end.map(|_| false)
            }
        }
    }

    /// Goes a part of the second way; at its end the forces there tell whether it is another equilibrium. The model is as it was.
    fn go_beside(&mut self, turns: &[UnitQuaternion<f64>]) {
        let kept = self.model.memory();
        let end = self.go_a_part(turns);
        let there = end.as_ref().and_then(|_| self.forces_of_model());
        // A model takes back its own memory.
        let is_back = self.model.set_memory(&kept).is_ok();
        if end.is_some() || !is_back {
            let here = self.forces_of_model();
            let size = self.size();
            (self.path.is_home, self.path.parts) = (false, 0);
            self.path.has_others = here.zip(there).is_some_and(|(here, there)| differ(&here, &there, size));
        }
    }

    /// Goes a part of a way from rest; the state at its end, once it is reached. The model stays there.
    fn go_a_part(&mut self, turns: &[UnitQuaternion<f64>]) -> Option<BodyState> {
        let is_second = self.path.is_home;
        match (self.path.there.take(), turns.first()) {
            (Some(there), _) => self.model.set_memory(&there).ok()?,
            (None, Some(first)) if !is_second => self.leave_for_rest(&vec![*first; turns.len()]),
            _ => self.leave_for_rest(&[]),
        }
        self.path.parts += 1;
        let share = f64::from(self.path.parts) / f64::from(PARTS);
        let poses = if self.path.parts >= PARTS {
            self.poses.clone()
        } else if is_second {
            each_from_rest(&self.poses, turns, share)
        } else {
            let origins: Vec<Vector3<f64>> = self.controls.iter().map(|control| control.origin).collect();
            from_rest(&origins, &self.poses, turns, share)
        };
        let state = self.model.state(&poses);
        if self.path.parts >= PARTS {
            return Some(state);
        }
        self.path.there = Some(Box::new(self.model.memory()));
        None
    }

    /// V and ∂V/∂P of the model's own, where it has an equilibrium in the poses of now.
    fn forces_of_model(&mut self) -> Option<(f64, Vec<PoseSlope>)> {
        let mut slopes = self.slopes.clone();
        let response = self.model.respond(&self.poses, &mut slopes)?;
        response.is_defined.then_some((response.energy, slopes))
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

/// Least difference of the forces of two equilibria, in parts of the largest; and least motion against rest, by V over force and size, of a
/// body that has several: below it forces are rounding errors.
const OTHER: f64 = 0.01;
const MOVED: f64 = 1e-5;

/// Whether V and ∂V/∂P are not those of one equilibrium of a body of this size, m.
fn differ(here: &(f64, Vec<PoseSlope>), there: &(f64, Vec<PoseSlope>), size: f64) -> bool {
    let norm = |slope: &PoseSlope| slope.translation.norm().max(slope.matrix.norm() / size);
    let largest = here.1.iter().chain(&there.1).map(norm).fold(0.0, f64::max);
    let differences = here.1.iter().zip(&there.1).map(|(a, b)| {
        norm(&PoseSlope { translation: a.translation - b.translation, matrix: a.matrix - b.matrix })
    });
    let energy = here.0.abs().max(there.0.abs());
    differences.fold(0.0, f64::max) > OTHER * largest && energy > MOVED * largest * size
}

/// The turns of the poses, the first one the shorter of both, the others by less than half a turn against it.
fn shortest(poses: &[ControlPose]) -> Vec<UnitQuaternion<f64>> {
    let turn = |pose: &ControlPose| nearest_turn(&pose.matrix);
    let first = poses.first().map_or_else(UnitQuaternion::identity, turn);
    let first = same_side(&UnitQuaternion::identity(), first);
    poses.iter().map(|pose| same_side(&first, turn(pose))).collect()
}
