//! One load step to the next equilibrium: a prediction along the tangent, and the iterations after it.
//!
//! In: the [`Newton`] problem and an equilibrium with the factor of its tangent. Out: the next equilibrium with its own. K(u) d = -f(u)
//! is solved with the tangent of each state until the steps are short, then with the last factor, as long as each step lowers the energy
//! as predicted. Each d is shortened until the energy falls (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithm 3.2). Tangents
//! must be positive definite; where the last one is not that of the equilibrium, its softest motion is looked at there.

use super::error::SolveError;
use super::factored::Factored;
use super::minimise::{Energy, Setback, Step, minimise};
use super::newton::{Counts, Equilibrium, Imbalance, IterationEnd, Newton, Path, Point};
use super::pushed::Border;
use super::settle::{Settler, State, largest, sum};
use super::stability::{ROUGH, scattered};
use crate::fem::{NodeFields, StiffnessMatrix};
use nalgebra::{DMatrix, Matrix3};

/// Factorizations of a search, next to an equilibrium and far from one.
const MOST_FACTORS: usize = 25;
const MOST_FACTORS_FAR: usize = 200;
/// Iterations with pressures as unknowns.
const MAX_MIXED: usize = 10;
/// An old factor is used again after a step shorter than the first of these parts of the largest displacement, while each step leaves at
/// most the second part of the decrease that the one before promised.
const NEAR_END: f64 = 1e-2;
const EASED_GAIN: f64 = 0.02;
/// Iterations for each factorization that a search may take.
const STEPS_OF_A_FACTOR: usize = 8;
/// Largest change of F in a load step whose first iteration takes the factor from its beginning.
const NEARBY: f64 = 0.05;
/// A factor serves as that of a state if the body has moved by no more than this part of the largest displacement since; a last step
/// with it is shorter by this part, since it does not square the error.
const SAME: f64 = 1e-3;
const SHORTER: f64 = 1e-4;
/// Steps of inverse iteration to the softest motion.
const INVERSE_STEPS: usize = 3;
/// The first addition to a tangent that is not positive definite: a part of the resting body's diagonal, or of its least eigenvalue.
const LEAST_SHIFT: f64 = 1e-3;
const LEAST_SHIFT_FAR: f64 = 0.25;
/// Part of one shift with which the next iteration begins, and the least of all.
const EASED: f64 = 16.0;
const LEAST_SCALE: f64 = 1e-8;
/// The first way along a mode, in parts of the cube root of the body's volume.
const FIRST_WAY: f64 = 0.25;
/// Largest change of F in a prediction under loads: a beam turns by some 40°.
const LONGEST: f64 = 1.0;
/// Load steps shorter than this share of the way are not refused for a long prediction.
const SHORT: f64 = 1.0 / 256.0;

impl<'a> Newton<'a> {
    /// The equilibrium with the controlled nodes as `path` writes them, in one load step from the equilibrium `u`; `None` where
    /// that step fails. Loads are those at the end of the way. `tangent` is that of `u`, made where there is none, and then that of the
    /// equilibrium that is found.
    pub fn step_to(
        &self,
        u: &NodeFields,
        tangent: &mut Option<Factored<'a>>,
        path: &Path<'_>,
    ) -> Result<Option<Equilibrium>, SolveError> {
        let mut counts = Counts::default();
        match self.step(&self.start(u.clone()), tangent, [0.0, 1.0], path, &mut counts) {
            Ok(found) => self.judge(found, 1.0, counts).map(Some),
            Err(IterationEnd::Solve(error)) => Err(error),
            Err(IterationEnd::Setback(_)) => Ok(None),
        }
    }

