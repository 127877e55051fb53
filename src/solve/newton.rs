//! Static equilibrium at large strain: Newton's iteration on f(u) = 0 at the free nodes, at one share of the way of the controlled
//! ones.
//!
//! In: hyperelastic tetrahedra, the split of the nodes, a path that says where the controlled nodes stand at every share 0 to 1 of the
//! way, and the loads there. Out: an equilibrium. Each load step is predicted along the tangent, then iterated with K(u) d = -f(u),
//! each d shortened until the energy falls (Nocedal and Wright, Numerical Optimization, 2nd ed., algorithm 3.2). The tangent must be
//! positive definite throughout, so what is found is a stable equilibrium. Pieces that are pushed and not held ([`Pushed`]) move
//! along. `branch` leads from step to step, `arc` beyond critical states.

use super::error::SolveError;
use super::minimise::{Energy, Setback, Step, minimise};
use super::pushed::{Border, Pushed, Tangent, matrix};
use super::settle::{Settler, State, largest, sum};
use super::solver::LinearSolver;
use super::stability::{EXACT, ROUGH, Stability, twins, zero_at};
use crate::base::progress::Silent;
use crate::fem::{Hyperelastic, NodeFields, Partition, StiffnessMatrix};
use nalgebra::{DMatrix, Matrix3};
use std::ops::Deref;
use std::sync::Arc;

/// [`Newton::last_step`] of an equilibrium that others are measured against.
pub const LAST_STEP: f64 = 1e-9;
const MAX_ITERATIONS: usize = 25;
/// Iterations of a search far from an equilibrium.
const MAX_FAR: usize = 200;
const MAX_MIXED: usize = 10;
/// What is first added to a tangent that is not positive definite: a part of the resting body's diagonal, or of its least eigenvalue.
const LEAST_SHIFT: f64 = 1e-3;
const LEAST_SHIFT_FAR: f64 = 0.25;
/// Part of one shift with which the next iteration begins, and the least of all.
const EASED: f64 = 16.0;
const LEAST_SCALE: f64 = 1e-8;
/// The first way along a mode, in parts of the cube root of the body's volume.
const FIRST_WAY: f64 = 0.25;
/// Largest change of F in a prediction under loads: a beam turns by some 40°.
const LONGEST: f64 = 1.0;
/// Shares of the way below which a prediction may be as long as it is.
const SHORT: f64 = 1.0 / 256.0;
pub(super) const SHORTEST_STEP: f64 = 1.0 / 4096.0;
/// A least eigenvalue below this part of that at rest is on its way to zero, as is one that comes to zero within this share of the way.
const CRITICAL: f64 = 0.2;
const NEAR: f64 = 2.0 * SHORTEST_STEP;
/// How far back on the way the equilibrium is that the least eigenvalue is compared with.
const BEFORE: f64 = 16.0 * SHORTEST_STEP;

/// The displacements of the controlled nodes at a share of the way, written into one column over all nodes.
pub type Path<'a> = dyn Fn(f64, &mut NodeFields) + 'a;

/// The problem that Newton's method solves.
pub struct Newton<'a> {
    pub body: &'a Hyperelastic,
    pub partition: &'a Partition,
    /// The solver for K at the free nodes; `None` where all are controlled.
    pub solver: Option<&'a dyn LinearSolver>,
    /// `None` where nothing acts but what holds the controlled nodes.
    pub loads: Option<Loads<'a>>,
    /// The iteration ends with a full step in which no node moves by more than this part of the largest displacement; that
    /// step still squares the error.
    pub last_step: f64,
}

/// The loads on a body on its way.
#[derive(Clone, Copy)]
pub struct Loads<'a> {
    /// Forces at a share of the way that keep their directions, one column over all nodes, N.
    pub forces: &'a dyn Fn(f64) -> NodeFields,
    /// The body at a share of the way; `None` where it is as warm as [`Newton::body`] from beginning to end.
    pub warm: Option<&'a WarmBody<'a>>,
    /// Controlled nodes that are pushed.
    pub pushed: Option<&'a dyn Pushed>,
}

/// The body, as warm as it is at a share of the way.
pub type WarmBody<'a> = dyn Fn(f64) -> Result<Arc<Hyperelastic>, SolveError> + 'a;

