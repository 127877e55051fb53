//! Static equilibrium at large strain: Newton's iteration on f(u) = 0 at the free nodes, along a path of the controlled
//! ones.
//!
//! In: hyperelastic tetrahedra, the split of the nodes, a path that says where the controlled nodes stand at every
//! share 0 to 1 of the way. Out: the displacements at its end. Each load step is predicted along the tangent, then
//! iterated with K(u) d = -f(u), each d shortened until the energy falls (Nocedal and Wright, Numerical Optimization,
//! 2nd ed., algorithm 3.2). A step that fails is halved. The tangent must be positive definite throughout, so what is
//! found is a stable equilibrium, connected with the start by stable ones (Crisfield, Non-linear Finite Element
//! Analysis of Solids and Structures, vol. 1, sections 9.2 to 9.4). Where the path ends, the halving has bracketed the
//! critical state, and the tangent's least eigenvalue and its mode show how the body gives way there.

use super::error::SolveError;
use super::minimise::{Energy, Setback, Step, minimise};
use super::settle::{Settler, State, largest, sum};
use super::solver::LinearSolver;
use super::stability::{Stability, least_modes, twins, zero_at};
use crate::base::progress::{Progress, Silent};
use crate::fem::{Hyperelastic, NodeFields, Partition, StiffnessMatrix};
use nalgebra::Matrix3;

/// [`Newton::last_step`] of an equilibrium that others are measured against.
pub const LAST_STEP: f64 = 1e-9;
const MAX_ITERATIONS: usize = 25;
const MAX_MIXED: usize = 10;
/// Least part of the resting body's stiffness that is added to a tangent that is not positive definite.
const LEAST_SHIFT: f64 = 1e-3;
/// A load step that needs no more factorizations lets the next one be twice as long.
const EASY: usize = 6;
const SHORTEST_STEP: f64 = 1.0 / 4096.0;
/// Earlier equilibria that are kept, and how far back on the way the one is that the least eigenvalue is compared with.
const KEPT: usize = 16;
const BEFORE: f64 = 16.0 * SHORTEST_STEP;

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
    /// The free stretch with which the start is in equilibrium; the body has its own from the first step on.
    pub stretch_before: f64,
}

/// A state in equilibrium.
#[derive(Clone, Debug, PartialEq)]
pub struct Equilibrium {
    /// Displacements of all nodes, one column, m.
    pub u: NodeFields,
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

#[derive(Debug)]
pub enum NewtonError {
    Solve(SolveError),
    /// The last equilibrium, the share of the way at which it stands, and why the next was not found.
    Stopped {
        at: Box<Equilibrium>,
        share: f64,
        why: Setback,
        /// The stability of that equilibrium; `None` where the next critical state is too near for an estimate.
        stability: Option<Box<Stability>>,
    },
}

/// The reason why an iteration ended early.
enum IterationEnd {
    Setback(Setback),
    Solve(SolveError),
}

impl From<SolveError> for IterationEnd {
    fn from(error: SolveError) -> IterationEnd {
        match error {
            // Too ill-conditioned to be solved is as good as singular.
            SolveError::NotPositiveDefinite { .. } | SolveError::Factor { .. } => {
                IterationEnd::Setback(Setback::Unstable)
            }
            other => IterationEnd::Solve(other),
        }
    }
}

impl Newton<'_> {
    /// Follows `path` from the equilibrium `start`, which stands at share 0, to share 1, at first in `steps` equal
    /// load steps and never in longer ones.
    ///
    /// `path` writes the displacements of the controlled nodes at a share into one column over all nodes. `progress`
    /// is advanced by 1000 in all.
    pub fn follow(
        &self,
        start: NodeFields,
        steps: usize,
        path: &dyn Fn(f64, &mut NodeFields),
        progress: &dyn Progress,
    ) -> Result<Equilibrium, NewtonError> {
        let longest = 1.0 / steps.max(1) as f64;
        let (mut u, mut share, mut step) = (start, 0.0, longest);
        let mut counts = Counts::default();
        let mut failed = f64::INFINITY;
        let mut trail = Vec::new();
        while share < 1.0 {
            // The last steps share what is left, so that none is a sliver.
            let target = if 1.0 - share <= step * (1.0 + 1e-9) { 1.0 } else { share + step };
            let before = counts.factorizations;
            match self.step(&u, [share, target], path, &mut counts) {
                Ok(found) => {
                    if trail.len() == KEPT {
                        trail.remove(0);
                    }
                    trail.push((share, std::mem::replace(&mut u, found)));
                    progress.advance((1000.0 * target) as u64 - (1000.0 * share) as u64);
                    share = target;
                    counts.steps += 1;
                    if counts.factorizations - before <= EASY {
                        // Not beyond where a step has failed: from here it is tried once more, then halved.
                        let reach = if failed > share { failed - share } else { longest };
                        step = (2.0 * step).min(longest).min(reach);
                    }
                }
                Err(IterationEnd::Solve(error)) => return Err(NewtonError::Solve(error)),
                Err(IterationEnd::Setback(why)) => {
                    failed = target;
                    step *= 0.5;
                    counts.halved += 1;
                    if step < SHORTEST_STEP {
                        let stability = self.stability(&u, share, &trail, path).ok().map(Box::new);
                        let at = Box::new(self.judge(u, share, counts));
                        return Err(NewtonError::Stopped { at, share, why, stability });
                    }
                }
            }
        }
        Ok(self.judge(u, 1.0, counts))
    }

