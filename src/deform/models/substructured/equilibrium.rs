//! The frames of the interfaces in equilibrium: Newton's method on the energy of all parts.
//!
//! In: parts, the control elements' frames and stretches, frames to start from. Out: the frames at which V is stationary,
//! V, and the forces on the control elements. Unknowns are twists of the interfaces' frames; the Hessian is exact, and shifted by a
//! multiple of its diagonal where it is not positive definite.
//!
//! The way from the last settled places to the control elements' new frames is divided into
//! steps; in each, control elements move by a part of the screw motion to their new frames, interfaces by the mean of these
//! motions, which is exact where all are alike, and are then settled.

use super::link::{ControlState, LinkedPart, PartEnd, Places};
use crate::deform::loads::Borne;
use crate::deform::pose::se3::{exp, log_of};
use crate::solve::envelope::Envelope;
use crate::solve::minimise::{Energy, Step, minimise};
use nalgebra::{Isometry3, Vector6};

/// Result of a search.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Search {
    pub is_settled: bool,
    /// Hessians that were factorised.
    pub iterations: usize,
    /// J.
    pub energy: f64,
}

/// The parts, and memory for the search.
pub struct Assembly {
    pub parts: Vec<LinkedPart>,
    /// Load on each interface; empty where nothing acts.
    loads: Vec<Borne>,
    /// A length against which shifts are measured, m.
    size: f64,
    gradient: Vec<f64>,
    hessian: Envelope,
    factor: Envelope,
    step: Vec<f64>,
    before: Places,
}

const MOST_ITERATIONS: usize = 40;
/// A step by less, in rad and parts of the size, is the last one: what is left is of the order of its square.
const LAST_STEP: f64 = 1e-6;
/// No step turns or shifts a frame by more.
const LONGEST_STEP: f64 = 0.5;
/// Part of the energy that is its rounding.
const ROUNDING: f64 = 1e-12;
/// Least shift of a Hessian that is not positive definite, in parts of its diagonal.
const SHIFT: f64 = 1e-4;

impl Assembly {
    pub fn new(parts: Vec<LinkedPart>, rest: &Places, size: f64) -> Assembly {
        let n = 6 * rest.interfaces.len();
        let mut start: Vec<usize> = (0..n).map(|row| row / 6 * 6).collect();
        for part in &parts {
            let first = interfaces(part).map(|(_, i)| 6 * i).min().unwrap_or(0);
            for (_, i) in interfaces(part) {
                start[6 * i..6 * i + 6].iter_mut().for_each(|start| *start = first.min(*start));
            }
        }
        let hessian = Envelope::new(start);
        Assembly {
            parts,
            loads: Vec::new(),
            size,
            gradient: vec![0.0; n],
            factor: hessian.clone(),
            hessian,
            step: vec![0.0; n],
            before: rest.clone(),
        }
    }

    /// Sets the loads on the interfaces.
    pub fn bear(&mut self, loads: impl Iterator<Item = Borne>) {
        self.loads.clear();
        self.loads.extend(loads);
    }

    /// V.
    pub fn value(&mut self, places: &Places) -> f64 {
        let strained: f64 = self.parts.iter_mut().map(|part| part.value(places)).sum();
        let loaded = places.interfaces.iter().zip(&self.loads);
        strained
            + loaded
                .map(|(frame, load)| load.potential(&frame.translation.vector, &frame.rotation))
                .sum::<f64>()
    }

    /// Moves the interfaces to equilibrium, or leaves them where the search ended. Afterwards all parts have the gradient
    /// there.
    pub fn settle(&mut self, places: &mut Places) -> Search {
        let energy = self.value(places);
        let mut search = Search { energy, is_settled: energy.is_finite(), iterations: 0 };
        if search.is_settled && !self.step.is_empty() {
            self.before.interfaces.copy_from_slice(&places.interfaces);
            let mut at = PlacedAssembly { assembly: self, places, energy, tried: energy };
            let found = minimise(&mut at, MOST_ITERATIONS, &mut search.iterations);
            search.energy = at.energy;
            search.is_settled = found.is_ok();
            if !search.is_settled {
                places.interfaces.copy_from_slice(&self.before.interfaces);
                self.value(places);
            }
        }
        self.parts.iter_mut().for_each(|part| part.differentiate(false));
        search
    }

    /// Gradient and Hessian where the parts were last evaluated.
    fn assemble(&mut self) {
        self.gradient.fill(0.0);
        self.hessian.clear();
        for part in &mut self.parts {
            part.differentiate(true);
            let q = part.gradient.len();
            for (a, i) in interfaces(part) {
                for row in 0..6 {
                    self.gradient[6 * i + row] += part.gradient[6 * a + row];
                }
                for (b, j) in interfaces(part).filter(|(_, j)| *j <= i) {
                    for row in 0..6 {
                        let columns = if i == j { row + 1 } else { 6 };
                        let from = &part.hessian[(6 * a + row) * q + 6 * b..][..columns];
                        for (column, value) in from.iter().enumerate() {
                            self.hessian.add(6 * i + row, 6 * j + column, *value);
                        }
                    }
                }
            }
        }
    }

