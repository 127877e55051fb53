//! A force-feedback device as a source of poses: its measurements reach its stylus like those of any tracker.
//!
//! In: a device, or the loop that drives it. Out: a [`DeviceState`] with sensor 0 and the buttons 0 and 1.
//!
//! [`ActingPush`] remembers the last pushes and gives the one that acted on the hand while the handle moved: if messages
//! take time, it is older than the loop's last one.

use super::device::{Device, Push, Reading, SampleInfo};
use crate::track::device::{DeviceState, Link, Reading as Sample, Source, now_s};
use std::collections::VecDeque;
use triple_buffer::Output;

/// Reads from the device itself, or from the loop that drives it.
pub struct HapticSource {
    device: String,
    from: From,
    state: DeviceState,
}

enum From {
    Loop(Output<Option<Reading>>),
    Device(Box<dyn Device>),
}

impl HapticSource {
    /// A device without forces, for which no loop runs.
    pub fn alone(device: Box<dyn Device>) -> HapticSource {
        HapticSource { device: device.describe(), from: From::Device(device), state: DeviceState::default() }
    }

    pub(super) fn of_loop(device: String, readings: Output<Option<Reading>>) -> HapticSource {
        HapticSource { device, from: From::Loop(readings), state: DeviceState::default() }
    }

    fn take(&mut self, reading: &Reading) {
        let state = &mut self.state;
        state.link = Link::Up;
        let Reading { device_from_handle, buttons, arrived_s, tracked, measured_s, info } = *reading;
        let SampleInfo { count, flow, before } = info;
        if state.sensors.get(&0).is_some_and(|last| last.count == count) {
            return;
        }
        let quality = if tracked { 1.0 } else { 0.0 };
        state.sensors.insert(
            0,
            Sample { value: device_from_handle, arrived_s, before, measured_s, quality, count, flow },
        );
        for (number, pressed) in (0..).zip(buttons) {
            if state.buttons.get(&number).is_none_or(|last| last.value != pressed) {
                state.take_button(number, pressed, None);
            }
        }
    }
}

impl Source for HapticSource {
    fn describe(&self) -> String {
        self.device.clone()
    }

    fn latest(&mut self) -> &DeviceState {
        let reading = match &mut self.from {
            From::Loop(readings) => *readings.read(),
            From::Device(device) => device.read(now_s()),
        };
        match reading {
            Some(reading) => self.take(&reading),
            None if self.state.link == Link::Up => self.state.link = Link::Down("it does not answer".into()),
            None => {}
        }
        &self.state
    }
}

/// Time for which pushes are remembered, s: the longest silence during a force, and the greatest age of a pose.
const KEPT_S: f64 = 0.2;

/// The pushes of the last ticks, for the mean over the time between two poses, shifted by the delay. Allocates only in
/// [`ActingPush::new`].
pub struct ActingPush {
    given: VecDeque<TimedPush>,
}

/// The body's push in the tick at a given time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPush {
    pub at_s: f64,
    pub push: Push,
    /// Share of the push that acts: from 0, no force, to 1, all of it.
    pub gain: f64,
}

impl ActingPush {
    pub fn new(rate_hz: f64) -> ActingPush {
        ActingPush { given: VecDeque::with_capacity((KEPT_S * rate_hz) as usize + 2) }
    }

    /// Forgets all pushes, because they belong to another potential.
    pub fn clear(&mut self) {
        self.given.clear();
    }

    pub fn give(&mut self, given: TimedPush) {
        if self.given.len() == self.given.capacity() {
            self.given.pop_front();
        }
        self.given.push_back(given);
    }

