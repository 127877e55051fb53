//! Predicts where a sensor will be when its picture is shown, from constant velocity and constant angular velocity.
//!
//! In: poses and their times. Out: the pose a little later. Velocities are means of about 16 ms.

use super::one_euro::alpha;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Poses are predicted no further ahead than this, s.
pub const FARTHEST_S: f64 = 0.1;
/// Hands are always slower than this, m/s and rad/s.
pub const FASTEST_M_S: f64 = 10.0;
pub const FASTEST_RAD_S: f64 = 40.0;
/// Cutoff of the velocities, Hz.
const CUTOFF_HZ: f64 = 10.0;
/// Two readings are taken to be at least this far apart, s.
const SHORTEST_S: f64 = 1e-3;

/// The last pose, when it was measured, and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    pub pose: Isometry3<f64>,
    pub time_s: f64,
    /// `None` before the second pose.
    speeds: Option<[Vector3<f64>; 2]>,
}

impl Motion {
    pub fn new(pose: Isometry3<f64>, time_s: f64) -> Motion {
        Motion { pose, time_s, speeds: None }
    }

    pub fn update(&mut self, pose: Isometry3<f64>, time_s: f64) {
        let step_s = (time_s - self.time_s).max(SHORTEST_S);
        let now = [
            (pose.translation.vector - self.pose.translation.vector) / step_s,
            (pose.rotation * self.pose.rotation.inverse()).scaled_axis() / step_s,
        ];
        let part = alpha(CUTOFF_HZ, step_s);
        let [along, turning] = match self.speeds {
            Some(last) => [last[0].lerp(&now[0], part), last[1].lerp(&now[1], part)],
            None => now,
        };
        self.speeds = Some([along.cap_magnitude(FASTEST_M_S), turning.cap_magnitude(FASTEST_RAD_S)]);
        (self.pose, self.time_s) = (pose, time_s);
    }

    /// The pose at `time_s`, at most `FARTHEST_S` after the last one and never before it. `part` is the fraction of the
    /// prediction that is applied: 1 for all of it, 0 for the last pose itself.
    pub fn at(&self, time_s: f64, part: f64) -> Isometry3<f64> {
        let Some([along, turning]) = self.speeds else { return self.pose };
        let ahead_s = (time_s - self.time_s).clamp(0.0, FARTHEST_S) * part;
        let place = self.pose.translation.vector + along * ahead_s;
        let turn = UnitQuaternion::from_scaled_axis(turning * ahead_s);
        Isometry3::from_parts(Translation3::from(place), turn * self.pose.rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screw(time_s: f64) -> Isometry3<f64> {
        let axis = Vector3::new(0.3, -0.5, 0.8) * 2.0 * time_s;
        Isometry3::new(Vector3::new(0.4, 0.1, -0.7) * time_s, axis)
    }

    #[test]
    fn a_steady_motion_is_predicted_without_error() {
        let mut motion = Motion::new(screw(0.0), 0.0);
        for i in 1..200 {
            // Uneven steps.
            let time_s = f64::from(i) * 0.01 + 0.003 * f64::from(i % 3);
            motion.update(screw(time_s), time_s);
            let (found, expected) = (motion.at(time_s + 0.05, 1.0), screw(time_s + 0.05));
            let off = (found.translation.vector - expected.translation.vector).norm();
            let angle = found.rotation.angle_to(&expected.rotation);
            assert!(off < 1e-12 && angle < 1e-7, "{off} m, {angle} rad");
        }
    }

    #[test]
    fn prediction_ends_after_a_tenth_of_a_second_and_has_a_greatest_speed() {
        let mut motion = Motion::new(Isometry3::identity(), 0.0);
        assert_eq!(motion.at(5.0, 1.0), Isometry3::identity(), "one pose has no speed");
        motion.update(Isometry3::new(Vector3::new(1e6, 0.0, 0.0), Vector3::new(0.0, 3.0, 0.0)), 0.0);
        let far = motion.at(1e9, 1.0);
        assert!((far.translation.x - 1e6 - FASTEST_M_S * FARTHEST_S).abs() < 1e-6);
        assert_eq!(motion.at(-1.0, 1.0), motion.pose);
    }
}
