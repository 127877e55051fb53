//! One tracked thing, from what its tracker says to its pose in the room now.
//!
//! In: readings of one sensor. Out: a finite pose at any time, and how well it is seen. Calibration first, then what no
//! hand does is held back, then filter and prediction; gaps and jumps are bridged instead of shown.

use super::clock::DeviceClock;
use super::motion::{FASTEST_M_S, FASTEST_RAD_S, Motion};
use super::one_euro::PoseFilter;
use crate::stage::ROOM_LIMIT_M;
use crate::stage::tracking::{Sensor, TrackerFrame};
use crate::track::device::Reading;
use crate::track::{Signal, normalised};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// A step between two readings that no hand makes is longer than this, beside what its speed allows in the time between
/// them, of which no more than `STEP_S` counts: after a pause a leap is a leap.
const STEP_M: f64 = 0.05;
const STEP_RAD: f64 = 0.4;
const STEP_S: f64 = 0.02;
/// A jump is taken when it has stood so long, s: one wrong reading is never seen.
const CONFIRM_S: f64 = 0.1;
/// From where it was held the pose glides to where it is within this time, s.
const BRIDGE_S: f64 = 0.2;

/// The state of one sensor.
#[derive(Clone, Debug)]
pub struct Follower {
    pub sensor: Sensor,
    pub frame: TrackerFrame,
    pub faults: Faults,
    pub signal: Signal,
    clock: DeviceClock,
    filter: Option<PoseFilter>,
    /// Of the sensor in the room, filtered.
    motion: Option<Motion>,
    /// The last reading that was believed: unfiltered, when measured, when it arrived.
    raw: Option<Believed>,
    jump: Option<Jump>,
    bridge: Option<Bridge>,
    shown: Option<Isometry3<f64>>,
    count: u64,
    started_s: f64,
}

/// What was wrong with the readings so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    /// Readings more than 1 km away or without a rotation.
    pub invalid: u64,
    /// Steps that no hand makes.
    pub jumps: u64,
    /// Stamps of the device's clock that were not believed.
    pub clock: u64,
    /// How often it was not seen for longer than its policy's `after`.
    pub drop_outs: u64,
}

/// What is to be said of a sensor, once each time it happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    Lost { age_s: f64 },
    Back { gap_s: f64 },
}

#[derive(Clone, Copy, Debug)]
struct Believed {
    pose: Isometry3<f64>,
    time_s: f64,
    arrived_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct Jump {
    to: Believed,
    since_s: f64,
}

/// What was shown against what is true when they part: it fades away, however the truth moves on.
#[derive(Clone, Copy, Debug)]
struct Bridge {
    from: Isometry3<f64>,
    start_s: f64,
    /// Shift and turn from the truth to `from`, once that is known.
    off: Option<[Vector3<f64>; 2]>,
}

impl Follower {
    pub fn new(sensor: Sensor, frame: TrackerFrame, now_s: f64) -> Follower {
        Follower {
            filter: sensor.filter.map(PoseFilter::new),
            sensor,
            frame,
            faults: Faults::default(),
            signal: Signal::Lost { age_s: 0.0 },
            clock: DeviceClock::default(),
            motion: None,
            raw: None,
            jump: None,
            bridge: None,
            shown: None,
            count: 0,
            started_s: now_s,
        }
    }

    /// room_from_body of a reading as it is, without filter, prediction and drop-out policy.
    pub fn calibrated(&self, tracker_from_sensor: &Isometry3<f64>) -> Isometry3<f64> {
        self.frame.room_from_sensor(tracker_from_sensor) * self.sensor.sensor_from_body
    }

