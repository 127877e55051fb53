//! The precomputed Green's functions: a scene's body in, the surface rows of u⁽ᵏ⁾ = -A⁻¹B b⁽ᵏ⁾ out, in one
//! checked file.
//!
//! Twelve affine columns per control element (the paper, "Elastic deformation using control elements") and, for
//! the effect `haptics`, the handle stiffness S = Φᵀ(C - BᵀA⁻¹B)Φ.

mod basis;
mod bytes;
mod check;
mod control;
mod error;
mod file;
mod finding;
mod fingerprint;
mod floating;
mod judge;
mod kind;
mod needs;
mod pack;
mod pieces;
mod prepare;
mod rigid;
mod storage;
mod validate;

pub use crate::mesh::diagnostics::Severity;
pub use basis::{Precomputed, Solution, StepTimes, precompute, refuse, solve, solve_prepared};
pub use control::{ControlElement, FIELD_NAMES, FIELDS};
pub use error::GreenError;
pub use file::{BodyMeta, ControlMeta, GreenFile, Meta, write};
pub use finding::Finding;
pub use fingerprint::fingerprint;
pub use judge::judge_file;
pub use kind::{GREEN, PACKED};
pub use needs::Needs;
pub use pack::{pack, packed, packed_path, unpack};
pub use prepare::{Prepared, prepare, prepare_mesh};
pub use rigid::RigidMotion;
pub use storage::{Basis, Stored, half_to_single};
