//! Errors of force and shape to expect of a body, measured on it while it is precomputed.
//!
//! In: a body of a scene and its solution. Out: a section of the .green file with [`ExpectedErrors`]: of the model against static
//! equilibrium ([`model`]), and what mesh and element add ([`mesh`]). Only this effect measures. `check`, `precompute`, `inspect`,
//! `deform` and the overlay show what was measured.

pub mod mesh;
pub mod model;
#[cfg(test)]
mod tests;

use super::entry::{EffectEntry, EffectInput, Resolved};
use crate::base::failure::Failure;
use crate::deform::{ErrorsAt, ExpectedErrors, FinerErrors, Hung, MeshErrors, MovedErrors};
use crate::green::{GreenError, GreenFile, Precomputed, STIFFNESS, Tensor};
use crate::mesh::refine;
use crate::scene::{Body, Grab, Scene};
use crate::solve::Progress;
use crate::world::{BodyFrame, RunningEffect, World};
use mesh::BetterBody;
use model::Measured;
use std::sync::Arc;

/// Largest number of control elements that are moved: the first ones that a hand can grab.
pub const MOST_MOVED: usize = 2;

pub const NAME: &str = "expected_errors";

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: NAME,
    summary: "errors of force and shape to expect, measured on the body: of its model, and by its mesh and element",
    requirements: &[STIFFNESS],
    needs_energy: true,
    needs_inside: true,
    measures_errors: true,
    precompute: Some(section),
    check_section: Some(|file, body| read(file, body).map(drop)),
    section_after_change: Some(|scene, body| vec![(TENSOR.into(), not_measured(scene, body))]),
    attach: Some(join),
    ..EffectEntry::NOTHING
};

/// The one tensor of a section: [`ExpectedErrors`] as JSON, numbers with three digits.
const TENSOR: &str = "errors";

/// The section of the .green file.
fn section(
    scene: &Resolved,
    body: &mut Precomputed,
    progress: &dyn Progress,
) -> Result<Vec<(String, Tensor)>, GreenError> {
    Ok(vec![(TENSOR.into(), written(&measure(scene, body, progress)))])
}

fn name_in_section() -> String {
    format!("{NAME}/{TENSOR}")
}

/// The reason why errors that were measured of a body are not shown after a change of it.
pub const CHANGED: &str = "a control element was released, or a modulus changed, since they were measured";

/// The tensor of a body of which something was released or changed since it was measured.
fn not_measured(scene: &Resolved, body: &str) -> Tensor {
    let mut errors = unmeasured(scene, body);
    errors.left_out.push(CHANGED.into());
    written(&errors)
}

fn written(errors: &ExpectedErrors) -> Tensor {
    let text = serde_json::to_vec(errors).unwrap_or_default();
    Tensor::new(&[text.len()], text)
}

/// The errors measured of a body that is not written yet.
pub fn of_precomputed(body: &Precomputed) -> Option<ExpectedErrors> {
    serde_json::from_slice(&body.sections.get(&name_in_section())?.bytes).ok()
}

/// The errors measured of a body, if the file holds them. Fails if that is not what [`measure`] writes.
pub fn read(file: &GreenFile, body: &str) -> Result<Option<ExpectedErrors>, GreenError> {
    let Some(meta) = file.meta.bodies.get(body) else { return Ok(None) };
    if !meta.requirements.sections().any(|section| section == NAME) {
        return Ok(None);
    }
    let damaged = |reason: String| GreenError::Damaged {
        path: file.path.clone(),
        reason: format!("tensor {body}/{}: {reason}", name_in_section()),
    };
    let (_, text) = file.section::<u8>(body, NAME, TENSOR)?;
    let errors: ExpectedErrors = serde_json::from_slice(text).map_err(|error| damaged(error.to_string()))?;
    errors.check().map_err(damaged)?;
    let known = |moved: &MovedErrors| meta.controls.iter().any(|control| control.name == moved.control);
    if let Some(unknown) = errors.moved.iter().find(|moved| !known(moved)) {
        return Err(damaged(format!("the body has no control element {}", unknown.control)));
    }
    Ok(Some(errors))
}

