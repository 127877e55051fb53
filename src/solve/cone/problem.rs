//! The problem, and the sweeps and Newton steps that solve it.

use super::compliance::Compliance;
use super::single::{single, within};
use nalgebra::{DVector, Vector2, Vector3};

type V3 = Vector3<f64>;

/// Sweeps between two measurements.
const BETWEEN: usize = 4;
/// Sweeps at most that a problem of this many contacts takes; a smaller one may take more of the shorter ones. A Newton step counts as
/// the sweeps that take as long.
const MOST_SWEEPS: usize = 600;
const FEW: usize = 200;
const MOST_OF_FEW: usize = 4000;
/// Newton steps one after the other, and the sweeps after each.
const NEWTON_STEPS: usize = 8;
const AFTER: usize = 8;
/// Factor by which a step is shortened, so many times at most.
const SHORTER: f64 = 0.4;
const SHORTENED: i32 = 4;
/// Factor by which steps should come nearer: where they do not, they are not tried again soon.
const NEARER: f64 = 0.05;
/// Part of all contacts up to which those that are pressed are solved by themselves.
const FEW_PRESSED: f64 = 0.7;
/// Resistance of a contact in the first careful step, as a part of the mean softness; factors by which it becomes less after a step that
/// succeeds, and more after one that does not; and the part of what is missed with which a step succeeds.
const RESISTANCE: f64 = 0.1;
const LESS: f64 = 0.2;
const MORE: f64 = 4.0;
const SUCCESS: f64 = 0.3;
/// Part of all sweeps before steps become careful, and that of one of these.
const HASTY: f64 = 0.15;
const CAREFUL: f64 = 0.05;
/// Part of the largest displacement of d₀ by which the conditions may be missed.
const TOLERANCE: f64 = 1e-8;
/// Part of it by which they are missed where that is told.
const FAR: f64 = 1e-2;

/// A problem.
pub struct Cone<'a> {
    pub w: &'a Compliance<'a>,
    pub d0: &'a DVector<f64>,
    pub friction: &'a [f64],
}

/// Distance of the forces from those that the conditions ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// Sweeps, with Newton steps as the sweeps that take as long.
    pub sweeps: usize,
    /// Largest displacement by which a condition is missed, and largest one of d₀, m.
    pub missed: f64,
    pub largest: f64,
    pub is_solved: bool,
}

impl Reached {
    /// Whether more is missed than one could overlook.
    pub fn is_far(&self) -> bool {
        !self.is_solved && self.missed > FAR * self.largest
    }
}

/// Forces, the displacements under them, and the largest displacement by which they miss a condition, with the root of the sum of all
/// their squares.
#[derive(Clone)]
pub struct Tried {
    pub f: Vec<f64>,
    pub d: Vec<f64>,
    pub missed: f64,
    pub all_missed: f64,
}

/// Three numbers of a contact.
pub fn of(all: &[f64], a: usize) -> V3 {
    V3::from_column_slice(&all[3 * a..3 * a + 3])
}

pub fn set(all: &mut [f64], a: usize, x: &V3) {
    all[3 * a..3 * a + 3].copy_from_slice(x.as_slice());
}

