//! A thin shell held by control elements, or under dead forces, in equilibrium.
//!
//! In: its control points at rest, [`Point`]s of integration, [`Grip`]s, and how the control elements are held. Out: the
//! control points in equilibrium, the energy, and its derivatives by the holds.
//!
//! Newton's iteration with the exact Hessian, a band. Thin shells make it slow: what a step bends, it stretches to second
//! order, and that meets the large membrane stiffness. The geometric part of the Hessian is therefore taken with the stress
//! that the last step was to lead to, σ + C B δq, which has no such part; both agree in equilibrium (Magisano, Leonetti and
//! Garcea, CMAME 313, 2017, 986-1005). Where that does not converge, energy is led down with the true Hessian, shifted until
//! it is positive definite; a state that is stationary but not stable is left along its mode. Near an equilibrium that was
//! found so, its factor serves on, and an iteration costs a gradient. Where small steps lead on, the next factor is made a part
//! at a time beside them, so that none of them takes long.

use super::super::frames::PoseSlope;
use super::super::memory::{ModelMemory, Unknowns};
use super::point::{Block, Grip, Hold, Point, half_product};
use super::spline::Grid;
use crate::base::lanes::{self, Kernel};
use crate::solve::envelope::{Envelope, dot};
use crate::solve::minimise::{Energy, Step, factorise, minimise};
use nalgebra::{Matrix3, Vector3};

/// Twice the energy that an iteration promises to win, in parts of the energy: when it is below, this iteration is the last.
const CONVERGED: f64 = 1e-9;
/// Limit of the same kind on the next iteration with the factor of an earlier state, where each iteration wins at most `COASTS`
/// of the one before.
const COASTED: f64 = 1e-14;
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
/// Steps in which the Hessian of the next one is made.
const PARTS: usize = 6;
/// Number of the first of these iterations after which it is foreseen whether they suffice.
const TOLD: usize = 2;
/// Evaluations of the slopes that take as long as a factor.
const FACTOR_WORK: usize = 3;
/// Iterations with an earlier factor, at full length, and along the energy's way down.
const CHEAP: usize = 12;
const FAST: usize = 16;
const SAFE: usize = 80;
/// Least shift of a Hessian that is not positive definite, in parts of the mean of its diagonal.
const SHIFT: f64 = 1e-7;

/// A shell in the state in which it was last held.
#[derive(Clone)]
pub struct Sheet {
    pub rest: Vec<Vector3<f64>>,
    pub q: Vec<Vector3<f64>>,
    pub points: Vec<Point>,
    pub grips: Vec<Grip>,
    /// Dead forces on the control points, N.
    pub loads: Vec<Vector3<f64>>,
    /// Stress to which the last step led each point.
    stress: Vec<[[f64; 3]; 2]>,
    gradient: Vec<f64>,
    step: Vec<f64>,
    hessian: Envelope,
    factor: Envelope,
    /// The holds of the equilibrium that the factor is of; the state a last iteration before it, and the stress, of which it
    /// was made; and whether it has yet to be made of them.
    factored: Vec<Hold>,
    /// The holds of the equilibrium in which it stands, where it is one.
    settled: Vec<Hold>,
    factored_q: Vec<Vector3<f64>>,
    factored_stress: Vec<[[f64; 3]; 2]>,
    /// Whether it was made with stresses that a step led to, and …
    is_led: bool,
    is_awaited: bool,
    next: Next,
    pairs: Vec<Pair>,
    trial: Vec<Vector3<f64>>,
    kept: Vec<Vector3<f64>>,
    /// The largest distance of a control point from the first, and the mean thickness, m.
    pub size: f64,
    pub thickness: f64,
    /// Evaluations of the slopes, as which a factor counts several; whoever reads it sets it to 0.
    pub work: usize,
}

/// The factor that is made beside the steps.
#[derive(Clone, Default)]
struct Next {
    /// The equilibrium that it is of.
    holds: Vec<Hold>,
    q: Vec<Vector3<f64>>,
    /// Parts of its Hessian that are made; `None` where none is begun.
    parts: Option<usize>,
}

/// A step and what it changed of the gradient.
#[derive(Clone)]
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
}

/// An equilibrium of the shell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// V, J, less the work of dead forces.
    pub energy: f64,
    pub iterations: usize,
    /// Whether it was reached from a state that was not stable.
    pub buckled: bool,
}

