//! One sensor, from its raw readings to its present pose in the room.
//!
//! In: readings of one sensor. Out: a finite pose at any time, and how well it is tracked. The calibration comes first, then
//! the rejection of jumps that no hand makes, then filter and prediction. Gaps and jumps are bridged smoothly.

use super::super::state::{Signal, normalised};
use super::clock::DeviceClock;
use super::motion::{FASTEST_M_S, FASTEST_RAD_S, Motion};
use super::one_euro::PoseFilter;
use crate::stage::ROOM_LIMIT_M;
use crate::stage::tracking::{Sensor, TrackerFrame};
use crate::track::device::Reading;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Largest motion of a hand between two readings, m and rad, in addition to what its speed allows in the time between them.
/// If the device was silent for longer than usual, only `STEP_S` of that time counts.
const STEP_M: f64 = 0.05;
const STEP_RAD: f64 = 0.4;
const STEP_S: f64 = 0.02;
/// A jump is accepted when it has lasted for this long, s, so that a single wrong reading is never shown.
const CONFIRM_S: f64 = 0.1;
/// Time in which the shown pose glides from the held one to the measured one, s.
const BRIDGE_S: f64 = 0.2;

#[derive(Clone, Debug)]
pub struct Follower {
    pub sensor: Sensor,
    pub frame: TrackerFrame,
    pub faults: SensorFaults,
    pub signal: Signal,
    clock: DeviceClock,
    filter: Option<PoseFilter>,
    /// The sensor's pose in the room, filtered.
    motion: Option<Motion>,
    /// The last accepted reading: unfiltered pose, time of measurement, time of arrival.
    raw: Option<TrustedPose>,
    jump: Option<Jump>,
    bridge: Option<Bridge>,
    shown: Option<Isometry3<f64>>,
    /// Whether the held pose was shown since the last reading.
    was_held: bool,
    /// Number and arrival of the last reading.
    taken: (u64, f64),
    started_s: f64,
}

/// Counts of what was wrong with a sensor's readings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorFaults {
    /// Readings more than 1 km away or without a rotation.
    pub invalid: u64,
    /// Jumps further than any hand moves.
    pub jumps: u64,
    /// Stamps of the device's clock that were refused.
    pub clock: u64,
    /// Number of times that the sensor was untracked for longer than its policy's `after`.
    pub drop_outs: u64,
}

/// An event of a sensor that the user is notified of once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    Lost { age_s: f64 },
    Back { gap_s: f64 },
}

#[derive(Clone, Copy, Debug)]
struct TrustedPose {
    pose: Isometry3<f64>,
    time_s: f64,
    arrived_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Jump {
    to: TrustedPose,
    since_s: f64,
}

/// The difference between the shown and the true pose, which fades away while the true pose moves on.
#[derive(Clone, Copy, Debug)]
struct Bridge {
    from: Isometry3<f64>,
    start_s: f64,
    length_s: f64,
    /// Translation and rotation from the true pose to `from`, once they are known.
    off: Option<[Vector3<f64>; 2]>,
}

impl Follower {
    pub fn new(sensor: Sensor, frame: TrackerFrame, now_s: f64) -> Follower {
        Follower {
            filter: sensor.filter.map(PoseFilter::new),
            sensor,
            frame,
            faults: SensorFaults::default(),
            signal: Signal::Lost { age_s: 0.0 },
            clock: DeviceClock::default(),
            motion: None,
            raw: None,
            jump: None,
            bridge: None,
            shown: None,
            was_held: false,
            taken: (0, 0.0),
            started_s: now_s,
        }
    }

