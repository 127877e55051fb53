//! Vibration of a body in a frame, mode by mode, for an effect that makes it heard.
//!
//! In each step of a frame the amplitude x of a mode follows ẍ + 2δ ẋ + λ x = a + b t + c t² exactly. The modes are those of all that
//! nothing holds, so that they change when a hand takes or releases a control element. In one step x is measured from another place than in
//! the next where elements are released; ẋ is not.

use nalgebra::Vector3;
use std::sync::Arc;

/// Modes of a body while the same control elements are held.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VibrationModes {
    /// λ, (rad/s)², and δ, 1/s, of each mode.
    pub squares: Vec<f64>,
    pub decays: Vec<f64>,
    /// Motion of each node of the surface in each mode, along the axes of the columns, 1/√kg.
    pub shapes: Vec<Vec<Vector3<f32>>>,
}

/// A mode in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ModeStep {
    /// x and ẋ where the step begins, √kg m and √kg m/s.
    pub state: [f64; 2],
    /// Part of ẋ that has just been added because held elements move on at another speed than in the step before.
    pub kick: f64,
    /// a, b and c, √kg m/s², and over s and s².
    pub load: [f64; 3],
}

/// All modes in a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VibrationStep {
    pub dt_s: f64,
    pub modes: Vec<ModeStep>,
}

/// Vibration of a body in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Vibration {
    /// The same as in the frame before, unless hands have taken or released elements.
    pub modes: Arc<VibrationModes>,
    pub steps: Vec<VibrationStep>,
}
