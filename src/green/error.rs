//! Errors for bodies that could not be precomputed, and .green files that cannot be used.

use super::substructure::BodyError;
use crate::base::failure::Failure;
use crate::base::machine::TooLarge;
use crate::base::output::OutputError;
use crate::bem;
use crate::fem::AssemblyError;
use crate::scene::SceneError;
use crate::solve::SolveError;
use std::path::PathBuf;
use std::sync::Arc;

#[derive(Debug, thiserror::Error)]
pub enum GreenError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{body}: {source}")]
    Assembly { body: String, source: AssemblyError },
    #[error("{body}: {source}")]
    Boundary { body: String, source: bem::Error },
    #[error("{body}: {source}")]
    Solve { body: String, source: SolveError },
    #[error("{body}: {source}")]
    Parts { body: String, source: BodyError },
    #[error(
        "{body}: has {count} control elements, but model \"{model}\" takes {allowed}. Write model = \"rotation\"{}",
        if *count > 4 { ", or join elements that move together" } else { "" }
    )]
    ControlCount { body: String, model: &'static str, count: usize, allowed: &'static str },
    #[error(
        "{body}: model \"{model}\" is made from equilibria at large turns, which are not sought with {unknowns} unknowns and this \
         solver. It takes a direct solver and {most} unknowns at most; write model = \"reduced\", or method = \"cholesky\" and a \
         coarser mesh"
    )]
    NoEquilibria { body: String, model: &'static str, unknowns: usize, most: usize },
    #[error(
        "{body}: model \"{model}\" is made from equilibria at large turns, and none was found when the body was bent, twisted, pulled \
         and pressed. Write model = \"reduced\", and look for slivers (`greenstage check`)"
    )]
    NoneFound { body: String, model: &'static str },
    #[error(
        "body.{body}.updates: the columns of the effect {effect} hold only for the body as precomputed. \
         Leave out the effect or updates"
    )]
    Updates { body: String, effect: &'static str },
    #[error("{body}: {source}; coarsen the mesh, or give the program more memory")]
    Memory { body: String, source: TooLarge },
    #[error(
        "{body}: the compressed compliance errs by {found:.1e}, above kept = {{ error = {asked:e} }}. \
         Write a larger error, or kept = \"inverse\""
    )]
    Compression { body: String, asked: f64, found: f64 },
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{0}")]
    InBackground(Arc<GreenError>),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{}: is not a .green file", path.display())]
    Foreign { path: PathBuf },
    #[error("{}: {reason}; run `greenstage precompute --force` on its scene to make it anew", path.display())]
    Damaged { path: PathBuf, reason: String },
    #[error(
        "{}: is stale: made for fingerprint {found}, the scene now has {expected}. Run `greenstage \
         precompute` on the scene",
        path.display()
    )]
    Stale { path: PathBuf, found: String, expected: String },
}

impl GreenError {
    /// Whether the request or its files are to blame, rather than the work.
    pub fn is_request(&self) -> bool {
        match self {
            GreenError::Scene(error) => error.is_request(),
            GreenError::Foreign { .. } | GreenError::Damaged { .. } | GreenError::Stale { .. } => true,
            GreenError::Assembly { .. }
            | GreenError::ControlCount { .. }
            | GreenError::NoEquilibria { .. }
            | GreenError::NoneFound { .. }
            | GreenError::Updates { .. } => true,
            GreenError::Parts { source, .. } => source.is_request(),
            GreenError::Boundary { source, .. } => matches!(source, bem::Error::Flat { .. }),
            GreenError::Solve { .. } | GreenError::Memory { .. } | GreenError::Compression { .. } => false,
            GreenError::InBackground(error) => error.is_request(),
            GreenError::Output(error) => error.is_request(),
            GreenError::Io { source, .. } => {
                use std::io::ErrorKind::{
                    IsADirectory, NotADirectory, NotFound, PermissionDenied, ReadOnlyFilesystem,
                };
                let kind = source.kind();
                [IsADirectory, NotADirectory, NotFound, PermissionDenied, ReadOnlyFilesystem].contains(&kind)
            }
        }
    }
}

impl From<GreenError> for Failure {
    fn from(error: GreenError) -> Failure {
        if error.is_request() { Failure::request(error) } else { Failure::work(error) }
    }
}
