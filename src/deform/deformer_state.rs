//! The state of a deformer: all of it that changes from frame to frame, as plain data.

use super::contribution::Contribution;
use super::followed::FollowedTurn;
use super::frames::PoseSlope;
use super::loads::AppliedLoads;
use super::memory::ModelMemory;
use super::model::{BodyState, Response};
use super::pose::ControlPoses;
use serde::{Deserialize, Serialize};

/// State from which [`Deformer::restore`](super::Deformer::restore) makes the same surface, and all later frames with the same
/// bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeformerState {
    pub poses: ControlPoses,
    pub turns: Vec<FollowedTurn>,
    pub loads: AppliedLoads,
    pub loads_changed: bool,
    pub contribution: Contribution,
    /// The model's state for the poses, and the one for which the surface was last summed.
    pub state: BodyState,
    pub summed: BodyState,
    /// The energy of the poses and its slopes, where the model has them.
    pub response: Option<Response>,
    pub slopes: Vec<PoseSlope>,
    pub evaluated: bool,
    pub memory: ModelMemory,
}
