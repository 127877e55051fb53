//! The poses and buttons of head and styli at one time, and which poses can be used.

use crate::stage::ROOM_LIMIT_M;
use nalgebra::{Isometry3, UnitQuaternion};

/// Head and styli at one time.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerState {
    /// `None`: the head is not tracked. It then stays where it was last tracked, and before that where the stage places it.
    #[serde(with = "crate::field::numbers::option")]
    pub head: Option<Isometry3<f32>>,
    /// A source always gives the same styli in the same order.
    pub styli: Vec<StylusState>,
    pub time_s: f64,
}

/// A six-degree-of-freedom pointing device with two buttons.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StylusState {
    #[serde(with = "crate::field::numbers")]
    pub room_from_stylus: Isometry3<f32>,
    /// The button that grabs.
    pub pressed: bool,
    /// The second button, which scales what is held or does what else the mode defines.
    pub second: bool,
    pub signal: Signal,
    /// The ray starts at the viewer's eye, as the mouse's does. Since the viewer would see it end-on, it is drawn as if held
    /// elsewhere and pointing at the same place.
    pub from_eye: bool,
}

/// The quality with which a sensor is tracked now.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Signal {
    #[default]
    Live,
    /// Not tracked for `age_s` seconds: its last pose is held.
    Held { age_s: f64 },
    /// A sensor that is untracked for longer than its policy allows: it neither grabs nor holds.
    Lost { age_s: f64 },
}

/// The last usable pose, and how many unusable ones have come since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldPose {
    #[serde(with = "crate::field::numbers::option")]
    pub last: Option<Isometry3<f64>>,
    pub invalid: u64,
}

impl HeldPose {
    /// Takes a new pose if it is usable and counts it otherwise; true if it was taken.
    pub fn update(&mut self, pose: &Isometry3<f32>) -> bool {
        match usable(pose) {
            Some(pose) => {
                self.last = Some(pose);
                true
            }
            None => {
                self.invalid = self.invalid.saturating_add(1);
                false
            }
        }
    }
}

/// The pose in f64, its rotation normalised again; `None` if a number is not finite, the place lies more than
/// 1 km away, or the quaternion's length is off by more than 1 %.
pub fn usable(pose: &Isometry3<f32>) -> Option<Isometry3<f64>> {
    let pose: Isometry3<f64> = pose.cast();
    let is_in_room = pose.translation.vector.iter().all(|x| x.abs() <= ROOM_LIMIT_M);
    let is_rotation = (pose.rotation.coords.norm() - 1.0).abs() <= 0.01;
    (is_in_room && is_rotation).then(|| {
        let rotation = UnitQuaternion::new_normalize(pose.rotation.into_inner());
        Isometry3::from_parts(pose.translation, rotation)
    })
}

/// The rotation of a quaternion that need not have length 1; `None` if its length is not within 0.001 to 1000.
pub fn normalised(rotation: &UnitQuaternion<f64>) -> Option<UnitQuaternion<f64>> {
    let length = rotation.coords.norm();
    (1e-3..=1e3).contains(&length).then(|| UnitQuaternion::new_normalize(*rotation.quaternion()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Quaternion, Translation3};

    #[test]
    fn unusable_poses_are_counted_and_the_last_usable_one_is_held() {
        let good = Isometry3::translation(1.0, 2.0, 3.0);
        let mut held = HeldPose::default();
        assert!(held.update(&good));
        let zero_quaternion = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 0.0, 0.0, 0.0));
        for bad in [
            Isometry3::translation(f32::NAN, 0.0, 0.0),
            Isometry3::translation(0.0, f32::INFINITY, 0.0),
            Isometry3::translation(0.0, 0.0, 1e30),
            Isometry3::from_parts(Translation3::identity(), zero_quaternion),
            Isometry3::rotation(nalgebra::Vector3::new(f32::NAN, 0.0, 0.0)),
        ] {
            assert!(!held.update(&bad), "{bad}");
        }
        assert_eq!((held.last, held.invalid), (Some(good.cast()), 5));
    }
}
