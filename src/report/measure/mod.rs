//! A scene's body computed with every setting of every knob, each with its costs and the parts of its error.
//!
//! ```text
//! u_setting - u* =   (stored - f64)                    storage
//!                  + (conjugate gradients - Cholesky)  solver
//!                  + (this mesh, element - finest)     discretisation, with the model's own coefficients
//!                  + (model - nonlinear statics)       model, both with tet4 on the scene's mesh
//! ```
//!
//! The parts are fields on one finest mesh, and their sum, node by node, is the whole: its norm is at most the sum of
//! theirs. u* is thus the nonlinear equilibrium of the scene's mesh, corrected by what refining does in the linear
//! theory; forces and torques are compared with its own in the same way. All is relative to that equilibrium: to the L2
//! norm of its displacement, the root of its energy, its largest wrench.

mod candidates;
mod effects;
mod fields;
mod frame;
mod ladder;
mod norms;
pub mod poses;
mod rows;
mod smooth;
mod truth;

pub use candidates::Limits;
pub use ladder::Ladder;
pub use norms::Norms;

use super::{ModelError, Report, Row, SCHEMA};
use crate::deform::{ControlPoses, Kind, StaticsError, find_model};
use crate::fem::AssemblyError;
use crate::green::{GreenError, Requirements};
use crate::mesh::TetMesh;
use crate::scene::{Scene, SceneError};
use crate::solve::Progress;
use crate::verify::Fault;
use std::path::Path;

/// What is to be measured.
pub struct Request<'a> {
    pub scene: &'a Scene,
    pub body: &'a str,
    /// By name, one pose for each control element in the scene's order.
    pub poses: &'a [(String, ControlPoses)],
    pub pose_source: String,
    pub limits: Limits,
    /// Where the user sets `limits.largest`.
    pub largest_key: String,
    pub quick: bool,
    /// What the body's model and effects require, as the scene lists them.
    pub needs_of: &'a dyn Fn(&Scene) -> Requirements,
    /// The command that does it again.
    pub command: String,
    /// For files that live while it is measured.
    pub scratch: &'a Path,
}

#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Green(#[from] GreenError),
    #[error(transparent)]
    Statics(#[from] StaticsError),
    #[error("the norms' matrix: {0}")]
    Assembly(#[from] AssemblyError),
    #[error("the smooth problem: {0}")]
    Smooth(#[from] Fault),
    #[error(
        "the reference needs tet10 on this mesh, {nodes} nodes and three times as many unknowns, more than {largest:.0}; \
         raise {key} (a million unknowns take some 10 GB), or take a coarser mesh"
    )]
    TooLarge { nodes: usize, largest: f64, key: String },
    #[error(
        "the mesh file has 10-node tetrahedra: its corners are what all elements have in common; \
         `greenstage convert` writes a mesh of them"
    )]
    TenNodes,
    #[error("{0}")]
    Model(String),
    #[error("no pose is left: {0}")]
    NoPose(String),
    #[error("{}: {source}", path.display())]
    Io { path: std::path::PathBuf, source: std::io::Error },
}

/// Every setting's costs and errors, and what they were measured with.
pub struct Measured {
    pub rows: Vec<Row>,
    pub models: Vec<ModelError>,
    /// What each part of the error is taken against.
    pub references: Vec<String>,
    /// The poses that the errors are over, and why others are left out.
    pub poses: Vec<(String, ControlPoses)>,
    pub left_out: Vec<String>,
}

/// Measures all settings, and nothing else; long, with `progress`.
pub fn settings(request: &Request<'_>, progress: &dyn Progress) -> Result<Measured, MeasureError> {
    settings_on(&candidates::Meshes::new(request)?, request, progress)
}

fn settings_on(
    meshes: &candidates::Meshes,
    request: &Request<'_>,
    progress: &dyn Progress,
) -> Result<Measured, MeasureError> {
    let candidates = candidates::solve(request, meshes, progress)?;
    let truth = truth::Truth::new(request, meshes, &candidates, progress)?;
    let rows = rows::rows(request, meshes, &candidates, &truth, progress)?;
    Ok(Measured {
        rows,
        references: truth.references(&candidates),
        models: truth.models,
        poses: truth.poses.into_iter().map(|pose| (pose.name, pose.poses)).collect(),
        left_out: truth.left_out,
    })
}

/// Measures it all: settings, the smooth problem, effects.
pub fn measure(request: &Request<'_>, progress: &dyn Progress) -> Result<Report, MeasureError> {
    let meshes = candidates::Meshes::new(request)?;
    let measured = settings_on(&meshes, request, progress)?;
    let smooth = smooth::measure(
        &|element, refine| candidates::smooth_mesh(&meshes, request, element, refine),
        meshes.linear.len() as u32,
        progress,
    )?;
    let body = &request.scene.body[request.body];
    let is_online = |name: &str| find_model(name).is_ok_and(|model| matches!(model.kind, Kind::Online(_)));
    let model = if is_online(&body.model) { &body.model } else { "linear" };
    let effects = effects::measure(
        request.scene,
        request.body,
        request.needs_of,
        model,
        &measured.poses[0].1,
        request.scratch,
    )?;
    let base = &meshes.linear[0];
    let (low, high) = crate::mesh::quality::bounding_box(&base.nodes);
    Ok(Report {
        schema: SCHEMA,
        program: format!("greenstage {}", env!("CARGO_PKG_VERSION")),
        machine: machine(),
        scene: request.scene.path.display().to_string(),
        command: request.command.clone(),
        body: request.body.to_owned(),
        about: about(request, base),
        size: (high - low).amax(),
        references: measured.references,
        poses: measured.poses.into_iter().map(|(name, _)| name).collect(),
        pose_source: request.pose_source.clone(),
        quick: request.quick,
        rows: measured.rows,
        models: measured.models,
        smooth,
        effects,
    })
}

/// What the body is, one sentence each.
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
    said
}

/// Processor and threads, as far as the system tells.
pub fn machine() -> String {
    let name = std::fs::read_to_string("/proc/cpuinfo").ok().and_then(|text| {
        let line = text.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split(':').nth(1)?.trim().to_owned())
    });
    let name = name.unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    format!("{name}, {} threads, {}", rayon::current_num_threads(), std::env::consts::OS)
}
