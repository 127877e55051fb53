//! The path of a body: whether its state follows from its poses and the way of the hands, and its return to the equilibrium from rest
//! where it does not.
//!
//! In: the poses of every frame, and whether the model had an equilibrium there. A path is lost where the model had none, where
//! control elements were turned by more than half a turn against each other, for which no model is made, and where one jumped from
//! one frame to the next. Out: once the hands hold still, the equilibrium that the model finds on a way from rest, one part of it a
//! frame, so that no frame takes longer than those of a moving hand. There it goes a second way from rest beside what is shown: where
//! that leads to other forces, the body has several equilibria in these poses, and is marked.
//!
//! Turns that the hands have made stay: a body that they wound is not unwound. A jump by more than [`KNOWN`] may have gone either way
//! round; so many turns as there were jumps are taken for none.

use super::memory::ModelMemory;
use super::pose::follow::KNOWN;
use super::pose::frame::{ControlPose, ControlPoses};
use serde::{Deserialize, Serialize};
use std::f64::consts::SQRT_2;

/// Frames in which hands hold still before a lost path is looked for, and parts of the way from rest, one a frame: at 60 frames a
/// second half a second in all.
const CALM: u32 = 15;
pub(super) const PARTS: u32 = 12;
/// Largest motion of a control element, in rad and in parts of the body's size, of a hand that holds still.
const STILL: f64 = 0.01;
/// Longest shift in a frame that is no jump, in parts of the body's size.
const SHIFT: f64 = 0.25;

/// The path of one body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BodyPath {
    pub(super) is_lost: bool,
    /// Jumps by turns of an unknown direction since the path was lost.
    pub(super) jumps: u32,
    /// Poses at which the hands hold still, and the frames since they do.
    pub(super) still: ControlPoses,
    pub(super) frames: u32,
    /// Parts of the way from rest that were gone, and the model's memory there.
    pub(super) parts: u32,
    pub(super) there: Option<Box<ModelMemory>>,
    /// Whether that way led to no equilibrium: it is not gone again to these poses.
    pub(super) is_vain: bool,
    /// Whether it came home, and the second way has yet to be gone.
    pub(super) is_home: bool,
    /// Whether the second way led to another equilibrium.
    pub(super) has_others: bool,
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
    /// Two ways from rest lead to two equilibria, one of which is shown.
    Several,
}

impl Doubt {
    pub fn name(self) -> &'static str {
        match self {
            Doubt::NoEquilibrium => "no equilibrium",
            Doubt::Inverted => "inside out",
            Doubt::PathLost => "path lost",
            Doubt::Several => "several equilibria",
        }
    }

    pub fn explain(self) -> &'static str {
        match self {
            Doubt::NoEquilibrium => "these poses have no equilibrium; an earlier one is shown",
            Doubt::Inverted => "parts of it are turned inside out",
            Doubt::PathLost => "it may be in another state than from rest; hold still, and it goes back",
            Doubt::Several => "these poses have several equilibria; hands that go another way reach another",
        }
    }
}

impl BodyPath {
    /// Takes the step of a frame from the poses `last` to those of now.
    pub(super) fn follow(&mut self, last: &[ControlPose], now: &[ControlPose], size: f64) {
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
            (self.frames, self.parts, self.there) = (0, 0, None);
            self.forget_others();
            (self.is_vain, self.is_home) = (false, false);
        }
    }

    /// Takes the path for lost where there were several equilibria: from one of them other poses or loads may lead to states that hands do
    /// not reach from rest.
    pub(super) fn forget_others(&mut self) {
        self.is_lost |= std::mem::take(&mut self.has_others);
    }

    /// Whether a way from rest is to be gone once the hands hold still.
    pub(super) fn is_open(&self) -> bool {
        (self.is_lost && !self.is_vain) || self.is_home
    }

    pub(super) fn is_due(&self) -> bool {
        self.is_open() && self.frames > CALM
    }
}

/// Twice the sine of half the turn between two poses, and what stretches add to it.
fn chord(one: &ControlPose, other: &ControlPose) -> f64 {
    (other.matrix - one.matrix).norm() / SQRT_2
}
