//! Loads that are applied to a body beside its control elements.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, PoisonError};

type V3 = Vector3<f64>;

/// All loads of a body as they are now, in the body's frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppliedLoads {
    /// One for each column of the family `loads`; what is left out is 0.
    pub coefficients: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointLoad>,
}

/// A force at one point of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLoad {
    /// The point is the mean of these nodes of the surface with these weights.
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
    pub pull: Pull,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Pull {
    /// N, along the body's axes.
    Force(#[serde(with = "crate::field::numbers")] V3),
    /// A pull towards `place`, m about the body's centre, by a spring, N/m; without one the point is there.
    Towards {
        #[serde(with = "crate::field::numbers")]
        place: V3,
        spring: Option<f64>,
    },
}

/// Loads that a body's models share: set by frames, read by force loops.
pub type SharedLoads = Arc<Mutex<AppliedLoads>>;

/// Sets what is applied; false where it is as it was.
pub fn set(shared: &SharedLoads, loads: &AppliedLoads) -> bool {
    let mut applied = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let differs = *applied != *loads;
    if differs {
        applied.clone_from(loads);
    }
    differs
}
