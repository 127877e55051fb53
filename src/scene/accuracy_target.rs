//! Targets by which a body's settings are chosen instead of being named: an accuracy, or a budget.

use serde::{Deserialize, Serialize};

/// The largest relative errors over the measured poses.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Accuracy {
    /// Error of the displacement, relative L2 over the body.
    pub displacement: Option<f64>,
    /// Error of forces and torques on control elements, relative to the largest wrench of the pose.
    pub force: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Budget {
    /// Time of one evaluation with every control element moved: from poses to the surface.
    pub frame_ms: Option<f64>,
    pub file_mb: Option<f64>,
    pub offline_s: Option<f64>,
    /// Unknowns of the largest solve while it is measured.
    pub largest: Option<f64>,
}

/// The target by which element, refinement, storage, solver and model of a body are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AccuracyTarget {
    Accuracy(Accuracy),
    Budget(Budget),
}

impl AccuracyTarget {
    /// Its key in the scene file.
    pub fn key(&self) -> &'static str {
        match self {
            AccuracyTarget::Accuracy(_) => "accuracy",
            AccuracyTarget::Budget(_) => "budget",
        }
    }

    pub fn largest(&self) -> Option<f64> {
        match self {
            AccuracyTarget::Accuracy(accuracy) => accuracy.largest,
            AccuracyTarget::Budget(budget) => budget.largest,
        }
    }

    /// Whether it limits times, which hold for one machine only.
    pub fn is_timed(&self) -> bool {
        matches!(self, AccuracyTarget::Budget(budget) if budget.frame_ms.is_some() || budget.offline_s.is_some())
    }
}
