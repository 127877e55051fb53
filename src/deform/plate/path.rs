//! The way of all control elements from one set of frames to another.
//!
//! In: frames before and after, whose quaternions tell turns up to 360° apart. Out: the motion of the first control element,
//! which the whole body makes and does not feel, and steps of the others seen from it, each along a screw.

use super::super::frames::ControlFrame;
use super::super::se3::{exp, log, long_turn};
use super::point::Hold;
use super::sheet::{Sheet, Standing};
use nalgebra::{Isometry3, Translation3};
use std::f64::consts::PI;

/// No step turns a control element by more, rad, moves it by more than this part of the body's size, or stretches it by more.
const TURN: f64 = PI / 8.0;
const MOVE: f64 = 0.2;
const STRETCH: f64 = 0.1;
const MOST_STEPS: f64 = 64.0;

pub struct Path {
    /// The first element's motion.
    pub carried: Isometry3<f64>,
    steps: usize,
}

/// As the shell sees a control element.
pub fn held(frame: &ControlFrame) -> Hold {
    Hold { place: frame.place, matrix: frame.turn.to_rotation_matrix() * frame.stretch }
}

fn placed(frame: &ControlFrame) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(frame.place), frame.turn)
}

impl Path {
    pub fn between(from: &[ControlFrame], to: &[ControlFrame], size: f64) -> Path {
        let carried = match (from.first(), to.first()) {
            (Some(from), Some(to)) => placed(to) * placed(from).inverse(),
            _ => Isometry3::identity(),
        };
        let steps = from.iter().zip(to).map(|(from, to)| {
            let motion = placed(to) * (carried * placed(from)).inverse();
            let moved = to.place - (carried * placed(from)).translation.vector;
            let turn = long_turn(&motion.rotation).norm() / TURN;
            turn.max(moved.norm() / (MOVE * size)).max((to.stretch - from.stretch).norm() / STRETCH)
        });
        let steps = steps.fold(1.0, f64::max).ceil();
        // Where it is not a number, one step will fail.
        Path { carried, steps: steps.min(MOST_STEPS) as usize }
    }

    /// Leads the sheet, which was carried already, to the last frames, with its holds.
    pub fn follow(
        &self,
        from: &[ControlFrame],
        to: &[ControlFrame],
        holds: &mut [Hold],
        sheet: &mut Sheet,
    ) -> Option<Standing> {
        let (mut iterations, mut buckled) = (0, false);
        let mut last = None;
        for step in 1..=self.steps {
            let share = step as f64 / self.steps as f64;
            for ((hold, from), to) in holds.iter_mut().zip(from).zip(to) {
                *hold = if step == self.steps { held(to) } else { self.at(from, to, share) };
            }
            let found = sheet.settle(holds)?;
            iterations += found.iterations;
            buckled |= found.buckled;
            last = Some(Standing { iterations, buckled, ..found });
        }
        last
    }

    fn at(&self, from: &ControlFrame, to: &ControlFrame, share: f64) -> Hold {
        let start = self.carried * placed(from);
        let motion = placed(to) * start.inverse();
        let turn = long_turn(&motion.rotation);
        let place = if turn.norm() <= PI {
            exp(&(log(&motion.rotation, &motion.translation.vector) * share)) * start
        } else {
            let turned = nalgebra::UnitQuaternion::from_scaled_axis(turn * share) * start.rotation;
            Isometry3::from_parts(start.translation.vector.lerp(&to.place, share).into(), turned)
        };
        let stretch = from.stretch * (1.0 - share) + to.stretch * share;
        held(&ControlFrame { place: place.translation.vector, turn: place.rotation, stretch })
    }
}
