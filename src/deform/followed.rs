//! Turns followed from pose to pose, through whole turns.
//!
//! In: the matrices of a control element one after another. Out: by how much it has turned since rest. A matrix determines
//! the angle φ of a turn up to multiples of 360°. Its quaternion q = (cos φ/2, a sin φ/2), with the sign that continues the
//! quaternion before it, determines φ up to multiples of 720°. Of the angles φ = 2 atan2(q·a, w) + 720° k the one nearest to
//! the last angle is taken. Near whole turns sin φ/2 is small and q says little of the axis a: there the last axis is kept,
//! and φ is the twist about it.

use super::nearest::continued;
use super::pose::ControlPose;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Sine of half the angle to a whole turn from which on the axis is taken anew: 60°, where a hand that wobbles tilts it
/// by no more than it wobbles.
const AXIS: f64 = 0.5;

/// A turn from rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FollowedTurn {
    /// The rotation, with the sign that continues the one before.
    #[serde(with = "crate::field::numbers")]
    pub quaternion: UnitQuaternion<f64>,
    /// Unit axis; zero before the turn has an axis.
    #[serde(with = "crate::field::numbers")]
    axis: Vector3<f64>,
    /// Angle about the axis, rad, not reduced.
    #[serde(with = "crate::field::numbers")]
    angle: f64,
}

impl FollowedTurn {
    pub const REST: FollowedTurn = FollowedTurn {
        quaternion: UnitQuaternion::new_unchecked(Quaternion::new(1.0, 0.0, 0.0, 0.0)),
        axis: Vector3::new(0.0, 0.0, 0.0),
        angle: 0.0,
    };

    /// The turn of a quaternion, of up to 360° by its sign.
    pub fn of(quaternion: UnitQuaternion<f64>) -> FollowedTurn {
        let sine = quaternion.imag();
        let axis = sine.try_normalize(1e-9).unwrap_or_default();
        FollowedTurn { quaternion, axis, angle: 2.0 * sine.norm().atan2(quaternion.w) }
    }

    /// The turn at `pose`, the next after this one.
    pub fn follow(&self, pose: &ControlPose) -> FollowedTurn {
        self.advanced(continued(Some(&self.quaternion), &pose.matrix))
    }

    fn advanced(&self, quaternion: UnitQuaternion<f64>) -> FollowedTurn {
        let sine = quaternion.imag();
        let mut axis = self.axis;
        if sine.norm() > AXIS {
            let now = sine.normalize();
            axis = if now.dot(&axis) < 0.0 { -now } else { now };
        }
        let angle = nearest(2.0 * sine.dot(&axis).atan2(quaternion.w), self.angle);
        FollowedTurn { quaternion, axis, angle }
    }

    /// The angle between this turn and another, rad, whole turns included.
    pub fn against(&self, other: &FollowedTurn) -> f64 {
        let apart = (self.axis * self.angle - other.axis * other.angle).norm();
        let between = self.quaternion.inverse() * other.quaternion;
        let angle = 2.0 * between.imag().norm().atan2(between.w);
        let [one, two] = [nearest(angle, apart), nearest(-angle, apart)];
        if (one - apart).abs() <= (two - apart).abs() { one.abs() } else { two.abs() }
    }
}

/// The angle `angle` + 4π k nearest to `last`.
fn nearest(angle: f64, last: f64) -> f64 {
    angle + 4.0 * PI * ((last - angle) / (4.0 * PI)).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn pose(turn: Vector3<f64>) -> ControlPose {
        ControlPose { matrix: *Rotation3::from_scaled_axis(turn).matrix(), ..ControlPose::REST }
    }

    /// Four turns there and back in steps of 5°, exactly about an axis or with a hand that wobbles by 2° across it.
    #[test]
    fn whole_turns_are_counted_there_and_back() {
        for axis in [Vector3::x(), Vector3::new(0.6, 0.0, -0.8), Vector3::new(1.0, -2.0, 0.5).normalize()] {
            let across = axis.cross(&Vector3::new(0.3, 1.0, 0.2)).normalize();
            for wobble in [0.0, 2f64.to_radians()] {
                let mut turn = FollowedTurn::REST;
                let way = (0..=288).chain((-10..288).rev());
                for (frame, step) in way.enumerate() {
                    let angle = (5.0 * f64::from(step)).to_radians();
                    let sway = Rotation3::from_scaled_axis(across * (wobble * (0.7 * frame as f64).sin()));
                    let matrix = sway.matrix() * pose(axis * angle).matrix;
                    turn = turn.follow(&ControlPose { matrix, ..ControlPose::REST });
                    let told = turn.against(&FollowedTurn::REST);
                    let off = (told - angle.abs()).abs();
                    assert!(off <= wobble + 1e-9, "{step} × 5° about {axis}: {}°", told.to_degrees());
                }
            }
        }
    }

    #[test]
    fn elements_that_turn_together_are_not_turned_against_each_other() {
        let mut turns = [FollowedTurn::REST; 3];
        for step in 0..=200 {
            let angle = (6.0 * f64::from(step)).to_radians();
            for (turn, ahead) in turns.iter_mut().zip([0.0, 0.3, 1.0]) {
                *turn = turn.follow(&pose(Vector3::z() * (angle + ahead)));
            }
            let between = [turns[0].against(&turns[1]), turns[2].against(&turns[1])];
            assert!((between[0] - 0.3).abs() + (between[1] - 0.7).abs() < 1e-9, "{angle}: {between:?}");
        }
        // One each way: 200° against each other, which no two matrices tell from 160°.
        let [mut one, mut two] = [FollowedTurn::REST; 2];
        for step in 0..=20 {
            let angle = (5.0 * f64::from(step)).to_radians();
            (one, two) = (one.follow(&pose(Vector3::y() * angle)), two.follow(&pose(Vector3::y() * -angle)));
        }
        assert!((one.against(&two).to_degrees() - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_quaternion_tells_up_to_a_whole_turn_and_a_flat_pose_nothing() {
        let turned = |degrees: f64| {
            let half = 0.5 * degrees.to_radians();
            UnitQuaternion::new_unchecked(Quaternion::new(half.cos(), 0.0, half.sin(), 0.0))
        };
        for degrees in [0.0, 20.0, 170.0, 200.0, 340.0] {
            let told = FollowedTurn::of(turned(degrees)).against(&FollowedTurn::REST).to_degrees();
            assert!((told - degrees).abs() < 1e-9, "{degrees}: {told}");
        }
        let turn = FollowedTurn::of(turned(200.0));
        let flat = ControlPose { matrix: nalgebra::Matrix3::zeros(), ..ControlPose::REST };
        assert_eq!(turn.follow(&flat), turn);
    }
}
