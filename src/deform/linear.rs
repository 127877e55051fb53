//! The paper's main method: u = Σ cₖ u⁽ᵏ⁾ with the coefficients as the poses give them.
//!
//! Exact for the linear theory of elasticity, which holds for small rotations of the control elements.

use super::{
    Columns, ControlPose, ControlPoses, ControlRest, DeformationModel, Kind, ModelEntry, ModelStats,
    Superposition, SurfaceDisplacements,
};
use crate::green::Needs;
use nalgebra::Isometry3;

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "linear",
    summary: "the paper's main method: exact in the linear theory, right for small rotations",
    needs: Needs { stiffness: false },
    kind: Kind::Online(|controls: &[ControlRest]| {
        Box::new(Linear { sum: Superposition::new(controls.len()) })
    }),
};

pub struct Linear {
    sum: Superposition,
}

impl DeformationModel for Linear {
    fn evaluate(
        &mut self,
        columns: &Columns<'_>,
        poses: &ControlPoses,
        u: &mut SurfaceDisplacements,
    ) -> ModelStats {
        u.body_from_surface = Isometry3::identity();
        self.sum.update(columns, poses.iter().map(ControlPose::coefficients).collect(), &mut u.u)
    }
}