impl Cone<'_> {
    pub fn contacts(&self) -> usize {
        self.friction.len()
    }

    /// d under these forces.
    pub fn displacements(&self, f: &[f64]) -> Vec<f64> {
        let mut d = self.d0.as_slice().to_vec();
        for a in 0..self.contacts() {
            let own = of(f, a);
            if own != V3::zeros() {
                self.w.add(a, &own, &mut d);
            }
        }
        d
    }

    /// Improves `f` until the conditions hold. After a few sweeps over all contacts those that are pressed then are solved by themselves.
    pub fn solve(&self, f: &mut DVector<f64>) -> Reached {
        self.solve_within(f, 0.0)
    }

    /// [`Cone::solve`], done as soon as no condition is missed by more than `within`, m.
    pub fn solve_within(&self, f: &mut DVector<f64>, within: f64) -> Reached {
        let largest = self.d0.amax();
        let limit = within.max(TOLERANCE * largest);
        let few = (FEW as f64 / self.contacts().max(1) as f64).powi(2).max(1.0);
        let most = ((MOST_SWEEPS as f64 * few) as usize).min(MOST_OF_FEW);
        let mut tried = self.tried(f.as_slice().to_vec());
        let hasty = (HASTY * most as f64) as usize;
        // One in any case: what has come off has no force, however small.
        self.sweep(&mut tried, 1);
        let mut sweeps = 1;
        while tried.missed > limit && sweeps < hasty {
            self.sweep(&mut tried, BETWEEN);
            sweeps += BETWEEN;
            let pressed: Vec<usize> = (0..self.contacts()).filter(|a| tried.f[3 * a] > 0.0).collect();
            if (pressed.len() as f64) < FEW_PRESSED * self.contacts() as f64 {
                sweeps += self.solve_alone(&pressed, &mut tried, limit, hasty.saturating_sub(sweeps));
            } else {
                sweeps += self.solve_all(&mut tried, limit, hasty.saturating_sub(sweeps));
            }
            // Anew, without the rounding of the changes.
            tried = self.tried(tried.f);
        }
        if tried.missed > limit {
            sweeps += self.solve_carefully(&mut tried, limit, most);
        }
        f.copy_from_slice(&tried.f);
        Reached { sweeps, missed: tried.missed, largest, is_solved: tried.missed <= limit }
    }

    /// Solves in steps in which each contact resists a change of its force, by less and less as long as they succeed: a proximal point
    /// method (R. Rockafellar, SIAM Journal on Control and Optimization 14, 1976, 877-898). The sweeps that it took.
    fn solve_carefully(&self, tried: &mut Tried, limit: f64, most: usize) -> usize {
        let mean = (0..self.contacts()).map(|a| self.w.softness(a)).sum::<f64>() / self.contacts() as f64;
        let (mut now, mut resistance, mut sweeps) = (tried.clone(), RESISTANCE * mean, 0);
        while tried.missed > limit && sweeps < most {
            let w = self.w.with_skin(resistance);
            let resisted = self.d0.iter().zip(&now.f).map(|(d, f)| d - resistance * f);
            let d0 = DVector::from_iterator(self.d0.len(), resisted);
            let step = Cone { w: &w, d0: &d0, friction: self.friction };
            let mut next = step.tried(now.f.clone());
            let enough = (SUCCESS * now.missed).max(0.5 * limit);
            sweeps += step.solve_all(&mut next, enough, (CAREFUL * most as f64) as usize).max(BETWEEN);
            if next.missed <= enough {
                now = self.tried(next.f);
                resistance *= LESS;
            } else {
                resistance *= MORE;
            }
            if now.missed < tried.missed {
                tried.clone_from(&now);
            }
        }
        sweeps
    }

    /// Solves for some contacts while the others stay open. The sweeps that it took.
    fn solve_alone(&self, some: &[usize], tried: &mut Tried, limit: f64, most: usize) -> usize {
        let part = |all: &[f64]| -> Vec<f64> {
            some.iter().flat_map(|a| all[3 * a..3 * a + 3].iter().copied()).collect()
        };
        let friction: Vec<f64> = some.iter().map(|a| self.friction[*a]).collect();
        let (w, d0) = (self.w.part(some), DVector::from_vec(part(self.d0.as_slice())));
        let alone = Cone { w: &w, d0: &d0, friction: &friction };
        let mut own = alone.tried(part(&tried.f));
        let sweeps = alone.solve_all(&mut own, limit, most);
        for (i, a) in some.iter().enumerate() {
            set(&mut tried.f, *a, &of(&own.f, i));
        }
        sweeps
    }

    /// Sweeps and Newton steps over all contacts. The sweeps that it took.
    fn solve_all(&self, tried: &mut Tried, limit: f64, most: usize) -> usize {
        let (mut sweeps, mut wait, mut patience) = (0, 0, 0);
        while tried.missed > limit && sweeps < most {
            let before = tried.missed;
            self.sweep(tried, BETWEEN);
            sweeps += BETWEEN;
            if wait > 0 {
                wait -= 1;
            } else if tried.missed > limit {
                let swept = tried.missed;
                let ahead = BETWEEN as f64 * (limit / swept).ln() / (swept / before).min(0.99).ln();
                let Some(taken) = self.go(tried, limit, ahead) else { continue };
                sweeps += taken;
                patience = if tried.missed < NEARER * swept { 0 } else { 2 * patience + 1 };
                wait = patience;
            }
        }
        sweeps
    }

    /// Newton steps, each followed by sweeps. What they took, in sweeps; `None` where sweeps alone, so many of which are ahead, are faster.
    fn go(&self, tried: &mut Tried, limit: f64, ahead: f64) -> Option<usize> {
        let mut taken = 0;
        for step in 0..NEWTON_STEPS {
            let Some(newton) = self.newton(tried) else { break };
            if step == 0 && newton.sweeps() as f64 > ahead {
                return None;
            }
            taken += newton.sweeps();
            let Some(to) = newton.forces() else { break };
            let shortened = (0..SHORTENED).find_map(|times| {
                let share = SHORTER.powi(times);
                let part = tried.f.iter().zip(&to).map(|(from, to)| from + (to - from) * share);
                let mut next = self.tried(part.collect());
                if next.missed > limit {
                    self.sweep(&mut next, AFTER);
                }
                taken += AFTER + 1;
                (next.missed <= limit || next.all_missed < tried.all_missed).then_some(next)
            });
            let Some(next) = shortened else { break };
            *tried = next;
            if tried.missed <= limit {
                break;
            }
        }
        Some(taken)
    }

    fn tried(&self, f: Vec<f64>) -> Tried {
        let d = self.displacements(&f);
        let [missed, all_missed] = self.missed(&f, &d);
        Tried { f, d, missed, all_missed }
    }

    fn sweep(&self, tried: &mut Tried, times: usize) {
        for _ in 0..times {
            (0..self.contacts()).for_each(|a| self.relax(a, &mut tried.f, &mut tried.d));
        }
        [tried.missed, tried.all_missed] = self.missed(&tried.f, &tried.d);
    }

    /// Solves one contact while the others keep their forces, under which the displacements are `d`.
    fn relax(&self, a: usize, f: &mut [f64], d: &mut [f64]) {
        let (own, old) = (self.w.own(a), of(f, a));
        let free = of(d, a) - own * old;
        let new = single(own, &free, self.friction[a], &old);
        if new != old {
            set(f, a, &new);
            self.w.add(a, &(new - old), d);
        }
    }

    /// Displacements by which conditions are missed, of each contact that by which f - ρ d, put into its cone, differs from f: the largest,
    /// and the root of the sum of their squares.
    fn missed(&self, f: &[f64], d: &[f64]) -> [f64; 2] {
        let of_contact = |a: usize| {
            let softness = self.w.softness(a);
            let (own, gap) = (of(f, a), of(d, a));
            let moved = own - gap / softness;
            let normal = moved.x.max(0.0);
            let tangent = within(&Vector2::new(moved.y, moved.z), self.friction[a] * own.x.max(0.0));
            softness * (own - V3::new(normal, tangent.x, tangent.y)).norm()
        };
        let add = |[most, squares]: [f64; 2], missed: f64| [most.max(missed), squares + missed * missed];
        let [most, squares] = (0..self.contacts()).map(of_contact).fold([0.0; 2], add);
        [most, squares.sqrt()]
    }
}
