//! A VRPN force device: sensor 0 and two buttons in, a force field out.
//!
//! VRPN has no torque. The force is sent as a constant field around the device's last position, so that a server that
//! evaluates the field itself applies just that force until the next one comes. Beyond the field's radius it ends, when the
//! device has moved far from its last known position. The bytes are those of `track::vrpn`, tested only with our own server.

use super::device::{Device, Push, Reading, SampleInfo};
use crate::track::device::{DeviceState, Link, Source};
use crate::track::vrpn::{Address, Client, ForceField, ForceSender, Timing, Transport};
use nalgebra::Isometry3;

/// The field's radius: a device that moves further than this before a new force comes stops pushing, m.
const RADIUS_M: f32 = 0.1;
/// The time between two pings of the server, s.
const ECHO_S: f64 = 0.1;
/// The assumed travel time of messages, besides the server's own cycle, until the first ping was answered, s.
const UNHEARD_S: f64 = 1e-3;

pub struct VrpnDevice {
    /// Dropped before the client, whose connection it needs to take the force back.
    sender: ForceSender,
    client: Client,
    last: Option<Isometry3<f64>>,
    resting: bool,
    latency_s: f64,
}

impl VrpnDevice {
    /// `Phantom0@host`, or as VRPN names devices otherwise.
    pub fn open(name: &str) -> Result<VrpnDevice, String> {
        let address = Address::parse(name).map_err(|error| error.to_string())?;
        let timing = Timing { ping_s: ECHO_S, ..Timing::default() };
        let client = Client::with_timing(address, Transport::Tcp, timing);
        let (sender, latency_s) = (client.force_sender(), UNHEARD_S);
        Ok(VrpnDevice { sender, client, last: None, resting: true, latency_s })
    }
}

/// Sensor 0 and buttons 0 and 1 of a client's state; `None` without a connection, or before the first pose.
fn reading(state: &DeviceState) -> Option<Reading> {
    if state.link != Link::Up {
        return None;
    }
    let pose = state.sensors.get(&0)?;
    let pressed = |button: i32| state.buttons.get(&button).is_some_and(|button| button.value);
    Some(Reading {
        device_from_handle: pose.value,
        buttons: [pressed(0), pressed(1)],
        arrived_s: pose.arrived_s,
        measured_s: pose.measured_s,
        tracked: pose.quality > 0.0,
        info: SampleInfo { count: pose.count, flow: pose.flow, before: pose.before },
    })
}

impl Device for VrpnDevice {
    fn describe(&self) -> String {
        self.client.describe()
    }

    fn read(&mut self, _now_s: f64) -> Option<Reading> {
        let state = self.client.latest();
        let reading = reading(state);
        let turn_s = reading.map_or(0.0, |reading| reading.info.flow.interval_s);
        self.latency_s = state.round_trip_s.unwrap_or(UNHEARD_S + turn_s);
        self.last = reading.map(|reading| reading.device_from_handle);
        reading
    }

    fn push(&mut self, push: &Push, _now_s: f64) {
        let is_none = *push == Push::NONE;
        // No force is sent once, not repeatedly.
        if is_none && self.resting {
            return;
        }
        let origin = self.last.map_or([0.0; 3], |pose| pose.translation.vector.cast::<f32>().into());
        let field = ForceField {
            origin,
            force: push.force.cast::<f32>().into(),
            radius: if is_none { 0.0 } else { RADIUS_M },
            ..ForceField::default()
        };
        self.resting = self.sender.set(field) && is_none;
    }

    fn malformed(&mut self) -> u64 {
        self.client.latest().counters.malformed
    }

    /// A ping and its pong take as long as a force and the pose that follows it, including the wait for the server's cycle.
    fn latency_s(&self) -> f64 {
        self.latency_s
    }
}
