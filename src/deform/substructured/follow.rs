//! Interfaces on the way from one set of poses to the next.
//!
//! In: the last settled places and the control elements' new frames. Out: settled places there. The way is divided into
//! steps; in each, control elements move by a part of the screw motion to their new frames, interfaces by the mean of these
//! motions, which is exact where all are alike, and are then settled.

use super::equilibrium::{Assembly, Search};
use super::link::EndFrame;
use super::linked_part::{ControlState, Places};
use crate::deform::se3::{exp, log};
use nalgebra::{Isometry3, Translation3, Vector3, Vector6};

/// A step turns two control elements against each other by no more, rad, …
const TURN: f64 = 0.35;
/// … shifts them by no more of the body's size, stretches one by no more.
const SHIFT: f64 = 0.15;
const STRETCH: f64 = 0.2;
const MOST_STEPS: f64 = 64.0;

/// Motion of interfaces with control elements, and memory for it.
pub struct Follower {
    /// Share of each control element in the motion of each interface.
    shares: Vec<Vec<f64>>,
    size: f64,
    motions: Vec<Vector6<f64>>,
    from: Vec<ControlState>,
}

impl Follower {
    pub fn new(rest: &Places, size: f64) -> Follower {
        let share = |at: &EndFrame| {
            let weight = |control: &ControlState| {
                1.0 / ((control.frame.place - at.place).norm_squared() + 1e-12 * size * size)
            };
            let weights: Vec<f64> = rest.controls.iter().map(weight).collect();
            let total: f64 = weights.iter().sum();
            weights.into_iter().map(|weight| weight / total).collect()
        };
        Follower {
            shares: rest.interfaces.iter().map(share).collect(),
            size,
            motions: vec![Vector6::zeros(); rest.controls.len()],
            from: rest.controls.clone(),
        }
    }

    /// Moves `places` to where the control elements are at `to`; the search of the last step, with the Hessians of all.
    pub fn follow(
        &mut self,
        assembly: &mut Assembly,
        places: &mut Places,
        to: &[ControlState],
        finer: f64,
    ) -> Search {
        self.from.copy_from_slice(&places.controls);
        for ((motion, from), to) in self.motions.iter_mut().zip(&self.from).zip(to) {
            let turn = to.frame.turn * from.frame.turn.inverse();
            *motion = log(&turn, &(to.frame.place - turn * from.frame.place));
        }
        let steps = (self.steps(to) * finer).clamp(1.0, MOST_STEPS * finer).ceil();
        let mut iterations = 0;
        let mut search = Search::default();
        for step in 1..=steps as usize {
            let share = step as f64 / steps;
            for (i, place) in places.interfaces.iter_mut().enumerate() {
                let of = |(motion, share): (&Vector6<f64>, &f64)| motion * *share;
                let mean: Vector6<f64> = self.motions.iter().zip(&self.shares[i]).map(of).sum();
                *place = moved(place, &(mean / steps));
            }
            for (e, (place, to)) in places.controls.iter_mut().zip(to).enumerate() {
                let from = &self.from[e];
                *place = if step as f64 == steps {
                    *to
                } else {
                    let stretch = |k: usize| from.stretch[k] + share * (to.stretch[k] - from.stretch[k]);
                    let frame = moved(&from.frame, &(self.motions[e] * share));
                    ControlState { frame, stretch: std::array::from_fn(stretch) }
                };
            }
            search = assembly.settle(places);
            iterations += search.iterations;
            if !search.is_settled {
                break;
            }
        }
        Search { iterations, ..search }
    }

    /// Steps that the way wants, not rounded.
    fn steps(&self, to: &[ControlState]) -> f64 {
        let first = self.motions.first().copied().unwrap_or_else(Vector6::zeros);
        let against = |(e, motion): (usize, &Vector6<f64>)| {
            // How the first element's motion and its own part its place.
            let place = &self.from[e].frame;
            let apart = (moved(place, &first).place - moved(place, motion).place).norm();
            let turn = (motion - first).fixed_rows::<3>(3).norm() / TURN;
            let stretch = |k: usize| (to[e].stretch[k] - self.from[e].stretch[k]).abs();
            let stretch = (0..6).map(stretch).fold(0.0, f64::max) / STRETCH;
            turn.max(apart / (SHIFT * self.size)).max(stretch)
        };
        self.motions.iter().enumerate().map(against).fold(0.0, f64::max)
    }
}

/// exp ξ g, ξ about the origin of the body's frame.
fn moved(frame: &EndFrame, motion: &Vector6<f64>) -> EndFrame {
    let isometry = Isometry3::from_parts(Translation3::from(frame.place), frame.turn);
    let moved = exp(motion) * isometry;
    let mut turn = moved.rotation;
    turn.renormalize_fast();
    EndFrame { place: Vector3::from(moved.translation.vector), turn }
}