    /// The equilibrium with the controlled nodes as `path` writes them, in one load step from the equilibrium `u`; `None` where
    /// that step fails. Loads are those at the end of the way.
    pub fn step_to(
        &self,
        u: &NodeFields,
        path: &dyn Fn(f64, &mut NodeFields),
    ) -> Result<Option<Equilibrium>, SolveError> {
        let mut counts = Counts::default();
        match self.step(u, [0.0, 1.0], path, &mut counts) {
            Ok(found) => Ok(Some(self.judge(found, 1.0, counts))),
            Err(IterationEnd::Solve(error)) => Err(error),
            Err(IterationEnd::Setback(_)) => Ok(None),
        }
    }

    /// The stable equilibrium next to `guess`, whose controlled nodes stand where they are held, under the loads at the end of the way;
    /// `None` where Newton's iteration finds none from there.
    pub fn settle_near(&self, guess: NodeFields) -> Result<Option<Equilibrium>, SolveError> {
        let mut counts = Counts::default();
        let Some(solver) = self.solver else { return Ok(Some(self.judge(guess, 1.0, counts))) };
        let loads = self.loads.map(|loads| (loads.forces)(1.0));
        let forced = (largest(&guess), loads.as_ref());
        if self.body.is_nearly_incompressible() {
            match self.iterate_mixed(solver, &guess, guess.clone(), forced, &mut counts) {
                Ok(u) => return Ok(Some(self.judge(u, 1.0, counts))),
                Err(IterationEnd::Setback(_)) => {}
                Err(IterationEnd::Solve(error)) => return Err(error),
            }
        }
        let rest = self.body.tangent(&self.body.gradients(&NodeFields::zeros(guess.nodes, 1)));
        match self.iterate_from(solver, guess, forced, &mut counts, Some(rest.diagonal)) {
            Ok(u) => Ok(Some(self.judge(u, 1.0, counts))),
            Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// The stability of the equilibrium `u` at `share` of the path, compared with that at rest and an earlier one of `trail`.
    fn stability(
        &self,
        u: &NodeFields,
        share: f64,
        trail: &[(f64, NodeFields)],
        path: &dyn Fn(f64, &mut NodeFields),
    ) -> Result<Stability, IterationEnd> {
        let solver = self.solver.ok_or(IterationEnd::Setback(Setback::Unstable))?;
        let least = |u: &NodeFields| -> Result<f64, IterationEnd> {
            let a = self.partition.a(&self.body.tangent(&self.body.gradients(u)));
            Ok(least_modes(&a, solver.factor(&a, &Silent)?.as_ref())?.0[0])
        };
        let k = self.body.tangent(&self.body.gradients(u));
        let a = self.partition.a(&k);
        let factor = solver.factor(&a, &Silent)?;
        let (values, shape) = least_modes(&a, factor.as_ref())?;
        let mut ahead = u.clone();
        path(share + SHORTEST_STEP, &mut ahead);
        let (ahead, _) = factor.solve(&self.partition.minus_b_times(&k, &sum(&ahead, -1.0, u)), &Silent)?;
        let driven = shape.dots(&ahead)[0].abs() / ahead.norms()[0].max(f64::MIN_POSITIVE);
        let mut mode = NodeFields::zeros(u.nodes, 1);
        self.partition.insert_free(&shape, &mut mode);
        let rest = least(&NodeFields::zeros(u.nodes, 1))?;
        let mut stability =
            Stability { least: values[0] / rest, zero_at: None, mode, modes: twins(&values), driven };
        let earlier = trail.iter().rev().find(|(at, _)| share - at >= BEFORE).or(trail.first());
        if let Some((at, u)) = earlier {
            stability.zero_at = zero_at((*at, least(u)?), (share, values[0]), stability.snaps());
        }
        Ok(stability)
    }

    /// One load step: from the equilibrium `u` at a share of the way to that with the controlled nodes where `path` has them at
    /// `target`.
    fn step(
        &self,
        u: &NodeFields,
        [share, target]: [f64; 2],
        path: &dyn Fn(f64, &mut NodeFields),
        counts: &mut Counts,
    ) -> Result<NodeFields, IterationEnd> {
        let mut moved = u.clone();
        path(target, &mut moved);
        let is_idle = moved == *u && self.loads.is_none();
        let Some(solver) = self.solver.filter(|_| !is_idle) else { return Ok(moved) };

        // The prediction keeps the free nodes in balance to first order: A d = loads - f - B Δb, where loads and f are the same
        // but for what has changed. A is that of the equilibrium: as warm as it was there.
        let moved_by = sum(&moved, -1.0, u);
        let before = self.loads.filter(|_| share == 0.0).map(|loads| loads.stretch_before);
        let k = self.body.tangent(&match before {
            Some(stretch) => self.body.gradients_from(u, stretch),
            None => self.body.gradients(u),
        });
        let mut rhs = self.partition.minus_b_times(&k, &moved_by);
        let loads = self.loads.map(|loads| (loads.forces)(target));
        let loads = loads.as_ref();
        if loads.is_some() {
            rhs = sum(&rhs, 1.0, &self.settler(loads).downhill(&self.body.gradients(u)));
        }
        let d = self.solve(solver, &k, &rhs, counts)?;
        let predicted = sum(&moved, 1.0, &d);
        let size = largest(u).max(largest(if loads.is_some() { &predicted } else { &moved }));
        if self.body.is_nearly_incompressible() {
            match self.iterate_mixed(solver, u, predicted.clone(), (size, loads), counts) {
                // From the same prediction, downhill.
                Err(IterationEnd::Setback(_)) => {}
                done => return done,
            }
        }
        self.iterate(solver, predicted, (size, loads), counts)
    }

    /// The body under fixed loads.
    fn settler<'a>(&'a self, loads: Option<&'a NodeFields>) -> Settler<'a> {
        Settler { body: self.body, partition: self.partition, loads }
    }

    /// Newton's iteration from the equilibrium `before` by way of `u`, with the pressures as unknowns of their own that
    /// are eliminated from each linear system: p = λ θ holds at its end alone, so that a step's false dilatations, which
    /// are of its second order, are not multiplied by λ in the tangent (Magisano, Leonetti and Garcea, Comput. Methods
    /// Appl. Mech. Engng. 313, 2017, 986-1005). The energy rises on the way; a tangent that is not positive definite ends
    /// the iteration, and the last one is that of the energy.
    fn iterate_mixed(
        &self,
        solver: &dyn LinearSolver,
        before: &NodeFields,
        mut u: NodeFields,
        (size, loads): (f64, Option<&NodeFields>),
        counts: &mut Counts,
    ) -> Result<NodeFields, IterationEnd> {
        counts.moves.clear();
        let mut pressures = self.body.pressures_after(&self.body.gradients(before), &sum(&u, -1.0, before));
        for _ in 0..MAX_MIXED {
            let gradients = self.body.gradients(&u);
            let downhill = self.settler(loads).downhill(&gradients);
            let k = self.body.tangent_with(&gradients, &pressures);
            let d = self.solve(solver, &k, &downhill, counts)?;
            counts.moves.push(largest(&d) / size);
            pressures = self.body.pressures_after(&gradients, &d);
            u = sum(&u, 1.0, &d);
            if largest(&d) <= self.last_step * size {
                return Ok(u);
            }
        }
        Err(IterationEnd::Setback(Setback::Slow))
    }

    /// Newton's iteration at fixed controlled nodes under `loads`, for displacements of about `size`, m.
    fn iterate(
        &self,
        solver: &dyn LinearSolver,
        u: NodeFields,
        forced: (f64, Option<&NodeFields>),
        counts: &mut Counts,
    ) -> Result<NodeFields, IterationEnd> {
        self.iterate_from(solver, u, forced, counts, None)
    }

    /// [`Newton::iterate`], where `measure`, the diagonal of the resting body's stiffness, is added to tangents that are not positive
    /// definite on the way; that of the result is.
    fn iterate_from(
        &self,
        solver: &dyn LinearSolver,
        u: NodeFields,
        (size, loads): (f64, Option<&NodeFields>),
        counts: &mut Counts,
        measure: Option<Vec<Matrix3<f64>>>,
    ) -> Result<NodeFields, IterationEnd> {
        counts.moves.clear();
        let settler = self.settler(loads);
        let (now, nothing) = (settler.state(u), NodeFields::zeros(0, 1));
        let (downhill, d) = (nothing.clone(), nothing);
        let mut search = FreeNodes {
            newton: self,
            solver,
            settler,
            size,
            counts,
            now,
            tried: None,
            downhill,
            d,
            measure,
            shift: 0.0,
            error: None,
        };
        let found = minimise(&mut search, MAX_ITERATIONS, &mut 0);
        match search.error {
            Some(error) => Err(IterationEnd::Solve(error)),
            None if search.shift > 0.0 => Err(IterationEnd::Setback(Setback::Unstable)),
            None => found.map(|_| search.now.u).map_err(IterationEnd::Setback),
        }
    }

    /// A d = `rhs` at the free nodes; d over all nodes, zero at the controlled ones.
    fn solve(
        &self,
        solver: &dyn LinearSolver,
        k: &StiffnessMatrix,
        rhs: &NodeFields,
        counts: &mut Counts,
    ) -> Result<NodeFields, IterationEnd> {
        counts.factorizations += 1;
        let a = self.partition.a(k);
        let (free, _) = solver.factor(&a, &Silent)?.solve(rhs, &Silent)?;
        let mut d = NodeFields::zeros(k.nodes(), 1);
        self.partition.insert_free(&free, &mut d);
        Ok(d)
    }

    fn judge(&self, u: NodeFields, share: f64, counts: Counts) -> Equilibrium {
        let gradients = self.body.gradients(&u);
        let mut forces = self.body.forces(&gradients);
        if let Some(loads) = self.loads {
            forces = sum(&forces, -1.0, &(loads.forces)(share));
        }
        let norm = |nodes: &[u32]| forces.at(nodes).norms()[0];
        let (left, held) = (norm(&self.partition.free), norm(&self.partition.controlled));
        let residual = if held == 0.0 { 0.0 } else { left / held };
        Equilibrium { energy: self.body.energy(&gradients), u, forces, gradients, residual, counts }
    }
}

/// The energy of a body at fixed controlled nodes, without shifts: what is found is stable.
struct FreeNodes<'a> {
    newton: &'a Newton<'a>,
    solver: &'a dyn LinearSolver,
    settler: Settler<'a>,
    size: f64,
    counts: &'a mut Counts,
    now: State,
    tried: Option<State>,
    downhill: NodeFields,
    d: NodeFields,
    /// The measure that is added to the tangent, and the part of it that the last one needed.
    measure: Option<Vec<Matrix3<f64>>>,
    shift: f64,
    error: Option<SolveError>,
}

impl Energy for FreeNodes<'_> {
    const TRIALS: usize = 8;