/// A state: displacements of all nodes, one column, m, and motions of what is pushed.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    pub u: NodeFields,
    pub q: Vec<f64>,
}

/// A state in equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// Displacements of all nodes, one column, m.
    pub u: NodeFields,
    /// Motions of what is pushed.
    pub q: Vec<f64>,
    /// Strain energy, J.
    pub energy: f64,
    /// f less the loads over all nodes, N: at the controlled ones the forces that hold them, at the free ones the residual.
    pub forces: NodeFields,
    /// F - I at every point of the elements.
    pub gradients: Vec<Matrix3<f64>>,
    /// ‖f at free nodes‖₂ / ‖f at controlled nodes‖₂; 0 where nothing is held.
    pub residual: f64,
    pub counts: Counts,
}

/// Counts of the work of an equilibrium.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Counts {
    /// Load steps made.
    pub steps: usize,
    /// Load steps that failed and were halved.
    pub halved: usize,
    /// One for each load step's prediction and for each of Newton's iterations.
    pub factorizations: usize,
    /// max |d| of the iterations of the last load step, against the largest displacement: each about the square of the
    /// one before.
    pub moves: Vec<f64>,
}

/// The reason why an iteration ended early.
#[derive(Debug)]
pub(super) enum IterationEnd {
    Setback(Setback),
    Solve(SolveError),
}

impl From<SolveError> for IterationEnd {
    fn from(error: SolveError) -> IterationEnd {
        match error {
            // Too ill-conditioned to be solved is as good as singular.
            SolveError::NotPositiveDefinite { .. }
            | SolveError::Factor { .. }
            | SolveError::Inexact { .. } => IterationEnd::Setback(Setback::Unstable),
            other => IterationEnd::Solve(other),
        }
    }
}

/// The body at a share of the way.
pub(super) enum AtShare<'a> {
    Same(&'a Hyperelastic),
    Warm(Arc<Hyperelastic>),
}

impl Deref for AtShare<'_> {
    type Target = Hyperelastic;

    fn deref(&self) -> &Hyperelastic {
        match self {
            AtShare::Same(body) => body,
            AtShare::Warm(body) => body,
        }
    }
}

/// What the free nodes and the pushed pieces lack of their balance, and the border of the tangent there.
pub(super) struct Imbalance {
    /// Loads less f at the free nodes.
    pub free: NodeFields,
    /// Q - Jᵀ f, one column.
    pub pushes: DMatrix<f64>,
    pub border: Border,
}