/// The stress with which the Hessian is taken.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Geometric {
    /// The stress of the state.
    Own,
    /// The stress to which the last step led.
    Led,
}

impl Sheet {
    pub fn new(grid: &Grid, rest: Vec<Vector3<f64>>, points: Vec<Point>, grips: Vec<Grip>) -> Sheet {
        let unknowns = 3 * rest.len();
        let band = Envelope::band(unknowns, 3 * grid.reach() + 2);
        let first = rest.first().copied().unwrap_or_else(Vector3::zeros);
        let size = rest.iter().map(|x| (x - first).norm()).fold(0.0, f64::max);
        let sum = |of: fn(&Point) -> f64| points.iter().map(of).sum::<f64>();
        let thickness = sum(|point| point.thickness * point.area) / sum(|point| point.area);
        let stress = vec![[[0.0; 3]; 2]; points.len()];
        Sheet {
            q: rest.clone(),
            factored_stress: stress.clone(),
            stress,
            points,
            grips,
            loads: vec![Vector3::zeros(); rest.len()],
            gradient: vec![0.0; unknowns],
            step: vec![0.0; unknowns],
            hessian: band.clone(),
            factor: band,
            factored: Vec::new(),
            settled: Vec::new(),
            factored_q: rest.clone(),
            is_led: false,
            is_awaited: false,
            next: Next { q: rest.clone(), ..Next::default() },
            pairs: vec![Pair { step: vec![0.0; unknowns], change: vec![0.0; unknowns] }; CHEAP],
            trial: rest.clone(),
            kept: rest.clone(),
            rest,
            size,
            thickness,
            work: 0,
        }
    }

    /// Back to rest.
    pub fn reset(&mut self) {
        self.drop_factor();
        self.settled.clear();
        self.q.clone_from_slice(&self.rest);
        self.relax();
    }

    /// Another state.
    pub fn put(&mut self, q: &[Vector3<f64>]) {
        self.drop_factor();
        self.settled.clear();
        self.q.clone_from_slice(q);
        self.relax();
    }

    /// Sets the thermal strain, by which the shell without stress is longer. A factor at another strain is dropped.
    pub fn warm(&mut self, strain: f64) {
        let green = 0.5 * strain * (2.0 + strain);
        if self.points.iter().any(|point| point.warmth != green) {
            self.drop_factor();
            self.settled.clear();
            self.points.iter_mut().for_each(|point| point.warmth = green);
            self.relax();
        }
    }

    /// The stresses are those of the state again.
    fn relax(&mut self) {
        for (point, stress) in self.points.iter().zip(&mut self.stress) {
            *stress = point.local(&self.q).map_or([[0.0; 3]; 2], |local| point.stress(&local.strain));
        }
    }

    /// The linear answers to holds that are all close to rest.
    pub fn answers(&mut self, holds: &[Vec<Hold>]) -> Option<Vec<Vec<Vector3<f64>>>> {
        self.reset();
        self.assemble(holds.first()?, Geometric::Own)?;
        self.factorise()?;
        let mut answers = Vec::with_capacity(holds.len());
        for holds in holds {
            self.slope(holds)?;
            self.solve();
            answers.push(self.step.chunks_exact(3).map(Vector3::from_column_slice).collect());
        }
        Some(answers)
    }

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

    /// Count of the numbers that [`Sheet::keep`] adds for `controls` control elements.
    pub fn kept(&self, controls: usize) -> usize {
        5 + 36 * controls + 9 * self.q.len() + 6 * self.points.len()
    }

    /// Adds the state, and where the factor was made.
    pub fn keep(&self, controls: usize, memory: &mut ModelMemory) {
        let nowhere = Hold { place: Vector3::zeros(), matrix: Matrix3::zeros() };
        for holds in [&self.factored, &self.settled, &self.next.holds] {
            memory.unknowns.push(f64::from(u8::from(!holds.is_empty())));
            for hold in holds.iter().chain(std::iter::repeat(&nowhere)).take(controls) {
                memory.put(&hold.place);
                memory.put(&hold.matrix);
            }
        }
        memory.unknowns.push(f64::from(u8::from(self.is_led)));
        memory.unknowns.push(self.next.parts.map_or(-1.0, |parts| parts as f64));
        let places = self.q.iter().chain(&self.factored_q).chain(&self.next.q);
        memory.unknowns.extend(places.flat_map(|q| [q.x, q.y, q.z]));
        memory.unknowns.extend(self.factored_stress.as_flattened().as_flattened());
    }

