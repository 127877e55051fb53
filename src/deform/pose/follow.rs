//! Poses from frame to frame: turns that are followed through whole turns, and limits on a tracked hand.
//!
//! In: the matrices of a control element one after another. Out: by how much it has turned since rest. A matrix determines
//! the angle φ of a turn up to multiples of 360°. Its quaternion q = (cos φ/2, a sin φ/2), with the sign that continues the
//! quaternion before it, determines φ up to multiples of 720°. Of the angles φ = 2 atan2(q·a, w) + 720° k the one nearest to
//! the last angle is taken. Near whole turns sin φ/2 is small and q says little of the axis a: there the last axis is kept,
//! and φ is the twist about it.
//!
//! A tracked hand's poses are admitted, clamped, slowed or held before anything is summed: out come poses that are finite, proper
//! and no wilder than the limits below, and what was wrong. A lost tracker, a hand that lets go of a scale or a sensor that flips
//! never reaches a buffer.

use super::frame::{ControlPose, continued, same_side};
use crate::fem::Polar;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
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
    pub fn new(quaternion: UnitQuaternion<f64>) -> FollowedTurn {
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

/// Least and greatest stretch of a control element along any direction.
pub const STRETCH: [f64; 2] = [0.05, 20.0];
/// A turn by more than this between two frames is a sensor's jump, not a hand's, rad.
pub const JUMP: f64 = 150.0 * std::f64::consts::PI / 180.0;
/// A turn by more than this between two frames may have gone the other way round, rad.
pub const KNOWN: f64 = std::f64::consts::FRAC_PI_2;
/// Largest turn in a frame by which the pose follows after a jump, rad.
pub const CATCH_UP: f64 = 15.0 * std::f64::consts::PI / 180.0;

/// A fault of a pose, and its remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PoseFault {
    /// A number is not finite: the last pose is held.
    NotFinite,
    /// M mirrors: the nearest proper matrix is taken.
    Mirrored,
    /// M collapses or blows up: its stretches are clamped to [`STRETCH`].
    Stretch,
    /// M turned by more than [`JUMP`] since the last frame: it is followed by [`CATCH_UP`] a frame.
    Jump,
}

impl PoseFault {
    pub fn explain(self) -> &'static str {
        match self {
            PoseFault::NotFinite => "a number is not finite; the last pose is held",
            PoseFault::Mirrored => "it mirrors; the nearest pose that does not is taken",
            PoseFault::Stretch => "it is stretched beyond 0.05 to 20; clamped",
            PoseFault::Jump => "it turned by more than 150° in one frame; followed slowly",
        }
    }
}

/// Admits the poses of one control element, frame by frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseLimiter {
    /// The turn from the pose that was admitted last to that of the hand, while the pose is catching up after a jump. The hand's
    /// turns are followed meanwhile, so that the pose goes all the way after it.
    behind: Option<FollowedTurn>,
}

impl PoseLimiter {
    /// The pose to use in this frame, after `last` in the one before, and what was wrong with the one that came.
    pub fn admit(&mut self, last: &ControlPose, pose: &ControlPose) -> (ControlPose, Vec<PoseFault>) {
        if pose == last {
            return (*pose, Vec::new());
        }
        let polar = if pose.is_finite() { Polar::new(&pose.matrix) } else { None };
        let Some(polar) = polar else { return (*last, vec![PoseFault::NotFinite]) };
        let (rotation, mirrored) = (polar.turn(), polar.sign < 0.0);
        let mut faults = Vec::new();
        if mirrored {
            faults.push(PoseFault::Mirrored);
        }
        let (stretch, clamped) = clamp(&polar.stretch());
        if clamped {
            faults.push(PoseFault::Stretch);
        }
        // The last pose went through here, so its polar factor is defined.
        let turned = Polar::new(&last.matrix).map_or(UnitQuaternion::identity(), |polar| polar.turn());
        let behind = self.behind(&(turned.inverse() * rotation));
        let angle = behind.angle.abs();
        if angle > JUMP {
            faults.push(PoseFault::Jump);
        }
        if angle <= CATCH_UP || (self.behind.is_none() && angle <= JUMP) {
            self.behind = None;
            let untouched = !mirrored && !clamped;
            let matrix = if untouched { pose.matrix } else { rotation.to_rotation_matrix() * stretch };
            return (ControlPose { translation: pose.translation, matrix }, faults);
        }
        let share = CATCH_UP / angle;
        let step = UnitQuaternion::from_scaled_axis(behind.axis * (behind.angle * share));
        self.behind = Some(FollowedTurn {
            quaternion: step.inverse() * behind.quaternion,
            axis: behind.axis,
            angle: behind.angle * (1.0 - share),
        });
        let translation = last.translation.lerp(&pose.translation, share);
        (ControlPose { translation, matrix: (turned * step).to_rotation_matrix() * stretch }, faults)
    }

    /// The turn from the last pose to that of the hand, which are `apart` now. A hand that went by more than [`KNOWN`] since the
    /// frame before turned nobody knows how: the shorter turn is taken.
    fn behind(&self, apart: &UnitQuaternion<f64>) -> FollowedTurn {
        let shorter = if apart.w < 0.0 { UnitQuaternion::new_unchecked(-apart.into_inner()) } else { *apart };
        match &self.behind {
            Some(behind) if behind.quaternion.angle_to(apart) <= KNOWN => {
                behind.advanced(same_side(&behind.quaternion, shorter))
            }
            _ => FollowedTurn::new(shorter),
        }
    }
}

