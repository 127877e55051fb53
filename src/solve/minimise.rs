//! The state in which an energy is least: Newton's method, led downhill.
//!
//! In: an [`Energy`], which has the mechanics. Out: its state at the [`Minimum`], or the [`Setback`] that ended the search. A step
//! solves (H + s D) d = -g with the least s of 0, 1, 4, 16 … at which the matrix is positive definite, D being the problem's own
//! measure, and goes as far along d as the energy falls (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithms 3.1 and
//! 3.2). A state that is stationary but not stable is left along its mode. Allocates nothing.

/// A trial must achieve this part of the decrease of energy that the slope predicts (Armijo).
const DECREASE: f64 = 1e-4;
/// Factorisations of one state.
const SHIFTS: i32 = 24;
/// Lengths of a way along a mode, each half of the one before.
const MODE_TRIALS: usize = 14;

/// An energy with the state in which it is, and all that is needed to lower it.
pub trait Energy {
    /// Lengths of a step that are tried, each half of the one before.
    const TRIALS: usize;

    /// Finds V, its gradient, and where this costs little more, its Hessian; `None` where the state has no energy.
    fn evaluate(&mut self) -> Option<f64>;

    /// Rounding error of V.
    fn rounding(&self) -> f64 {
        0.0
    }

    /// Whether the factor of an earlier state still serves.
    fn serves(&mut self) -> bool {
        false
    }

    /// Factorises the Hessian, to which `shift` times the problem's own measure is added; false where it is not positive definite.
    fn factorise(&mut self, shift: f64) -> bool;

    /// Finds the step from a state of this energy with the factor, shortened to what one iteration may do.
    fn find_step(&mut self, energy: f64) -> Step;

    /// V after a share of the step, which becomes the trial.
    fn trial(&mut self, share: f64) -> Option<f64>;

    /// Makes the trial the state.
    fn accept(&mut self);

    /// Goes the last step; returns V after it.
    fn finish(&mut self, _energy: f64, _gain: f64) -> Option<f64> {
        let energy = self.trial(1.0).filter(|energy| energy.is_finite())?;
        self.accept();
        Some(energy)
    }

    /// Gives up a factor that was not of this state; false where it was, so that nothing is left to try.
    fn renew(&mut self) -> bool {
        false
    }

    /// Makes the step that mode along which V falls most, or rises least; returns the first share of it to go. `None` where a state
    /// that is not stable may stay.
    fn find_mode(&mut self) -> Option<f64> {
        None
    }
}

/// A step that was found.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    /// -g·d of the whole step, twice the energy that it should win.
    pub gain: f64,
    /// Whether nothing that counts is left to win after it.
    pub is_last: bool,
}

/// A minimum that was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Minimum {
    pub energy: f64,
    /// Whether a state that was stationary but not stable was left on the way.
    pub buckled: bool,
}

/// The reason why no minimum was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setback {
    /// The Hessian is not positive definite, however it is shifted where shifts are allowed: the equilibrium is lost, or the
    /// step is too long.
    Unstable,
    /// No step, however short, lowers the energy, or the state has none.
    NoDescent,
    /// The iteration did not converge within its limit.
    Slow,
}

/// Leads the energy down to a minimum in at most `most` iterations, which are added to `iterations`. Where there is none, the
/// state is the best that was found.
pub fn minimise<E: Energy>(problem: &mut E, most: usize, iterations: &mut usize) -> Result<Minimum, Setback> {
    let mut buckled = false;
    for _ in 0..most {
        *iterations += 1;
        let energy = problem.evaluate().ok_or(Setback::NoDescent)?;
        let shift = match problem.serves() {
            true => 0.0,
            false => factorise(problem).ok_or(Setback::Unstable)?,
        };
        let Step { gain, is_last } = problem.find_step(energy);
        if gain.is_nan() && !is_last {
            return Err(Setback::NoDescent);
        }
        let first = if is_last && shift > 0.0 { problem.find_mode() } else { None };
        if let Some(first) = first {
            let mut ways = (0..MODE_TRIALS).flat_map(|k| [first, -first].map(|way| way * halved(k)));
            ways.find(|way| problem.trial(*way).is_some_and(|after| after < energy))
                .ok_or(Setback::NoDescent)?;
            problem.accept();
            buckled = true;
        } else if is_last {
            let energy = problem.finish(energy, gain).ok_or(Setback::NoDescent)?;
            return Ok(Minimum { energy, buckled });
        } else {
            let most = energy + problem.rounding();
            let falls = |share: f64, after: f64| after <= most - DECREASE * share * gain;
            let mut shares = (0..E::TRIALS).map(halved);
            if shares.any(|share| problem.trial(share).is_some_and(|after| falls(share, after))) {
                problem.accept();
            } else if !problem.renew() {
                return Err(Setback::NoDescent);
            }
        }
    }
    Err(Setback::Slow)
}