/// Adds the measured errors of the bodies to each frame.
struct ShownErrors(Vec<(usize, Arc<ExpectedErrors>)>);

fn join(listed: &EffectInput<'_>, world: &mut World) -> Result<Option<Box<dyn RunningEffect>>, Failure> {
    let mut told = Vec::new();
    for &(b, name) in &listed.bodies {
        let model = world.bodies[b].assets.model;
        let errors = read(listed.file, name)?.filter(|errors| errors.model == model);
        told.extend(errors.map(|errors| (b, Arc::new(errors))));
    }
    Ok(Some(Box::new(ShownErrors(told))))
}

impl RunningEffect for ShownErrors {
    fn name(&self) -> &'static str {
        NAME
    }

    fn surface(&mut self, _: &World, bodies: &mut [BodyFrame]) {
        for (b, errors) in &self.0 {
            bodies[*b].expected = Some(errors.clone());
        }
    }
}

fn unmeasured(scene: &Resolved, body: &str) -> ExpectedErrors {
    let (model, element) = (scene.bodies[body].model, scene.body[body].element_name().to_owned());
    ExpectedErrors { model, element, begin_at_zero: model.is_exact_near_rest(), ..ExpectedErrors::default() }
}

/// The reason why nothing of a body can be measured, whatever it lists.
pub fn unmeasurable(body: &Body) -> Option<&'static str> {
    if body.control.len() < 2 {
        return Some("it has one control element, and errors are measured by moving one against another");
    }
    let can_be_grabbed = body.control.values().any(|control| control.grab == Grab::Dragger);
    (!can_be_grabbed).then_some("no control element can be grabbed")
}

/// The advice to solve a body on a finer mesh.
pub fn finer_mesh(body: &Body) -> String {
    match body.refine < refine::MOST {
        true => format!("solve again with refine = {}, and compare", body.refine + 1),
        false => "solve again on a finer mesh, and compare".to_owned(),
    }
}

/// Measures the body. Anything that cannot be measured is left out with the reason, and never keeps the body from being written.
pub fn measure(scene: &Resolved, body: &mut Precomputed, progress: &dyn Progress) -> ExpectedErrors {
    let asked = &scene.body[&body.name];
    let mut errors = unmeasured(scene, &body.name);
    if let Some(why) = unmeasurable(asked) {
        errors.left_out.push(why.into());
        return errors;
    }
    let grabbed: Vec<usize> =
        (0..asked.control.len()).filter(|&e| asked.control[e].grab == Grab::Dragger).collect();
    let moved = &grabbed[..grabbed.len().min(MOST_MOVED)];
    if moved.len() < grabbed.len() {
        let (most, all) = (moved.len(), grabbed.len());
        errors.left_out.push(format!("of {all} control elements that can be grabbed, {most} were moved"));
    }
    let mesh = mesh_errors(scene, body, moved, progress, &mut errors.left_out);
    let model = model_errors(scene, body, moved, progress, &mut errors);
    let of_one = |((e, model), mesh): ((&usize, MovedErrors), OfMesh)| MovedErrors {
        control: body.solution.controls[*e].name.clone(),
        hung: model.hung.map(|hung| Hung { mesh: mesh.pushed.map(|of_axes| of_axes[hung.along]), ..hung }),
        mesh: mesh.small,
        finer: model.finer.map(|finer| FinerErrors { rest: mesh.quadratic, ..finer }),
        ..model
    };
    errors.moved = moved.iter().zip(model).zip(mesh).map(of_one).collect();
    if let Err(why) = errors.check() {
        errors.moved.clear();
        errors.left_out.push(format!("what was measured cannot be an error: {why}"));
    }
    errors
}

/// The mesh errors of a moved control element in small motions.
#[derive(Default)]
struct OfMesh {
    small: Option<MeshErrors>,
    /// Errors of quadratic elements on the same mesh.
    quadratic: Option<MeshErrors>,
    /// Errors of the force with which the element is pushed along each axis, free in all else.
    pushed: Option<[f64; 3]>,
}

