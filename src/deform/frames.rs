//! A control element's pose taken apart: where its origin is, how it is turned, how it is stretched.
//!
//! In: a pose T, M. Out: the place o + T, the rotation R and the symmetric stretch U of M = R U, and the way back of forces:
//! the derivatives of an energy by T and M from those by place, rotation and stretch. With X = Rᵀ dM the polar factors move by
//!
//! ```text
//! dR = R [w]     (tr U - U) w = axial X     dU = sym X - sym([w] U)
//! ∂V/∂M = R ([y] + P)     (tr U - U) y = τ - axial(P U)     for dV = τ·w + P:dU
//! ```

use super::nearest::{continued, nearest};
use super::pose::ControlPose;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The axial vector a of X, with a · ω = X : \[ω\]; for Σ f r it is the moment Σ r × f.
pub fn axial(x: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(x[(2, 1)] - x[(1, 2)], x[(0, 2)] - x[(2, 0)], x[(1, 0)] - x[(0, 1)])
}

/// M = R U at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlFrame {
    /// o + T, m.
    pub place: Vector3<f64>,
    /// R, with the sign that continues the rotation before: it distinguishes a turn by 200° from one by -160°.
    pub turn: UnitQuaternion<f64>,
    /// U.
    pub stretch: Matrix3<f64>,
}

/// Derivatives of an energy by a [`ControlFrame`], in the body's axes but for that by U.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameSlope {
    /// Slope by the place, N.
    pub force: Vector3<f64>,
    /// Slope by a turn exp(\[δ\]) R about the place, N·m.
    pub torque: Vector3<f64>,
    /// Slope by U: symmetric, in the element's own axes, N·m.
    pub stretch: Matrix3<f64>,
}

/// Derivatives of an energy by a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseSlope {
    /// ∂V/∂T, N: the force that a hand must apply.
    #[serde(with = "crate::field::numbers")]
    pub translation: Vector3<f64>,
    /// ∂V/∂M, N·m: Σ f_i y_jᵀ over the held nodes, y being their places from o at rest.
    #[serde(with = "crate::field::numbers")]
    pub matrix: Matrix3<f64>,
}

impl ControlFrame {
    /// `None` where M is too flat to have a rotation.
    pub fn of(
        origin: &Vector3<f64>,
        pose: &ControlPose,
        before: Option<&UnitQuaternion<f64>>,
    ) -> Option<ControlFrame> {
        nearest(&pose.matrix)?;
        let turn = continued(before, &pose.matrix);
        let stretch = turn.to_rotation_matrix().transpose() * pose.matrix;
        let stretch = (stretch + stretch.transpose()) * 0.5;
        Some(ControlFrame { place: origin + pose.translation, turn, stretch })
    }

    /// The derivatives by the pose from those by the frame.
    pub fn pull_back(&self, slope: &FrameSlope) -> PoseSlope {
        let (rotation, u) = (self.turn.to_rotation_matrix(), &self.stretch);
        let torque = rotation.transpose() * slope.torque;
        let spin = Matrix3::from_diagonal_element(u.trace()) - u;
        // A rotation is defined, so that no two stretches cancel.
        let y = spin.try_inverse().unwrap_or_else(Matrix3::zeros) * (torque - axial(&(slope.stretch * u)));
        PoseSlope { translation: slope.force, matrix: rotation * (y.cross_matrix() + slope.stretch) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn slopes_go_back_to_the_pose() {
        let origin = Vector3::new(0.2, 0.1, -0.4);
        let turn = Rotation3::from_scaled_axis(Vector3::new(0.5, -1.2, 0.8));
        let stretch = Matrix3::new(1.2, 0.1, -0.05, 0.1, 0.9, 0.15, -0.05, 0.15, 1.1);
        let pose = ControlPose { translation: Vector3::new(0.3, 0.4, -1.0), matrix: turn.matrix() * stretch };
        // V = a·p + t·log R + B:U, whose slopes by the frame are these where the turn is taken from R₀.
        let (a, t) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.7, 0.2, -0.9));
        let b = Matrix3::new(0.3, -0.2, 0.5, -0.2, 0.8, 0.1, 0.5, 0.1, -0.4);
        let energy = |pose: &ControlPose| {
            let frame = ControlFrame::of(&origin, pose, None).unwrap();
            let moved = frame.turn * UnitQuaternion::from_rotation_matrix(&turn).inverse();
            a.dot(&frame.place) + t.dot(&moved.scaled_axis()) + b.dot(&frame.stretch)
        };
        let frame = ControlFrame::of(&origin, &pose, None).unwrap();
        let slope = frame.pull_back(&FrameSlope { force: a, torque: t, stretch: b });
        let step = 1e-6;
        for k in 0..12 {
            let moved = |by: f64| {
                let mut pose = pose;
                if k < 3 {
                    pose.translation[k] += by
                } else {
                    pose.matrix[(k / 3 - 1, k % 3)] += by
                }
                energy(&pose)
            };
            let expected = (moved(step) - moved(-step)) / (2.0 * step);
            let found = if k < 3 { slope.translation[k] } else { slope.matrix[(k / 3 - 1, k % 3)] };
            assert!((found - expected).abs() < 1e-8, "{k}: {found} {expected}");
        }
    }
}
