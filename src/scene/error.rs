//! Errors in a scene, with the file that has them.

use crate::base::failure::Failure;
use crate::config::ConfigError;
use crate::mesh::{MeshError, generate};
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error(transparent)]
    Config(#[from] ConfigError),
    #[error("{}: no such file, and {message}; give one of these, or the path of a .toml file", path.display())]
    Unknown { path: PathBuf, message: String },
    #[error("{}{}: {entity}: {message}", path.display(), at(*line))]
    Invalid {
        path: PathBuf,
        /// Line of the entity in the file, or of the innermost table around it that is written there.
        line: Option<usize>,
        entity: String,
        message: String,
    },
    #[error("{}: is a mesh or a surface, no scene; `greenstage new {}` makes a scene of it", path.display(), path.display())]
    IsMesh { path: PathBuf },
    #[error("{}{}: body.{body}.mesh: {source}", path.display(), at(*line))]
    Mesh { path: PathBuf, line: Option<usize>, body: String, source: Box<MeshError> },
    #[error("{}{}: {entity}: {source}", path.display(), at(*line))]
    Generate { path: PathBuf, line: Option<usize>, entity: String, source: generate::GenerateError },
}

/// `:12` of a line that is known.
fn at(line: Option<usize>) -> String {
    line.map_or(String::new(), |line| format!(":{line}"))
}

impl SceneError {
    /// Whether the scene or its files are to blame, rather than the machine, whose memory is too small.
    pub fn is_request(&self) -> bool {
        !matches!(self, SceneError::Generate { source: generate::GenerateError::Memory(_), .. })
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        if error.is_request() { Failure::request(error) } else { Failure::work(error) }
    }
}