fn mesh_errors(
    scene: &Scene,
    body: &Precomputed,
    moved: &[usize],
    progress: &dyn Progress,
    left_out: &mut Vec<String>,
) -> Vec<OfMesh> {
    let better = match BetterBody::new(scene, &body.name, progress) {
        Ok(better) => better,
        Err(error) => {
            left_out.push(format!("what the mesh adds: {error}"));
            return moved.iter().map(|_| OfMesh::default()).collect();
        }
    };
    let digits = |MeshErrors { wrench, shape, stiffness, loads }: MeshErrors| MeshErrors {
        wrench: rounded(wrench),
        shape: rounded(shape),
        stiffness: stiffness.map(|stiffness| stiffness.rounded()),
        loads: loads.into_iter().map(three_digits_of).collect(),
    };
    let mut of_one = |e: usize| {
        let small = better.share(&body.solution, e).map(digits);
        if small.is_none() {
            let control = &body.solution.controls[e].name;
            left_out.push(format!(
                "{control}: what the mesh adds: the mesh is too coarse to measure it, or nothing resists"
            ));
        }
        let pushed = better.pushed(&body.solution, e).map(|of_axes| of_axes.map(rounded));
        OfMesh { small, quadratic: better.of_quadratic(e).map(digits), pushed }
    };
    moved.iter().map(|&e| of_one(e)).collect()
}

/// The model errors of each moved control element, bent and shifted; into `errors` go those of the loads where all elements rest.
/// Empty for a model that is static equilibrium itself.
fn model_errors(
    scene: &Resolved,
    body: &mut Precomputed,
    moved: &[usize],
    progress: &dyn Progress,
    errors: &mut ExpectedErrors,
) -> Vec<MovedErrors> {
    let (model, left_out) = (errors.model, &mut errors.left_out);
    if model.law().is_some() {
        left_out.push(format!("what the model adds: \"{}\" is static equilibrium itself", model.name));
        return moved.iter().map(|_| MovedErrors::default()).collect();
    }
    progress.begin("errors of the loads", 1000);
    let mut measured = Measured::new(scene, body);
    if let (Ok(measured), Some(&e)) = (&mut measured, moved.first()) {
        errors.loads = measured.loads.clone();
        match measured.loaded(e, progress, &mut |why| left_out.push(why)) {
            Ok(loaded) => errors.loaded = loaded.as_ref().map(three_digits),
            Err(error) => left_out.push(error.to_string()),
        }
    }
    progress.end();
    let mut all = Vec::new();
    for &e in moved {
        let control = body.solution.controls[e].name.clone();
        let mut told = |why: String| left_out.push(format!("{control}: {why}"));
        let found = match &mut measured {
            Ok(measured) => {
                measured.errors(&body.solution, e, progress, &mut told).map_err(|error| error.to_string())
            }
            Err(error) => Err(error.to_string()),
        };
        // Where it fails in one of its steps.
        progress.end();
        let found = found.unwrap_or_else(|why| {
            told(why);
            MovedErrors::default()
        });
        all.push(MovedErrors {
            across: found.across.map(three_digits_of),
            model: found.model.map(three_digits),
            finer: found.finer.map(|FinerErrors { mesh, whole, .. }| FinerErrors {
                rest: None,
                mesh: mesh.map(three_digits),
                whole: whole.map(three_digits),
            }),
            hung: found.hung.map(|hung| Hung { at: hung.at.iter().map(three_digits).collect(), ..hung }),
            ..MovedErrors::default()
        });
    }
    all
}

fn three_digits(at: &ErrorsAt) -> ErrorsAt {
    ErrorsAt {
        angle: at.angle,
        turn: no_less(at.turn),
        stretch: no_less(at.stretch),
        off: no_less(at.off),
        force: at.force.map(rounded),
        torque: at.torque.map(rounded),
        shape: rounded(at.shape),
    }
}

/// A part, to three digits, and to 0 what is nothing: the last digits of a float depend on how many threads summed it.
fn rounded(value: f64) -> f64 {
    if value < 1e-9 { 0.0 } else { three_digits_of(value) }
}

/// A reach, to three digits: the pose in which it was measured is within.
fn no_less(value: f64) -> f64 {
    rounded(1.005 * value)
}

fn three_digits_of(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}
