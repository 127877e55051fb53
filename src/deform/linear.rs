//! The paper's main method: u = Σ cₖ u⁽ᵏ⁾ with the coefficients as the poses give them.
//!
//! Exact for the linear theory of elasticity, which holds for small rotations of the control elements.

use super::model::{Coefficients, ControlRest, DeformationModel, Kind, ModelEntry};
use super::pose::ControlPose;
use crate::green::Needs;
use nalgebra::Isometry3;

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "linear",
    summary: "the paper's main method: exact in the linear theory, right for small rotations",
    needs: Needs { stiffness: false },
    kind: Kind::Online(|_: &[ControlRest]| Box::new(Linear)),
};

pub struct Linear;

impl DeformationModel for Linear {
    fn coefficients(&mut self, poses: &[ControlPose]) -> Coefficients {
        Coefficients {
            c: poses.iter().map(ControlPose::coefficients).collect(),
            body_from_surface: Isometry3::identity(),
            rotation_undefined: false,
        }
    }
}
