//! The frames of the interfaces in equilibrium: Newton's method on the energy of all parts.
//!
//! In: parts, the control elements' frames and stretches, frames to start from. Out: the frames at which V is stationary,
//! V, and the forces on the control elements. Unknowns are twists of the interfaces' frames; the Hessian is exact, and shifted by a
//! multiple of its diagonal where it is not positive definite.

use super::link::Twist;
use super::linked_part::{LinkedPart, PartEnd, Places};
use crate::deform::loads::Borne;
use crate::solve::envelope::Envelope;
use crate::solve::minimise::{Energy, Step, minimise};

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
        strained + loaded.map(|(frame, load)| load.potential(&frame.place, &frame.turn)).sum::<f64>()
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

    /// Adds the loads' part of gradient and Hessian, of a motion exp (ω, v) in the frame's axes.
    fn add_loads(&mut self, places: &Places) {
        for (i, (frame, load)) in places.interfaces.iter().zip(&self.loads).enumerate() {
            let load = load.along(&frame.turn);
            let (torque, [mixed, turning]) = (load.torque(), load.curvatures());
            for row in 0..3 {
                self.gradient[6 * i + row] -= torque[row];
                self.gradient[6 * i + 3 + row] -= load.force[row];
                for column in 0..3 {
                    if column <= row {
                        self.hessian.add(6 * i + row, 6 * i + column, -turning[(row, column)]);
                    }
                    self.hessian.add(6 * i + 3 + row, 6 * i + column, -mixed[(row, column)]);
                }
            }
        }
    }

    /// Scales the step so that no frame moves too far; returns how far the farthest goes.
    fn shorten(&mut self) -> f64 {
        let of = |step: &[f64]| {
            let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
            norm(&step[..3]).max(norm(&step[3..]) / self.size)
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
            *frame = before.moved(&(Twist::from_column_slice(step) * share));
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
