//! A force-feedback device: where its handle is, in; the force and torque on it, out.

use crate::track::Flow;
use nalgebra::{Isometry3, Vector3, Vector6};

/// What a device measured last, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    pub device_from_handle: Isometry3<f64>,
    /// The one that grabs, and the second.
    pub buttons: [bool; 2],
    /// When it arrived, seconds of this program's clock.
    pub arrived_s: f64,
    /// When the device says that it measured it, seconds of the device's clock.
    pub measured_s: Option<f64>,
    /// False where the device says that it does not know where it is.
    pub tracked: bool,
    pub info: SampleInfo,
}

/// How many poses came so far, and how steadily; a device without a wire does not count them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleInfo {
    pub count: u64,
    pub flow: Flow,
    /// The last tracked one before it, and when it arrived.
    pub before: Option<(Isometry3<f64>, f64)>,
}

impl Reading {
    /// Older by either clock.
    pub fn is_before(&self, other: &Reading) -> bool {
        let is_measured_before =
            self.measured_s.zip(other.measured_s).is_some_and(|(own, other)| own < other);
        self.arrived_s < other.arrived_s || is_measured_before
    }
}

/// What the device pushes the hand with, about its handle's origin, in the device's frame.
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

    /// Force above torque.
    pub fn stacked(&self) -> Vector6<f64> {
        let (f, t) = (&self.force, &self.torque);
        Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
    }

    pub fn unstacked(both: &Vector6<f64>) -> Push {
        Push { force: both.fixed_rows::<3>(0).into_owned(), torque: both.fixed_rows::<3>(3).into_owned() }
    }

    pub fn plus(&self, other: &Push) -> Push {
        Push { force: self.force + other.force, torque: self.torque + other.torque }
    }
}

/// A device that the loop reads and drives once a tick. Neither call blocks or allocates: what travels over a network has
/// a thread of its own.
pub trait Device: Send {
    /// `haply ws://localhost:10001`, for messages.
    fn describe(&self) -> String;

    /// The newest reading; `None` as long as there is no device.
    fn read(&mut self, now_s: f64) -> Option<Reading>;

    /// The force from now until the next call.
    fn push(&mut self, push: &Push, now_s: f64);

    /// Seconds from a measurement to the loop and from the loop to the motors, beside the tick itself, at worst of late: as an
    /// echo measures it, or what must be feared as long as none has come.
    fn latency_s(&self) -> f64 {
        0.0
    }

    /// Messages that could not be read so far.
    fn malformed(&mut self) -> u64 {
        0
    }

    /// Where the user holds the handle, for a device that is simulated, in its own frame.
    fn hand(&mut self, _device_from_hand: &Isometry3<f64>) {}
}