    /// Mean of push and gain from one time to another, each push held until the next; `None` before the first.
    pub fn during(&self, from_s: f64, until_s: f64) -> Option<TimedPush> {
        let span_s = until_s - from_s;
        let mut mean = TimedPush { at_s: from_s, push: Push::NONE, gain: 0.0 };
        let mut end_s = f64::INFINITY;
        for given in self.given.iter().rev() {
            let begins_s = given.at_s.max(from_s);
            // For a span of length 0, the push that acts at that time.
            let part = if span_s > 0.0 { (end_s.min(until_s) - begins_s).max(0.0) / span_s } else { 1.0 };
            let is_first = given.at_s <= from_s + SAME_S;
            if span_s > 0.0 || is_first {
                mean.push = mean.push.plus(&given.push.scaled(part));
                mean.gain += part * given.gain;
            }
            if is_first {
                return Some(mean);
            }
            end_s = given.at_s;
        }
        None
    }
}

/// Times that differ by less are equal, s.
const SAME_S: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use super::super::device::Push;
    use super::*;
    use nalgebra::{Isometry3, Vector3};
    use std::sync::{Arc, Mutex};

    struct FakeDevice(Arc<Mutex<Option<Reading>>>);

    impl Device for FakeDevice {
        fn describe(&self) -> String {
            "fake device".into()
        }

        fn read(&mut self, _now_s: f64) -> Option<Reading> {
            *self.0.lock().unwrap()
        }

        fn push(&mut self, _push: &Push, _now_s: f64) {}
    }

    #[test]
    fn a_device_is_one_sensor_and_two_buttons_until_it_is_gone() {
        let said = Arc::new(Mutex::new(None));
        let mut source = HapticSource::alone(Box::new(FakeDevice(said.clone())));
        assert_eq!(source.latest().link, Link::Waiting);
        let reading = |count: u64, pressed: bool| Reading {
            buttons: [pressed, false],
            info: SampleInfo { count, ..SampleInfo::default() },
            ..Reading::at(Isometry3::translation(0.1 * count as f64, 0.0, 0.0), 0.001 * count as f64)
        };
        for (count, pressed) in [(1, false), (2, true)] {
            *said.lock().unwrap() = Some(reading(count, pressed));
            let state = source.latest();
            assert_eq!((state.sensors[&0].count, state.buttons[&0].value), (count, pressed));
            assert_eq!(state.sensors[&0].value.translation.x, 0.1 * count as f64);
        }
        *said.lock().unwrap() = None;
        assert!(matches!(source.latest().link, Link::Down(_)));
    }

    #[test]
    fn the_mean_is_that_of_what_acted() {
        let mut acting = ActingPush::new(1000.0);
        for (at_s, force) in [(1.0, 4.0), (1.001, 8.0), (1.003, 2.0)] {
            let push = Push { force: Vector3::new(force, 0.0, 0.0), torque: Vector3::zeros() };
            acting.give(TimedPush { at_s, push, gain: 0.5 });
        }
        let force = |from_s, until_s| acting.during(from_s, until_s).map(|given| given.push.force.x);
        for (from_s, until_s, expected) in [
            (1.0, 1.001, 4.0),
            (1.0, 1.004, (4.0 + 16.0 + 2.0) / 4.0),
            (1.0005, 1.002, (2.0 + 8.0) / 1.5),
            (1.5, 1.6, 2.0),
            (1.002, 1.002, 8.0),
        ] {
            let found = force(from_s, until_s).unwrap();
            assert!((found - expected).abs() < 1e-9, "{from_s} to {until_s}: {found}, expected {expected}");
        }
        assert!((acting.during(1.0, 1.004).unwrap().gain - 0.5).abs() < 1e-9);
        assert_eq!(force(0.999, 1.002), None, "nothing is known of before");
        for i in 0..1000 {
            acting.give(TimedPush { at_s: 2.0 + 1e-3 * f64::from(i), push: Push::NONE, gain: 1.0 });
        }
        assert!(acting.given.len() <= acting.given.capacity() && acting.given.capacity() < 600);
        acting.clear();
        assert_eq!(acting.during(2.5, 2.6), None);
    }
}