    /// Adds the loads' part of gradient and Hessian, of a motion exp (v, ω) in the frame's axes.
    fn add_loads(&mut self, places: &Places) {
        for (i, (frame, load)) in places.interfaces.iter().zip(&self.loads).enumerate() {
            let load = load.along(&frame.rotation);
            let (wrench, curvature) = (load.wrench(), load.curvature());
            for row in 0..6 {
                self.gradient[6 * i + row] -= wrench[row];
                for column in 0..=row {
                    self.hessian.add(6 * i + row, 6 * i + column, -curvature[(row, column)]);
                }
            }
        }
    }

    /// Scales the step so that no frame moves too far; returns how far the farthest goes.
    fn shorten(&mut self) -> f64 {
        let of = |step: &[f64]| {
            let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
            norm(&step[3..]).max(norm(&step[..3]) / self.size)
        };
        let largest = self.step.chunks_exact(6).map(of).fold(0.0, f64::max);
        if largest > LONGEST_STEP {
            self.step.iter_mut().for_each(|x| *x *= LONGEST_STEP / largest);
        }
        largest
    }
}

/// The assembly with its interfaces at their places.
struct PlacedAssembly<'a> {
    assembly: &'a mut Assembly,
    places: &'a mut Places,
    /// V where the interfaces were before the step, and where it is tried.
    energy: f64,
    tried: f64,
}

impl Energy for PlacedAssembly<'_> {
    const TRIALS: usize = 12;

    fn evaluate(&mut self) -> Option<f64> {
        self.assembly.assemble();
        self.assembly.add_loads(self.places);
        Some(self.energy)
    }

    fn rounding(&self) -> f64 {
        ROUNDING * self.energy.abs()
    }

    fn factorise(&mut self, shift: f64) -> bool {
        let Assembly { factor, hessian, .. } = &mut *self.assembly;
        factor.copy_from(hessian);
        factor.change_diagonal(|entry| entry + SHIFT * shift * entry.abs());
        factor.factor()
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        let Assembly { factor, gradient, step, .. } = &mut *self.assembly;
        step.iter_mut().zip(&*gradient).for_each(|(step, slope)| *step = -slope);
        factor.solve(step);
        let gain = -step.iter().zip(gradient).map(|(step, slope)| step * *slope).sum::<f64>();
        Step { gain, is_last: self.assembly.shorten() < LAST_STEP }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let Assembly { before, step, .. } = &*self.assembly;
        let moved = self.places.interfaces.iter_mut().zip(&before.interfaces).zip(step.chunks_exact(6));
        for ((frame, before), step) in moved {
            *frame = before * exp(&(Vector6::from_column_slice(step) * share));
            frame.rotation.renormalize_fast();
        }
        self.tried = self.assembly.value(self.places);
        Some(self.tried)
    }

    fn accept(&mut self) {
        self.assembly.before.interfaces.copy_from_slice(&self.places.interfaces);
        self.energy = self.tried;
    }
}

/// The ends of a part that are interfaces: their places among the ends, and their numbers.
fn interfaces(part: &LinkedPart) -> impl Iterator<Item = (usize, usize)> + '_ {
    part.ends.iter().enumerate().filter_map(|(at, end)| match end {
        PartEnd::Interface(i) => Some((at, *i)),
        PartEnd::Control(_) => None,
    })
}

/// Largest turn of two control elements against each other in one step, rad.
const TURN: f64 = 0.35;
/// Largest shift against each other in parts of the body's size, and largest stretch of one, in one step.
const APART: f64 = 0.15;
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
        let share = |at: &Isometry3<f64>| {
            let weight = |control: &ControlState| {
                1.0 / ((control.frame.translation.vector - at.translation.vector).norm_squared()
                    + 1e-12 * size * size)
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
            *motion = log_of(&(to.frame * from.frame.inverse()));
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
            let [one, other] = [&first, motion].map(|motion| moved(place, motion).translation.vector);
            let apart = (one - other).norm();
            let turn = (motion - first).fixed_rows::<3>(3).norm() / TURN;
            let stretch = |k: usize| (to[e].stretch[k] - self.from[e].stretch[k]).abs();
            let stretch = (0..6).map(stretch).fold(0.0, f64::max) / STRETCH;
            turn.max(apart / (APART * self.size)).max(stretch)
        };
        self.motions.iter().enumerate().map(against).fold(0.0, f64::max)
    }
}

/// exp ξ g, ξ about the origin of the body's frame.
fn moved(frame: &Isometry3<f64>, motion: &Vector6<f64>) -> Isometry3<f64> {
    let mut moved = exp(motion) * frame;
    moved.rotation.renormalize_fast();
    moved
}
