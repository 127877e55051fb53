//! Force-feedback devices: the handle's pose comes in, force and torque go out.

use crate::deform::se3;
use crate::track::Flow;
use nalgebra::{Isometry3, Vector3, Vector6};

/// The newest measurement of a device, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    pub device_from_handle: Isometry3<f64>,
    /// The button that grabs, and the second button.
    pub buttons: [bool; 2],
    /// Time of arrival, seconds of this program's clock.
    pub arrived_s: f64,
    /// Time of measurement, seconds of the device's clock.
    pub measured_s: Option<f64>,
    /// False if the device reports that it does not know its pose.
    pub tracked: bool,
    pub info: SampleInfo,
}

/// Statistics of a device's samples; a simulated device does not keep them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleInfo {
    pub count: u64,
    pub flow: Flow,
    /// The last tracked pose before this one, and when it arrived.
    pub before: Option<(Isometry3<f64>, f64)>,
}

impl Reading {
    /// A tracked pose without buttons, stamp and statistics.
    pub fn at(device_from_handle: Isometry3<f64>, arrived_s: f64) -> Reading {
        let (buttons, info) = ([false; 2], SampleInfo::default());
        Reading { device_from_handle, buttons, arrived_s, measured_s: None, tracked: true, info }
    }

    /// Whether it is older than `other` by either clock.
    pub fn is_before(&self, other: &Reading) -> bool {
        let is_measured_before =
            self.measured_s.zip(other.measured_s).is_some_and(|(own, other)| own < other);
        self.arrived_s < other.arrived_s || is_measured_before
    }
}

/// Force and torque of the device on the hand, about the handle's origin, in the device's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Push {
    /// N.
    pub force: Vector3<f64>,
    /// N·m.
    pub torque: Vector3<f64>,
}

impl Push {
    pub const NONE: Push = Push { force: Vector3::new(0.0, 0.0, 0.0), torque: Vector3::new(0.0, 0.0, 0.0) };

    pub fn is_finite(&self) -> bool {
        self.force.iter().chain(self.torque.iter()).all(|x| x.is_finite())
    }

    pub fn scaled(&self, by: f64) -> Push {
        Push { force: self.force * by, torque: self.torque * by }
    }

    /// The force above the torque in one vector.
    pub fn stacked(&self) -> Vector6<f64> {
        se3::joined(&self.force, &self.torque)
    }

    pub fn unstacked(both: &Vector6<f64>) -> Push {
        let (force, torque) = se3::halves(both);
        Push { force, torque }
    }

    pub fn plus(&self, other: &Push) -> Push {
        Push { force: self.force + other.force, torque: self.torque + other.torque }
    }
}

/// A device that the loop reads and drives once a tick. No call blocks or allocates: network devices have threads of their
/// own.
pub trait Device: Send {
    /// `haply ws://localhost:10001`, for messages.
    fn describe(&self) -> String;

    /// The newest reading; `None` while there is no device.
    fn read(&mut self, now_s: f64) -> Option<Reading>;

    /// Sets the force until the next call.
    fn push(&mut self, push: &Push, now_s: f64);

    /// The greatest recent time from a measurement to the loop plus from the loop to the motors, without the tick itself, s: as
    /// an echo measures it, or a cautious estimate until one has come.
    fn latency_s(&self) -> f64 {
        0.0
    }

    /// The number of messages that could not be read.
    fn malformed(&mut self) -> u64 {
        0
    }

    /// Gives a simulated device the pose of the user's hand, in the device's frame.
    fn hand(&mut self, _device_from_hand: &Isometry3<f64>) {}
}
