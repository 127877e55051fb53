//! One machinery of comparison: references, variants, poses, norms, times and resumption.
//!
//! In: a [`Request`]: a scene's body, poses and limits. Out: the costs of every setting and the parts of its error
//! ([`settings`]), and in addition those of models, a smooth problem and effects ([`measure()`]). The rooms `report`,
//! `tuning` and `verify` read these results; the effect expected_errors measures with the same
//! [`Trial`](crate::deform::Trial)s and [`Truth`](crate::deform::Truth)s.
//!
//! ```text
//! u_setting - u* =   (stored - f64)                    storage
//!                  + (conjugate gradients - Cholesky)  solver
//!                  + (equilibrium here - u*)           discretisation
//!                  + (model - equilibrium here)        model
//! ```
//!
//! u* is the nonlinear equilibrium with tet10 on the finest mesh, in the same pose (`finer`): the whole error is measured against
//! it, and nothing of it comes from linear theory. A pose without such an equilibrium is named with the reason, and no error is
//! told for it. The equilibrium here is known with tet4 on the scene's mesh; on other meshes it is taken to differ from that as the
//! most accurate model does that is made on both. In addition, each model alone is tried at rotations from 1° to 360° ([`trials`]).
//!
//! The parts are fields on one finest mesh. Their sum, node by node, is the whole error, so its norm is at most the sum of
//! their norms. Forces and torques are compared in the same way. All errors are relative to that equilibrium: to the L2
//! norm of its displacement, the root of its energy, its largest wrench.

pub mod body;
mod course;
pub mod data;
pub mod exact;
mod fields;
mod finer;
mod measurements;
mod norms;
mod pose_errors;
pub mod poses;
mod reference;
mod request;
mod resume;
pub mod smooth;
mod times;
pub mod trials;
mod truth;
pub mod units;
mod variants;
mod verified;

pub use data::{
    Cost, EffectCost, Errors, Measurement, ModelError, ModelTrial, ModelTrials, PARAMETERS, Parameter,
    Report, SCHEMA, Setting, Shapes, SmoothError, Spread, Timing, TrialMotion,
};
pub use finer::EquilibriumOfPose;
pub use norms::{MeshLadder, Norms, largest};
pub use request::{Limits, MeasureError, Request, TimeLimit};
pub use resume::{FOLDER, remove};
pub use truth::{RefinedBody, TrueErrors};
pub use variants::online;
pub use verified::{SettingInSession, Verified, verify};

use crate::base::machine;
use crate::deform::{ControlPoses, LINEAR};
use crate::fem::{ELEMENTS, Element, TET4, TET10};
use crate::mesh::TetMesh;
use crate::solve::{Progress, Solver};
use course::{Course, Step, StepKind};
use poses::hardest_first;
use reference::References;
use resume::Kept;
use std::path::Path;
use variants::{Candidate, Meshes, comes_first, is_common, is_of_scene, iterative};

/// Costs and errors of every setting, and the references of the errors.
pub struct Measured {
    pub rows: Vec<Measurement>,
    pub timing: Timing,
    pub models: Vec<ModelError>,
    /// The reference of each part of the error.
    pub references: Vec<String>,
    /// The poses that were measured, and why others were left out.
    pub poses: Vec<(String, ControlPoses)>,
    pub left_out: Vec<String>,
    /// The poses that were compared with a finer equilibrium, and sentences about the others.
    pub compared: Vec<String>,
    pub not_compared: Vec<String>,
    pub doubt: Option<[f64; 2]>,
    /// Models that were not measured, and why.
    pub models_left_out: Vec<String>,
}

/// Solutions of the body with every setting, and the references with which they are compared.
struct Solutions<'a> {
    candidates: Vec<Candidate>,
    references: References<'a>,
    /// Models that a body or an element does not suit, and why.
    left_out: Vec<String>,
}

/// Makes the course of a request, and announces how long it will take.
fn course<'a>(
    request: &Request<'_>,
    meshes: &Meshes,
    whole: bool,
    progress: &'a dyn Progress,
) -> Result<Course<'a>, MeasureError> {
    let mut kept = None;
    if let Some(folder) = request.keep {
        let io = |source| MeasureError::Io { path: folder.to_owned(), source };
        let (found, notices) = Kept::open(folder, request).map_err(io)?;
        notices.iter().for_each(|notice| progress.tell(notice));
        kept = Some(found);
    }
    let can_stop = if kept.is_some() { "; Ctrl-C stops it, and the same command continues" } else { "" };
    let course = Course::new(agenda(request, meshes, whole), request.limit, kept, progress);
    progress.tell(&format!("measuring {}{can_stop}", course.forecast()));
    Ok(course)
}

