//! The way of all control elements from one set of frames to another.
//!
//! In: frames before and after, whose quaternions distinguish turns up to 360° apart. Out: steps between them, each along a
//! screw.

use super::super::frames::ControlFrame;
use super::super::se3::{exp, log, long_turn};
use super::point::Hold;
use super::sheet::{Sheet, Standing};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use std::f64::consts::PI;

/// No step turns a control element by more, rad, moves it by more than this part of the body's size, or stretches it by more.
const TURN: f64 = PI / 8.0;
const MOVE: f64 = 0.2;
const STRETCH: f64 = 0.1;
const MOST_STEPS: f64 = 64.0;

/// The hold of a control element on the shell.
pub fn held(frame: &ControlFrame) -> Hold {
    Hold { place: frame.place, matrix: frame.turn.to_rotation_matrix() * frame.stretch }
}

/// A control element's frame as a motion.
pub fn placed(frame: &ControlFrame) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(frame.place), frame.turn)
}

/// Leads the sheet to these frames.
pub fn follow(
    from: &[ControlFrame],
    to: &[ControlFrame],
    holds: &mut [Hold],
    sheet: &mut Sheet,
) -> Option<Standing> {
    let steps = distance(from, to, sheet.size).max(1.0).ceil().min(MOST_STEPS);
    let (mut iterations, mut buckled) = (0, false);
    for step in 1.. {
        let share = step as f64 / steps;
        for ((hold, from), to) in holds.iter_mut().zip(from).zip(to) {
            *hold = if share >= 1.0 { held(to) } else { at(from, to, share) };
        }
        let found = sheet.settle(holds)?;
        iterations += found.iterations;
        buckled |= found.buckled;
        if share >= 1.0 {
            return Some(Standing { iterations, buckled, ..found });
        }
    }
    None
}

/// Distance that the farthest control element goes, in largest steps.
pub fn distance(from: &[ControlFrame], to: &[ControlFrame], size: f64) -> f64 {
    let of = |(from, to): (&ControlFrame, &ControlFrame)| {
        let turn = long_turn(&(to.turn * from.turn.inverse())).norm() / TURN;
        let moved = (to.place - from.place).norm() / (MOVE * size);
        turn.max(moved).max((to.stretch - from.stretch).norm() / STRETCH)
    };
    from.iter().zip(to).map(of).fold(0.0, f64::max)
}

/// The hold at `share` of the way from one frame to another.
fn at(from: &ControlFrame, to: &ControlFrame, share: f64) -> Hold {
    let start = placed(from);
    let motion = placed(to) * start.inverse();
    let turn = long_turn(&motion.rotation);
    let place = if turn.norm() <= PI {
        exp(&(log(&motion.rotation, &motion.translation.vector) * share)) * start
    } else {
        let turned = UnitQuaternion::from_scaled_axis(turn * share) * start.rotation;
        Isometry3::from_parts(from.place.lerp(&to.place, share).into(), turned)
    };
    let stretch = from.stretch * (1.0 - share) + to.stretch * share;
    held(&ControlFrame { place: place.translation.vector, turn: place.rotation, stretch })
}
