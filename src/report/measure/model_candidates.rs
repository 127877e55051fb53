//! The body solved for the models that need column families of their own.
//!
//! In: the body's meshes. Out: for each such model a [`Candidate`] on every discretisation that is affordable, with exactly the
//! model's families.

use super::candidates::{Candidate, Meshes, candidate};
use super::of_models::{is_common, online};
use super::request::{MeasureError, Request};
use crate::deform::ModelEntry;
use crate::fem::{ELEMENTS, Element, TET4};
use crate::green::PERTURBATION;
use crate::solve::{Progress, Solver};

/// The series take as long again as the fields of `reduced`, from which they are made.
fn is_dear(model: &ModelEntry) -> bool {
    model.requirements.iter().any(|family| family.name == PERTURBATION.name)
}

/// Solves the body for every model with families of its own: with tet4 on the scene's mesh, where models are compared with
/// equilibria, then on other meshes and elements. Tells `left_out` which body or element a model refuses, and why.
pub fn solve(
    request: &Request<'_>,
    meshes: &Meshes,
    left_out: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<Candidate>, MeasureError> {
    let mut candidates = Vec::new();
    for model in online().filter(|model| !is_common(model)) {
        let mut refused: Vec<&Element> = Vec::new();
        for (refine, element) in discretisations(meshes) {
            let limit = request.limits.largest_of_models;
            let unknowns = unknowns(meshes, refine, element);
            let is_own = (refine, element) == (0, &TET4);
            if is_own && unknowns > limit {
                left_out.push(format!(
                    "model {}: {unknowns:.0} unknowns are more than the {limit:.0} for which a model with columns of its \
                     own is measured; raise {}",
                    model.name, request.largest_key
                ));
                break;
            }
            if !is_own && (unknowns > 0.25 * limit || is_dear(model) || refused.contains(&element)) {
                continue;
            }
            match candidate(request, refine, element, Solver::default(), &[model], progress) {
                Ok(candidate) => candidates.push(candidate),
                Err(MeasureError::Green(why)) => {
                    left_out.push(format!("model {} with {}: {why}", model.name, element.name));
                    refused.push(element);
                    if is_own {
                        break;
                    }
                }
                Err(error) => return Err(error),
            }
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