/// Measures all settings, and nothing else. This takes long; `progress` follows it.
pub fn settings(request: &Request<'_>, progress: &dyn Progress) -> Result<Measured, MeasureError> {
    settings_against(request, &[], progress).map(|(measured, _)| measured)
}

/// [`settings`], and the true errors of each row against equilibria in the poses of the request (`truth`).
pub fn settings_against(
    request: &Request<'_>,
    truths: &[Option<EquilibriumOfPose>],
    progress: &dyn Progress,
) -> Result<(Measured, Vec<TrueErrors>), MeasureError> {
    let meshes = Meshes::new(request)?;
    let course = course(request, &meshes, false, progress)?;
    let mut solved = Solutions::new(&meshes, request, &course)?;
    let (rows, timing) = solved.rows(&meshes, request, &course)?;
    let of = (&meshes, &solved.candidates[..], &solved.references);
    let judged = truth::judged(request, &rows, of, truths);
    Ok((solved.measured(&meshes, rows, timing), judged))
}

impl<'a> Solutions<'a> {
    fn new(
        meshes: &'a Meshes,
        request: &Request<'_>,
        course: &Course<'_>,
    ) -> Result<Solutions<'a>, MeasureError> {
        let mut left_out = Vec::new();
        // Equilibria before all that is dearer: where time is short, errors of few settings in several poses say more than those of
        // many settings in one.
        let mut candidates = variants::solve_first(request, meshes, course)?;
        let mut references = References::new(request, meshes, &candidates, course)?;
        variants::solve_rest(request, meshes, &mut left_out, course, &mut candidates)?;
        references.judge_models(request, meshes, &candidates, course)?;
        Ok(Solutions { candidates, references, left_out })
    }

    fn rows(
        &mut self,
        meshes: &Meshes,
        request: &Request<'_>,
        course: &Course<'_>,
    ) -> Result<(Vec<Measurement>, Timing), MeasureError> {
        let (candidates, references) = (&self.candidates, &self.references);
        measurements::measurements(request, meshes, candidates, references, &mut self.left_out, course)
    }

    fn measured(mut self, meshes: &Meshes, rows: Vec<Measurement>, timing: Timing) -> Measured {
        let (compared, not_compared) = self.references.compared();
        let doubt = self.references.doubt();
        self.references.models_left_out.append(&mut self.left_out);
        Measured {
            rows,
            timing,
            references: self.references.sentences(meshes),
            models: self.references.models,
            poses: self.references.poses.into_iter().map(|pose| (pose.name, pose.poses)).collect(),
            left_out: self.references.left_out,
            compared,
            not_compared,
            doubt,
            models_left_out: self.references.models_left_out,
        }
    }
}

/// Measures settings, models, the smooth problem and effects; `shown` chooses the rows whose shapes a page will draw.
pub fn measure(
    request: &Request<'_>,
    shown: &dyn Fn(&[Measurement], &Setting) -> Vec<usize>,
    progress: &dyn Progress,
) -> Result<Report, MeasureError> {
    let meshes = Meshes::new(request)?;
    let course = course(request, &meshes, true, progress)?;
    let mut solved = Solutions::new(&meshes, request, &course)?;
    let trials = trials::measure(request, &solved.candidates, &solved.references, &course)?;
    let (rows, timing) = solved.rows(&meshes, request, &course)?;
    let own = own_setting(request);
    let shown = shown(&rows, &own);
    let shapes = pose_errors::shapes(&meshes, &solved.candidates, &solved.references, &rows, &shown, &own);
    let measured = solved.measured(&meshes, rows, timing);
    let mesh_of = |element: &'static Element, refine: u32| meshes.mesh(request, refine, element).cloned();
    let smooth = smooth::measure(&mesh_of, meshes.linear.len() as u32, &course)?;
    let effects = course.step_as_json(Step::EFFECTS, |_| {
        let model = request.scene.bodies[request.body].model;
        let model = if model.law().is_some() { &LINEAR } else { model };
        let (of, poses) = (request.requirements_of, &measured.poses[0].1);
        Ok(times::of_effects(request.scene, request.body, of, model, poses, request.scratch)?)
    })?;
    let base = &meshes.linear[0];
    let (low, high) = crate::base::extent::bounding_box(&base.nodes);
    let machine = [Some(machine::description()), course.taken_over()];
    Ok(Report {
        schema: SCHEMA,
        program: format!("greenstage {}", env!("CARGO_PKG_VERSION")),
        machine: machine.into_iter().flatten().collect::<Vec<_>>().join(". "),
        scene: scene_name(&request.scene.path),
        command: request.command.clone(),
        body: request.body.to_owned(),
        about: about(request, base),
        size: (high - low).amax(),
        references: measured.references,
        poses: measured.poses.into_iter().map(|(name, _)| name).collect(),
        pose_source: request.pose_source.clone(),
        compared: measured.compared,
        not_compared: measured.not_compared,
        doubt: measured.doubt,
        quick: request.quick,
        own,
        rows: measured.rows,
        timing: measured.timing,
        models: measured.models,
        trials,
        smooth,
        effects,
        left_out: course.left_out(),
        shapes,
    })
}

