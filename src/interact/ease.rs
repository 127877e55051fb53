//! Motion that eases from one state to another in a set time, whatever the frame rate.
//!
//! In: the time now. Out: the fraction of the motion, 0 to 1, and control poses and places in between. Each is computed from
//! the start of the motion, so that the frames in between do not matter.

use nalgebra::{Matrix3, Similarity3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// A motion in progress.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ease {
    start_s: f64,
}

/// Duration of a motion, s.
pub const EASE_S: f64 = 0.4;

impl Ease {
    pub fn start(time_s: f64) -> Self {
        Self { start_s: time_s }
    }

    /// The share of the way at `time_s`: s² (3 - 2 s) of the share s of [`EASE_S`], exactly 0 and 1 at its ends and
    /// 1 beyond. A time before the start, as of a clock that was set back, or that is not a number counts as the end.
    pub fn share(&self, time_s: f64) -> f64 {
        let s = (time_s - self.start_s) / EASE_S;
        if (0.0..1.0).contains(&s) { s * s * (3.0 - 2.0 * s) } else { 1.0 }
    }
}

/// A control pose T, M at `share` of its way back to rest: M = R S, T (1 - share), R by slerp along `turn` (whose sign
/// distinguishes a turn by 200° from one by -160°), S on a straight line to I. Exactly rest at 1.
pub fn towards_rest(
    translation: &Vector3<f64>,
    matrix: &Matrix3<f64>,
    turn: &UnitQuaternion<f64>,
    share: f64,
) -> (Vector3<f64>, Matrix3<f64>, UnitQuaternion<f64>) {
    if share >= 1.0 {
        return (Vector3::zeros(), Matrix3::identity(), UnitQuaternion::identity());
    }
    let stretch = turn.to_rotation_matrix().transpose() * matrix;
    let turn = part_of_turn(turn, 1.0 - share);
    let stretch = stretch * (1.0 - share) + Matrix3::identity() * share;
    (translation * (1.0 - share), turn.to_rotation_matrix() * stretch, turn)
}

/// `part` of a turn up to a whole one either way: the angle is 2 acos w, above half a turn where w is negative.
fn part_of_turn(turn: &UnitQuaternion<f64>, part: f64) -> UnitQuaternion<f64> {
    let sine = turn.imag().norm();
    if sine < 1e-12 {
        return if turn.w > 0.0 { *turn } else { UnitQuaternion::identity() };
    }
    let half_angle = sine.atan2(turn.w) * part;
    let axis = turn.imag() / sine;
    let parts = nalgebra::Quaternion::from_imag(axis * half_angle.sin());
    UnitQuaternion::new_normalize(nalgebra::Quaternion::new(half_angle.cos(), parts.i, parts.j, parts.k))
}

/// A place between two: the origin on a straight line, the rotation by slerp, the scale by its logarithm.
pub fn between(from: &Similarity3<f64>, to: &Similarity3<f64>, share: f64) -> Similarity3<f64> {
    if share >= 1.0 {
        return *to;
    }
    let rotation = from.isometry.rotation;
    let rotation = rotation.try_slerp(&to.isometry.rotation, share, 1e-9).unwrap_or(to.isometry.rotation);
    let place = from.isometry.translation.vector.lerp(&to.isometry.translation.vector, share);
    let scale = from.scaling() * (to.scaling() / from.scaling()).powf(share);
    Similarity3::from_parts(place.into(), rotation, scale)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn the_share_grows_from_nothing_to_all_in_the_set_time() {
        let ease = Ease::start(10.0);
        assert_eq!([9.0, 10.0, 10.4, 99.0, f64::NAN].map(|t| ease.share(t)), [1.0, 0.0, 1.0, 1.0, 1.0]);
        assert!((ease.share(10.2) - 0.5).abs() < 1e-12);
        let shares: Vec<f64> = (0..=40).map(|i| ease.share(10.0 + 0.01 * f64::from(i))).collect();
        assert!(shares.is_sorted());
    }

    #[test]
    fn a_pose_eases_to_exact_rest_along_its_own_turn() {
        let stretch = Matrix3::new(1.2, 0.1, 0.0, 0.1, 0.9, 0.0, 0.0, 0.0, 1.0);
        // 270° and -90° are the same matrix, but not the same way back.
        for angle in [0.5, -PI / 2.0, 1.5 * PI] {
            let (sin, cos) = (angle / 2.0_f64).sin_cos();
            let turn = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(cos, 0.0, 0.0, sin));
            let matrix = turn.to_rotation_matrix() * stretch;
            let shift = Vector3::new(0.1, 0.2, 0.3);
            let (t, m, q) = towards_rest(&shift, &matrix, &turn, 0.0);
            assert!((m - matrix).norm() < 1e-14 && t == shift && (q.coords - turn.coords).norm() < 1e-14);
            let (t, m, _) = towards_rest(&shift, &matrix, &turn, 0.5);
            let halfway = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), angle / 2.0);
            assert!((m - halfway * (stretch + Matrix3::identity()) / 2.0).norm() < 1e-12, "{angle}: {m}");
            assert!((t - shift / 2.0).norm() < 1e-15);
            let (t, m, q) = towards_rest(&shift, &matrix, &turn, 1.0);
            assert_eq!((t, m, q), (Vector3::zeros(), Matrix3::identity(), UnitQuaternion::identity()));
        }
    }

    #[test]
    fn a_place_between_two_scales_evenly_and_arrives_exactly() {
        let from = Similarity3::new(Vector3::x(), Vector3::zeros(), 1.0);
        let to = Similarity3::new(-Vector3::x(), Vector3::new(0.0, 1.0, 0.0), 0.25);
        let half = between(&from, &to, 0.5);
        assert!((half.scaling() - 0.5).abs() < 1e-12 && half.isometry.translation.vector.norm() < 1e-15);
        assert!((half.isometry.rotation.angle() - 0.5).abs() < 1e-12);
        assert_eq!(between(&from, &to, 1.0), to);
    }
}
