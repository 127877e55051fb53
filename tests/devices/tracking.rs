//! Trackers: what each protocol's bytes mean, what damaged ones cost, and the whole way from a packet to a table.

mod command;
mod devices;
mod dtrack;
mod keys;
mod osc;

use greenstage::track::device::{DeviceState, Source, now_s};
use nalgebra::Isometry3;

/// Asks again and again until `is` is true of the source's state, which it returns; fails after 60 s.
fn wait(source: &mut dyn Source, what: &str, mut is: impl FnMut(&DeviceState) -> bool) -> DeviceState {
    let deadline_s = now_s() + 60.0;
    while now_s() < deadline_s {
        let state = source.latest();
        if is(state) {
            return state.clone();
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    panic!("no {what} within 60 s: {:?}", source.latest());
}

fn near(pose: &Isometry3<f64>, expected: &Isometry3<f64>, tolerance: f64) -> bool {
    (pose.translation.vector - expected.translation.vector).norm() < tolerance
        && pose.rotation.angle_to(&expected.rotation) < tolerance
}

/// The numbers of the buttons that are pressed.
pub fn pressed(state: &DeviceState) -> Vec<i32> {
    state.buttons.iter().filter(|(_, button)| button.value).map(|(number, _)| *number).collect()
}

/// The port of `dtrack on 127.0.0.1:40000`.
fn port(source: &dyn Source) -> u16 {
    source.describe().rsplit_once(':').unwrap().1.parse().unwrap()
}

fn everything_is_finite(state: &DeviceState) -> bool {
    state.sensors.values().all(|reading| {
        let pose = reading.value;
        let is_unit = (pose.rotation.coords.norm() - 1.0).abs() < 1e-6;
        is_unit && pose.translation.vector.iter().all(|x| x.is_finite())
    }) && state.valuators.values().all(|reading| reading.value.is_finite())
}
