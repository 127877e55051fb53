//! The memory of a body: all that it keeps from one frame to the next beside its fields.

use crate::deform::{DeformerState, PoseLimiter};
use nalgebra::Similarity3;
use serde::{Deserialize, Serialize};

/// The memory of a body, beside its fields.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyMemory {
    #[serde(with = "crate::field::numbers")]
    pub room_from_body: Similarity3<f64>,
    /// One per control element.
    pub limiters: Vec<PoseLimiter>,
    pub range_left: bool,
    pub deformations: u64,
    pub deformer: DeformerState,
}