    fn evaluate(&mut self) -> Option<f64> {
        self.downhill = self.settler.downhill(&self.now.gradients);
        Some(self.now.energy)
    }

    fn rounding(&self) -> f64 {
        self.settler.rounding(&self.now)
    }

    fn factorise(&mut self, shift: f64) -> bool {
        let mut k = self.newton.body.tangent(&self.now.gradients);
        match &self.measure {
            None if shift > 0.0 => return false,
            Some(measure) if shift > 0.0 => {
                let part = LEAST_SHIFT * shift;
                k.diagonal.iter_mut().zip(measure).for_each(|(own, more)| *own += more * part);
            }
            _ => {}
        }
        self.shift = shift;
        match self.newton.solve(self.solver, &k, &self.downhill, self.counts) {
            Ok(d) => self.d = d,
            Err(IterationEnd::Solve(error)) => self.error = Some(error),
            Err(IterationEnd::Setback(_)) => return false,
        }
        self.error.is_none()
    }

    fn find_step(&mut self, _energy: f64) -> Step {
        let longest = largest(&self.d);
        self.counts.moves.push(longest / self.size);
        let gain = self.downhill.dots(&self.d.at(&self.newton.partition.free))[0];
        Step { gain, is_last: longest <= self.newton.last_step * self.size }
    }

