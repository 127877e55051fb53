//! A stage's trackers, its sensors with their calibration, and which of them are on the head and on the styli.
//!
//! Data only: nothing is opened here. The keys of each kind of source are read by its entry in `track::SOURCES`.

use super::haptic::HapticDevice;
use indexmap::IndexMap;
use nalgebra::{Isometry3, Point3, Similarity3, Translation3, UnitQuaternion};
use std::path::PathBuf;

/// Everything that is tracked on a stage, in the order of the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracking {
    pub trackers: IndexMap<String, Tracker>,
    /// Each names one of `trackers`; no two have the same tracker and id.
    pub sensors: IndexMap<String, Sensor>,
    /// Each names one of `sensors`.
    pub styli: IndexMap<String, Stylus>,
    /// The sensor on the viewer's head.
    pub head: Option<String>,
}

impl Tracking {
    /// Names of the styli in the order of the trackers' state; if none is tracked, the names of the two hands.
    pub fn stylus_names(&self) -> Vec<&str> {
        if self.styli.is_empty() {
            vec!["right", "left"]
        } else {
            self.styli.keys().map(String::as_str).collect()
        }
    }
}

/// A source of poses, buttons and valuators, and how its frame lies in the room.
#[derive(Clone, Debug, PartialEq)]
pub struct Tracker {
    pub source: TrackerSource,
    pub frame: TrackerFrame,
}

/// The source of a tracker's poses.
#[derive(Clone, Debug, PartialEq)]
pub enum TrackerSource {
    Table(SourceTable),
    /// A table `[haptic.NAME]`: the haptic loop that drives the device also reads its poses.
    Haptic(HapticDevice),
}

/// The keys of a table `[tracker.NAME]` that belong to the kind of source, and where they stand.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceTable {
    pub keys: toml::Table,
    pub path: PathBuf,
    pub line: usize,
}

/// The transform from a tracker's frame and unit to metres in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerFrame {
    /// The axis that is reversed first if the tracker's system is left-handed.
    pub mirror: Option<Axis>,
    /// The transform whose scaling turns the tracker's unit into metres.
    pub room_from_tracker: Similarity3<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    X,
    Y,
    Z,
}

/// One sensor: its number, how it is mounted, and how its poses are filtered and predicted.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    pub tracker: String,
    pub id: i32,
    /// The body is a head (origin midway between the eyes, -z to where it looks) or a stylus (ray along -z).
    pub sensor_from_body: Isometry3<f64>,
    pub filter: Option<OneEuro>,
    /// Time by which the pose is predicted, s; 0: it is used as it came.
    pub predict_s: f64,
    pub lost: LostPolicy,
}

/// The One Euro filter's parameters (G. Casiez, N. Roussel, D. Vogel, CHI 2012).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OneEuro {
    /// Cutoff at rest, Hz: lower is smoother.
    pub min_cutoff: f64,
    /// Cutoff gained per speed, Hz per m/s for places and per rad/s for orientations: higher lags less.
    pub beta: f64,
    /// Cutoff of the speed itself, Hz.
    pub speed_cutoff: f64,
}

/// Treatment of a sensor that is not tracked any more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LostPolicy {
    /// Age from which on the last pose counts as held, s.
    pub after_s: f64,
    /// Age from which on it counts as lost, s: a notice is given, and a stylus lets go.
    pub warn_s: f64,
}

/// A pointing device: a sensor and its buttons.
#[derive(Clone, Debug, PartialEq)]
pub struct Stylus {
    pub sensor: String,
    pub grab: Option<ButtonId>,
    pub second: Option<ButtonId>,
}

/// A button of a tracker, which need not be the tracker of the stylus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ButtonId {
    pub tracker: String,
    pub button: i32,
}

impl Axis {
    /// The name in a stage file.
    pub fn name(self) -> &'static str {
        match self {
            Axis::X => "x",
            Axis::Y => "y",
            Axis::Z => "z",
        }
    }
}

impl Default for LostPolicy {
    fn default() -> LostPolicy {
        LostPolicy { after_s: 0.25, warn_s: 2.0 }
    }
}

impl Default for TrackerFrame {
    fn default() -> TrackerFrame {
        TrackerFrame { mirror: None, room_from_tracker: Similarity3::identity() }
    }
}

impl TrackerFrame {
    /// room_from_sensor of a reading p, q: with the mirror D and room_from_tracker (s, R, t) the place is
    /// t + s R D p and the orientation R D q D.
    pub fn room_from_sensor(&self, tracker_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
        let mirrored = self.mirrored(tracker_from_sensor);
        let place = self.room_from_tracker * Point3::from(mirrored.translation.vector);
        let rotation = self.room_from_tracker.isometry.rotation * mirrored.rotation;
        Isometry3::from_parts(Translation3::from(place.coords), rotation)
    }

    /// The reading of a sensor that is at a place in the room: the inverse of [`TrackerFrame::room_from_sensor`].
    pub fn tracker_from_sensor(&self, room_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
        let place = self.room_from_tracker.inverse() * Point3::from(room_from_sensor.translation.vector);
        let rotation = self.room_from_tracker.isometry.rotation.inverse() * room_from_sensor.rotation;
        self.mirrored(&Isometry3::from_parts(Translation3::from(place.coords), rotation))
    }

    /// D p and D q D.
    fn mirrored(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        let (mut place, mut q) = (pose.translation.vector, *pose.rotation.quaternion());
        if let Some(axis) = self.mirror {
            let axis = axis as usize;
            place[axis] = -place[axis];
            // A reflection keeps the part of the rotation's axis along it and reverses the other two.
            for other in (0..3).filter(|other| *other != axis) {
                q.coords[other] = -q.coords[other];
            }
        }
        Isometry3::from_parts(Translation3::from(place), UnitQuaternion::new_unchecked(q))
    }
}

impl std::fmt::Display for TrackerSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            TrackerSource::Haptic(device) => write!(f, "force device, {device}"),
            TrackerSource::Table(SourceTable { keys, .. }) => {
                for (index, (key, value)) in keys.iter().enumerate() {
                    let comma = if index > 0 { ", " } else { "" };
                    match value.as_str() {
                        Some(text) => write!(f, "{comma}{key} {text}")?,
                        None => write!(f, "{comma}{key} {value}")?,
                    }
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    /// x → M x and R → M R M with the reflection M.
    #[test]
    fn a_mirrored_pose_is_that_of_the_reflection_and_comes_back() {
        let pose = Isometry3::new(Vector3::new(0.1, -0.2, 0.3), Vector3::new(0.4, 1.1, -0.7));
        let matrix = |pose: &Isometry3<f64>| *pose.rotation.to_rotation_matrix().matrix();
        for (k, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
            let frame = TrackerFrame { mirror: Some(axis), ..TrackerFrame::default() };
            let mut reflection = Matrix3::identity();
            reflection[(k, k)] = -1.0;
            let found = frame.room_from_sensor(&pose);
            assert!(
                (found.translation.vector - reflection * pose.translation.vector).norm() < 1e-14,
                "{found}"
            );
            assert!((matrix(&found) - reflection * matrix(&pose) * reflection).norm() < 1e-14, "{found}");
            let back = frame.tracker_from_sensor(&found);
            assert!((back.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-14, "{back}");
        }
    }
}
