//! Limits on the poses of a tracked hand: they are admitted, clamped, slowed or held before anything is summed.
//!
//! In: control poses as hands made them. Out: poses that are finite, proper and no wilder than the limits below,
//! and what was wrong. A lost tracker, a hand that lets go of a scale or a sensor that flips never reaches a buffer.

use super::pose::ControlPose;
use crate::fem::Polar;
use nalgebra::{Matrix3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Least and greatest stretch of a control element along any direction.
pub const STRETCH: [f64; 2] = [0.05, 20.0];
/// A turn by more than this between two frames is a sensor's jump, not a hand's, rad.
pub const JUMP: f64 = 150.0 * std::f64::consts::PI / 180.0;
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
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseLimiter {
    /// Whether the pose is catching up after a jump.
    behind: bool,
}

impl PoseLimiter {
    /// The pose to use in this frame, after `last` in the one before, and what was wrong with the one that came.
    pub fn admit(&mut self, last: &ControlPose, pose: &ControlPose) -> (ControlPose, Vec<PoseFault>) {
        if pose == last {
            return (*pose, Vec::new());
        }
        let polar = if pose.is_finite() { Polar::of(&pose.matrix) } else { None };
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
        let turned = Polar::of(&last.matrix).map_or(UnitQuaternion::identity(), |polar| polar.turn());
        let angle = turned.angle_to(&rotation);
        if angle > JUMP {
            faults.push(PoseFault::Jump);
            self.behind = true;
        }
        if !(self.behind && angle > CATCH_UP) {
            self.behind = false;
            let untouched = !mirrored && !clamped;
            let matrix = if untouched { pose.matrix } else { rotation.to_rotation_matrix() * stretch };
            return (ControlPose { translation: pose.translation, matrix }, faults);
        }
        let share = CATCH_UP / angle;
        let step = turned.try_slerp(&rotation, share, 1e-9).unwrap_or(turned);
        let translation = last.translation.lerp(&pose.translation, share);
        (ControlPose { translation, matrix: step.to_rotation_matrix() * stretch }, faults)
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
        let angle = |pose: &ControlPose| Polar::of(&pose.matrix).unwrap().turn().angle();
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
