//! Online deformation: control poses in, displacements, positions and normals of the surface out.
//!
//! One [`DeformationModel`] per body turns poses into a [`BodyState`] (the paper's `fieldHasChanged`), from which
//! [`Deformer`] makes x_i = Σ_p w_ip (R_p (X_i + Σ_k c_k u_i⁽ᵏ⁾) + t_p) (its `evaluate`): [`Superposition`] sums the columns
//! of the .green file, [`move_parts`] moves the parts where there are several. A model of large strain has static
//! equilibrium found in the background, or by [`Statics`] where every pose is waited for.

mod contribution;
mod deformer;
mod errors_at;
mod expected;
mod kernel;
mod loads;
mod memory;
mod mesh_errors;
mod model;
mod model_reach;
mod models;
mod motion_errors;
mod path;
mod pose;
pub mod pose_file;
mod statics;
mod touch_points;
mod touch_potential;
mod trial;
mod turn;

pub use contribution::{Contribution, DeformerState, ElementPotential, PoseCurvature, Topology};
pub use deformer::{Deformer, FrameTimes};
pub use errors_at::{ErrorsAt, percent};
pub use expected::{ExpectedErrors, FinerErrors, Hung, MovedErrors};
pub use kernel::parts::move_parts;
pub use kernel::superposition::{BYTES_PER_THREAD, Places, SumStats, Superposition, displacement};
pub use kernel::surface::{NearestPoint, SurfaceNormals, nearest_point, vertex_normals};
pub use kernel::surface_stress::{FaceLoads, NodeStress, Strain, SurfaceParts, SurfaceStress};
pub use loads::applied::StaticForces;
pub use loads::{AppliedLoads, PointLoad, Pull, refusal as load_refusal};
pub use memory::{FoundMemory, HeldNodes, ModelMemory, Warm};
pub use mesh_errors::{MeshErrors, RigidStiffness, wrench_size};
pub use model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, LoadInput, MakeModel, ModelEntry,
    ModelInput, PointResult, Response, StateAge,
};
pub use model_reach::{ComparedState, ModelReach};
pub use models::helicoidal::{CubicForm, Helicoidal};
pub use models::linear::ENTRY as LINEAR;
pub use models::perturbation::ENTRY as PERTURBED;
pub use models::plate::ENTRY as PLATE;
pub use models::reduced::{ENTRY as REDUCED, NEO_HOOKEAN_ENTRY as REDUCED_NEO_HOOKEAN, Reduced};
pub use models::rod::ENTRY as ROD;
pub use models::rotation::{ENTRY as ROTATION, Rotation, mean_rotation};
pub use models::substructured::ENTRY as SUBSTRUCTURED;
pub use models::{MODELS, find_model, make_model, model_of, volume_model_of};
pub use motion_errors::{DirectionErrors, MotionErrors, TurnErrors};
pub use path::{BodyPath, Doubt};
pub use pose::follow::{CATCH_UP, FollowedTurn, JUMP, PoseFault, PoseLimiter, STRETCH};
pub use pose::frame::{
    ControlFrame, ControlPose, ControlPoses, FrameSlope, PoseSlope, Wrench, axial, same_side, unwrapped,
};
pub use pose::screw::{Screw, Way};
pub use pose::se3;
pub use statics::critical::{CriticalPose, ModeShape};
pub use statics::freedom::{COMPONENTS, Freedom, Search, Wrenches};
pub use statics::{
    Branch, EquilibriumResult, HeldBody, LeastMode, Statics, StaticsError, TangentState, legs,
};
pub use touch_points::{MOST_POINTS, TouchPoint, contact_axes};
pub use touch_potential::{TouchPotential, TouchResponse};
pub use trial::{Deviation, Direction, GOOD, Motion, Moved, PoseResult, Trial, Truth, in_session, trials};
pub use turn::{Reach, law_strain, local_turn, mean_strain, reach};
