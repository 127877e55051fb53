//! Every model alone, at rotations from 1° to 360°: its errors in bends and twists of one control element.
//!
//! In: the body solved for each model. Out: [`ModelTrials`]: how far shape, force, torque and energy are from static equilibrium
//! of a St. Venant–Kirchhoff body on the same mesh, and the time of a frame. A model is tried as a session has it: from a
//! .green file with its families and its energy, in single precision.

use super::course::{Course, Step};
use super::data::{ModelTrial, ModelTrials, TrialMotion};
use super::reference::{MOST_POISSON, References, softened};
use super::request::{MeasureError, Request};
use super::variants::{Candidate, is_measured, online, variant};
use crate::deform::{
    Deformer, MODELS, ModelEntry, Motion, Moved, Statics, StaticsError, Trial, Truth, in_session, trials,
};
use crate::effect::expected::mesh::softest_turn;
use crate::fem::TET4;
use crate::green::Precomputed;
use crate::scene::{Grab, Scene, Storage};
use crate::solve::{Progress, Solver};

const DEGREES: [f64; 10] = [1.0, 3.0, 10.0, 30.0, 60.0, 90.0, 135.0, 180.0, 270.0, 360.0];
const QUICK_DEGREES: [f64; 3] = [10.0, 30.0, 90.0];

/// Tries every online model; those that cannot be tried stand among the sentences.
pub fn measure(
    request: &Request<'_>,
    candidates: &[Candidate],
    references: &References<'_>,
    course: &Course<'_>,
) -> Result<ModelTrials, MeasureError> {
    if !course.affords(Step::TRIALS) {
        return Ok(ModelTrials::default());
    }
    course.step_as_json(Step::TRIALS, |progress| tried(request, candidates, references, progress))
}

fn tried(
    request: &Request<'_>,
    candidates: &[Candidate],
    references: &References<'_>,
    progress: &dyn Progress,
) -> Result<ModelTrials, MeasureError> {
    let mut found = ModelTrials::default();
    let scene = scene(request);
    let element = scene.body[request.body].element;
    let nodes = candidates.iter().find(|c| c.refine == 0 && c.element == element);
    let unknowns = nodes.map_or(f64::INFINITY, |c| 3.0 * c.solution.mesh.nodes.len() as f64);
    let limit = request.limits.largest_of_models;
    if unknowns > limit {
        found.about.push(format!(
            "Not measured: {unknowns:.0} unknowns of {} are more than the {limit:.0} for which models are tried; raise {}.",
            element.name, request.largest_key
        ));
        return Ok(found);
    }
    let mut statics = match Truth::SameMesh.statics(&scene, request.body, progress) {
        Ok(statics) => statics,
        Err(StaticsError::Green(why)) => {
            found.about.push(format!("Not measured: {why}"));
            return Ok(found);
        }
        Err(error) => return Err(error.into()),
    };
    let Some(mut moved) = moved(request, &statics) else {
        found.about.push("Not measured: no control element can be moved against others.".into());
        return Ok(found);
    };
    let own = nodes.and_then(|c| softest_turn(&c.solution, moved.element, &moved.axis));
    if let Some(across) = own {
        moved = moved.about(across);
    }
    found.about = about(request, &scene, &statics, &moved);
    let held = equilibria(request, &mut statics, &moved, &mut found.about, progress)?;
    for model in online().filter(|model| is_measured(request, model)) {
        let of = |c: &&Candidate| c.is_of(0, element, model);
        let solved =
            if element == &TET4 { references.base(candidates, model) } else { candidates.iter().find(of) };
        let Some(solved) = solved else {
            let (model, element) = (model.name, element.name);
            found.about.push(format!("Left out: {model}, which was not made with {element} on this mesh."));
            continue;
        };
        let (name, solution) = (request.body, solved.solution.clone());
        let made = Precomputed::from_solution(name, Storage::F32, model.with_energy(), solution);
        let mut deformer = match in_session(&made, model)? {
            Ok(deformer) => deformer,
            Err(why) => {
                found.about.push(format!("Left out: {}: {why}", model.name));
                continue;
            }
        };
        let nodes = Trial::surface_nodes(&statics, &deformer);
        found.rows.extend(held.iter().filter_map(|trial| row(model, trial, &mut deformer, &nodes)));
    }
    Ok(found)
}

