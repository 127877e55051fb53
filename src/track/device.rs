//! The raw readings of one source: poses, buttons and valuators in the device's own frame, with time and quality.
//!
//! In: the contents of a tracker's packets; each kind of source has a separate file. Out: a [`DeviceState`], of which the newest
//! is handed over without a lock. Calibration, filter and prediction come later.

use super::flow::Flow;
use super::state::normalised;
use nalgebra::Isometry3;
use std::collections::BTreeMap;

/// The most sensors, buttons and valuators that a source keeps, whatever its packets contain.
pub const MOST_CHANNELS: usize = 256;
/// If all channels are taken, a new one replaces the one that has been silent longest, provided that it was silent for
/// longer than this, s.
const STALE_S: f64 = 2.0;

/// The newest reading of every sensor, button and valuator of a source, by its number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceState {
    pub sensors: BTreeMap<i32, Reading<Isometry3<f64>>>,
    pub buttons: BTreeMap<i32, Reading<bool>>,
    pub valuators: BTreeMap<i32, Reading<f64>>,
    pub counters: Counters,
    pub link: Link,
    /// The longest recent time from a question to its answer, s; `None` if nothing was asked or answered yet.
    pub round_trip_s: Option<f64>,
}

/// A value, and what is known about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading<T> {
    pub value: T,
    /// Time of arrival, seconds of this program's clock ([`now_s`]).
    pub arrived_s: f64,
    /// The last tracked reading before this one, and when it arrived: a reader that looks rarely needs both for the speed.
    pub before: Option<(T, f64)>,
    /// Time of measurement, seconds of the device's clock.
    pub measured_s: Option<f64>,
    /// 1 tracked, 0 not tracked (the value is then the last one that was).
    pub quality: f32,
    /// Number of readings of this channel since the start.
    pub count: u64,
    pub flow: Flow,
}

impl<T: Copy> Reading<T> {
    /// The last tracked value, this one or the one before, and when it arrived.
    pub fn seen(&self) -> Option<(T, f64)> {
        if self.quality > 0.0 { Some((self.value, self.arrived_s)) } else { self.before }
    }
}

/// Counts of received data since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    pub packets: u64,
    pub messages: u64,
    /// Dropped because they did not parse or broke a limit.
    pub malformed: u64,
    /// Well-formed, but dropped: too many at once, on too many channels, or of no use here.
    pub dropped: u64,
    /// Number of times that a flood was made to wait; the operating system dropped what came meanwhile.
    pub throttled: u64,
    pub reconnects: u64,
}

/// Whether the source is there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Link {
    /// Not heard from yet.
    #[default]
    Waiting,
    Up,
    /// Connected, but silent for longer than a working device ever is.
    Quiet,
    /// Gone, and why; the source tries again at growing intervals.
    Down(String),
}

/// A source of poses, buttons and valuators; most have a thread of their own that receives them.
pub trait Source: Send {
    /// `vrpn Tracker0@host`, for tables and messages.
    fn describe(&self) -> String;

    /// The newest state. Never blocks.
    fn latest(&mut self) -> &DeviceState;
}

/// Seconds since the program first asked: one steady clock for all sources.
pub fn now_s() -> f64 {
    use std::sync::OnceLock;
    use std::time::Instant;
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Times at which a reading arrived, and at which the device measured it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamp {
    pub arrived_s: f64,
    pub measured_s: Option<f64>,
}

impl Stamp {
    pub fn now(measured_s: Option<f64>) -> Stamp {
        Stamp { arrived_s: now_s(), measured_s }
    }
}

impl DeviceState {
    /// Takes the pose of a sensor and normalises its quaternion. A pose that is not finite or has no rotation is dropped
    /// and counted, and so is one of a new sensor while [`MOST_CHANNELS`] others are active. A reading with quality 0
    /// keeps the last pose.
    pub fn take_pose(&mut self, sensor: i32, pose: Isometry3<f64>, measured_s: Option<f64>, quality: f32) {
        self.take_pose_at(Stamp::now(measured_s), sensor, pose, quality);
    }

    /// Takes a pose with a given time of arrival, for recordings.
    pub fn take_pose_at(&mut self, stamp: Stamp, sensor: i32, pose: Isometry3<f64>, quality: f32) {
        let is_finite =
            pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|x| x.is_finite());
        let rotation = normalised(&pose.rotation);
        let last = self.sensors.get(&sensor).map(|reading| reading.value);
        let value = match (rotation, last) {
            (Some(rotation), _) if is_finite && quality > 0.0 => {
                Isometry3::from_parts(pose.translation, rotation)
            }
            (_, last) if quality <= 0.0 => last.unwrap_or_else(Isometry3::identity),
            _ => {
                self.counters.dropped += 1;
                return;
            }
        };
        match take(&mut self.sensors, sensor, value, stamp, quality) {
            Some(reading) => reading.flow.stood((quality > 0.0).then_some(value.translation.vector)),
            None => self.counters.dropped += 1,
        }
    }

    pub fn take_button(&mut self, button: i32, pressed: bool, measured_s: Option<f64>) {
        self.take_button_at(Stamp::now(measured_s), button, pressed);
    }

    fn take_button_at(&mut self, stamp: Stamp, button: i32, pressed: bool) {
        let kept = take(&mut self.buttons, button, pressed, stamp, 1.0).is_some();
        self.counters.dropped += u64::from(!kept);
    }

    pub fn take_valuator(&mut self, valuator: i32, value: f64, measured_s: Option<f64>) {
        self.take_valuator_at(Stamp::now(measured_s), valuator, value);
    }

    fn take_valuator_at(&mut self, stamp: Stamp, valuator: i32, value: f64) {
        let kept = value.is_finite() && take(&mut self.valuators, valuator, value, stamp, 1.0).is_some();
        self.counters.dropped += u64::from(!kept);
    }
}