/// Factorises with the least shift at which the matrix is positive definite; returns it.
pub fn factorise<E: Energy>(problem: &mut E) -> Option<f64> {
    let mut shifts = std::iter::once(0.0).chain((0..SHIFTS - 1).map(|k| 4.0_f64.powi(k)));
    shifts.find(|shift| problem.factorise(*shift))
}

fn halved(k: usize) -> f64 {
    0.5_f64.powi(k as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// V = ¼ (x² - 1)² + ½ y² has minima at x = ±1 and a saddle between; it is not defined for x above `most`.
    struct Wells {
        at: [f64; 2],
        trial: [f64; 2],
        step: [f64; 2],
        stiffness: [f64; 2],
        may_leave: bool,
        most: f64,
    }

    impl Wells {
        fn new(at: [f64; 2], may_leave: bool) -> Wells {
            Wells { at, trial: at, step: [0.0; 2], stiffness: [1.0; 2], may_leave, most: f64::INFINITY }
        }
    }

    impl Energy for Wells {
        const TRIALS: usize = 30;

        fn evaluate(&mut self) -> Option<f64> {
            self.trial = self.at;
            self.trial(0.0)
        }

        fn factorise(&mut self, shift: f64) -> bool {
            self.stiffness = [3.0 * self.at[0].powi(2) - 1.0 + shift, 1.0 + shift];
            self.stiffness[0] > 0.0
        }

        fn find_step(&mut self, _energy: f64) -> Step {
            let [x, y] = self.at;
            let gradient = [x * (x * x - 1.0), y];
            self.step = [0, 1].map(|i| -gradient[i] / self.stiffness[i]);
            let gain = -(self.step[0] * gradient[0] + self.step[1] * gradient[1]);
            Step { gain, is_last: gain <= 1e-16 }
        }

        fn trial(&mut self, share: f64) -> Option<f64> {
            self.trial = [0, 1].map(|i| self.at[i] + share * self.step[i]);
            let [x, y] = self.trial;
            let energy = 0.25 * (x * x - 1.0).powi(2) + 0.5 * y * y;
            (x.is_nan() || x <= self.most).then_some(energy)
        }

        fn accept(&mut self) {
            self.at = self.trial;
        }

        fn find_mode(&mut self) -> Option<f64> {
            self.may_leave.then(|| {
                self.step = [1.0, 0.0];
                0.1
            })
        }
    }

    #[test]
    fn a_saddle_is_left_and_the_minimum_is_counted_in_iterations() {
        let mut iterations = 0;
        let mut wells = Wells::new([0.0, 1e-9], true);
        let found = minimise(&mut wells, 40, &mut iterations).unwrap();
        assert!(found.buckled && found.energy < 1e-15 && (wells.at[0] - 1.0).abs() < 1e-8, "{found:?}");
        assert!((4..40).contains(&iterations), "{iterations}");
        let mut stays = Wells::new([0.0, 1e-9], false);
        let found = minimise(&mut stays, 40, &mut 0).unwrap();
        assert!(!found.buckled && (found.energy - 0.25).abs() < 1e-15 && stays.at[0] == 0.0, "{found:?}");
    }

    #[test]
    fn a_saddle_is_left_to_the_side_on_which_the_energy_is_defined() {
        for (most, side) in [(0.0, -1.0), (2.0, 1.0)] {
            let mut wells = Wells { most, ..Wells::new([0.0; 2], true) };
            let found = minimise(&mut wells, 50, &mut 0).unwrap();
            assert!(found.buckled && found.energy < 1e-15, "{found:?}");
            assert!((wells.at[0] - side).abs() < 1e-8, "{} and not {side}", wells.at[0]);
        }
    }

    #[test]
    fn a_search_that_ends_early_says_why() {
        assert_eq!(minimise(&mut Wells::new([3.0, 0.0], true), 2, &mut 0), Err(Setback::Slow));
        assert_eq!(minimise(&mut Wells::new([f64::NAN, 0.0], true), 9, &mut 0), Err(Setback::Unstable));
    }
}
