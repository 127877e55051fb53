//! The way of a body through stable equilibria, and beyond the critical ones on it.
//!
//! In: the [`Newton`] problem, an equilibrium at share 0 of the way. Out: that at share 1. A load step that fails is halved, so what is
//! found is connected with the start by stable equilibria (Crisfield, Non-linear Finite Element Analysis of Solids and Structures,
//! vol. 1, sections 9.2 to 9.4). Where the halving has bracketed a critical state, the tangent's least eigenvalue and its mode show
//! how the body gives way there. At a limit point the path turns back, and is followed by arc length through unstable states until it
//! is stable again; at a bifurcation the body leaves it along the mode, to the stable state to which its energy falls. States in which
//! an element is turned inside out are no way on.

use super::error::SolveError;
use super::minimise::Setback;
use super::newton::{Counts, Equilibrium, IterationEnd, Newton, Path, Point, SHORTEST_STEP};
use super::settle::largest;
use super::stability::{ROUGH, Stability};
use crate::base::progress::Progress;
use crate::fem::NodeFields;
use nalgebra::Matrix3;

/// A load step that needs no more factorizations lets the next one be twice as long.
const EASY: usize = 3;
/// Earlier equilibria that are kept.
const KEPT: usize = 16;
/// Critical states that one way passes at most.
const MOST_PASSED: usize = 8;
/// Lengths of the step beyond a bifurcation that are tried, in parts of the longest load step.
const BEYOND: [f64; 4] = [0.03125, 0.125, 0.0078125, 0.5];
/// Perturbations along the mode, each half of the one before; the first moves a node by the cube root of the body's volume.
const PERTURBATIONS: i32 = 14;
/// Steps by arc length from a limit point to the next stable state.
const MOST_ARCS: usize = 200;
/// Largest motion of a node in one of them, in parts of the cube root of the body's volume.
const LONGEST_ARC: f64 = 0.5;

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

impl From<SolveError> for NewtonError {
    fn from(error: SolveError) -> NewtonError {
        NewtonError::Solve(error)
    }
}

/// A critical state beyond which the body went on.
#[derive(Clone, Debug, PartialEq)]
pub struct Passed {
    /// Share of the way at the last equilibrium before it.
    pub share: f64,
    pub stability: Stability,
    /// F - I at every point of the elements there.
    pub gradients: Vec<Matrix3<f64>>,
    /// Left along its mode, not followed through unstable states by arc length.
    pub is_left: bool,
}

/// The end of a way, and the critical states that it passed.
#[derive(Clone, Debug, PartialEq)]
pub struct Followed {
    pub equilibrium: Equilibrium,
    pub passed: Vec<Passed>,
}

/// A stable state beyond a critical one, and whether the way there left it along its mode.
struct Onwards {
    point: Point,
    share: f64,
    is_left: bool,
}

