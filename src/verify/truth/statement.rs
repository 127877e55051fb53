//! Statements: errors that the program prints of its own answers, each beside the true one.

use super::bodies::BodyKind;
use serde::{Deserialize, Serialize};

/// Source of a statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    Report,
    Planner,
    Expected,
}

/// Quantity that a statement is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// The shape, relative.
    Shape,
    /// The larger of force and torque, relative.
    Wrench,
    /// N.
    Force,
    /// N·m.
    Torque,
}

/// A printed error and the true one, in the same unit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Statement {
    pub source: Source,
    pub quantity: Quantity,
    /// The setting, or the pose with its model.
    pub of: String,
    /// Turn of the pose, °; 0 for a statement about several poses.
    pub turn: f64,
    /// `None` where the program says that it was not measured.
    pub shown: Option<f64>,
    /// The doubt that is stated beside it.
    pub doubt: f64,
    pub truth: f64,
}

/// Half of the last of the three digits that are printed.
const ROUNDING: f64 = 0.005;

impl Statement {
    /// Whether the true error is within what was printed; `None` where nothing was.
    pub fn holds(&self) -> Option<bool> {
        self.shown.map(|shown| self.truth <= (1.0 + ROUNDING) * (shown + self.doubt))
    }

    /// The printed error over the true one.
    pub fn ratio(&self) -> Option<f64> {
        Some((self.shown? + self.doubt) / self.truth).filter(|ratio| ratio.is_finite())
    }
}

/// The statements about a body.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct JudgedBody {
    pub seed: u64,
    pub kind: BodyKind,
    pub model: String,
    pub nodes: usize,
    pub seconds: f64,
    pub statements: Vec<Statement>,
    /// Statements and poses that could not be judged, and why.
    pub left_out: Vec<String>,
}
