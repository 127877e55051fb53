//! The paper's main method: u = Σ cₖ u⁽ᵏ⁾ with the coefficients as the poses give them.
//!
//! Exact for the linear theory of elasticity, which holds for small rotations of the control elements.

use super::model::{BodyState, ControlRest, DeformationModel, Energy, Frame, Kind, ModelEntry};
use super::pose::ControlPose;
use crate::green::AFFINE;
use nalgebra::Isometry3;

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "linear",
    summary: "the paper's main method: exact in the linear theory, right for small rotations",
    requirements: &[AFFINE],
    frame: Frame::Rest,
    energy: Some(Energy::OfPoses),
    // Measured on bodies held at one end, against St. Venant-Kirchhoff statics on the same mesh; the error grows with the
    // square of the angle.
    turn_limits_deg: [10.0, 30.0],
    kind: Kind::Online(|_: &[ControlRest]| Box::new(Linear)),
};

pub struct Linear;

impl DeformationModel for Linear {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        BodyState {
            parts: vec![Isometry3::identity()],
            coefficients: poses.iter().flat_map(ControlPose::coefficients).collect(),
            rotation_undefined: false,
        }
    }
}