/// The scene's file, or the name of a built-in scene.
fn scene_name(path: &Path) -> String {
    match path.file_stem() {
        Some(name) if !path.exists() => format!("{}, which the program brings along", name.to_string_lossy()),
        _ => path.display().to_string(),
    }
}

/// The setting in the scene; without the tolerance of a direct solver, which has no effect.
fn own_setting(request: &Request<'_>) -> Setting {
    let body = &request.scene.body[request.body];
    let Solver { method, tolerance, .. } = body.solver;
    Setting {
        refine: 0,
        element: body.element.name.into(),
        solver: if method.is_direct {
            Solver::default()
        } else {
            Solver { method, tolerance, ..Solver::default() }
        },
        storage: body.storage.name(),
        model: request.scene.bodies[request.body].model,
    }
}

/// Mesh, material and control elements of the body, one sentence each.
fn about(request: &Request<'_>, base: &TetMesh) -> Vec<String> {
    let body = &request.scene.body[request.body];
    let origin = match (&body.mesh, &body.generate) {
        (Some(file), _) => format!("read from {}", file.display()),
        _ => "generated".into(),
    };
    let material = |m: &crate::scene::Material| {
        format!("Young's modulus {:.3e} Pa, Poisson's ratio {}", m.young, m.poisson)
    };
    let mut sentences = vec![
        format!("{} nodes and {} tetrahedra, {origin}", base.nodes.len(), base.tets.len()),
        format!("isotropic: {}", material(&body.material)),
    ];
    sentences.extend(body.region.iter().map(|(region, m)| format!("region {region}: {}", material(m))));
    let names: Vec<&str> = body.control.keys().map(String::as_str).collect();
    sentences.push(format!("{} control elements: {}", names.len(), names.join(", ")));
    let loads: Vec<&str> = body.loads().iter().map(|load| load.name).collect();
    if !loads.is_empty() {
        sentences.push(format!(
            "measured without its loads ({}); the effect expected_errors measures the scene's model under them",
            loads.join(", ")
        ));
    }
    sentences
}

/// Unknowns of the demo's tube with tet4, at which times are fitted.
const TUBE: f64 = 30_240.0;