    /// Takes the newest reading, if it is a new one. Gaps are those of the device: a caller that looks rarely misses
    /// readings, but that counts as no gap.
    pub fn take(&mut self, reading: &Reading<Isometry3<f64>>) {
        let now = (reading.count, reading.arrived_s);
        let is_same = std::mem::replace(&mut self.taken, now) == now;
        if is_same || reading.quality <= 0.0 || !reading.arrived_s.is_finite() {
            return;
        }
        let Some(pose) = in_room(self.frame.room_from_sensor(&reading.value)) else {
            self.faults.invalid += 1;
            return;
        };
        let time_s = self.clock.time_s(reading.arrived_s, reading.measured_s);
        self.faults.clock = self.clock.faults;
        let now = TrustedPose { pose, time_s, arrived_s: reading.arrived_s };
        let Some(last) = self.raw else { return self.begin(now, now.arrived_s) };
        let gap_s = now.arrived_s - reading.before.map_or(last.arrived_s, |(_, before_s)| before_s);
        if self.was_held || gap_s > self.sensor.lost.after_s {
            return self.begin(now, now.arrived_s);
        }
        let is_pause = gap_s > STEP_S.max(2.0 * reading.flow.interval_s);
        let is_hand = |from: &TrustedPose| {
            let step_s = (now.time_s - from.time_s).max(0.0);
            if is_step(&from.pose, &pose, step_s.min(STEP_S)) {
                return true;
            }
            // Readings in between were missed here; the device's previous one must be compatible with this one as well.
            let before = reading.before.and_then(|(value, _)| in_room(self.frame.room_from_sensor(&value)));
            let leads = before.is_none_or(|before| is_step(&before, &pose, gap_s.max(0.0)));
            !is_pause && leads && is_step(&from.pose, &pose, step_s)
        };
        if is_hand(&last) {
            return self.follow(now);
        }
        match self.jump {
            Some(Jump { to, since_s }) if is_hand(&to) => self.jump = Some(Jump { to: now, since_s }),
            _ => {
                self.faults.jumps += 1;
                self.jump = Some(Jump { to: now, since_s: now.arrived_s });
            }
        }
        self.settle(now.arrived_s);
    }

    /// room_from_body at `now_s`; `None` before the first reading. If the sensor was untracked for longer than its policy's
    /// `after`, the prediction is taken back, and the last measured pose is held.
    pub fn pose(&mut self, now_s: f64) -> (Option<Isometry3<f64>>, Option<Event>) {
        self.settle(now_s);
        let event = self.age(now_s);
        let Some(motion) = &self.motion else { return (None, event) };
        let held_s = match self.signal {
            Signal::Live => 0.0,
            Signal::Held { age_s } | Signal::Lost { age_s } => age_s - self.sensor.lost.after_s,
        };
        let room_from_sensor = if self.sensor.predict_s > 0.0 {
            motion.at(now_s + self.sensor.predict_s, fading(held_s / BRIDGE_S))
        } else {
            motion.pose
        };
        let mut room_from_body = room_from_sensor * self.sensor.sensor_from_body;
        if let Some(bridge) = &mut self.bridge {
            room_from_body = bridge.over(&room_from_body, now_s);
            if bridge.left_s(now_s) <= 0.0 {
                self.bridge = None;
            }
        }
        // A pose that the calibration moves out of range is not shown.
        let shown = in_room(room_from_body).or(self.shown);
        self.shown = shown;
        (shown, event)
    }

    /// Accepts a jump that has lasted long enough.
    fn settle(&mut self, now_s: f64) {
        if let Some(jump) = self.jump.take_if(|jump| now_s - jump.since_s >= CONFIRM_S) {
            self.was_held = true;
            self.begin(jump.to, now_s);
        }
    }

    fn follow(&mut self, now: TrustedPose) {
        self.jump = None;
        self.raw = Some(now);
        let pose = match &mut self.filter {
            Some(filter) => filter.apply(&now.pose, now.time_s),
            None => now.pose,
        };
        match &mut self.motion {
            Some(motion) => motion.update(pose, now.time_s),
            None => self.motion = Some(Motion::new(pose, now.time_s)),
        }
    }

