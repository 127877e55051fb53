//! The precomputed Green's functions: a scene's body in, the surface rows of u⁽ᵏ⁾ = -A⁻¹B b⁽ᵏ⁾ out, in one
//! checked file.
//!
//! The numbers come in column families ([`FAMILIES`]): twelve affine columns per control element (the paper, "Elastic
//! deformation using control elements"), the handle stiffness S = Φᵀ(C - BᵀA⁻¹B)Φ. A model or an effect declares those that
//! it needs ([`Requirements`]); nothing else is computed or stored.

mod acting;
mod basis;
mod boundary;
mod bytes;
mod check;
mod column_names;
mod compressed;
mod control;
mod dense;
mod derive;
mod error;
mod families;
mod family;
mod file;
mod filter;
mod fingerprint;
mod floating;
mod forecast;
mod journal;
mod judge;
mod kept;
mod kind;
mod lift;
mod numbers;
mod on_demand;
mod on_disk;
mod pack;
mod pieces;
mod prepare;
mod requirements;
mod resurface;
mod rigid;
mod solution;
pub mod substructure;
pub mod update;
mod validate;
mod write;
mod zstd_context;

pub use acting::acting;
pub use basis::{precompute, precompute_kept, solve, solve_prepared, suits};
pub use bytes::{Number, Tensor};
pub use check::refuse;
pub use column_names::{column_names_of, is_numbered};
pub use control::{ControlElement, FIELD_NAMES, FIELDS};
pub use derive::{Changes, derive, why_anew};
pub use error::GreenError;
pub use families::{
    AFFINE, COMPLIANCE, COMPRESSED, CUBIC, Compliance, EQUILIBRIA, FAMILIES, KEPT_FACTOR, KnownEquilibrium,
    LOAD_COMPLIANCE, LOAD_FIELDS, LOAD_FORCES, LOADS, LoadForces, MOMENTS, MOST_PRESSURES, PERTURBATION,
    PRESSED_POINTS, PathKind, QUARTIC, RADIUS, REACTION, REDUCED, REDUCED_FIELDS, REDUCED_LOADS,
    REDUCED_NEO_HOOKEAN, SERIES, STIFFNESS, SUBSTRUCTURES, TORQUES, Tractions, UPDATES, VOLUME, VOLUME_FORMS,
    Volume, WARMTH, columns_of_effect, compliance_size, has_equilibria, is_column, nodal_forces,
};
pub use family::{Assembled, ColumnName, ColumnSource, FamilyEntry, Further};
pub use file::{BodyMeta, ControlMeta, GreenFile, LoadMeta, Meta, Turning};
pub use fingerprint::fingerprint;
pub use forecast::{Forecast, boundary_told, compliance_fits};
pub use journal::{Journal, KEPT_AFTER, drop_journal, path_of as journal_path};
pub use judge::judge_file;
pub use kept::{Caching, Keeping};
pub use kind::{GREEN, PACKED};
pub use lift::Lift;
pub use on_demand::{SolvedCompliance, Yield};
pub use pack::{pack, packed, packed_path, unpack};
pub use prepare::{Fits, Prepared, densities_of_tets, materials_of_tets, prepare, prepare_mesh, unjudged};
pub use requirements::{Family, Requirements};
pub use resurface::{NewSurface, NewWeight, resurfaced};
pub use rigid::RigidMotion;
pub use solution::{Precomputed, Solution, StepTimes};
pub use write::{opened, write, write_with};
