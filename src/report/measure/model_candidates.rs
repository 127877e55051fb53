//! The body solved for the models that need column families of their own.
//!
//! In: the body's meshes. Out: for each such model a [`Candidate`] on every discretisation that is affordable, with exactly the
//! model's families.

use super::candidate::Candidate;
use super::candidates::{Meshes, candidate};
use super::course::Course;
use super::names;
use super::of_models::{is_common, online};
use super::request::{MeasureError, Request};
use crate::deform::ModelEntry;
use crate::fem::{ELEMENTS, Element, TET4};
use crate::green::PERTURBATION;
use crate::solve::Solver;

/// The series take as long again as the fields of `reduced`, from which they are made.
fn is_dear(model: &ModelEntry) -> bool {
    model.requirements.iter().any(|family| family.name == PERTURBATION.name)
}

/// The models with families of their own, and the discretisations for which they are affordable, in the order in which they are
/// solved.
pub fn planned(request: &Request<'_>, meshes: &Meshes) -> Vec<(&'static ModelEntry, u32, &'static Element)> {
    let limit = request.limits.largest_of_models;
    let is_affordable = |model: &ModelEntry, refine: u32, element: &Element| {
        let unknowns = unknowns(meshes, refine, element);
        let is_own = (refine, element) == (0, &TET4);
        unknowns <= limit && (is_own || unknowns <= 0.25 * limit && !is_dear(model))
    };
    if unknowns(meshes, 0, &TET4) > limit {
        return Vec::new();
    }
    let models = online().filter(|model| !is_common(model));
    let all = models.flat_map(|model| discretisations(meshes).into_iter().map(move |(r, e)| (model, r, e)));
    all.filter(|(model, refine, element)| is_affordable(model, *refine, element)).collect()
}

/// Solves the body for every model with its own column families: with tet4 on the scene's mesh, where models are compared with
/// equilibria, then on other meshes and elements. Adds to `left_out` which body or element a model refuses, and why.
pub fn solve(
    request: &Request<'_>,
    meshes: &Meshes,
    left_out: &mut Vec<String>,
    course: &Course<'_>,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    let (limit, own) = (request.limits.largest_of_models, unknowns(meshes, 0, &TET4));
    if own > limit {
        left_out.extend(online().filter(|model| !is_common(model)).map(|model| {
            format!(
                "model {}: {own:.0} unknowns are more than the {limit:.0} for which a model with columns of its own is \
                 measured; raise {}",
                model.name, request.largest_key
            )
        }));
    }
    // Elements that a model refuses, and models that the scene's own mesh refuses or that there is no time for.
    let mut refused: Vec<(&str, &Element)> = Vec::new();
    let mut without: Vec<&str> = Vec::new();
    for (model, refine, element) in planned(request, meshes) {
        let is_own = (refine, element) == (0, &TET4);
        if without.contains(&model.name) || refused.contains(&(model.name, element)) {
            continue;
        }
        if !course.affords(&names::solved(refine, element, Solver::default(), Some(model.name))) {
            if is_own {
                without.push(model.name);
            }
            continue;
        }
        match candidate(request, refine, element, Solver::default(), &[model], course) {
            Ok(candidate) => candidates.push(candidate),
            Err(MeasureError::Green(why)) => {
                left_out.push(format!("model {} with {}: {why}", model.name, element.name));
                refused.push((model.name, element));
                if is_own {
                    without.push(model.name);
                }
            }
            Err(error) => return Err(error),
        }
    }
    Ok(candidates)
}

/// Refinements and elements, tet4 on the scene's mesh first.
fn discretisations(meshes: &Meshes) -> Vec<(u32, &'static Element)> {
    let own = (0, &TET4);
    let all = (0..meshes.linear.len() as u32).flat_map(|refine| ELEMENTS.iter().map(move |e| (refine, *e)));
    std::iter::once(own).chain(all.filter(|other| *other != own)).collect()
}

fn unknowns(meshes: &Meshes, refine: u32, element: &Element) -> f64 {
    let nodes = meshes.of(element).get(refine as usize).map_or(0, |mesh| mesh.nodes.len());
    3.0 * nodes as f64 * element.unknown_cost
}
