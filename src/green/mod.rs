//! The precomputed Green's functions: a scene's body in, the surface rows of u⁽ᵏ⁾ = -A⁻¹B b⁽ᵏ⁾ out, in one
//! checked file.
//!
//! Twelve affine columns per control element (the paper, "Elastic deformation using control elements") and, for
//! the effect `haptics`, the handle stiffness S = Φᵀ(C - BᵀA⁻¹B)Φ.

mod basis;
mod bytes;
mod check;
mod control;
mod file;
mod fingerprint;
mod floating;
mod judge;
mod kind;
mod pack;
mod pieces;
mod prepare;
mod rigid;
mod storage;
mod validate;

pub use crate::mesh::trouble::Severity;
pub use basis::{Precomputed, Solution, StepTimes, assemble, precompute, refuse, solve, solve_prepared};
pub use check::Finding;
pub use control::{ControlElement, FIELD_NAMES, FIELDS};
pub use file::{BodyMeta, ControlMeta, GreenFile, Meta, write};
pub use fingerprint::fingerprint;
pub use judge::judge_file;
pub use kind::{GREEN, PACKED};
pub use pack::{pack, packed, packed_path, unpack};
pub use prepare::{Prepared, prepare, prepare_mesh};
pub use rigid::RigidMotion;
pub use storage::{Basis, Stored, half_to_single};

use crate::base::machine::TooLarge;
use crate::base::output::OutputError;
use crate::fem::AssemblyError;
use crate::scene::SceneError;
use crate::solve::SolveError;
use std::path::PathBuf;

/// What a body's model and effects need beside the basis columns; nothing else is computed or stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Needs {
    /// The 12E × 12E handle stiffness S.
    pub stiffness: bool,
}

impl Needs {
    /// What either asks for.
    pub fn and(self, other: Needs) -> Needs {
        Needs { stiffness: self.stiffness || other.stiffness }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum GreenError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{body}: {source}")]
    Assembly { body: String, source: AssemblyError },
    #[error("{body}: {source}")]
    Solve { body: String, source: SolveError },
    #[error("{body}: {source}; coarsen the mesh, or give the program more memory")]
    Memory { body: String, source: TooLarge },
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{}: {reason}; run `greenstage precompute --force` on its scene to make it anew", path.display())]
    Damaged { path: PathBuf, reason: String },
    #[error(
        "{}: is stale: the scene, its mesh or the program changed since it was made (its fingerprint is {found}, \
         the scene's {expected}); run `greenstage precompute` on the scene",
        path.display()
    )]
    Stale { path: PathBuf, found: String, expected: String },
}

impl GreenError {
    /// Whether the request or its files are to blame, rather than the work.
    pub fn is_request(&self) -> bool {
        match self {
            GreenError::Scene(_) | GreenError::Damaged { .. } | GreenError::Stale { .. } => true,
            GreenError::Assembly { .. } => true,
            GreenError::Solve { .. } | GreenError::Memory { .. } => false,
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
