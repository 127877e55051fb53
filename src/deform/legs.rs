//! Poses on the way from rest to poses that have turned by more than half a turn.

use super::pose::ControlPose;
use super::se3::long_turn;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

/// The pose at `share` of a way from rest on which the turn grows to `turn`, of up to 360° by its sign.
pub fn part_of(pose: &ControlPose, turn: &UnitQuaternion<f64>, share: f64) -> ControlPose {
    let stretch = turn.to_rotation_matrix().transpose() * pose.matrix - Matrix3::identity();
    let part = Rotation3::from_scaled_axis(long_turn(turn) * share);
    ControlPose {
        translation: pose.translation * share,
        matrix: part * (Matrix3::identity() + stretch * share),
    }
}
