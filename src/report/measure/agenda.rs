//! The steps of a measurement, and how long each should take.
//!
//! In: a request and its meshes. Out: the steps for a [`Course`](super::course::Course). The expected times are those of an idle
//! machine with two cores, fitted to the demo's tube; the course corrects them by what the first steps take.

use super::candidates::{Meshes, discretisations, iterative};
use super::course::{Step, StepKind};
use super::model_candidates::planned;
use super::names;
use super::request::Request;
use crate::fem::{ELEMENTS, Element, TET4, TET10};
use crate::solve::Solver;

/// Unknowns of the demo's tube with tet4, to which times are fitted.
const TUBE: f64 = 30_240.0;

/// The steps in their order; `whole` with all that stands in a report beside the settings.
pub fn agenda(request: &Request<'_>, meshes: &Meshes, whole: bool) -> Vec<Step> {
    let mut steps = Vec::new();
    let step =
        |key: String, kind: StepKind, seconds: f64, is_needed: bool| Step { key, kind, seconds, is_needed };
    let unknowns = |refine: u32, element: &Element| {
        let nodes = meshes.of(element).get(refine as usize).map_or(0, |mesh| mesh.nodes.len());
        3.0 * nodes as f64 / TUBE
    };
    let top = meshes.linear.len() as u32 - 1;
    let repeats = if request.quick { 1.0 } else { 2.0 };
    // Errors of every storage in three poses, all on the finest mesh.
    let judged = |own: f64| 0.18 * unknowns(top, &TET10) + 0.75 * own;
    let mut solved = Vec::new();
    for (refine, element) in discretisations(request, meshes) {
        let is_needed = (refine, element) == (0, &TET4) || (refine, element) == (top, &TET10);
        let seconds = repeats * direct(unknowns(refine, element) * element.unknown_cost.sqrt());
        let key = names::solved(refine, element, Solver::default(), None);
        // One storage in place of all of them.
        let spared = if request.limit.is_some() && (refine, element) == (top, &TET10) { 0.4 } else { 1.0 };
        let judged = spared * judged(unknowns(refine, element));
        solved.push((step(key, StepKind::Solve, seconds, is_needed), judged));
    }
    for (model, refine, element) in planned(request, meshes) {
        let seconds = OF_MODELS * repeats * direct(unknowns(refine, element) * element.unknown_cost.sqrt());
        let key = names::solved(refine, element, Solver::default(), Some(model.name));
        solved.push((
            step(key, StepKind::SolveForModel, seconds, false),
            0.5 * judged(unknowns(refine, element)),
        ));
    }
    let own = request.scene.body[request.body].element;
    if meshes.affords(request, 0, own) {
        for solver in iterative() {
            let digits = -solver.tolerance().unwrap_or(1e-10).log10();
            let seconds = (0.7 + 0.2 * digits) * unknowns(0, own).powf(4.0 / 3.0);
            let key = names::solved(0, own, solver, None);
            solved.push((
                step(key, StepKind::SolveIteratively, seconds, false),
                0.5 * judged(unknowns(0, own)),
            ));
        }
    }
    let poses = request.poses.len() as f64;
    let base = unknowns(0, &TET4);
    steps.extend(solved.iter().map(|(step, _)| step.clone()));
    steps.push(step(names::EQUILIBRIA.into(), StepKind::Equilibria, 0.5 * poses * base.powf(1.4), true));
    if whole {
        let motions = if request.quick { 6.0 } else { 20.0 };
        steps.push(step(names::TRIALS.into(), StepKind::Trials, 1.5 * motions * base.powf(1.4), false));
    }
    steps.extend(solved.iter().map(|(of, seconds)| {
        step(names::errors(&of.key), StepKind::Errors, seconds * poses / 3.0, of.is_needed)
    }));
    let rows = 2.0 * solved.len() as f64;
    steps.push(step(
        names::TIMES.into(),
        StepKind::Other,
        4e-4 * rows * request.limits.rounds as f64 * base,
        true,
    ));
    if whole {
        if top > 0 {
            for element in ELEMENTS.iter().copied() {
                let all = (0..=top).filter(|refine| meshes.affords(request, *refine as usize, element));
                let seconds =
                    all.map(|refine| direct(unknowns(refine, element) * element.unknown_cost.sqrt())).sum();
                steps.push(step(names::smooth(element), StepKind::Other, seconds, false));
            }
        }
        steps.push(step(names::EFFECTS.into(), StepKind::Other, 0.5 * base + direct(base), true));
    }
    steps
}

/// Time of a direct solve with the columns of two control elements, s, by the unknowns over [`TUBE`].
fn direct(unknowns: f64) -> f64 {
    0.4 * unknowns.powf(1.6)
}

/// A solve with column families of a model's own over one without.
const OF_MODELS: f64 = 30.0;
