//! Secants of the last steps of a search, by which second derivatives with an old factor are mended: L-BFGS.
//!
//! In: steps s with the changes c of the slopes along them, and a direction r = B⁻¹ g by the old factor of B. Out: r with B mended so
//! that each step, the newest first, changes the slopes as it did (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithm
//! 7.4). Allocates nothing once it is made.

use crate::deform::memory::Unknowns;
use crate::solve::envelope::dot;

/// Steps that are remembered.
const PAIRS: usize = 5;
/// Least s·c, in parts of |s| |c|, of a step along which the energy counts as convex.
const CONVEX: f64 = 1e-6;

pub struct Secants {
    variables: usize,
    /// Number of pairs, and the place of the next one.
    count: usize,
    next: usize,
    steps: Vec<f64>,
    changes: Vec<f64>,
}

impl Secants {
    pub fn new(variables: usize) -> Secants {
        let numbers = vec![0.0; PAIRS * variables];
        Secants { variables, count: 0, next: 0, steps: numbers.clone(), changes: numbers }
    }

    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds the step between two states and the change of their slopes, each as of now and before.
    pub fn add(&mut self, states: [&[f64]; 2], slopes: [&[f64]; 2]) {
        let at = self.next * self.variables..(self.next + 1) * self.variables;
        let (own_step, own_change) = (&mut self.steps[at.clone()], &mut self.changes[at]);
        for (own, [now, before]) in [(&mut *own_step, states), (&mut *own_change, slopes)] {
            for (own, (now, before)) in own.iter_mut().zip(now.iter().zip(before)) {
                *own = now - before;
            }
        }
        let least = CONVEX * (dot(own_step, own_step) * dot(own_change, own_change)).sqrt();
        if dot(own_step, own_change) > least {
            self.next = (self.next + 1) % PAIRS;
            self.count = (self.count + 1).min(PAIRS);
        } else {
            // Numbers that are not finite cannot be kept.
            own_step.fill(0.0);
            own_change.fill(0.0);
            self.count = self.count.min(PAIRS - 1);
        }
    }

    /// Solves with the mended B for the slopes in `x`; `solve` does so with the old factor.
    pub fn solve(&self, x: &mut [f64], solve: impl FnOnce(&mut [f64])) {
        let mut shares = [0.0; PAIRS];
        for back in 1..=self.count {
            let (step, change) = self.pair(back);
            let share = dot(step, x) / dot(step, change);
            shares[back - 1] = share;
            x.iter_mut().zip(change).for_each(|(x, change)| *x -= share * change);
        }
        solve(x);
        for back in (1..=self.count).rev() {
            let (step, change) = self.pair(back);
            let share = shares[back - 1] - dot(change, x) / dot(step, change);
            x.iter_mut().zip(step).for_each(|(x, step)| *x += share * step);
        }
    }

    /// The newest pair for 1, that before it for 2, …
    fn pair(&self, back: usize) -> (&[f64], &[f64]) {
        let at = (self.next + PAIRS - back) % PAIRS * self.variables;
        (&self.steps[at..][..self.variables], &self.changes[at..][..self.variables])
    }

    /// Count of the numbers that [`Secants::keep`] adds.
    pub fn kept(&self) -> usize {
        2 + self.steps.len() + self.changes.len()
    }

    /// Adds all pairs.
    pub fn keep(&self, unknowns: &mut Vec<f64>) {
        unknowns.extend([self.count as f64, self.next as f64]);
        unknowns.extend(self.steps.iter().chain(&self.changes));
    }

    /// Takes back what [`Secants::keep`] added.
    pub fn take_back(&mut self, unknowns: &mut Unknowns<'_>) {
        self.count = (unknowns.take::<f64>() as usize).min(PAIRS);
        self.next = unknowns.take::<f64>() as usize % PAIRS;
        unknowns.fill(&mut self.steps);
        unknowns.fill(&mut self.changes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// Along steps that are conjugate, s_i·B s_j = 0, the mended matrix is B whatever the old factor was (Nocedal and Wright, theorem
    /// 6.4).
    #[test]
    fn conjugate_steps_tell_the_whole_matrix() {
        let b = Matrix3::new(4.0, 1.0, -0.5, 1.0, 3.0, 0.7, -0.5, 0.7, 2.0);
        let mut steps = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut secants = Secants::new(3);
        for i in 0..3 {
            for j in 0..i {
                let along = steps[j].dot(&(b * steps[i])) / steps[j].dot(&(b * steps[j]));
                steps[i] -= along * steps[j];
            }
            let (from, slope) = (Vector3::new(0.3, -2.0, 1.0), Vector3::new(1.0, 1.0, -5.0));
            let (to, there) = (from + steps[i], slope + b * steps[i]);
            secants.add([to.as_slice(), from.as_slice()], [there.as_slice(), slope.as_slice()]);
        }
        let expected = Vector3::new(0.7, -0.2, 1.9);
        let mut found = b * expected;
        secants.solve(found.as_mut_slice(), |x| x.iter_mut().for_each(|x| *x *= 0.1));
        assert!((found - expected).norm() < 1e-14, "{found}");

        let mut kept = Vec::new();
        secants.keep(&mut kept);
        assert_eq!(kept.len(), secants.kept());
        secants.clear();
        secants.take_back(&mut Unknowns(&kept));
        let mut again = b * expected;
        secants.solve(again.as_mut_slice(), |x| x.iter_mut().for_each(|x| *x *= 0.1));
        assert_eq!(found, again);
    }

    #[test]
    fn a_step_along_which_the_energy_is_not_convex_tells_nothing() {
        let mut secants = Secants::new(2);
        let add = |secants: &mut Secants, change: [f64; 2]| {
            secants.add([&[1.0, 0.0], &[0.0, 0.0]], [&change, &[0.0, 0.0]]);
        };
        let nothing = [[-1.0, 0.0], [0.0, 5.0], [f64::NAN, 0.0]];
        nothing.iter().for_each(|change| add(&mut secants, *change));
        let mut x = [1.0, 2.0];
        secants.solve(&mut x, |x| x.reverse());
        assert_eq!(x, [2.0, 1.0]);

        // Nor where it takes the place of the oldest step.
        (0..PAIRS).for_each(|_| add(&mut secants, [2.0, 0.0]));
        nothing.iter().for_each(|change| add(&mut secants, *change));
        let mut x = [2.0, 0.0];
        secants.solve(&mut x, |x| x.reverse());
        assert_eq!(x, [1.0, 0.0]);
    }
}
