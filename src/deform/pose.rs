//! Poses of control elements, and the paper's twelve coefficients.

use crate::green::FIELDS;
use nalgebra::{Matrix3, Vector3};

/// x ↦ o + T + M (x - o) on the nodes of one control element, in the body's frame.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlPose {
    /// T, m.
    #[serde(with = "crate::field::numbers")]
    pub translation: Vector3<f64>,
    /// M.
    #[serde(with = "crate::field::numbers")]
    pub matrix: Matrix3<f64>,
}

/// One pose per control element, in the body's order.
pub type ControlPoses = Vec<ControlPose>;

impl ControlPose {
    pub const REST: ControlPose = ControlPose {
        translation: Vector3::new(0.0, 0.0, 0.0),
        matrix: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
    };

    /// c: T, then M - I row by row.
    pub fn coefficients(&self) -> [f64; FIELDS] {
        let (t, d) = (self.translation, self.matrix - Matrix3::identity());
        [
            t.x,
            t.y,
            t.z,
            d[(0, 0)],
            d[(0, 1)],
            d[(0, 2)],
            d[(1, 0)],
            d[(1, 1)],
            d[(1, 2)],
            d[(2, 0)],
            d[(2, 1)],
            d[(2, 2)],
        ]
    }

    /// Expresses the affine motion about the origin `to` instead of `from`: o + T + M (x - o) = o' + T' + M (x - o') with
    /// T' = T + (M - I)(o' - o).
    pub fn with_origin(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> ControlPose {
        let translation = self.translation + (self.matrix - Matrix3::identity()) * (to - from);
        ControlPose { translation, matrix: self.matrix }
    }

    pub fn is_finite(&self) -> bool {
        self.translation.iter().chain(self.matrix.iter()).all(|value| value.is_finite())
    }
}
