//! The request of a measurement, and the errors of measuring.

use super::body::ProblemError;
use crate::deform::{ControlPoses, ModelEntry, StaticsError};
use crate::effect::Resolved;
use crate::fem::AssemblyError;
use crate::green::{GreenError, Requirements};
use crate::scene::SceneError;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Limits of the computation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Unknowns of a solve; each of tet4_anp counts three times.
    pub largest: f64,
    /// Unknowns of the largest solve for a model with its own column families, which takes many times as long; on other meshes
    /// and elements than the models' errors are measured with, a quarter of it.
    pub largest_of_models: f64,
    pub refinements: u32,
    /// Number of times that each setting's evaluation is timed.
    pub rounds: usize,
}

impl Limits {
    /// Unknowns of the largest solve, where no others are asked for.
    pub const LARGEST: f64 = 300_000.0;
    /// Ratio of `largest_of_models` to `largest`.
    pub const MODELS_SHARE: f64 = 0.2;
}

/// A limit of time, from a moment that may lie before the measuring.
#[derive(Clone, Copy, Debug)]
pub struct TimeLimit {
    pub from: Instant,
    pub seconds: f64,
}

impl TimeLimit {
    /// Negative when the time is over.
    pub fn seconds_left(&self) -> f64 {
        self.seconds - self.from.elapsed().as_secs_f64()
    }
}

/// The body and the poses in which it is to be measured.
pub struct Request<'a> {
    pub scene: &'a Resolved,
    pub body: &'a str,
    /// Poses by name, one for each control element in the scene's order.
    pub poses: &'a [(String, ControlPoses)],
    pub pose_source: String,
    pub limits: Limits,
    /// The option or key by which the user sets `limits.largest`.
    pub largest_key: String,
    pub quick: bool,
    /// Whether each file is packed too, which takes long.
    pub packs: bool,
    /// Families and sections that the body's model and effects need.
    pub requirements_of: &'a dyn Fn(&Resolved) -> Requirements,
    /// The command that measures this again.
    pub command: String,
    /// A folder for temporary files.
    pub scratch: &'a Path,
    /// A folder in which finished steps are kept until the report is written.
    pub keep: Option<&'a Path>,
    /// Time in which all should be measured; steps that do not fit are left out.
    pub limit: Option<TimeLimit>,
}

impl Request<'_> {
    /// Families of the body's .green file with this model and the scene's effects. Sections of effects are no part of what is
    /// compared here.
    pub fn requirements(&self, model: &'static ModelEntry) -> Requirements {
        let scene = self.scene.with_model(self.body, model);
        let requirements = (self.requirements_of)(&scene).without_sections();
        requirements.and(Requirements::new(model.requirements))
    }
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
    Smooth(#[from] ProblemError),
    #[error(
        "the reference (tet10) has {nodes} nodes, and 3 unknowns each, above {largest:.0}. Raise {key} \
         (10 GB for a million), or coarsen the mesh"
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
    Io { path: PathBuf, source: std::io::Error },
}
