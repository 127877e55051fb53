//! Static equilibrium at large strain, f(u) = 0 at the free nodes: the problem, its tangents, and the stability of what is found.
//!
//! In: hyperelastic tetrahedra, the split of the nodes, a path that says where the controlled nodes stand at every share 0 to 1 of the
//! way, and the loads there. Out: equilibria. `load_step` leads to the next one, `branch` from step to step, `arc` beyond critical
//! states. Pieces that are pushed and not held ([`Pushed`]) move along.

use super::error::SolveError;
use super::factored::Factored;
use super::minimise::Setback;
use super::pushed::{Border, Pushed, Tangent, matrix};
use super::settle::{Settler, sum};
use super::solver::LinearSolver;
use super::stability::{EXACT, Stability, twins, zero_at};
use crate::base::progress::Silent;
use crate::fem::{Hyperelastic, NodeFields, Partition, StiffnessMatrix};
use nalgebra::{DMatrix, Matrix3};
use std::ops::Deref;
use std::sync::Arc;

/// [`Newton::last_step`] of an equilibrium that others are measured against.
pub const LAST_STEP: f64 = 1e-9;
pub(super) const SHORTEST_STEP: f64 = 1.0 / 4096.0;
/// A least eigenvalue below this part of that at rest is on its way to zero, as is one that comes to zero within this share of the way.
const CRITICAL: f64 = 0.2;
const NEAR: f64 = 2.0 * SHORTEST_STEP;
/// A least eigenvalue below this part of that at rest is too near to zero to judge the mode by: the least imperfection of the mesh then
/// drives the body along it, and its twin is many times stiffer.
const TOO_NEAR: f64 = 1e-4;
/// Distance on the way back to the equilibrium with which the least eigenvalue is compared.
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
    /// The iteration ends with a full step in which no node moves by more than this part of the largest displacement.
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
    pub factorizations: usize,
    /// max |d| of the iterations of the last load step, against the largest displacement.
    pub moves: Vec<f64>,
}

impl Counts {
    /// Adds the work of another way.
    pub fn add(&mut self, earlier: &Counts) {
        self.steps += earlier.steps;
        self.halved += earlier.halved;
        self.factorizations += earlier.factorizations;
    }
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
            | SolveError::Inexact { .. }
            | SolveError::Loose => IterationEnd::Setback(Setback::Unstable),
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

/// Forces that the free nodes and the pushed pieces lack of their balance, and the border of the tangent there.
pub(super) struct Imbalance {
    /// Loads less f at the free nodes.
    pub free: NodeFields,
    /// Q - Jᵀ f, one column.
    pub pushes: DMatrix<f64>,
    pub border: Border,
}

impl<'a> Newton<'a> {
    /// A state without motions of what is pushed.
    pub(super) fn start(&self, u: NodeFields) -> Point {
        Point { u, q: vec![0.0; self.pushed().map_or(0, Pushed::count)] }
    }

    /// Length scale of the body, m: the cube root of its volume.
    pub(super) fn extent(&self) -> f64 {
        self.body.points.volume.iter().sum::<f64>().cbrt()
    }

    pub(super) fn pushed(&self) -> Option<&'a dyn Pushed> {
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

    /// Factorises the positive definite tangent K.
    pub(super) fn factor(
        &self,
        k: StiffnessMatrix,
        counts: &mut Counts,
    ) -> Result<Factored<'a>, IterationEnd> {
        let solver = self.solver.ok_or(IterationEnd::Setback(Setback::Unstable))?;
        counts.factorizations += 1;
        Ok(Factored::new(k, self.partition, solver)?)
    }

    /// The step that a tangent has for an imbalance; errors where what is pushed makes it unstable.
    pub(super) fn solve(
        &self,
        made: &Factored<'_>,
        imbalance: &Imbalance,
    ) -> Result<(NodeFields, DMatrix<f64>), IterationEnd> {
        let tangent = made.tangent(self.partition, &imbalance.border)?;
        if tangent.negative > 0 {
            return Err(IterationEnd::Setback(Setback::Unstable));
        }
        Ok(tangent.solve(&imbalance.free, &imbalance.pushes)?)
    }

    /// The factor of the tangent at an equilibrium; errors where that is not stable.
    pub(super) fn factor_at(
        &self,
        point: &Point,
        share: f64,
        counts: &mut Counts,
    ) -> Result<Factored<'a>, IterationEnd> {
        let body = self.body_at(share)?;
        let gradients = body.gradients(&point.u);
        let made = self.factor(body.tangent(&gradients), counts)?;
        if self.pushed().is_some() {
            let forces = self.forces_at(share);
            let net = self.settler(&body, forces.as_ref()).net_forces(&gradients);
            self.solve(&made, &self.imbalance(share, &point.q, &net))?;
        }
        Ok(made)
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
    pub(super) fn modes(
        &self,
        point: &Point,
        share: f64,
        tolerance: f64,
    ) -> Result<(Vec<f64>, NodeFields), IterationEnd> {
        self.with_tangent(point, share, |_, tangent| Ok(tangent.least_modes(tolerance)?))
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
        // The way of the free nodes alone: the controlled ones go where they are led.
        let of = |fields: &NodeFields| fields.at(&self.partition.free);
        let judged = |point: &Point, share: f64| {
            let (values, mode, ahead) = self.with_tangent(point, share, |k, tangent| {
                let (free, pushes, moved) = self.drift(point, share, SHORTEST_STEP, k, path)?;
                let (d, _) = tangent.solve(&free, &pushes)?;
                let (values, mode) = tangent.least_modes(EXACT)?;
                Ok((values, mode, sum(&d, 1.0, &moved)))
            })?;
            let driven = of(&mode).dots(&of(&ahead))[0].abs() / of(&ahead).norms()[0].max(f64::MIN_POSITIVE);
            Ok::<_, IterationEnd>((values, mode, driven))
        };
        let (values, mode, driven) = judged(point, share)?;
        let rest = self.modes(&self.start(NodeFields::zeros(point.u.nodes, 1)), 0.0, EXACT)?.0[0];
        let (part, modes) = (values[0] / rest, twins(&values));
        let mut stability =
            Stability { least: part, at_rest: rest, zero_at: None, is_critical: false, mode, modes, driven };
        let earlier = trail.iter().rev().find(|(at, _)| share - at >= BEFORE).or(trail.first());
        if let Some((at, point)) = earlier {
            let (before, mode, driven) = judged(point, *at)?;
            if part < TOO_NEAR {
                stability = Stability { modes: twins(&before), mode, driven, ..stability };
            }
            stability.zero_at = zero_at((*at, before[0]), (share, values[0]), stability.snaps());
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
    pub(super) fn motions_of(&self, mode: &NodeFields, share: f64, q: &[f64]) -> DMatrix<f64> {
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
