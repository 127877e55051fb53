//! Which deformation models settings have, and the body solved for those that need column families of their own.
//!
//! In: the list of models. Out: those that are made from what every candidate has ([`common`]), and for each other online
//! model a [`Candidate`] of its own on every discretisation that is affordable, with exactly the model's families.

use super::candidates::{Candidate, Meshes, candidate};
use super::request::{MeasureError, Request};
use crate::deform::{Kind, MODELS, ModelEntry};
use crate::fem::{ELEMENTS, Element, TET4};
use crate::green::{AFFINE, CUBIC, Family, PERTURBATION, Requirements, STIFFNESS, SUBSTRUCTURES};
use crate::solve::{Progress, Solver};

/// What every candidate has.
const COMMON: &[Family] = &[AFFINE, STIFFNESS, CUBIC];

/// What these models and their energies need.
pub fn families(models: &[&ModelEntry]) -> Requirements {
    let of = |model: &&ModelEntry| {
        Requirements::of(model.requirements).and(Requirements::of(model.energy.unwrap_or_default()))
    };
    models.iter().map(of).fold(Requirements::default(), Requirements::and)
}

/// The models that are evaluated in every frame.
pub fn online() -> impl Iterator<Item = &'static ModelEntry> {
    MODELS.iter().filter(|model| matches!(model.kind, Kind::Online(_)))
}

/// Those that are made from what every candidate has.
pub fn common() -> impl Iterator<Item = &'static ModelEntry> {
    online().filter(|model| is_common(model))
}

fn is_common(model: &ModelEntry) -> bool {
    let made = Requirements::of(COMMON);
    model.requirements.iter().all(|family| made.has(*family))
}

/// Those of the affine columns alone: they suit every body, and where one of them is not defined nothing is measured.
pub fn of_affine_columns() -> impl Iterator<Item = &'static ModelEntry> {
    online().filter(|model| model.requirements.iter().all(|family| family.name == AFFINE.name))
}

/// Whether the model moves the nodes inside the body too, which are in no .green file.
pub fn moves_inside(model: &ModelEntry) -> bool {
    !model.requirements.iter().any(|family| family.name == SUBSTRUCTURES.name)
}

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