impl<'a> Newton<'a> {
    /// The equilibrium with the controlled nodes as `path` writes them, in one load step from the equilibrium `u`; `None` where
    /// that step fails. Loads are those at the end of the way.
    pub fn step_to(&self, u: &NodeFields, path: &Path<'_>) -> Result<Option<Equilibrium>, SolveError> {
        let mut counts = Counts::default();
        match self.step(&self.start(u.clone()), [0.0, 1.0], path, &mut counts) {
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
        let Some(solver) = self.solver else { return self.judge(start, 1.0, counts).map(Some) };
        let held = |_: f64, _: &mut NodeFields| {};
        let search = Search { solver, share: 1.0, path: &held, size: largest(&start.u), measure: None };
        if self.body.is_nearly_incompressible() {
            match self.iterate_mixed(&search, &start.u, start.clone(), &mut counts) {
                Ok(found) => return self.judge(found, 1.0, counts).map(Some),
                Err(IterationEnd::Setback(_)) => {}
                Err(IterationEnd::Solve(error)) => return Err(error),
            }
        }
        let rest = self.body.tangent(&self.body.gradients(&NodeFields::zeros(start.u.nodes, 1)));
        let measure = rest.diagonal.iter().map(|own| own * LEAST_SHIFT).collect();
        let search = Search { measure: Some(measure), ..search };
        match self.iterate(&search, start, MAX_ITERATIONS, &mut counts) {
            Ok(found) => self.judge(found, 1.0, counts).map(Some),
            Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// A state without motions of what is pushed.
    pub(super) fn start(&self, u: NodeFields) -> Point {
        Point { u, q: vec![0.0; self.pushed().map_or(0, Pushed::count)] }
    }

    /// Length scale of the body, m: the cube root of its volume.
    pub(super) fn extent(&self) -> f64 {
        self.body.points.volume.iter().sum::<f64>().cbrt()
    }

    fn pushed(&self) -> Option<&'a dyn Pushed> {
        self.loads.and_then(|loads| loads.pushed)
    }

    pub(super) fn body_at(&self, share: f64) -> Result<AtShare<'a>, SolveError> {
        match self.loads.and_then(|loads| loads.warm) {
            Some(warm) => Ok(AtShare::Warm(warm(share)?)),
            None => Ok(AtShare::Same(self.body)),
        }
    }

    pub(super) fn forces_at(&self, share: f64) -> Option<NodeFields> {
        self.loads.map(|loads| (loads.forces)(share))
    }

    /// Puts the controlled nodes where they are at `share`.
    pub(super) fn place(&self, share: f64, path: &Path<'_>, point: &mut Point) {
        path(share, &mut point.u);
        if let Some(pushed) = self.pushed() {
            pushed.place(share, &point.q, &mut point.u);
        }
    }

    /// The imbalance under net forces `net` over all nodes.
    pub(super) fn imbalance(&self, share: f64, q: &[f64], net: &NodeFields) -> Imbalance {
        let mut free = net.at(&self.partition.free);
        free.data.iter_mut().for_each(|value| *value = -*value);
        let Some(pushed) = self.pushed() else {
            return Imbalance { free, pushes: DMatrix::zeros(0, 1), border: Border::none(net.nodes) };
        };
        let border = Border::new(pushed, share, q, net);
        let pushes = DMatrix::from_vec(q.len(), 1, pushed.forces(share, q));
        let pushes = pushes - border.motions.tr_mul(&matrix(net));
        Imbalance { free, pushes, border }
    }

    /// Solves with the positive definite tangent K.
    fn solve(
        &self,
        solver: &dyn LinearSolver,
        k: &StiffnessMatrix,
        imbalance: &Imbalance,
        counts: &mut Counts,
    ) -> Result<(NodeFields, DMatrix<f64>), IterationEnd> {
        counts.factorizations += 1;
        let a = self.partition.a(k);
        let factor = solver.factor(&a, &Silent)?;
        let tangent = Tangent::new(self.partition, k, factor.as_ref(), &imbalance.border)?;
        if tangent.negative > 0 {
            return Err(IterationEnd::Setback(Setback::Unstable));
        }
        Ok(tangent.solve(&imbalance.free, &imbalance.pushes)?)
    }

    /// Runs `judge` with the tangent of a stable state.
    fn with_tangent<T>(
        &self,
        point: &Point,
        share: f64,
        judge: impl FnOnce(&StiffnessMatrix, &Tangent<'_>) -> Result<T, IterationEnd>,
    ) -> Result<T, IterationEnd> {
        let solver = self.solver.ok_or(IterationEnd::Setback(Setback::Unstable))?;
        let body = self.body_at(share)?;
        let gradients = body.gradients(&point.u);
        let forces = self.forces_at(share);
        let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
        let k = body.tangent(&gradients);
        let a = self.partition.a(&k);
        let factor = solver.factor(&a, &Silent)?;
        let border = self.imbalance(share, &point.q, &net).border;
        judge(&k, &Tangent::new(self.partition, &k, factor.as_ref(), &border)?)
    }

    /// The least eigenvalues of the tangent of a stable state, N/m, with the mode of the first.
    fn modes(
        &self,
        point: &Point,
        share: f64,
        tolerance: f64,
    ) -> Result<(Vec<f64>, NodeFields), IterationEnd> {
        self.with_tangent(point, share, |_, tangent| Ok(tangent.least_modes(tolerance)?))
    }

    /// The least eigenvalue of the tangent of a stable equilibrium at `share`, N/m, to a thousandth, and its mode over all nodes, of
    /// length 1; `None` where nothing is free.
    pub fn least_mode(&self, point: &Point, share: f64) -> Result<Option<(f64, NodeFields)>, SolveError> {
        if self.solver.is_none() {
            return Ok(None);
        }
        match self.modes(point, share, ROUGH) {
            Ok((values, mode)) => Ok(values.first().map(|least| (*least, mode))),
            Err(IterationEnd::Solve(error)) => Err(error),
            Err(IterationEnd::Setback(_)) => Ok(None),
        }
    }

    /// The motion of what is pushed that has least stiffness at `share`, and that stiffness in parts of the largest, both of the nodes'
    /// motions; `None` where nothing is pushed.
    pub fn loosest(&self, point: &Point, share: f64) -> Result<Option<(usize, f64)>, SolveError> {
        if self.pushed().is_none() || self.solver.is_none() {
            return Ok(None);
        }
        match self.with_tangent(point, share, |_, tangent| Ok(tangent.loosest())) {
            Ok(loosest) => Ok(loosest),
            Err(IterationEnd::Solve(error)) => Err(error),
            Err(IterationEnd::Setback(_)) => Ok(None),
        }
    }

    /// The stability of the equilibrium at `share` of the path, compared with that at rest and an earlier one of `trail`.
    pub(super) fn stability(
        &self,
        point: &Point,
        share: f64,
        trail: &[(f64, Point)],
        path: &Path<'_>,
    ) -> Result<Stability, IterationEnd> {
        let least = |point: &Point, share: f64| -> Result<f64, IterationEnd> {
            Ok(self.modes(point, share, EXACT)?.0[0])
        };
        let ahead = |k: &StiffnessMatrix, tangent: &Tangent<'_>| {
            let (free, pushes, moved) = self.drift(point, share, SHORTEST_STEP, k, path)?;
            let (d, _) = tangent.solve(&free, &pushes)?;
            let (values, mode) = tangent.least_modes(EXACT)?;
            Ok((values, mode, sum(&d, 1.0, &moved)))
        };
        let (values, mode, ahead) = self.with_tangent(point, share, ahead)?;
        // The way of the free nodes alone: the controlled ones go where they are led.
        let of = |fields: &NodeFields| fields.at(&self.partition.free);
        let driven = of(&mode).dots(&of(&ahead))[0].abs() / of(&ahead).norms()[0].max(f64::MIN_POSITIVE);
        let rest = least(&self.start(NodeFields::zeros(point.u.nodes, 1)), 0.0)?;
        let (part, modes) = (values[0] / rest, twins(&values));
        let mut stability =
            Stability { least: part, at_rest: rest, zero_at: None, is_critical: false, mode, modes, driven };
        let earlier = trail.iter().rev().find(|(at, _)| share - at >= BEFORE).or(trail.first());
        if let Some((at, point)) = earlier {
            stability.zero_at = zero_at((*at, least(point, *at)?), (share, values[0]), stability.snaps());
        }
        let is_near = |zero: f64| part < CRITICAL || zero - share < NEAR;
        stability.is_critical = stability.zero_at.is_some_and(is_near);
        Ok(stability)
    }

    /// The forces by which a state at `share` lacks balance a `step` further on the way, to first order, at the free nodes and along the
    /// motions, and the displacements of the controlled nodes on that step.
    pub(super) fn drift(
        &self,
        point: &Point,
        share: f64,
        step: f64,
        k: &StiffnessMatrix,
        path: &Path<'_>,
    ) -> Result<(NodeFields, DMatrix<f64>, NodeFields), SolveError> {
        let mut moved = point.clone();
        self.place(share + step, path, &mut moved);
        let moved = sum(&moved.u, -1.0, &point.u);
        let mut change = NodeFields::zeros(moved.nodes, 1);
        k.multiply(&moved, &mut change);
        if self.loads.is_none() {
            let imbalance = self.imbalance(share, &point.q, &change);
            return Ok((imbalance.free, imbalance.pushes, moved));
        }
        let at = |share: f64, more: Option<&NodeFields>| -> Result<Imbalance, SolveError> {
            let (body, forces) = (self.body_at(share)?, self.forces_at(share));
            let net = self.settler(&body, forces.as_ref()).net_forces(&body.gradients(&point.u));
            Ok(self.imbalance(share, &point.q, &more.map_or(net.clone(), |more| sum(&net, 1.0, more))))
        };
        let (before, after) = (at(share, None)?, at(share + step, Some(&change))?);
        Ok((sum(&after.free, -1.0, &before.free), after.pushes - before.pushes, moved))
    }

    /// One load step: from the equilibrium at a share of the way to that with the controlled nodes where `path` has them at
    /// `target`.
    pub(super) fn step(
        &self,
        from: &Point,
        [share, target]: [f64; 2],
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
        let mut moved = from.clone();
        self.place(target, path, &mut moved);
        let is_idle = moved == *from && self.loads.is_none();
        let Some(solver) = self.solver.filter(|_| !is_idle) else { return Ok(moved) };
        let predicted = self.predict(solver, from, [share, target], (path, &moved), counts)?;
        let is_loaded = self.loads.is_some();
        let size = largest(&from.u).max(largest(if is_loaded { &predicted.u } else { &moved.u }));
        let body = self.body_at(target)?;
        if is_loaded && target - share > SHORT {
            let (here, there) = (body.gradients(&from.u), body.gradients(&predicted.u));
            if here.iter().zip(&there).any(|(here, there)| (there - here).norm() > LONGEST) {
                return Err(IterationEnd::Setback(Setback::Slow));
            }
        }
        let search = Search { solver, share: target, path, size, measure: None };
        if body.is_nearly_incompressible() {
            match self.iterate_mixed(&search, &from.u, predicted.clone(), counts) {
                // From the same prediction, downhill.
                Err(IterationEnd::Setback(_)) => {}
                done => return done,
            }
        }
        self.iterate(&search, predicted, MAX_ITERATIONS, counts)
    }

    /// The prediction keeps the free nodes in balance to first order: A d = loads - f - B Δb, where loads and f are the same
    /// but for what has changed. A is that of the equilibrium: as warm as it was there.
    fn predict(
        &self,
        solver: &dyn LinearSolver,
        from: &Point,
        [share, target]: [f64; 2],
        (path, moved): (&Path<'_>, &Point),
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
        let before = self.body_at(share)?;
        let k = before.tangent(&before.gradients(&from.u));
        let mut net = NodeFields::zeros(from.u.nodes, 1);
        k.multiply(&sum(&moved.u, -1.0, &from.u), &mut net);
        if self.loads.is_some() {
            let (after, forces) = (self.body_at(target)?, self.forces_at(target));
            let own = self.settler(&after, forces.as_ref()).net_forces(&after.gradients(&from.u));
            net = sum(&net, 1.0, &own);
        }
        let (d, dq) = self.solve(solver, &k, &self.imbalance(target, &from.q, &net), counts)?;
        Ok(self.moved(moved, 1.0, (&d, &dq), (target, path)))
    }

    /// A state after a part of a step, with the controlled nodes in their places.
    pub(super) fn moved(
        &self,
        from: &Point,
        part: f64,
        (d, dq): (&NodeFields, &DMatrix<f64>),
        (share, path): (f64, &Path<'_>),
    ) -> Point {
        let q = from.q.iter().zip(dq.iter()).map(|(q, d)| q + part * d).collect();
        let mut moved = Point { u: sum(&from.u, part, d), q };
        if self.pushed().is_some() {
            self.place(share, path, &mut moved);
        }
        moved
    }

    /// The body under fixed loads.
    pub(super) fn settler<'s>(
        &'s self,
        body: &'s Hyperelastic,
        loads: Option<&'s NodeFields>,
    ) -> Settler<'s> {
        Settler { body, partition: self.partition, loads }
    }

    /// Newton's iteration from the equilibrium `before` by way of `point`, with the pressures as unknowns of their own that
    /// are eliminated from each linear system: p = λ θ holds at its end alone, so that a step's false dilatations, which
    /// are of its second order, are not multiplied by λ in the tangent (Magisano, Leonetti and Garcea, Comput. Methods
    /// Appl. Mech. Engng. 313, 2017, 986-1005). The energy rises on the way; a tangent that is not positive definite ends
    /// the iteration, and the last one is that of the energy.
    fn iterate_mixed(
        &self,
        search: &Search<'_>,
        before: &NodeFields,
        mut point: Point,
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
        counts.moves.clear();
        let Search { solver, share, path, size, .. } = *search;
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let mut pressures = body.pressures_after(&body.gradients(before), &sum(&point.u, -1.0, before));
        for _ in 0..MAX_MIXED {
            let gradients = body.gradients(&point.u);
            let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
            let k = body.tangent_with(&gradients, &pressures);
            let (d, dq) = self.solve(solver, &k, &self.imbalance(share, &point.q, &net), counts)?;
            counts.moves.push(largest(&d) / size);
            pressures = body.pressures_after(&gradients, &d);
            point = self.moved(&point, 1.0, (&d, &dq), (share, path));
            if largest(&d) <= self.last_step * size {
                return Ok(point);
            }
        }
        Err(IterationEnd::Setback(Setback::Slow))
    }

    /// Newton's iteration downhill in at most `most` iterations; with a measure, what is found is stable, and states on the way need
    /// not be.
    fn iterate(
        &self,
        search: &Search<'_>,
        point: Point,
        most: usize,
        counts: &mut Counts,
    ) -> Result<Point, IterationEnd> {
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
            scale: 1.0,
            shift: 0.0,
            error: None,
        };
        let found = minimise(&mut descent, most, &mut 0);
        match descent.error {
            Some(error) => Err(IterationEnd::Solve(error)),
            None if descent.shift > 0.0 => Err(IterationEnd::Setback(Setback::Unstable)),
            None => found
                .map(|_| Point { u: descent.now.state.u, q: descent.now.q })
                .map_err(IterationEnd::Setback),
        }
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
        let solver = self.solver.ok_or(IterationEnd::Setback(Setback::Unstable))?;
        let own = Matrix3::from_diagonal_element(LEAST_SHIFT_FAR * at_rest);
        let (size, measure) = (largest(&point.u), Some(vec![own; point.u.nodes]));
        self.iterate(&Search { solver, share, path, size, measure }, point, MAX_FAR, counts)
    }

