//! The frames of the interfaces in equilibrium: Newton's method on the energy of all parts.
//!
//! In: parts, the control elements' frames and stretches, frames to start from. Out: the frames at which V is stationary,
//! V, and the forces on the control elements. Unknowns are twists of the interfaces' frames; the Hessian is exact, made
//! positive definite by a multiple of its diagonal where it is not, and factorised within its envelope (George and Liu,
//! Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 4).

use super::link::Twist;
use super::linked_part::{LinkedPart, PartEnd, Places};
use crate::deform::loads::Borne;

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
    hessian: Vec<f64>,
    factor: Vec<f64>,
    /// The first column of each row that is not zero.
    start: Vec<usize>,
    step: Vec<f64>,
    before: Places,
}

const MOST_ITERATIONS: usize = 40;
/// A step by less, in rad and parts of the size, is the last one: what is left is of the order of its square.
const LAST_STEP: f64 = 1e-6;
/// No step turns or shifts a frame by more.
const LONGEST_STEP: f64 = 0.5;
/// Part of the predicted decrease that must be met (Armijo), and of the energy that is its rounding.
const ARMIJO: f64 = 1e-4;
const ROUNDING: f64 = 1e-12;
const MOST_HALVINGS: usize = 12;

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
        Assembly {
            parts,
            loads: Vec::new(),
            size,
            gradient: vec![0.0; n],
            hessian: vec![0.0; n * n],
            factor: vec![0.0; n * n],
            start,
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
        let mut search = Search { energy: self.value(places), ..Search::default() };
        let n = self.gradient.len();
        while n > 0 && search.energy.is_finite() && search.iterations < MOST_ITERATIONS {
            self.assemble();
            self.add_loads(places);
            search.iterations += 1;
            let (Some(slope), largest) = (self.find_step(), self.shorten()) else { break };
            match self.advance(places, search.energy, slope) {
                Some(energy) => search.energy = energy,
                None => break,
            }
            if largest < LAST_STEP {
                search.is_settled = true;
                break;
            }
        }
        search.is_settled |= n == 0 && search.energy.is_finite();
        self.parts.iter_mut().for_each(|part| part.differentiate(false));
        search
    }

    /// Gradient and Hessian where the parts were last evaluated.
    fn assemble(&mut self) {
        let n = self.gradient.len();
        self.gradient.fill(0.0);
        self.hessian.fill(0.0);
        for part in &mut self.parts {
            part.differentiate(true);
            let q = part.gradient.len();
            for (a, i) in interfaces(part) {
                for row in 0..6 {
                    self.gradient[6 * i + row] += part.gradient[6 * a + row];
                }
                for (b, j) in interfaces(part).filter(|(_, j)| *j <= i) {
                    for row in 0..6 {
                        let from = &part.hessian[(6 * a + row) * q + 6 * b..][..6];
                        let to = &mut self.hessian[(6 * i + row) * n + 6 * j..][..6];
                        to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
                    }
                }
            }
        }
    }

    /// Adds the loads' part of gradient and Hessian, of a motion exp (ω, v) in the frame's axes.
    fn add_loads(&mut self, places: &Places) {
        let n = self.gradient.len();
        for (i, (frame, load)) in places.interfaces.iter().zip(&self.loads).enumerate() {
            let load = load.along(&frame.turn);
            let (torque, [mixed, turning]) = (load.torque(), load.curvatures());
            for row in 0..3 {
                self.gradient[6 * i + row] -= torque[row];
                self.gradient[6 * i + 3 + row] -= load.force[row];
                for column in 0..3 {
                    let at = |a: usize, b: usize| (6 * i + a + row) * n + 6 * i + b + column;
                    self.hessian[at(0, 0)] -= turning[(row, column)];
                    self.hessian[at(3, 0)] -= mixed[(row, column)];
                    self.hessian[at(0, 3)] -= mixed[(column, row)];
                }
            }
        }
    }

    /// Solves for the step; returns the slope of V along it, negative. `None` where no multiple of the diagonal helps.
    fn find_step(&mut self) -> Option<f64> {
        let n = self.gradient.len();
        let mut added = 0.0;
        while !self.factorise(added) {
            added = if added == 0.0 { 1e-4 } else { added * 8.0 };
            if added > 1e6 {
                return None;
            }
        }
        for i in 0..n {
            let from = self.start[i];
            let row = &self.factor[i * n..][..n];
            let sum: f64 = row[from..i].iter().zip(&self.step[from..i]).map(|(l, x)| l * x).sum();
            self.step[i] = (-self.gradient[i] - sum) / row[i];
        }
        for i in (0..n).rev() {
            let row = &self.factor[i * n..][..n];
            let value = self.step[i] / row[i];
            self.step[i] = value;
            let from = self.start[i];
            self.step[from..i].iter_mut().zip(&row[from..i]).for_each(|(x, l)| *x -= l * value);
        }
        Some(self.step.iter().zip(&self.gradient).map(|(step, g)| step * g).sum())
    }

    /// L of H + added · |diag H| = L Lᵀ within the envelope; false where a pivot is not positive.
    fn factorise(&mut self, added: f64) -> bool {
        let n = self.gradient.len();
        for i in 0..n {
            let from = self.start[i];
            for j in from..=i {
                let both = from.max(self.start[j]);
                let (above, below) = self.factor.split_at_mut(i * n);
                let own = &mut below[..n];
                let known = if j < i { &above[j * n..][..n] } else { &*own };
                let sum: f64 = own[both..j].iter().zip(&known[both..j]).map(|(a, b)| a * b).sum();
                let h = self.hessian[i * n + j];
                if j < i {
                    own[j] = (h - sum) / known[j];
                } else {
                    let (pivot, least) = (h + added * h.abs() - sum, 1e-12 * h.abs());
                    if pivot.is_nan() || pivot <= least {
                        return false;
                    }
                    own[i] = pivot.sqrt();
                }
            }
        }
        true
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

    /// Goes the step, or a half, a quarter … of it, until V falls; `None`, and back where it was, where it does not.
    fn advance(&mut self, places: &mut Places, energy: f64, slope: f64) -> Option<f64> {
        self.before.interfaces.copy_from_slice(&places.interfaces);
        let mut share = 1.0;
        for _ in 0..MOST_HALVINGS {
            let steps = self.step.chunks_exact(6);
            for ((frame, before), step) in
                places.interfaces.iter_mut().zip(&self.before.interfaces).zip(steps)
            {
                *frame = before.moved(&(Twist::from_column_slice(step) * share));
            }
            let value = self.value(places);
            if value <= energy + ARMIJO * share * slope.min(0.0) + ROUNDING * energy.abs() {
                return Some(value);
            }
            share *= 0.5;
        }
        places.interfaces.copy_from_slice(&self.before.interfaces);
        self.value(places);
        None
    }
}

/// The ends of a part that are interfaces: their places among the ends, and their numbers.
fn interfaces(part: &LinkedPart) -> impl Iterator<Item = (usize, usize)> + '_ {
    part.ends.iter().enumerate().filter_map(|(at, end)| match end {
        PartEnd::Interface(i) => Some((at, *i)),
        PartEnd::Control(_) => None,
    })
}