    /// Takes the newest reading, if it is a new one.
    pub fn take(&mut self, reading: &Reading<Isometry3<f64>>) {
        if reading.count == self.count {
            return;
        }
        self.count = reading.count;
        if reading.quality <= 0.0 || !reading.arrived_s.is_finite() {
            return;
        }
        let Some(pose) = in_room(self.frame.room_from_sensor(&reading.value)) else {
            self.faults.invalid += 1;
            return;
        };
        let time_s = self.clock.time_s(reading.arrived_s, reading.measured_s);
        self.faults.clock = self.clock.faults;
        let now = Believed { pose, time_s, arrived_s: reading.arrived_s };
        let Some(last) = self.raw else {
            return self.begin(now, now.arrived_s);
        };
        let gap_s = now.arrived_s - last.arrived_s;
        if gap_s > self.sensor.lost.after_s {
            return self.begin(now, now.arrived_s);
        }
        if is_hand(&last, &now) {
            return self.follow(now);
        }
        match self.jump {
            Some(Jump { to, since_s }) if is_hand(&to, &now) => self.jump = Some(Jump { to: now, since_s }),
            _ => {
                self.faults.jumps += 1;
                self.jump = Some(Jump { to: now, since_s: now.arrived_s });
            }
        }
        self.settle(now.arrived_s);
    }

    /// room_from_body at `now_s`; `None` before the first reading.
    pub fn pose(&mut self, now_s: f64) -> (Option<Isometry3<f64>>, Option<Event>) {
        self.settle(now_s);
        let event = self.age(now_s);
        let Some(motion) = &self.motion else {
            return (None, event);
        };
        let room_from_sensor =
            if self.sensor.predict_s > 0.0 { motion.at(now_s + self.sensor.predict_s) } else { motion.pose };
        let mut room_from_body = room_from_sensor * self.sensor.sensor_from_body;
        if let Some(bridge) = &mut self.bridge {
            room_from_body = bridge.over(&room_from_body, now_s);
            if now_s - bridge.start_s >= BRIDGE_S {
                self.bridge = None;
            }
        }
        // What the calibration carried out of reach is not shown.
        let shown = in_room(room_from_body).or(self.shown);
        self.shown = shown;
        (shown, event)
    }

    /// A jump that has stood long enough is believed.
    fn settle(&mut self, now_s: f64) {
        if let Some(jump) = self.jump.take_if(|jump| now_s - jump.since_s >= CONFIRM_S) {
            self.begin(jump.to, now_s);
        }
    }

    fn follow(&mut self, now: Believed) {
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

    /// The first reading, or the first after a gap or a jump: nothing of the past is mixed in, and what was shown last
    /// glides there.
    fn begin(&mut self, now: Believed, start_s: f64) {
        self.bridge = self.shown.map(|from| Bridge { from, start_s, off: None });
        self.motion = None;
        if let Some(filter) = &mut self.filter {
            filter.restart();
        }
        self.follow(now);
    }

    /// How well it is seen at `now_s`.
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
        match (before, self.signal) {
            (Signal::Live, Signal::Held { .. }) => {
                self.faults.drop_outs += 1;
                None
            }
            (Signal::Live, Signal::Lost { age_s }) => {
                self.faults.drop_outs += 1;
                Some(Event::Lost { age_s })
            }
            (Signal::Held { .. }, Signal::Lost { age_s }) => Some(Event::Lost { age_s }),
            // Never seen: said once it is overdue.
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
    fn over(&mut self, truth: &Isometry3<f64>, now_s: f64) -> Isometry3<f64> {
        let from = self.from;
        let [shift, turn] = *self.off.get_or_insert_with(|| {
            let shift = from.translation.vector - truth.translation.vector;
            [shift, (from.rotation * truth.rotation.inverse()).scaled_axis()]
        });
        let way = ((now_s - self.start_s) / BRIDGE_S).clamp(0.0, 1.0);
        let left = 1.0 - way * way * (3.0 - 2.0 * way);
        let place = truth.translation.vector + shift * left;
        let rotation = UnitQuaternion::from_scaled_axis(turn * left) * truth.rotation;
        Isometry3::from_parts(Translation3::from(place), rotation)
    }
}

/// Could a hand have done this?
fn is_hand(from: &Believed, to: &Believed) -> bool {
    let step_s = (to.time_s - from.time_s).clamp(0.0, STEP_S);
    let step_m = (to.pose.translation.vector - from.pose.translation.vector).norm();
    let step_rad = to.pose.rotation.angle_to(&from.pose.rotation);
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