    /// The energy of a state less the work of the loads, and of what pushes since the motions were `q`, J.
    pub(super) fn energy(&self, point: &Point, q: &[f64], share: f64) -> Result<f64, SolveError> {
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let energy = self.settler(&body, forces.as_ref()).state(point.u.clone()).energy;
        let pushes = self.pushed().map_or_else(Vec::new, |pushed| pushed.forces(share, q));
        let work =
            pushes.iter().zip(point.q.iter().zip(q)).map(|(force, (after, before))| force * (after - before));
        Ok(energy - work.sum::<f64>())
    }

    /// The state at `target` that follows on a stable one at `share` to first order, without a part along `mode`; `None` where the
    /// tangent is not positive definite.
    pub(super) fn aside(
        &self,
        (point, share): (&Point, f64),
        target: f64,
        mode: &NodeFields,
        path: &Path<'_>,
    ) -> Result<Option<Point>, SolveError> {
        let ahead = |k: &StiffnessMatrix, tangent: &Tangent<'_>| {
            let (free, pushes, moved) = self.drift(point, share, target - share, k, path)?;
            let (d, dq) = tangent.solve(&free, &pushes)?;
            Ok((sum(&d, 1.0, &moved), dq))
        };
        match self.with_tangent(point, share, ahead) {
            Ok((d, dq)) => {
                let part = mode.dots(&d)[0] / mode.dots(mode)[0];
                let moved = self.moved(point, 1.0, (&d, &dq), (target, path));
                let mut aside = self.along(&moved, -part, mode, (target, path));
                self.place(target, path, &mut aside);
                Ok(Some(aside))
            }
            Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// The motions of what is pushed in a mode.
    fn motions_of(&self, mode: &NodeFields, share: f64, q: &[f64]) -> DMatrix<f64> {
        let Some(pushed) = self.pushed() else { return DMatrix::zeros(0, 1) };
        let motions = matrix(&pushed.motions(share, q));
        let dq = motions.tr_mul(&motions).lu().solve(&motions.tr_mul(&matrix(mode)));
        dq.unwrap_or_else(|| DMatrix::zeros(q.len(), 1))
    }

    /// A state moved by `size` along a mode, with what is pushed.
    pub(super) fn along(
        &self,
        point: &Point,
        size: f64,
        mode: &NodeFields,
        (share, path): (f64, &Path<'_>),
    ) -> Point {
        let dq = self.motions_of(mode, share, &point.q);
        self.moved(point, size, (mode, &dq), (share, path))
    }

    /// The equilibrium of a state that is one at `share`, with its energy and forces.
    pub fn judge(&self, point: Point, share: f64, counts: Counts) -> Result<Equilibrium, SolveError> {
        let (body, forces) = (self.body_at(share)?, self.forces_at(share));
        let gradients = body.gradients(&point.u);
        let forces = self.settler(&body, forces.as_ref()).net_forces(&gradients);
        let norm = |nodes: &[u32]| forces.at(nodes).norms()[0];
        let (left, held) = (norm(&self.partition.free), norm(&self.partition.controlled));
        let residual = if held == 0.0 { 0.0 } else { left / held };
        let Point { u, q } = point;
        Ok(Equilibrium { energy: body.energy(&gradients), u, q, forces, gradients, residual, counts })
    }
}

/// A search for an equilibrium at one share of the way.
pub(super) struct Search<'a> {
    solver: &'a dyn LinearSolver,
    share: f64,
    path: &'a Path<'a>,
    /// Size of the displacements, m.
    size: f64,
    /// What is added to tangents that are not positive definite on the way; `None`: such a tangent ends the search.
    measure: Option<Vec<Matrix3<f64>>>,
}

/// A state on the way down, with the work of what pushes, J, since the way began.
struct Reached {
    state: State,
    q: Vec<f64>,
    work: f64,
}

/// The energy of a body at one share of its way.
struct Descent<'a> {
    newton: &'a Newton<'a>,
    search: &'a Search<'a>,
    settler: Settler<'a>,
    counts: &'a mut Counts,
    now: Reached,
    tried: Option<Reached>,
    imbalance: Imbalance,
    /// Displacements and motions of the step.
    step: (NodeFields, DMatrix<f64>),
    /// The least part of the measure that is tried, and the part that the last tangent needed: along a valley that is nearly flat, as
    /// that of a round column which buckles to any side, a body goes far with a small one only.
    scale: f64,
    shift: f64,
    error: Option<SolveError>,
}

