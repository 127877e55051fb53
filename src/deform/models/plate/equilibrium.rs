//! The search for the equilibrium of a shell.
//!
//! In: a [`Sheet`] in the state in which it was last held, and how its control elements are held now. Out: the sheet in equilibrium.
//!
//! Newton's iteration with the exact Hessian, a band. Thin shells make it slow: what a step bends, it stretches to second
//! order, and that meets the large membrane stiffness. The geometric part of the Hessian is therefore taken with the stress
//! that the last step was to lead to, σ + C B δq, which has no such part; both agree in equilibrium (Magisano, Leonetti and
//! Garcea, CMAME 313, 2017, 986-1005). Where that does not converge, energy is led down with the true Hessian, shifted until
//! it is positive definite; a state that is stationary but not stable is left along its mode. Near an equilibrium that was
//! found so, its factor serves on, and an iteration costs a gradient. Where small steps lead on, the next factor is made a part
//! at a time beside them, so that none of them takes long.

use super::point::Hold;
use super::sheet::{CHEAP, Geometric, Next, PARTS, Sheet, Standing, add, add_grips, add_part};
use crate::solve::envelope::dot;
use crate::solve::minimise::{Energy, Step, factorise, minimise};

/// Twice the energy that an iteration promises to win, in parts of the energy: when it is below, this iteration is the last.
const CONVERGED: f64 = 1e-9;
/// Limit of the same kind on the next iteration with the factor of an earlier state, where each iteration wins at most `COASTS`
/// of the one before.
const COASTED: f64 = 1e-17;
const COASTS: f64 = 0.5;
/// Multiple of the energy that counts as none: below this part of it, rounding errors of thin shells begin.
const ROUNDED: f64 = 1e3;
/// Equilibria are near where no control element turns by more, rad, or moves by more than this part of the thickness: in
/// between, a loss of stability is not seen.
const NEAR_TURN: f64 = 0.02;
const NEAR_MOVE: f64 = 0.05;
/// Distances from the state of the factor, in parts of the two above, at which the next factor is begun, and up to which the
/// old one serves meanwhile.
const BEGIN: f64 = 0.25;
const REACH: f64 = 2.0;
/// Number of the first of these iterations after which it is foreseen whether they suffice.
const TOLD: usize = 2;
/// Evaluations of the slopes that take as long as a factor.
const FACTOR_WORK: usize = 3;
/// Iterations at full length, and along the energy's way down.
const FAST: usize = 16;
const SAFE: usize = 80;
/// Least shift of a Hessian that is not positive definite, in parts of the mean of its diagonal.
const SHIFT: f64 = 1e-7;

impl Sheet {
    /// Equilibrium with the control elements held so, from the present state; `None`, and the state as it was, where none is
    /// found.
    pub fn settle(&mut self, holds: &[Hold]) -> Option<Standing> {
        self.kept.clone_from_slice(&self.q);
        let (mut iterations, mut buckled) = (0, false);
        let mut energy = self.settle_near(holds, &mut iterations);
        if energy.is_none() {
            self.q.clone_from_slice(&self.kept);
            energy = self.settle_beside(holds, &mut iterations);
        }
        if energy.is_none() {
            self.q.clone_from_slice(&self.kept);
            energy = self.settle_far(holds, &mut iterations, &mut buckled);
        }
        self.settled.clear();
        if energy.is_some() {
            self.settled.extend_from_slice(holds);
        } else {
            self.q.clone_from_slice(&self.kept);
            self.relax();
        }
        energy.map(|energy| Standing { energy, iterations, buckled })
    }