/// The body in single precision, of a material that does not lock.
fn scene(request: &Request<'_>) -> Scene {
    let element = request.scene.body[request.body].element;
    let scene = variant(request, 0, element, Solver::default());
    let soft = if element.locks { softened(&scene, request.body) } else { None };
    soft.unwrap_or(scene)
}

/// The first control element that a hand can take and move against the others.
fn moved(request: &Request<'_>, statics: &Statics) -> Option<Moved> {
    let origins: Vec<_> = statics.controls.iter().map(|control| control.origin).collect();
    let controls = &request.scene.body[request.body].control;
    let can_be_taken = statics.controls.iter().enumerate().filter(|(_, control)| {
        controls.get(&control.name).is_some_and(|control| control.grab == Grab::Dragger)
    });
    can_be_taken.map(|(e, _)| e).find_map(|e| Moved::new(&origins, e))
}

fn about(request: &Request<'_>, scene: &Scene, statics: &Statics, moved: &Moved) -> Vec<String> {
    let (element, name) = (scene.body[request.body].element.name, &statics.controls[moved.element].name);
    let laws = MODELS.iter().filter(|model| model.law().is_some());
    let laws: Vec<&str> = laws.map(|model| model.name).collect();
    let soft = if element_softened(request, scene) {
        format!(
            ", with Poisson's ratio {MOST_POISSON} and the same shear modulus where the scene's is larger: {element} locks \
             near 1/2"
        )
    } else {
        String::new()
    };
    vec![
        format!(
            "The control element {name} is bent along a circular arc, in the plane in which that is easiest, and twisted about the axis from the others, which rest; \
             it moves in steps of at most 10°, as with a hand."
        ),
        format!(
            "Every model is tried as a session has it, from a .green file in f32, and compared with the static equilibrium of \
             a St. Venant–Kirchhoff body with {element} on the same mesh{soft}. Discretisation has no part in these errors."
        ),
        format!(
            "Not among the curves: {}, which are static equilibrium themselves, found in the background; `greenstage bench` \
             prints how often per second.",
            laws.join(", ")
        ),
    ]
}

fn element_softened(request: &Request<'_>, scene: &Scene) -> bool {
    let poisson = |scene: &Scene| {
        let body = &scene.body[request.body];
        let regions = body.region.values().map(|material| material.poisson);
        regions.chain([body.material.poisson]).collect::<Vec<f64>>()
    };
    poisson(scene) != poisson(request.scene)
}

/// The motions that have an equilibrium; sentences about the others are added to `about`.
fn equilibria(
    request: &Request<'_>,
    statics: &mut Statics,
    moved: &Moved,
    about: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Vec<Trial>, MeasureError> {
    let degrees: &[f64] = if request.quick { &QUICK_DEGREES } else { &DEGREES };
    let of = |motion: fn(f64) -> Motion| degrees.iter().map(move |&degrees| motion(degrees));
    let motions: Vec<Motion> = of(Motion::Bend).chain(of(Motion::Twist)).collect();
    progress.begin("equilibria of bends and twists", 1000 * motions.len() as u64);
    let mut told = |motion: Motion, why: String| about.push(format!("Left out: {}: {why}.", motion.name()));
    let found = trials(statics, moved, &motions, progress, &mut told)?;
    progress.end();
    Ok(found)
}

fn row(model: &ModelEntry, trial: &Trial, deformer: &mut Deformer, nodes: &[usize]) -> Option<ModelTrial> {
    let (motion, degrees) = match trial.motion {
        Motion::Bend(degrees) => (TrialMotion::Bend, degrees),
        Motion::Twist(degrees) => (TrialMotion::Twist, degrees),
        _ => return None,
    };
    let found = trial.deviation(deformer, nodes);
    Some(ModelTrial {
        model: model.name.into(),
        motion,
        degrees,
        displacement: found.shape,
        force: found.force,
        torque: found.torque,
        energy: found.energy,
        frame_s: trial.frame_time(deformer),
    })
}