    /// Starts from this reading without the past: the first one, or the first after a gap or a jump. If a pose was held
    /// meanwhile, what is shown glides from there; a glide under way arrives no later than before.
    fn begin(&mut self, now: TrustedPose, start_s: f64) {
        let left_s = self.bridge.as_ref().map(|bridge| bridge.left_s(start_s)).filter(|left_s| *left_s > 0.0);
        let length_s = left_s.or(std::mem::take(&mut self.was_held).then_some(BRIDGE_S));
        self.bridge =
            self.shown.zip(length_s).map(|(from, length_s)| Bridge { from, start_s, length_s, off: None });
        self.motion = None;
        if let Some(filter) = &mut self.filter {
            filter.restart();
        }
        self.follow(now);
    }

    /// Updates the signal at `now_s`; returns an event when the sensor is lost or comes back.
    fn age(&mut self, now_s: f64) -> Option<Event> {
        let before = self.signal;
        let seen = self.raw.map(|raw| raw.arrived_s);
        let age_s = (now_s - seen.unwrap_or(self.started_s)).max(0.0);
        let policy = self.sensor.lost;
        self.signal = if seen.is_none() || age_s > policy.warn_s {
            Signal::Lost { age_s }
        } else if age_s > policy.after_s {
            Signal::Held { age_s }
        } else {
            Signal::Live
        };
        self.was_held |= seen.is_some() && self.signal != Signal::Live;
        self.faults.drop_outs += u64::from(before == Signal::Live && self.signal != Signal::Live);
        match (before, self.signal) {
            (Signal::Live | Signal::Held { .. }, Signal::Lost { age_s }) => Some(Event::Lost { age_s }),
            // Never tracked: reported once it is overdue.
            (Signal::Lost { age_s: earlier_s }, Signal::Lost { age_s })
                if seen.is_none() && earlier_s <= policy.warn_s && age_s > policy.warn_s =>
            {
                Some(Event::Lost { age_s })
            }
            (Signal::Lost { age_s: gap_s }, Signal::Live) if gap_s > policy.warn_s => {
                Some(Event::Back { gap_s })
            }
            _ => None,
        }
    }
}

impl Bridge {
    fn left_s(&self, now_s: f64) -> f64 {
        self.length_s - (now_s - self.start_s)
    }

    fn over(&mut self, truth: &Isometry3<f64>, now_s: f64) -> Isometry3<f64> {
        let from = self.from;
        let [shift, turn] = *self.off.get_or_insert_with(|| {
            let shift = from.translation.vector - truth.translation.vector;
            [shift, (from.rotation * truth.rotation.inverse()).scaled_axis()]
        });
        let left = fading(1.0 - self.left_s(now_s) / self.length_s);
        let place = truth.translation.vector + shift * left;
        let rotation = UnitQuaternion::from_scaled_axis(turn * left) * truth.rotation;
        Isometry3::from_parts(Translation3::from(place), rotation)
    }
}

/// 1 - 3 w² + 2 w³ for w from 0 to 1: falls smoothly from 1 to 0.
fn fading(way: f64) -> f64 {
    let way = way.clamp(0.0, 1.0);
    1.0 - way * way * (3.0 - 2.0 * way)
}

/// Whether a hand could have moved like this in `step_s`.
fn is_step(from: &Isometry3<f64>, to: &Isometry3<f64>, step_s: f64) -> bool {
    let step_m = (to.translation.vector - from.translation.vector).norm();
    let step_rad = to.rotation.angle_to(&from.rotation);
    step_m <= STEP_M + FASTEST_M_S * step_s && step_rad <= STEP_RAD + FASTEST_RAD_S * step_s
}

/// The pose with its rotation normalised, if it is finite and within 1 km.
fn in_room(pose: Isometry3<f64>) -> Option<Isometry3<f64>> {
    let is_near = pose.translation.vector.iter().all(|x| x.abs() <= ROOM_LIMIT_M);
    let rotation = normalised(&pose.rotation)?;
    is_near.then(|| Isometry3::from_parts(pose.translation, rotation))
}

#[cfg(test)]
#[path = "follower_tests.rs"]
mod tests;