    /// Takes back what [`Sheet::keep`] added; the factor is made where it is needed.
    pub fn take_back(&mut self, controls: usize, unknowns: &mut Unknowns<'_>) {
        for holds in [&mut self.factored, &mut self.settled, &mut self.next.holds] {
            let is_known = unknowns.take::<f64>() == 1.0;
            holds.clear();
            holds.extend((0..controls).map(|_| Hold { place: unknowns.take(), matrix: unknowns.take() }));
            if !is_known {
                holds.clear();
            }
        }
        self.is_awaited = !self.factored.is_empty();
        self.is_led = unknowns.take::<f64>() == 1.0;
        let parts = unknowns.take::<f64>();
        for q in self.q.iter_mut().chain(&mut self.factored_q).chain(&mut self.next.q) {
            *q = unknowns.take();
        }
        self.next.parts = (parts > 0.0).then_some((parts as usize).min(PARTS));
        unknowns.fill(self.factored_stress.as_flattened_mut().as_flattened_mut());
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

    fn drop_factor(&mut self) {
        self.factored.clear();
        self.is_awaited = false;
        self.next.parts = None;
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

    /// Energy, gradient and Hessian; `None` where the surface has lost its tangent plane.
    fn assemble(&mut self, holds: &[Hold], geometric: Geometric) -> Option<f64> {
        let energy = self.slope(holds)?;
        let Sheet { points, grips, stress, q, hessian, .. } = self;
        let led = (geometric == Geometric::Led).then_some(stress.as_slice());
        hessian.clear();
        for part in 0..PARTS {
            add_part(part, points, led, q, hessian)?;
        }
        add_grips(grips, holds, q, hessian)?;
        Some(energy)
    }

    /// Energy and gradient.
    pub fn slope(&mut self, holds: &[Hold]) -> Option<f64> {
        self.work += 1;
        let Sheet { q, rest, loads, gradient, .. } = self;
        let mut energy = potential(loads, q, rest);
        for (own, load) in gradient.chunks_exact_mut(3).zip(&self.loads) {
            (0..3).for_each(|axis| own[axis] = -load[axis]);
        }
        let mut of_points = None;
        lanes::run(Slope { points: &self.points, q, gradient, energy: &mut of_points });
        energy += of_points?;
        for grip in &self.grips {
            let pulled = grip.pulled(q, holds.get(grip.control)?);
            energy += grip.energy(&pulled);
            grip.add_gradient(&pulled, gradient);
        }
        energy.is_finite().then_some(energy)
    }

    pub fn energy(&self, holds: &[Hold], q: &[Vector3<f64>]) -> Option<f64> {
        let mut energy = potential(&self.loads, q, &self.rest);
        for point in &self.points {
            energy += point.energy(&point.local(q)?.strain);
        }
        for grip in &self.grips {
            energy += grip.energy(&grip.pulled(q, holds.get(grip.control)?));
        }
        energy.is_finite().then_some(energy)
    }

    /// Factorises the Hessian, shifted as little as it must be to be positive definite; returns the shift.
    fn factorise(&mut self) -> Option<f64> {
        factorise(&mut HeldSheet { sheet: self, holds: &[] })
    }

    /// The step against the gradient; returns twice the energy that it should win.
    fn solve(&mut self) -> f64 {
        for (step, slope) in self.step.iter_mut().zip(&self.gradient) {
            *step = -slope;
        }
        self.factor.solve(&mut self.step);
        -self.step.iter().zip(&self.gradient).map(|(step, slope)| step * slope).sum::<f64>()
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

    fn largest_step(&self) -> f64 {
        self.step.iter().fold(0.0, |most: f64, x| most.max(x.abs()))
    }

    fn is_step_bearable(&self) -> bool {
        self.largest_step() < 4.0 * self.size
    }

    fn limit_step(&mut self) {
        let excess = (self.largest_step() / (0.25 * self.size)).max(1.0);
        self.step.iter_mut().for_each(|x| *x /= excess);
    }

    /// Finds the stresses to which the whole step leads the present state.
    fn lead(&mut self) {
        let step = &self.step;
        for (point, led) in self.points.iter().zip(&mut self.stress) {
            let Some(local) = point.local(&self.q) else { continue };
            let by =
                point.strain_by(&local, |node| Vector3::from_column_slice(&step[3 * node..3 * node + 3]));
            let strain = [0, 1].map(|part| std::array::from_fn(|i| local.strain[part][i] + by[part][i]));
            *led = point.stress(&strain);
        }
    }

    /// The state after this share of the step, as the trial.
    fn go(&mut self, share: f64) {
        for ((trial, q), step) in self.trial.iter_mut().zip(&self.q).zip(self.step.chunks_exact(3)) {
            *trial = q + Vector3::new(step[0], step[1], step[2]) * share;
        }
    }

    /// An energy that counts as none: that of bending by 1e-5 rad.
    fn least_energy(&self) -> f64 {
        let bending: f64 = self.points.iter().map(|point| point.bending.first).sum();
        1e-10 * bending / (self.size * self.size)
    }

    /// ∂V by the pose of each control element.
    pub fn slopes(&self, holds: &[Hold], slopes: &mut [PoseSlope]) {
        slopes.fill(PoseSlope::default());
        for grip in &self.grips {
            if let (Some(hold), Some(slope)) = (holds.get(grip.control), slopes.get_mut(grip.control)) {
                let (force, matrix) = grip.slope(&grip.pulled(&self.q, hold));
                slope.translation += force;
                slope.matrix += matrix;
            }
        }
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

/// Potential of dead forces, zero at rest.
fn potential(loads: &[Vector3<f64>], q: &[Vector3<f64>], rest: &[Vector3<f64>]) -> f64 {
    -loads.iter().zip(q.iter().zip(rest)).map(|(load, (q, rest))| load.dot(&(q - rest))).sum::<f64>()
}

/// Adds the Hessian of one of [`PARTS`] parts of the points, with their own stress where none is led to. The parts are always the
/// same, and so are the bits of the sum.
fn add_part(
    part: usize,
    points: &[Point],
    led: Option<&[[[f64; 3]; 2]]>,
    q: &[Vector3<f64>],
    hessian: &mut Envelope,
) -> Option<()> {
    let size = points.len().div_ceil(PARTS).max(1);
    let (mut block, mut nodes) = (Block::ZERO, None);
    for (at, point) in points.iter().enumerate().skip(part * size).take(size) {
        // Points of a cell stand one after the other.
        if let Some(cell) = nodes.replace(point.nodes).filter(|cell| *cell != point.nodes) {
            block.spill(&cell, hessian);
        }
        let local = point.local(q)?;
        let stress = led.map_or_else(|| point.stress(&local.strain), |led| led[at]);
        point.add_hessian(&local, &stress, &mut block);
    }
    if let Some(cell) = nodes {
        block.spill(&cell, hessian);
    }
    Some(())
}

/// Energy of all points, `None` where the surface has lost its tangent plane, and its gradient, which is added.
struct Slope<'a> {
    points: &'a [Point],
    q: &'a [Vector3<f64>],
    gradient: &'a mut [f64],
    energy: &'a mut Option<f64>,
}

impl Kernel for Slope<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let mut energy = 0.0;
        for point in self.points {
            let Some(local) = point.local(self.q) else { return };
            let stress = point.stress(&local.strain);
            energy += half_product(&local.strain, &stress);
            point.add_gradient(&local, &stress, self.gradient);
        }
        *self.energy = Some(energy);
    }
}

/// x += share · y.
fn add(x: &mut [f64], share: f64, y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += share * y);
}

fn add_grips(grips: &[Grip], holds: &[Hold], q: &[Vector3<f64>], hessian: &mut Envelope) -> Option<()> {
    for grip in grips {
        grip.add_hessian(&grip.pulled(q, holds.get(grip.control)?), hessian);
    }
    Some(())
}

#[cfg(test)]
impl Sheet {
    /// V, its derivative along d, and Hd·d, at the present state.
    pub fn along(&mut self, holds: &[Hold], d: &[Vector3<f64>]) -> Option<[f64; 3]> {
        let energy = self.assemble(holds, Geometric::Own)?;
        let flat: Vec<f64> = d.iter().flat_map(|d| [d.x, d.y, d.z]).collect();
        let along = |a: &[f64]| a.iter().zip(&flat).map(|(a, d)| a * d).sum::<f64>();
        Some([energy, along(&self.gradient), along(&self.hessian.times(&flat))])
    }
}
