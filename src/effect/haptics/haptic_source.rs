//! A force-feedback device as a source of poses: its measurements reach its stylus like those of any tracker.
//!
//! In: a device, or the loop that drives it. Out: a [`DeviceState`] with sensor 0 and the buttons 0 and 1.

use super::device::{Device, Reading, SampleInfo};
use crate::track::device::{DeviceState, Link, Reading as Sample, Source, now_s};
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

#[cfg(test)]
mod tests {
    use super::super::device::Push;
    use super::*;
    use nalgebra::Isometry3;
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
}