/// `None` if there is no room for a new channel.
fn take<T: Copy>(
    readings: &mut BTreeMap<i32, Reading<T>>,
    channel: i32,
    value: T,
    stamp: Stamp,
    quality: f32,
) -> Option<&mut Reading<T>> {
    let Stamp { arrived_s, measured_s } = stamp;
    let last = readings.get(&channel).copied();
    if last.is_none() && readings.len() >= MOST_CHANNELS {
        let (stalest, reading) = readings.iter().min_by(|a, b| a.1.arrived_s.total_cmp(&b.1.arrived_s))?;
        if arrived_s - reading.arrived_s <= STALE_S {
            return None;
        }
        let stalest = *stalest;
        readings.remove(&stalest);
    }
    let mut flow = last.map_or_else(Flow::default, |last| last.flow);
    if let Some(last) = last {
        flow.arrived((arrived_s - last.arrived_s).max(0.0));
    }
    let before = last.and_then(|last| last.seen());
    if let (Some((_, before_s)), true) = (before, quality > 0.0) {
        flow.seen_again((arrived_s - before_s).max(0.0));
    }
    let count = last.map_or(0, |last| last.count) + 1;
    readings.insert(channel, Reading { value, arrived_s, before, measured_s, quality, count, flow });
    readings.get_mut(&channel)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    #[test]
    fn a_flood_of_channels_does_not_grow() {
        let mut state = DeviceState::default();
        let at_once = Stamp { arrived_s: 1.0, measured_s: None };
        for channel in 0..10_000 {
            state.take_pose_at(at_once, channel, Isometry3::identity(), 1.0);
            state.take_button_at(at_once, -channel, true);
            state.take_valuator_at(at_once, channel, f64::NAN);
        }
        assert_eq!((state.sensors.len(), state.buttons.len(), state.valuators.len()), (256, 256, 0));
        assert_eq!(state.counters.dropped, 2 * (10_000 - 256) + 10_000);
    }

    #[test]
    fn a_datagram_full_of_bodies_locks_no_sensor_out_for_ever() {
        let mut state = DeviceState::default();
        let at = |arrived_s| Stamp { arrived_s, measured_s: None };
        for body in 0..256 {
            state.take_pose_at(at(1.0), body, Isometry3::identity(), 1.0);
        }
        state.take_pose_at(at(1.5), 7, Isometry3::identity(), 1.0);
        state.take_pose_at(at(2.0), 1000, Isometry3::identity(), 1.0);
        assert!(!state.sensors.contains_key(&1000), "all others have just spoken");
        state.take_pose_at(at(3.1), 1000, Isometry3::identity(), 1.0);
        assert_eq!((state.sensors.len(), state.sensors[&1000].count), (256, 1));
        assert!(state.sensors.contains_key(&7), "not one that spoke since");
    }

    #[test]
    fn the_tracked_reading_before_is_kept_over_those_that_are_not_tracked() {
        let mut state = DeviceState::default();
        for (arrived_s, x, quality) in [(1.0, 1.0, 1.0), (1.1, 0.0, 0.0), (1.2, 0.0, 0.0), (1.5, 5.0, 1.0)] {
            let stamp = Stamp { arrived_s, measured_s: None };
            state.take_pose_at(stamp, 1, Isometry3::translation(x, 0.0, 0.0), quality);
        }
        let reading = state.sensors[&1];
        assert_eq!(reading.before, Some((Isometry3::translation(1.0, 0.0, 0.0), 1.0)));
        assert_eq!(reading.seen(), Some((Isometry3::translation(5.0, 0.0, 0.0), 1.5)));
        assert_eq!(reading.flow.gaps, 1);
    }

    #[test]
    fn a_sensor_that_is_not_tracked_keeps_its_last_pose() {
        let mut state = DeviceState::default();
        let pose = Isometry3::translation(1.0, 2.0, 3.0);
        state.take_pose(4, pose, Some(7.0), 1.0);
        state.take_pose(4, Isometry3::identity(), Some(7.1), 0.0);
        state.take_pose(4, Isometry3::translation(f64::NAN, 0.0, 0.0), Some(7.2), 1.0);
        let reading = state.sensors[&4];
        assert_eq!((reading.value, reading.quality, reading.count), (pose, 0.0, 2));
        assert_eq!(state.counters.dropped, 1);
    }

    #[test]
    fn quaternions_are_normalised_and_those_without_a_rotation_dropped() {
        let of = |w: f64| {
            let rotation = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, 0.0, 0.0, 0.0));
            Isometry3::from_parts(nalgebra::Translation3::identity(), rotation)
        };
        let mut state = DeviceState::default();
        state.take_pose(1, of(0.5), None, 1.0);
        assert_eq!(state.sensors[&1].value, Isometry3::identity());
        for none in [0.0, 1e-9, 1e300, f64::NAN] {
            state.take_pose(1, of(none), None, 1.0);
        }
        assert_eq!((state.sensors[&1].count, state.counters.dropped), (1, 4));
    }
}