    /// The stable equilibrium next to `guess`, whose controlled nodes stand where they are held, under the loads at the end of the way;
    /// `None` where Newton's iteration finds none from there.
    pub fn settle_near(&self, guess: NodeFields) -> Result<Option<Equilibrium>, SolveError> {
        let mut counts = Counts::default();
        let start = self.start(guess);
        if self.solver.is_none() {
            return self.judge(start, 1.0, counts).map(Some);
        }
        let held = |_: f64, _: &mut NodeFields| {};
        let search = Search { share: 1.0, path: &held, size: largest(&start.u), measure: None, before: None };
        if self.body.is_nearly_incompressible() {
            match self.iterate_mixed(&search, &start.u, start.clone(), &mut counts) {
                Ok((found, _)) => return self.judge(found, 1.0, counts).map(Some),
                Err(IterationEnd::Setback(_)) => {}
                Err(IterationEnd::Solve(error)) => return Err(error),
            }
        }
        let rest = self.body.tangent(&self.body.gradients(&NodeFields::zeros(start.u.nodes, 1)));
        let measure = rest.diagonal.iter().map(|own| own * LEAST_SHIFT).collect();
        let search = Search { measure: Some(measure), ..search };
        match self.iterate(search, start, MOST_FACTORS, &mut counts) {
            Ok((found, _)) => self.judge(found, 1.0, counts).map(Some),
            Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// One load step: from the equilibrium at a share of the way to that with the controlled nodes where `path` has them at
    /// `target`. `tangent` is that of `from`, made where there is none, and then that of the equilibrium that is found.
    pub(super) fn step(
        &self,
        from: &Point,
        tangent: &mut Option<Factored<'a>>,
        [share, target]: [f64; 2],
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
        let mut moved = from.clone();
        self.place(target, path, &mut moved);
        let is_idle = moved == *from && self.loads.is_none();
        if is_idle || self.solver.is_none() {
            return Ok(moved);
        }
        let before = match tangent.take() {
            Some(made) => made,
            None => self.factor_at(from, share, counts)?,
        };
        let before = &*tangent.insert(before);
        let predicted = self.predict(before, from, target, (path, &moved))?;
        let is_loaded = self.loads.is_some();
        let size = largest(&from.u).max(largest(if is_loaded { &predicted.u } else { &moved.u }));
        let body = self.body_at(target)?;
        let (here, there) = (body.gradients(&from.u), body.gradients(&predicted.u));
        let change = here.iter().zip(&there).map(|(here, there)| (there - here).norm()).fold(0.0, f64::max);
        if is_loaded && target - share > SHORT && change > LONGEST {
            return Err(IterationEnd::Setback(Setback::Slow));
        }
        let before = Some(before).filter(|_| change <= NEARBY);
        let search = Search { share: target, path, size, measure: None, before };
        let mut found = None;
        if body.is_nearly_incompressible() {
            match self.iterate_mixed(&search, &from.u, predicted.clone(), counts) {
                // From the same prediction, downhill.
                Err(IterationEnd::Setback(_)) => {}
                done => found = Some(done?),
            }
        }
        let (found, made) = match found {
            Some(found) => found,
            None => self.iterate(search, predicted, MOST_FACTORS, counts)?,
        };
        *tangent = Some(made);
        Ok(found)
    }

    /// The prediction keeps the free nodes in balance to first order: A d = loads - f - B Δb, where loads and f are the same
    /// but for what has changed. A is that of the equilibrium: as warm as it was there.
    fn predict(
        &self,
        before: &Factored<'_>,
        from: &Point,
        target: f64,
        (path, moved): (&Path<'_>, &Point),
    ) -> Result<Point, IterationEnd> {
        let mut net = NodeFields::zeros(from.u.nodes, 1);
        before.k.multiply(&sum(&moved.u, -1.0, &from.u), &mut net);
        if self.loads.is_some() {
            let (after, forces) = (self.body_at(target)?, self.forces_at(target));
            let own = self.settler(&after, forces.as_ref()).net_forces(&after.gradients(&from.u));
            net = sum(&net, 1.0, &own);
        }
        let (d, dq) = self.solve(before, &self.imbalance(target, &from.q, &net))?;
        Ok(self.moved(moved, 1.0, (&d, &dq), (target, path)))
    }

    /// Newton's iteration from the equilibrium `before` by way of `point`, with the pressures as unknowns of their own that
    /// are eliminated from each linear system: p = λ θ holds at its end alone, so that a step's false dilatations, which
    /// are of its second order, are not multiplied by λ in the tangent (Magisano, Leonetti and Garcea, Comput. Methods
    /// Appl. Mech. Engng. 313, 2017, 986-1005). The energy rises on the way; a tangent that is not positive definite ends
    /// the iteration, and the last one is that of the energy.
    fn iterate_mixed(
        &self,
        search: &Search<'_, 'a>,
        before: &NodeFields,
        mut point: Point,
        counts: &mut Counts,
    ) -> Result<(Point, Factored<'a>), IterationEnd> {
        counts.moves.clear();
        let Search { share, path, size, .. } = *search;
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let mut pressures = body.pressures_after(&body.gradients(before), &sum(&point.u, -1.0, before));
        for _ in 0..MAX_MIXED {
            let gradients = body.gradients(&point.u);
            let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
            let made = self.factor(body.tangent_with(&gradients, &pressures), counts)?;
            let (d, dq) = self.solve(&made, &self.imbalance(share, &point.q, &net))?;
            counts.moves.push(largest(&d) / size);
            pressures = body.pressures_after(&gradients, &d);
            point = self.moved(&point, 1.0, (&d, &dq), (share, path));
            if largest(&d) <= self.last_step * size {
                return Ok((point, made));
            }
        }
        Err(IterationEnd::Setback(Setback::Slow))
    }

    /// Newton's iteration downhill with at most `most` positive definite tangents; with a measure, states on the way need not be stable.
    fn iterate(
        &self,
        search: Search<'_, 'a>,
        point: Point,
        most: usize,
        counts: &mut Counts,
    ) -> Result<(Point, Factored<'a>), IterationEnd> {
        counts.moves.clear();
        let (body, forces) = (self.body_at(search.share)?, self.forces_at(search.share));
        let settler = self.settler(&body, forces.as_ref());
        let now = settler.state(point.u);
        let imbalance = Imbalance {
            free: NodeFields::zeros(0, 1),
            pushes: DMatrix::zeros(0, 1),
            border: Border::none(0),
        };
        let mut descent = Descent {
            newton: self,
            search,
            settler,
            counts,
            now: Reached { state: now, q: point.q, work: 0.0 },
            tried: None,
            imbalance,
            step: (NodeFields::zeros(0, 1), DMatrix::zeros(0, 1)),
            own: None,
            since: f64::INFINITY,
            gain: f64::INFINITY,
            scale: 1.0,
            shift: 0.0,
            left: most,
            error: None,
        };
        let found = minimise(&mut descent, STEPS_OF_A_FACTOR * most, &mut 0);
        match descent.error {
            Some(error) => Err(IterationEnd::Solve(error)),
            None if found.is_err() && descent.left == 0 => Err(IterationEnd::Setback(Setback::Slow)),
            None if descent.shift > 0.0 => Err(IterationEnd::Setback(Setback::Unstable)),
            None => {
                found.map_err(IterationEnd::Setback)?;
                let Descent { own, now, since, search: Search { share, .. }, .. } = descent;
                let own = own.ok_or(IterationEnd::Setback(Setback::Unstable))?;
                let point = Point { u: now.state.u, q: now.q };
                if since > 0.0 && !self.is_stable_beside(&own, &point, share)? {
                    return Err(IterationEnd::Setback(Setback::Unstable));
                }
                Ok((point, own))
            }
        }
    }

    /// Whether the tangent at `point` is positive definite along the softest motion of the one of a state nearby: that motion alone may
    /// have lost its stiffness on so short a way. It is found by inverse iteration, and its curvature is Rayleigh's quotient.
    fn is_stable_beside(&self, made: &Factored<'_>, point: &Point, share: f64) -> Result<bool, IterationEnd> {
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let gradients = body.gradients(&point.u);
        let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
        let border = self.imbalance(share, &point.q, &net).border;
        let tangent = made.tangent(self.partition, &border)?;
        let nodes = self.partition.free.len();
        let mut free = NodeFields { nodes, columns: 1, data: scattered(3 * nodes) };
        let mut pushes = DMatrix::zeros(border.count(), 1);
        for _ in 0..INVERSE_STEPS {
            let (d, dq) = tangent.solve(&free, &pushes)?;
            let size = d.norms()[0];
            free = d.at(&self.partition.free);
            free.data.iter_mut().for_each(|x| *x /= size);
            pushes = dq / size;
        }
        let (d, dq) = tangent.solve(&free, &pushes)?;
        let mut force = NodeFields::zeros(point.u.nodes, 1);
        body.tangent(&gradients).multiply(&d, &mut force);
        Ok(d.dots(&force)[0] + dq.dot(&(&border.curvature * &dq)) > 0.0)
    }

    /// The stable state to which the energy falls from `point`, whose controlled nodes stand where they are at `share`, however far;
    /// `at_rest` is the least eigenvalue of the tangent at rest, N/m.
    pub(super) fn descend(
        &self,
        point: Point,
        (share, at_rest): (f64, f64),
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
        let own = Matrix3::from_diagonal_element(LEAST_SHIFT_FAR * at_rest);
        let (size, measure) = (largest(&point.u), Some(vec![own; point.u.nodes]));
        let search = Search { share, path, size, measure, before: None };
        Ok(self.iterate(search, point, MOST_FACTORS_FAR, counts)?.0)
    }
}

/// A search for an equilibrium at one share of the way.
pub(super) struct Search<'a, 's> {
    share: f64,
    path: &'a Path<'a>,
    /// Size of the displacements, m.
    size: f64,
    /// Addition to tangents that are not positive definite on the way; `None`: such a tangent ends the search.
    measure: Option<Vec<Matrix3<f64>>>,
    /// The tangent of a state nearby, for the first steps.
    before: Option<&'a Factored<'s>>,
}

/// A state on the way down, with the work of what pushes, J, since the way began.
struct Reached {
    state: State,
    q: Vec<f64>,
    work: f64,
}

/// The energy of a body at one share of its way.
struct Descent<'a, 's> {
    newton: &'a Newton<'s>,
    search: Search<'a, 's>,
    settler: Settler<'a>,
    counts: &'a mut Counts,
    now: Reached,
    tried: Option<Reached>,
    imbalance: Imbalance,
    /// Displacements and motions of the step.
    step: (NodeFields, DMatrix<f64>),
    /// The tangent that was made last, and how far the body has moved since, in parts of its size.
    own: Option<Factored<'s>>,
    since: f64,
    /// The gain of the step before.
    gain: f64,
    /// The least part of the measure that is tried, and the part that the last tangent needed: along a valley that is nearly flat, as
    /// that of a round column which buckles to any side, a body goes far with a small one only.
    scale: f64,
    shift: f64,
    /// Positive definite tangents that it may factorise still.
    left: usize,
    error: Option<SolveError>,
}

impl Descent<'_, '_> {
    /// K with a shift.
    fn tangent(&self, shift: f64) -> StiffnessMatrix {
        let mut k = self.settler.body.tangent(&self.now.state.gradients);
        if let Some(measure) = self.search.measure.as_ref().filter(|_| shift > 0.0) {
            k.diagonal.iter_mut().zip(measure).for_each(|(own, more)| *own += more * shift);
        }
        k
    }

    /// The state after a part of the step.
    fn after(&self, part: f64) -> Point {
        let Search { share, path, .. } = self.search;
        let now = Point { u: self.now.state.u.clone(), q: self.now.q.clone() };
        self.newton.moved(&now, part, (&self.step.0, &self.step.1), (share, path))
    }

    /// -g·d of a step.
    fn gain_of(&self, (d, dq): &(NodeFields, DMatrix<f64>)) -> f64 {
        let free = d.at(&self.newton.partition.free);
        self.imbalance.free.dots(&free)[0] + self.imbalance.pushes.dot(dq)
    }

    /// The work of what pushes between two states, by the trapezoidal rule, J.
    fn work(&self, q: &[f64]) -> f64 {
        let Some(pushed) = self.newton.pushed() else { return 0.0 };
        let at = |q: &[f64]| pushed.forces(self.search.share, q);
        let (before, after) = (at(&self.now.q), at(q));
        let mean = before.iter().zip(&after).map(|(before, after)| 0.5 * (before + after));
        mean.zip(q.iter().zip(&self.now.q)).map(|(force, (after, before))| force * (after - before)).sum()
    }
}

impl Energy for Descent<'_, '_> {
    const TRIALS: usize = 8;

    fn evaluate(&mut self) -> Option<f64> {
        let net = self.settler.net_forces(&self.now.state.gradients);
        self.imbalance = self.newton.imbalance(self.search.share, &self.now.q, &net);
        Some(self.now.state.energy - self.now.work)
    }

    fn rounding(&self) -> f64 {
        self.settler.rounding(&self.now.state)
    }

    /// The factor of an earlier state serves as long as its steps win what they promise; the last one is made with a factor of its own.
    fn serves(&mut self) -> bool {
        let is_near = self.counts.moves.last().is_none_or(|last| *last <= NEAR_END);
        let own = self.own.as_ref().filter(|_| self.shift == 0.0 && is_near);
        let Some(Ok(step)) = own.or(self.search.before).map(|made| self.newton.solve(made, &self.imbalance))
        else {
            return false;
        };
        let is_end = largest(&step.0) <= self.newton.last_step * self.search.size && self.since > SAME;
        let serves = self.gain_of(&step) <= EASED_GAIN * self.gain && !is_end;
        self.step = step;
        serves
    }

    fn factorise(&mut self, shift: f64) -> bool {
        if self.error.is_some() || self.left == 0 || shift > 0.0 && self.search.measure.is_none() {
            return false;
        }
        self.own = None;
        self.search.before = None;
        let shift = self.scale * shift;
        self.shift = shift;
        let solved = self
            .newton
            .factor(self.tangent(shift), self.counts)
            .and_then(|made| Ok((self.newton.solve(&made, &self.imbalance)?, made)));
        match solved {
            Ok((step, made)) => {
                (self.step, self.own, self.since) = (step, Some(made), 0.0);
                self.left -= 1;
                if shift > 0.0 {
                    self.scale = (shift / EASED).clamp(LEAST_SCALE, 1.0);
                }
            }
            Err(IterationEnd::Solve(error)) => self.error = Some(error),
            Err(IterationEnd::Setback(_)) => return false,
        }
        self.error.is_none()
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        let size = self.search.size;
        let longest = largest(&self.step.0);
        self.counts.moves.push(longest / size);
        self.gain = self.gain_of(&self.step);
        let shorter = if self.since == 0.0 { 1.0 } else { SHORTER };
        let is_last = longest <= shorter * self.newton.last_step * size && self.since <= SAME;
        Step { gain: self.gain, is_last }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let Point { u, q } = self.after(share);
        let work = self.now.work + self.work(&q);
        let tried = self.tried.insert(Reached { state: self.settler.state(u), q, work });
        Some(tried.state.energy - tried.work)
    }

    fn accept(&mut self) {
        if let Some(tried) = self.tried.take() {
            self.since += largest(&sum(&tried.state.u, -1.0, &self.now.state.u)) / self.search.size;
            self.now = tried;
        }
    }

    /// The next step is found with the tangent of this state.
    fn renew(&mut self) -> bool {
        let is_old = self.since > 0.0 || self.own.is_none();
        self.gain = 0.0;
        is_old
    }

    /// The mode of the shifted tangent, which has the same modes if the measure is the same everywhere.
    fn find_mode(&mut self) -> Option<f64> {
        let own = self.own.as_ref()?;
        let tangent = own.tangent(self.newton.partition, &self.imbalance.border).ok()?;
        let (_, mode) = tangent.least_modes(ROUGH).ok()?;
        let dq = self.newton.motions_of(&mode, self.search.share, &self.now.q);
        let first = FIRST_WAY * self.newton.extent() / largest(&mode);
        self.step = (mode, dq);
        Some(first)
    }

    fn finish(&mut self, energy: f64, _gain: f64) -> Option<f64> {
        Point { u: self.now.state.u, q: self.now.q } = self.after(1.0);
        Some(energy)
    }
}