    fn trial(&mut self, share: f64) -> Option<f64> {
        let tried = self.settler.state(sum(&self.now.u, share, &self.d));
        Some(self.tried.insert(tried).energy)
    }

    fn accept(&mut self) {
        if let Some(tried) = self.tried.take() {
            self.now = tried;
        }
    }

    fn finish(&mut self, energy: f64, _gain: f64) -> Option<f64> {
        self.now.u = sum(&self.now.u, 1.0, &self.d);
        Some(energy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, STVK, TET4};
    use crate::mesh::{Block, block};
    use crate::solve::Solver;

    /// A cube of St. Venant–Kirchhoff material that is pressed along an axis snaps: its path drives the mode, whichever sign
    /// the mode has.
    #[test]
    fn a_pressed_cube_is_driven_by_its_own_path() {
        let mesh = block(&Block { size: [1.0; 3], cells: [3; 3] }).unwrap();
        let lame = vec![Lame::from_young_poisson(1.0, 0.3); mesh.tets.len()];
        let body = Hyperelastic::new(&TET4, &STVK, &mesh, &lame).unwrap();
        let start = NodeFields::zeros(mesh.nodes.len(), 1);
        for (axis, side) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
            let at = |node: u32| mesh.nodes[node as usize][axis] * side;
            let ends = (0..mesh.nodes.len() as u32).filter(|&node| at(node).abs() > 0.49);
            let partition = Partition::new(mesh.nodes.len(), ends);
            let a = partition.a(&body.tangent(&body.gradients(&start)));
            let solver = Solver::default().analyse(&a, &Silent).unwrap();
            let path = |share: f64, u: &mut NodeFields| {
                for &node in &partition.controlled {
                    u.data[3 * node as usize + axis] = if at(node) > 0.0 { -0.6 * side * share } else { 0.0 };
                }
            };
            let newton = Newton {
                body: &body,
                partition: &partition,
                solver: Some(&*solver),
                loads: None,
                last_step: LAST_STEP,
            };
            let Err(NewtonError::Stopped { stability: Some(stability), share, .. }) =
                newton.follow(start.clone(), 4, &path, &Silent)
            else {
                panic!("it bears being pressed to 0.4 of its length");
            };
            let driven = stability.driven;
            assert!((0.5..1.0 + 1e-9).contains(&driven), "{axis} {side}: {driven} at {share}");
        }
    }
}