/// The steps of a measurement in their order, with their expected times on an idle machine with two cores, fitted to the
/// demo's tube; the course corrects them by the times of the first steps. `whole`: with everything that a report has in
/// addition to the settings.
fn agenda(request: &Request<'_>, meshes: &Meshes, whole: bool) -> Vec<Step> {
    let mut steps = Vec::new();
    let step =
        |key: String, kind: StepKind, seconds: f64, is_needed: bool| Step { key, kind, seconds, is_needed };
    let unknowns = |refine: u32, element: &Element| meshes.unknowns(refine, element) / TUBE;
    let top = meshes.linear.len() as u32 - 1;
    let repeats = if request.quick { 1.0 } else { 2.0 };
    // Time of the errors of every storage in three poses, all on the finest mesh.
    let judged = |own: f64| 0.18 * unknowns(top, &TET10) + 0.75 * own;
    let mut solved = Vec::new();
    let own_solver = own_setting(request).solver;
    let (own, model) = (request.scene.body[request.body].element, request.scene.bodies[request.body].model);
    for (refine, element) in meshes.affordable(request) {
        let is_needed = (refine, element) == (0, &TET4) || (refine, element) == (0, own) && is_common(model);
        let seconds = repeats * direct(unknowns(refine, element) * element.unknown_cost.sqrt());
        let key = Step::solved(refine, element, Solver::default(), None);
        // One storage in place of all of them.
        let spared = if request.limit.is_some() && (refine, element) == (top, &TET10) { 0.4 } else { 1.0 };
        let judged = spared * judged(unknowns(refine, element));
        solved.push((step(key, StepKind::Solve, seconds, is_needed), judged));
    }
    for (model, refine, element) in meshes.for_models(request) {
        let of_model = if model.is_reduced() { OF_REDUCED } else { OF_MODELS };
        let seconds = of_model * repeats * direct(unknowns(refine, element) * element.unknown_cost.sqrt());
        let key = Step::solved(refine, element, Solver::default(), Some(model.name));
        let is_own = is_of_scene(request, model, refine, element);
        solved.push((
            step(key, StepKind::SolveForModel, seconds, is_own),
            0.5 * judged(unknowns(refine, element)),
        ));
    }
    if meshes.mesh(request, 0, own).is_some() {
        for solver in iterative(request) {
            let digits = -solver.tolerance().unwrap_or(1e-10).log10();
            let seconds = (0.7 + 0.2 * digits) * unknowns(0, own).powf(4.0 / 3.0);
            let key = Step::solved(0, own, solver, None);
            solved.push((
                step(key, StepKind::SolveIteratively, seconds, is_common(model) && solver == own_solver),
                0.5 * judged(unknowns(0, own)),
            ));
        }
    }
    let poses = request.poses.len() as f64;
    let base = unknowns(0, &TET4);
    let first = |solved: &Step| {
        let is_first = |(refine, element): &(u32, &'static Element)| {
            comes_first(request, *refine, element)
                && solved.key == Step::solved(*refine, element, Solver::default(), None)
        };
        meshes.affordable(request).iter().any(is_first)
    };
    steps.extend(solved.iter().map(|(step, _)| step.clone()).filter(first));
    steps.push(step(Step::EQUILIBRIA.into(), StepKind::Equilibria, 0.5 * poses * base.powf(1.4), true));
    let of_level = |level: u32| FINER * direct(unknowns(level, &TET10));
    let finer: f64 = (0..=top).map(of_level).sum();
    for (i, pose) in hardest_first(request.poses, meshes.extent()).into_iter().enumerate() {
        steps.push(step(Step::finer(pose, &request.poses[pose].0), StepKind::Finer, finer, i == 0));
    }
    steps.extend(solved.iter().map(|(step, _)| step.clone()).filter(|step| !first(step)));
    if whole {
        let motions = if request.quick { 6.0 } else { 20.0 };
        steps.push(step(Step::TRIALS.into(), StepKind::Trials, 1.5 * motions * base.powf(1.4), false));
    }
    steps.extend(solved.iter().map(|(of, seconds)| {
        step(Step::errors(&of.key), StepKind::Errors, seconds * poses / 3.0, of.is_needed)
    }));
    let rows = 2.0 * solved.len() as f64;
    steps.push(step(
        Step::TIMES.into(),
        StepKind::Other,
        4e-4 * rows * request.limits.rounds as f64 * base,
        true,
    ));
    if whole {
        if top > 0 {
            for element in ELEMENTS.iter().copied() {
                let all = (0..=top).filter(|refine| meshes.mesh(request, *refine, element).is_some());
                let seconds =
                    all.map(|refine| direct(unknowns(refine, element) * element.unknown_cost.sqrt())).sum();
                steps.push(step(Step::smooth(element), StepKind::Other, seconds, false));
            }
        }
        steps.push(step(Step::EFFECTS.into(), StepKind::Other, 0.5 * base + direct(base), true));
    }
    steps
}

/// Time of a direct solve with the columns of two control elements, s, by the unknowns over [`TUBE`].
fn direct(unknowns: f64) -> f64 {
    0.4 * unknowns.powf(1.6)
}

/// Time of a finer equilibrium next to the coarser one over that of a direct solve with the columns of two control elements.
const FINER: f64 = 2.0;

/// Time of a solve with a model's own column families over that of one without.
const OF_MODELS: f64 = 30.0;
/// Time of a solve with fields from equilibria of the body over that of one without.
const OF_REDUCED: f64 = 90.0;
