//! Measures a scene's body with every value of every parameter: the costs of each setting, and the parts of its error.
//!
//! ```text
//! u_setting - u* =   (stored - f64)                    storage
//!                  + (conjugate gradients - Cholesky)  solver
//!                  + (this mesh, element - finest)     discretisation, with the model's own coefficients
//!                  + (model - nonlinear statics)       model, both with tet4 on the scene's mesh
//! ```
//!
//! A model with its own column families is made on fewer meshes. From the finest of them on, its discretisation error is the
//! change by refinement in the most accurate model that is made on finer ones. Beside the settings, each model is tried alone at
//! rotations from 1° to 360° (`trials`).
//!
//! The parts are fields on one finest mesh. Their sum, node by node, is the whole error, so its norm is at most the sum of
//! their norms. u* is thus the nonlinear equilibrium on the scene's mesh, corrected by what refinement changes in the
//! linear theory; forces and torques are compared in the same way. All errors are relative to that equilibrium: to the L2
//! norm of its displacement, the root of its energy, its largest wrench.

mod agenda;
mod candidate;
mod candidates;
mod course;
mod effects;
mod fields;
mod frame;
mod kept;
mod kept_solution;
mod ladder;
mod measurements;
mod model_candidates;
mod names;
mod norms;
mod of_models;
mod pose_errors;
pub mod poses;
mod reference;
mod request;
mod shapes;
mod smooth;
mod trials;

pub use kept::{FOLDER, remove};
pub use ladder::MeshLadder;
pub use norms::Norms;
pub use request::{Limits, MeasureError, Request, TimeLimit};

use super::data::{Measurement, ModelError, Report, SCHEMA, Setting, Timing};
use super::headline::shown_of;
use crate::base::machine;
use crate::deform::{ControlPoses, LINEAR};
use crate::fem::Element;
use crate::mesh::TetMesh;
use crate::solve::{Progress, Solver};
use candidate::Candidate;
use candidates::Meshes;
use course::Course;
use kept::Kept;
use reference::References;
use std::path::Path;

/// Costs and errors of every setting, and what they are compared with.
pub struct Measured {
    pub rows: Vec<Measurement>,
    pub timing: Timing,
    pub models: Vec<ModelError>,
    /// The reference of each part of the error.
    pub references: Vec<String>,
    /// The poses that were measured, and why others were left out.
    pub poses: Vec<(String, ControlPoses)>,
    pub left_out: Vec<String>,
    /// Models that were not measured, and why.
    pub models_left_out: Vec<String>,
}

/// The body solved in every way, and what it is compared with.
struct Solved<'a> {
    candidates: Vec<Candidate>,
    references: References<'a>,
    /// Models that a body or an element does not suit, and why.
    left_out: Vec<String>,
}

/// The course of a request, with an announcement of how long it will take.
fn course<'a>(
    request: &Request<'_>,
    meshes: &Meshes,
    whole: bool,
    progress: &'a dyn Progress,
) -> Result<Course<'a>, MeasureError> {
    let mut kept = None;
    if let Some(folder) = request.keep {
        let io = |source| MeasureError::Io { path: folder.to_owned(), source };
        let (found, told) = Kept::open(folder, request).map_err(io)?;
        told.iter().for_each(|told| progress.tell(told));
        kept = Some(found);
    }
    let can_stop = if kept.is_some() { "; Ctrl-C stops it, and the same command continues" } else { "" };
    let course = Course::new(agenda::agenda(request, meshes, whole), request.limit, kept, progress);
    progress.tell(&format!("measuring {}{can_stop}", course.forecast()));
    Ok(course)
}

/// Measures all settings, and nothing else. This takes long; `progress` follows it.
pub fn settings(request: &Request<'_>, progress: &dyn Progress) -> Result<Measured, MeasureError> {
    let meshes = Meshes::new(request)?;
    let course = course(request, &meshes, false, progress)?;
    let mut solved = Solved::new(&meshes, request, &course)?;
    let (rows, timing) = solved.rows(&meshes, request, &course)?;
    Ok(solved.measured(rows, timing))
}

