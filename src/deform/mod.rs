//! Online deformation: control poses in, displacements, positions and normals of the surface out.
//!
//! One [`DeformationModel`] per body turns poses into a [`BodyState`] (the paper's `fieldHasChanged`), from which
//! [`Deformer`] makes x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p) (its `evaluate`): [`Superposition`] sums the columns
//! of the .green file, [`move_parts`] moves the parts where there are several. A model of large strain has static
//! equilibrium found in the background, or by [`Statics`] where every pose is waited for.

mod background;
mod contribution;
mod critical;
mod cubic_form;
mod deformer;
mod deformer_state;
mod equilibria;
mod errors_at;
mod expected;
mod followed;
mod force;
mod frames;
mod freedom;
mod helicoidal;
mod legs;
mod limiter;
mod linear;
mod loads;
mod mean_frame;
mod memory;
mod mesh_errors;
mod model;
mod models;
mod nearest;
mod normals;
mod partial;
mod parts;
mod perturbation;
mod plate;
mod pose;
pub mod pose_file;
mod pose_loads;
mod reduced;
mod rod;
mod rotation;
mod screw;
pub mod se3;
mod solved;
mod static_forces;
mod static_loads;
mod statics;
mod substructured;
mod superposition;
mod surface_point;
mod surface_stress;
mod trial;
mod turn;

pub use contribution::{Contribution, ElementPotential, PoseCurvature, Topology};
pub use critical::{CriticalPose, ModeShape};
pub use cubic_form::CubicForm;
pub use deformer::{Deformer, FrameTimes};
pub use deformer_state::DeformerState;
pub use errors_at::{ErrorsAt, percent};
pub use expected::{ExpectedErrors, Hung, MovedErrors};
pub use followed::FollowedTurn;
pub use force::Wrench;
pub use frames::{ControlFrame, FrameSlope, PoseSlope, axial};
pub use freedom::{COMPONENTS, Freedom, Search, Wrenches};
pub use helicoidal::Helicoidal;
pub use limiter::{CATCH_UP, JUMP, PoseFault, PoseLimiter, STRETCH};
pub use linear::ENTRY as LINEAR;
pub use loads::{AppliedLoads, PointLoad, Pull, refusal as load_refusal};
pub use memory::{FoundMemory, HeldNodes, ModelMemory, Warm};
pub use mesh_errors::{MeshErrors, RigidStiffness, wrench_size};
pub use model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, LoadInput, MakeModel, ModelEntry,
    ModelInput, PointResult, Response, StateAge,
};
pub use models::{MODELS, find_model, make_model};
pub use nearest::unwrapped;
pub use normals::{SurfaceNormals, vertex_normals};
pub use parts::move_parts;
pub use plate::ENTRY as PLATE;
pub use pose::{ControlPose, ControlPoses};
pub use reduced::Reduced;
pub use rotation::{ENTRY as ROTATION, Rotation, mean_rotation};
pub use screw::{Screw, Way};
pub use solved::{model_of, volume_model_of};
pub use static_forces::StaticForces;
pub use statics::{EquilibriumResult, HeldBody, Statics, StaticsError, legs};
pub use superposition::{BYTES_PER_THREAD, Places, SumStats, Superposition, displacement};
pub use surface_point::{NearestPoint, nearest_point};
pub use surface_stress::{FaceLoads, NodeStress, Strain, SurfaceParts, SurfaceStress};
pub use trial::{Deviation, Motion, Moved, PoseResult, Trial, Truth, in_session, trials};
pub use turn::{Reach, local_turn, reach};
