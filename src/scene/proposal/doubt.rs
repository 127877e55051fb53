//! The question which unit a file is in, where its size does not show it; and all other reasons for which nothing can be
//! proposed.

use super::super::SceneError;
use crate::base::failure::Failure;
use crate::mesh::MeshError;
use crate::mesh::diagnostics::digits;
use crate::mesh::length_unit::{LengthUnit, Scale, candidates, find_unit, is_plausible};
use std::path::{Path, PathBuf};

/// The file's extent is implausible in metres, and in which units it would be plausible.
#[derive(Clone, Debug, PartialEq)]
pub struct UnitDoubt {
    pub mesh: PathBuf,
    /// Longest side of the file's box, in the file's unit.
    pub extent: f64,
    /// The likeliest first; the last is metres, the unit of a file that names none.
    pub candidates: Vec<&'static LengthUnit>,
}

impl UnitDoubt {
    /// Length of the body if the file is in `unit`: "0.195 m".
    pub fn extent_in(&self, unit: &LengthUnit) -> String {
        format!("{} m", digits(self.extent * unit.metres))
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ProposalError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{}: the body would be {} m long", .0.mesh.display(), digits(.0.extent))]
    Unit(UnitDoubt),
    #[error("{0}")]
    Wrong(String),
}

impl From<ProposalError> for Failure {
    fn from(error: ProposalError) -> Failure {
        match error {
            ProposalError::Mesh(error) => error.into(),
            ProposalError::Scene(error) => error.into(),
            other => Failure::request(other),
        }
    }
}

/// Whether a file of that extent is taken for metres, or `asked` says what it is in; bodies of its material reach `largest`, m.
pub fn plausible(file: &Path, extent: f64, largest: f64, asked: Option<Scale>) -> Result<(), ProposalError> {
    if asked.is_some() || is_plausible(extent, largest) {
        return Ok(());
    }
    Err(ProposalError::Unit(UnitDoubt {
        mesh: file.to_owned(),
        extent,
        candidates: candidates(extent, largest).chain(find_unit("m")).collect(),
    }))
}