impl<'a> Solved<'a> {
    fn new(
        meshes: &'a Meshes,
        request: &Request<'_>,
        course: &Course<'_>,
    ) -> Result<Solved<'a>, MeasureError> {
        let mut left_out = Vec::new();
        let mut candidates = candidates::solve(request, meshes, course)?;
        candidates.extend(model_candidates::solve(request, meshes, &mut left_out, course)?);
        candidates.extend(candidates::solve_iteratively(request, meshes, course)?);
        let references = References::new(request, meshes, &candidates, course)?;
        Ok(Solved { candidates, references, left_out })
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

    fn measured(mut self, rows: Vec<Measurement>, timing: Timing) -> Measured {
        self.references.models_left_out.append(&mut self.left_out);
        Measured {
            rows,
            timing,
            references: self.references.sentences(&self.candidates),
            models: self.references.models,
            poses: self.references.poses.into_iter().map(|pose| (pose.name, pose.poses)).collect(),
            left_out: self.references.left_out,
            models_left_out: self.references.models_left_out,
        }
    }
}

/// Measures settings, models, the smooth problem and effects.
pub fn measure(request: &Request<'_>, progress: &dyn Progress) -> Result<Report, MeasureError> {
    let meshes = Meshes::new(request)?;
    let course = course(request, &meshes, true, progress)?;
    let mut solved = Solved::new(&meshes, request, &course)?;
    let trials = trials::measure(request, &solved.candidates, &solved.references, &course)?;
    let (rows, timing) = solved.rows(&meshes, request, &course)?;
    let own = own_setting(request);
    let shown: Vec<usize> = shown_of(&rows, &own).into_iter().map(|shown| shown.row).collect();
    let shapes = shapes::of(&meshes, &solved.candidates, &solved.references, &rows, &shown, &own);
    let measured = solved.measured(rows, timing);
    let mesh_of = |element: &'static Element, refine: u32| {
        let mesh = meshes.of(element).get(refine as usize);
        mesh.filter(|_| meshes.affords(request, refine as usize, element)).cloned()
    };
    let smooth = smooth::measure(&mesh_of, meshes.linear.len() as u32, &course)?;
    let effects = course.step_as_json(names::EFFECTS, |_| {
        let model = request.scene.bodies[request.body].model;
        let model = if model.law().is_some() { &LINEAR } else { model };
        let (of, poses) = (request.requirements_of, &measured.poses[0].1);
        Ok(effects::measure(request.scene, request.body, of, model, poses, request.scratch)?)
    })?;
    let base = &meshes.linear[0];
    let (low, high) = crate::mesh::quality::bounding_box(&base.nodes);
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

/// The file, or the name of a scene that the program brings along.
fn scene_name(path: &Path) -> String {
    match path.file_stem() {
        Some(name) if !path.exists() => format!("{}, which the program brings along", name.to_string_lossy()),
        _ => path.display().to_string(),
    }
}

/// The setting that the scene asks for; the tolerance of a direct solver means nothing.
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
    let mut said = vec![
        format!("{} nodes and {} tetrahedra, {origin}", base.nodes.len(), base.tets.len()),
        format!("isotropic: {}", material(&body.material)),
    ];
    said.extend(body.region.iter().map(|(region, m)| format!("region {region}: {}", material(m))));
    let names: Vec<&str> = body.control.keys().map(String::as_str).collect();
    said.push(format!("{} control elements: {}", names.len(), names.join(", ")));
    let loads: Vec<&str> = body.loads().iter().map(|load| load.name).collect();
    if !loads.is_empty() {
        said.push(format!(
            "measured without its loads ({}); the effect expected_errors measures the scene's model under them",
            loads.join(", ")
        ));
    }
    said
}
