//! The paper's main method: u = Σ cₖ u⁽ᵏ⁾ with the coefficients as the poses give them, and V = ½ cᵀ S c.
//!
//! Exact for the linear theory of elasticity, which holds for small rotations of the control elements.

use crate::deform::model::{
    Bearing, BodyState, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlPose, PoseSlope};
use crate::green::{AFFINE, FIELDS, STIFFNESS};
use nalgebra::{DMatrix, DVector, Isometry3};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "linear",
    summary: "the paper's main method: exact in the linear theory, right for small rotations",
    requirements: &[AFFINE],
    frame: Frame::Rest,
    energy: Some(&[STIFFNESS]),
    // Measured on bodies held at one end, against St. Venant-Kirchhoff statics on the same mesh; the error grows with the
    // square of the angle.
    turn_limits_deg: [10.0, 30.0],
    kind: Kind::Online(|input: &ModelInput<'_>| {
        let stiffness = (input.table)(STIFFNESS.name);
        let fields = DVector::zeros(FIELDS * input.controls.len());
        Ok(Box::new(Linear { stiffness, coefficients: fields.clone(), forces: fields }))
    }),
    loads: Bearing::Columns,
    fits: None,
};

struct Linear {
    stiffness: Option<DMatrix<f64>>,
    /// c and S c.
    coefficients: DVector<f64>,
    forces: DVector<f64>,
}

impl DeformationModel for Linear {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        BodyState {
            parts: vec![Isometry3::identity()],
            coefficients: poses.iter().flat_map(ControlPose::coefficients).collect(),
            ..BodyState::at_rest(0)
        }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let stiffness = self.stiffness.as_ref()?;
        for (own, pose) in self.coefficients.as_mut_slice().chunks_exact_mut(FIELDS).zip(poses) {
            own.copy_from_slice(&pose.coefficients());
        }
        self.forces.gemv(1.0, stiffness, &self.coefficients, 0.0);
        for (slope, g) in slopes.iter_mut().zip(self.forces.as_slice().chunks_exact(FIELDS)) {
            *slope = PoseSlope::of_numbers(g);
        }
        Some(Response { energy: 0.5 * self.coefficients.dot(&self.forces), is_defined: true })
    }
}