impl Newton<'_> {
    /// Follows `path` from the equilibrium `start`, which stands at share 0, to share 1, at first in `steps` equal
    /// load steps and never in longer ones.
    ///
    /// `progress` is advanced by 1000 in all.
    pub fn follow(
        &self,
        start: NodeFields,
        steps: usize,
        path: &Path<'_>,
        progress: &dyn Progress,
    ) -> Result<Followed, NewtonError> {
        let longest = 1.0 / steps.max(1) as f64;
        let (mut point, mut share, mut step) = (self.start(start), 0.0, longest);
        let mut counts = Counts::default();
        let (mut failed, mut trail, mut passed) = (f64::INFINITY, Vec::new(), Vec::new());
        let mut tangent = None;
        let advance =
            |from: f64, to: f64| progress.advance((1000.0 * to) as u64 - (1000.0 * from.min(to)) as u64);
        while share < 1.0 {
            // The last steps share what is left, so that none is a sliver.
            let target = if 1.0 - share <= step * (1.0 + 1e-9) { 1.0 } else { share + step };
            let before = counts.factorizations;
            match self.step(&point, &mut tangent, [share, target], path, &mut counts) {
                Ok(found) => {
                    if trail.len() == KEPT {
                        trail.remove(0);
                    }
                    trail.push((share, std::mem::replace(&mut point, found)));
                    advance(share, target);
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
                    while step >= target - share {
                        step *= 0.5;
                    }
                    counts.halved += 1;
                    if step >= SHORTEST_STEP {
                        continue;
                    }
                    let stability = match self.stability(&point, share, &trail, path) {
                        Ok(stability) => Some(stability),
                        Err(IterationEnd::Setback(_)) => None,
                        Err(IterationEnd::Solve(error)) => return Err(NewtonError::Solve(error)),
                    };
                    let beyond = match &stability {
                        Some(stability) if stability.is_critical && passed.len() < MOST_PASSED => {
                            self.beyond((&point, share), longest, stability, path, &mut counts)?
                        }
                        _ => None,
                    };
                    match (beyond, stability) {
                        (Some(Onwards { point: found, share: to, is_left }), Some(stability)) => {
                            let gradients = self.body_at(share)?.gradients(&point.u);
                            passed.push(Passed { share, stability, gradients, is_left });
                            advance(share, to);
                            (point, share, step) = (found, to, longest / 16.0);
                            (failed, trail, tangent) = (f64::INFINITY, Vec::new(), None);
                            counts.steps += 1;
                        }
                        (_, stability) => {
                            let stability = stability.map(Box::new);
                            let at = Box::new(self.judge(point, share, counts)?);
                            return Err(NewtonError::Stopped { at, share, why, stability });
                        }
                    }
                }
            }
        }
        Ok(Followed { equilibrium: self.judge(point, 1.0, counts)?, passed })
    }

    /// The least eigenvalue of the tangent of an equilibrium at `share`, N/m, to a thousandth, and its mode over all nodes, of length 1;
    /// `None` where nothing is free. The error says so where the equilibrium is not stable.
    pub fn least_mode(&self, point: &Point, share: f64) -> Result<Option<(f64, NodeFields)>, NewtonError> {
        if self.solver.is_none() {
            return Ok(None);
        }
        match self.modes(point, share, ROUGH) {
            Ok((values, mode)) => Ok(values.first().map(|least| (*least, mode))),
            Err(IterationEnd::Solve(error)) => Err(NewtonError::Solve(error)),
            Err(IterationEnd::Setback(why)) => {
                let at = Box::new(self.judge(point.clone(), share, Counts::default())?);
                Err(NewtonError::Stopped { at, share, why, stability: None })
            }
        }
    }

    /// The next stable state beyond the critical one that follows on the state at `share`, and whether the way was left along the mode.
    fn beyond(
        &self,
        (point, share): (&Point, f64),
        longest: f64,
        stability: &Stability,
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<Onwards>, SolveError> {
        let arc = if stability.snaps() { self.around((point, share), path, counts)? } else { None };
        if let Some(found) = arc {
            let (point, share) = found;
            return Ok(Some(Onwards { point, share, is_left: false }));
        }
        // A body that snaps falls far, or nowhere.
        for part in if stability.snaps() { &BEYOND[..1] } else { &BEYOND[..] } {
            let target = (share + (part * longest).max(2.0 * SHORTEST_STEP)).min(1.0);
            if let Some(found) = self.leave((point, share), target, stability, path, counts)? {
                return Ok(Some(Onwards { point: found, share: target, is_left: true }));
            }
        }
        Ok(None)
    }

    /// Follows the path by arc length around a limit point: to a stable state further on the way.
    fn around(
        &self,
        (point, share): (&Point, f64),
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<(Point, f64)>, SolveError> {
        let (mut found, mut arcs) = (None, 0);
        let steps = (SHORTEST_STEP, LONGEST_ARC * self.extent());
        self.trace((point.clone(), share), steps, path, counts, &mut |at| {
            arcs += 1;
            let upright = self.is_upright(&at.point, at.share)?;
            if upright && at.negative == 0 && at.share > share && at.share <= 1.0 {
                found = Some((at.point.clone(), at.share));
            }
            Ok(found.is_none() && upright && arcs < MOST_ARCS)
        })?;
        Ok(found)
    }

    /// The stable state at `target` to which the energy falls from beside the path, where it is least along the mode.
    fn leave(
        &self,
        (point, share): (&Point, f64),
        target: f64,
        stability: &Stability,
        path: &Path<'_>,
        counts: &mut Counts,
    ) -> Result<Option<Point>, SolveError> {
        let mode = &stability.mode;
        let Some(guess) = self.aside((point, share), target, mode, path)? else { return Ok(None) };
        let (mut least, mut beside) = (self.energy(&guess, &guess.q, target)?, None);
        for part in (0..PERTURBATIONS).flat_map(|k| [0.5_f64.powi(k), -0.5_f64.powi(k)]) {
            let tried = self.along(&guess, part * self.extent() / largest(mode), mode, (target, path));
            let energy = self.energy(&tried, &guess.q, target)?;
            if energy < least {
                (least, beside) = (energy, Some(tried));
            }
        }
        let Some(guess) = beside else { return Ok(None) };
        match self.descend(guess, (target, stability.at_rest), path, counts) {
            Ok(found) if self.is_upright(&found, target)? => Ok(Some(found)),
            Ok(_) | Err(IterationEnd::Setback(_)) => Ok(None),
            Err(IterationEnd::Solve(error)) => Err(error),
        }
    }

    /// Whether no element is turned inside out.
    fn is_upright(&self, point: &Point, share: f64) -> Result<bool, SolveError> {
        let gradients = self.body_at(share)?.gradients(&point.u);
        Ok(gradients.iter().all(|h| (Matrix3::identity() + h).determinant() > 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::progress::Silent;
    use crate::fem::{Hyperelastic, Lame, Partition, STVK, TET4};
    use crate::mesh::{Block, block};
    use crate::solve::{LAST_STEP, Solver};

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