impl Descent<'_> {
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
        let Search { share, path, .. } = *self.search;
        let now = Point { u: self.now.state.u.clone(), q: self.now.q.clone() };
        self.newton.moved(&now, part, (&self.step.0, &self.step.1), (share, path))
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

impl Energy for Descent<'_> {
    const TRIALS: usize = 8;

    fn evaluate(&mut self) -> Option<f64> {
        let net = self.settler.net_forces(&self.now.state.gradients);
        self.imbalance = self.newton.imbalance(self.search.share, &self.now.q, &net);
        Some(self.now.state.energy - self.now.work)
    }

    fn rounding(&self) -> f64 {
        self.settler.rounding(&self.now.state)
    }

    fn factorise(&mut self, shift: f64) -> bool {
        if shift > 0.0 && self.search.measure.is_none() {
            return false;
        }
        let shift = self.scale * shift;
        let k = self.tangent(shift);
        self.shift = shift;
        match self.newton.solve(self.search.solver, &k, &self.imbalance, self.counts) {
            Ok(step) => {
                self.step = step;
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
        let (d, dq) = &self.step;
        let longest = largest(d);
        self.counts.moves.push(longest / self.search.size);
        let gain = self.imbalance.free.dots(&d.at(&self.newton.partition.free))[0];
        let gain = gain + self.imbalance.pushes.dot(dq);
        Step { gain, is_last: longest <= self.newton.last_step * self.search.size }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let Point { u, q } = self.after(share);
        let work = self.now.work + self.work(&q);
        let tried = self.tried.insert(Reached { state: self.settler.state(u), q, work });
        Some(tried.state.energy - tried.work)
    }

    fn accept(&mut self) {
        if let Some(tried) = self.tried.take() {
            self.now = tried;
        }
    }

    /// The mode of the shifted tangent, which has the same modes if the measure is the same everywhere.
    fn find_mode(&mut self) -> Option<f64> {
        let Newton { partition, .. } = self.newton;
        let k = self.tangent(self.shift);
        let a = partition.a(&k);
        let factor = self.search.solver.factor(&a, &Silent).ok()?;
        let tangent = Tangent::new(partition, &k, factor.as_ref(), &self.imbalance.border).ok()?;
        let (_, mode) = tangent.least_modes(ROUGH).ok()?;
        self.counts.factorizations += 1;
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