    /// The energy in an equilibrium near that of the factor.
    fn settle_near(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<f64> {
        if !self.is_near(&self.factored, holds, if self.next.parts.is_some() { REACH } else { 1.0 }) {
            return None;
        }
        self.factor_again()?;
        let energy = self.coast(holds, iterations)?;
        self.make_next(holds);
        Some(energy)
    }

    /// The energy in an equilibrium near the last one, with the factor of that.
    fn settle_beside(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<f64> {
        if !self.is_near(&self.settled, holds, 1.0) {
            return None;
        }
        self.drop_factor();
        let settled = std::mem::take(&mut self.settled);
        self.assemble(&settled, Geometric::Own)?;
        self.take_factor(&settled)?;
        self.factored_q.clone_from_slice(&self.q);
        self.coast(holds, iterations)
    }

    /// The energy in an equilibrium at any distance.
    fn settle_far(&mut self, holds: &[Hold], iterations: &mut usize, buckled: &mut bool) -> Option<f64> {
        self.drop_factor();
        self.relax();
        if let Some((energy, is_stable)) = self.newton(holds, iterations) {
            if is_stable {
                self.factored.extend_from_slice(holds);
                self.is_led = true;
                return Some(energy);
            }
        } else {
            self.q.clone_from_slice(&self.kept);
        }
        self.descend(holds, iterations, buckled)
    }

    /// Makes the factor of the last equilibrium where that has yet to be done.
    fn factor_again(&mut self) -> Option<()> {
        if self.is_awaited {
            let holds = std::mem::take(&mut self.factored);
            self.q.clone_from_slice(&self.factored_q);
            self.stress.clone_from_slice(&self.factored_stress);
            let geometric = if self.is_led { Geometric::Led } else { Geometric::Own };
            let made = self.assemble(&holds, geometric).and_then(|_| self.factorise());
            self.q.clone_from_slice(&self.kept);
            self.factored = holds;
            made?;
            self.is_awaited = false;
            if let Some(parts) = self.next.parts {
                self.begin_next(parts);
            }
        }
        Some(())
    }

    /// Makes one more part of the next factor where the way from that of the present one is long enough.
    fn make_next(&mut self, holds: &[Hold]) {
        match self.next.parts {
            None if self.is_near(&self.factored, holds, BEGIN) => {}
            None => {
                self.next.holds.clear();
                self.next.holds.extend_from_slice(holds);
                self.next.q.clone_from_slice(&self.q);
                self.begin_next(1);
            }
            Some(PARTS) => {
                let Next { holds, q, .. } = std::mem::take(&mut self.next);
                self.drop_factor();
                if self.take_factor(&holds).is_some() {
                    self.factored_q.clone_from_slice(&q);
                }
                self.next = Next { holds, q, parts: None };
            }
            Some(part) => self.make_part(part),
        }
    }

    /// Begins the Hessian of the next factor with its first `parts` parts.
    fn begin_next(&mut self, parts: usize) {
        self.hessian.clear();
        (0..parts).for_each(|part| self.make_part(part));
    }

    fn make_part(&mut self, part: usize) {
        let Sheet { points, grips, hessian, next: Next { holds, q, parts }, .. } = self;
        let made = add_part(part, points, None, q, hessian);
        let held = if part + 1 == PARTS { add_grips(grips, holds, q, hessian) } else { Some(()) };
        *parts = made.and(held).map(|()| part + 1);
    }

    /// Factorises the Hessian, which is that of an equilibrium with own stresses; `None` where that is not stable.
    fn take_factor(&mut self, holds: &[Hold]) -> Option<()> {
        if self.factorise()? > 0.0 {
            return None;
        }
        self.factored.extend_from_slice(holds);
        self.is_led = false;
        Some(())
    }

    /// Whether no control element goes farther than `reach` times what counts as near.
    fn is_near(&self, from: &[Hold], holds: &[Hold], reach: f64) -> bool {
        let near = |(from, to): (&Hold, &Hold)| {
            (to.matrix - from.matrix).amax() < reach * NEAR_TURN
                && (to.place - from.place).amax() < reach * NEAR_MOVE * self.thickness
        };
        from.len() == holds.len() && from.iter().zip(holds).all(near)
    }

    /// Iterations with the last factor: the energy. What each step did to the slopes mends the factor for the next ones (BFGS in
    /// the form of Nocedal and Wright, Numerical Optimization, 2nd ed., algorithm 7.4).
    fn coast(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<f64> {
        let mut before = f64::INFINITY;
        for pair in 0..CHEAP {
            *iterations += 1;
            let energy = self.slope(holds)?;
            if let Some(last) = pair.checked_sub(1) {
                for (change, now) in self.pairs[last].change.iter_mut().zip(&self.gradient) {
                    *change += now;
                }
            }
            let gain = self.solve_mended(pair);
            if gain.is_nan() || gain > COASTS * before {
                return None;
            }
            self.go(1.0);
            self.q.clone_from_slice(&self.trial);
            let rate = if pair == 0 { 1.0 } else { gain / before };
            let wanted = COASTED * energy.abs().max(ROUNDED * self.least_energy());
            if gain * rate <= wanted {
                return Some(energy - 0.5 * gain);
            }
            // Too slow, even at the square of this rate.
            if pair >= TOLD && gain * rate.powi(2 * (CHEAP - pair) as i32) > wanted {
                return None;
            }
            before = gain;
            let own = &mut self.pairs[pair];
            own.step.copy_from_slice(&self.step);
            for (change, slope) in own.change.iter_mut().zip(&self.gradient) {
                *change = -slope;
            }
        }
        None
    }

    /// Newton's iteration in full steps: the energy, and whether the state is stable.
    fn newton(&mut self, holds: &[Hold], iterations: &mut usize) -> Option<(f64, bool)> {
        for _ in 0..FAST {
            *iterations += 1;
            let energy = self.assemble(holds, Geometric::Led)?;
            self.factored_q.clone_from_slice(&self.q);
            self.factored_stress.clone_from_slice(&self.stress);
            let shift = self.factorise()?;
            let gain = self.solve();
            if !self.is_step_bearable() {
                return None;
            }
            self.lead();
            self.go(1.0);
            self.q.clone_from_slice(&self.trial);
            if gain <= CONVERGED * energy.abs().max(self.least_energy()) {
                return Some((self.energy(holds, &self.q)?, shift == 0.0));
            }
        }
        None
    }

    /// Leads the energy down to where it is least.
    fn descend(&mut self, holds: &[Hold], iterations: &mut usize, buckled: &mut bool) -> Option<f64> {
        let found = minimise(&mut HeldSheet { sheet: self, holds }, SAFE, iterations).ok()?;
        *buckled |= found.buckled;
        self.relax();
        Some(found.energy)
    }

    /// Factorises the Hessian, shifted as little as it must be to be positive definite; returns the shift.
    pub fn factorise(&mut self) -> Option<f64> {
        factorise(&mut HeldSheet { sheet: self, holds: &[] })
    }

    /// [`Sheet::solve`] with a factor that `count` pairs have mended.
    fn solve_mended(&mut self, count: usize) -> f64 {
        let Sheet { pairs, step, gradient, factor, .. } = self;
        for (step, slope) in step.iter_mut().zip(&*gradient) {
            *step = -slope;
        }
        let mut shares = [0.0; CHEAP];
        for (share, pair) in shares.iter_mut().zip(&*pairs).take(count).rev() {
            *share = dot(&pair.step, step) / dot(&pair.step, &pair.change);
            add(step, -*share, &pair.change);
        }
        factor.solve(step);
        for (share, pair) in shares.iter().zip(&*pairs).take(count) {
            let back = dot(&pair.change, step) / dot(&pair.step, &pair.change);
            add(step, share - back, &pair.step);
        }
        -dot(step, gradient)
    }

    fn is_step_bearable(&self) -> bool {
        self.largest_step() < 4.0 * self.size
    }
}

/// The energy of a shell whose control elements are held so.
struct HeldSheet<'a> {
    sheet: &'a mut Sheet,
    holds: &'a [Hold],
}

impl Energy for HeldSheet<'_> {
    const TRIALS: usize = 27;

    fn evaluate(&mut self) -> Option<f64> {
        self.sheet.assemble(self.holds, Geometric::Own)
    }

    fn factorise(&mut self, shift: f64) -> bool {
        let Sheet { work, factor, hessian, gradient, .. } = &mut *self.sheet;
        let added = SHIFT * (hessian.trace() / gradient.len() as f64) * shift;
        *work += FACTOR_WORK;
        factor.copy_from(hessian);
        factor.change_diagonal(|entry| entry + added);
        factor.factor()
    }

    fn find_step(&mut self, energy: f64) -> Step {
        let gain = self.sheet.solve();
        self.sheet.limit_step();
        Step { gain, is_last: gain <= CONVERGED * energy.abs().max(self.sheet.least_energy()) }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        self.sheet.go(share);
        self.sheet.energy(self.holds, &self.sheet.trial)
    }

    fn accept(&mut self) {
        self.sheet.q.clone_from_slice(&self.sheet.trial);
    }

    /// Inverse iteration with the shifted Hessian, from a start that is in no symmetry's way.
    fn find_mode(&mut self) -> Option<f64> {
        let Sheet { step, factor, size, .. } = &mut *self.sheet;
        step.iter_mut().enumerate().for_each(|(i, step)| *step = (1.7 * i as f64).sin() + 0.3);
        for _ in 0..20 {
            factor.solve(step);
            let most = step.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            step.iter_mut().for_each(|x| *x /= most);
        }
        Some(0.02 * *size)
    }
}
