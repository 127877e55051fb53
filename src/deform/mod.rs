//! Online deformation: control poses in, displacements, positions and normals of the surface out.
//!
//! One [`DeformationModel`] per body turns poses into coefficients (the paper's `fieldHasChanged`), [`Deformer`] sums
//! u = Σ cₖ u⁽ᵏ⁾ over the columns of the .green file (its `evaluate`) and adds the rest surface and the normals. [`Statics`] stands apart: it solves a body anew for every pose.

mod deformer;
mod followed;
mod force;
mod guard;
mod linear;
mod model;
mod models;
mod normals;
mod partial;
mod pose;
pub mod pose_file;
mod rotation;
mod screw;
mod statics;
mod superposition;
mod surface_displacements;
mod turn;

pub use deformer::{Deformer, FrameTimes};
pub use followed::FollowedTurn;
pub use force::{Wrench, wrenches};
pub use guard::{CATCH_UP, JUMP, PoseFault, PoseGuard, STRETCH};
pub use linear::Linear;
pub use model::{Coefficients, ControlRest, DeformationModel, Kind, ModelEntry};
pub use models::{MODELS, find_model, not_online};
pub use normals::vertex_normals;
pub use pose::{ControlPose, ControlPoses};
pub use rotation::{Rotation, is_mean_defined, mean_rotation, unwrapped};
pub use screw::Screw;
pub use statics::{Settled, Statics, StaticsError};
pub use superposition::{BYTES_PER_THREAD, Columns, SumStats, Superposition};
pub use surface_displacements::SurfaceDisplacements;
pub use turn::local_turn;