/// S with its eigenvalues clamped to [`STRETCH`], and whether one had to be.
fn clamp(stretch: &Matrix3<f64>) -> (Matrix3<f64>, bool) {
    let eigen = stretch.symmetric_eigen();
    let clamped = eigen.eigenvalues.map(|value| value.clamp(STRETCH[0], STRETCH[1]));
    // The decomposition's own rounding is no fault.
    if (clamped - eigen.eigenvalues).amax() <= 1e-12 * STRETCH[1] {
        return (*stretch, false);
    }
    let axes = eigen.eigenvectors;
    (axes * Matrix3::from_diagonal(&clamped) * axes.transpose(), true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Vector3};

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
            let told = FollowedTurn::new(turned(degrees)).against(&FollowedTurn::REST).to_degrees();
            assert!((told - degrees).abs() < 1e-9, "{degrees}: {told}");
        }
        let turn = FollowedTurn::new(turned(200.0));
        let flat = ControlPose { matrix: nalgebra::Matrix3::zeros(), ..ControlPose::REST };
        assert_eq!(turn.follow(&flat), turn);
    }

    fn turned(angle: f64) -> ControlPose {
        let matrix = *Rotation3::from_axis_angle(&Vector3::z_axis(), angle).matrix();
        ControlPose { translation: Vector3::new(0.1, 0.0, 0.0), matrix }
    }

    fn scaled(x: f64, y: f64, z: f64) -> ControlPose {
        ControlPose { matrix: Matrix3::from_diagonal(&Vector3::new(x, y, z)), ..ControlPose::REST }
    }

    #[test]
    fn honest_poses_pass_as_they_are() {
        let (mut limiter, mut last) = (PoseLimiter::default(), ControlPose::REST);
        let sheared =
            ControlPose { matrix: Matrix3::new(1.0, 0.4, 0.0, 0.0, 1.2, 0.1, 0.3, 0.0, 0.9), ..turned(0.0) };
        for pose in [turned(0.5), sheared, turned(2.0), turned(3.0), turned(4.0)] {
            assert_eq!(limiter.admit(&last, &pose), (pose, vec![]));
            last = pose;
        }
    }

    #[test]
    fn a_hand_passes_half_a_turn_about_any_axis() {
        for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, 0.0, -0.8)] {
            let (mut limiter, mut last) = (PoseLimiter::default(), ControlPose::REST);
            for i in 0..=40 {
                let matrix = *Rotation3::new(axis * (std::f64::consts::PI * f64::from(i) / 20.0)).matrix();
                let pose = ControlPose { matrix, ..ControlPose::REST };
                assert_eq!(limiter.admit(&last, &pose), (pose, vec![]), "{} ° about {axis}", 9 * i);
                last = pose;
            }
        }
    }

    #[test]
    fn numbers_that_are_none_hold_the_last_pose() {
        let mut limiter = PoseLimiter::default();
        let last = turned(0.5);
        for bad in [f64::NAN, f64::INFINITY, 1e308] {
            let mut pose = turned(0.6);
            pose.matrix *= bad;
            let (admitted, faults) = limiter.admit(&last, &pose);
            assert!(admitted.is_finite() && !faults.is_empty(), "{bad}: {faults:?}");
        }
        let mut pose = turned(0.6);
        pose.translation.x = f64::NAN;
        assert_eq!(limiter.admit(&last, &pose), (last, vec![PoseFault::NotFinite]));
        assert_eq!(limiter.admit(&last, &turned(0.7)), (turned(0.7), vec![]));
    }

    #[test]
    fn collapse_blow_up_and_mirrors_are_clamped() {
        let diagonal = |pose: &ControlPose| {
            let mut values: Vec<f64> = pose.matrix.singular_values().iter().copied().collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        for (pose, expected, fault) in [
            (scaled(0.0, 0.0, 0.0), [0.05, 0.05, 0.05], PoseFault::Stretch),
            (scaled(1e6, 1.0, 1.0), [1.0, 1.0, 20.0], PoseFault::Stretch),
            (scaled(1.0, 1.0, -1.0), [1.0, 1.0, 1.0], PoseFault::Mirrored),
        ] {
            let (admitted, faults) = PoseLimiter::default().admit(&ControlPose::REST, &pose);
            assert!(near(&diagonal(&admitted), &expected), "{admitted:?}");
            assert!(faults.contains(&fault), "{faults:?}");
            assert!(admitted.matrix.determinant() > 0.0);
        }
    }

    #[test]
    fn a_jump_is_followed_slowly_until_it_is_reached() {
        let mut limiter = PoseLimiter::default();
        let far = turned(170f64.to_radians());
        let (mut last, faults) = limiter.admit(&ControlPose::REST, &far);
        assert_eq!(faults, [PoseFault::Jump]);
        let angle = |pose: &ControlPose| Polar::new(&pose.matrix).unwrap().turn().angle();
        assert!((angle(&last) - CATCH_UP).abs() < 1e-9);
        let mut followed = || {
            last = limiter.admit(&last, &far).0;
            last == far
        };
        let frames = (1..100).find(|_| followed()).unwrap();
        assert_eq!(frames, 11, "170° in steps of 15°");
        assert_eq!(limiter.admit(&far, &far), (far, vec![]));
    }
}
