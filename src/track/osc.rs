//! OSC trackers: `/tracking/trackers/{1…8|head}/{position|rotation}` with three floats each, by UDP, usually to port 9000.
//!
//! In: positions in metres, and rotations as three angles in degrees about x, y and z, applied in the order of the stage
//! file's key `euler`. Out: sensors 1 to 8, and 0 for `head`. Senders from Unity are left-handed: `mirror = "z"`.

use super::device::DeviceState;
use super::listen::Listen;
use super::source_entry::{SourceEntry, SourceSettings, keys};
use super::udp::{Parser, settings};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rosc::{OscMessage, OscPacket, OscType};
use std::net::Ipv4Addr;

/// Longer datagrams are refused, bytes; what these trackers send is far shorter.
const LARGEST: usize = 4 << 10;
/// The deepest nesting of bundles and arrays, into which the decoder recurses.
const DEEPEST: usize = 32;
const SENSORS: usize = 9;

pub const SOURCE: SourceEntry = SourceEntry {
    key: "osc",
    more_keys: &["interface", "euler"],
    sensors: Some(0..=SENSORS as i32 - 1),
    has_buttons: false,
    read,
};

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    osc: String,
    interface: Option<Ipv4Addr>,
    #[serde(default)]
    euler: EulerOrder,
}

fn read(tracker: &str, table: &toml::Table) -> Result<SourceSettings, String> {
    let Keys { osc, interface, euler } = keys(tracker, table)?;
    let place = Listen::parse(tracker, "osc", &osc, interface)?;
    Ok(settings("osc", place, Osc::new(euler)))
}

/// The order of three turns about the tracker's axes: `yxz` is R = Ry Rx Rz. Whatever the order, the message has the
/// angle about x first, then y, then z.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EulerOrder {
    Xyz,
    Xzy,
    #[default]
    Yxz,
    Yzx,
    Zxy,
    Zyx,
}

/// The state between messages.
#[derive(Clone, Copy, Debug)]
pub struct Osc {
    order: EulerOrder,
    halves: [Halves; SENSORS],
}

/// Position and orientation come in separate messages.
#[derive(Clone, Copy, Debug, Default)]
struct Halves {
    place: Half<Vector3<f64>>,
    rotation: Half<UnitQuaternion<f64>>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Half<T> {
    last: Option<T>,
    is_new: bool,
}

impl Osc {
    pub fn new(order: EulerOrder) -> Osc {
        Osc { order, halves: [Halves::default(); SENSORS] }
    }

    fn packet(&mut self, packet: &OscPacket, state: &mut DeviceState) {
        match packet {
            OscPacket::Message(message) => {
                state.counters.messages += 1;
                let known = sensor_and_half(&message.addr).zip(three(message));
                match known {
                    Some(((sensor, half), numbers)) => self.take(sensor, half, numbers, state),
                    None => state.counters.dropped += 1,
                }
            }
            OscPacket::Bundle(bundle) => bundle.content.iter().for_each(|inner| self.packet(inner, state)),
        }
    }

    /// A pose is complete when both halves are new; from senders of one half alone, with each message.
    fn take(&mut self, sensor: usize, half: &str, numbers: Vector3<f64>, state: &mut DeviceState) {
        let halves = &mut self.halves[sensor];
        let is_place = half == "position";
        if if is_place { halves.place.is_new } else { halves.rotation.is_new } {
            halves.finish(sensor, state);
        }
        let is_alone = halves.place.last.is_none() || halves.rotation.last.is_none();
        if is_place {
            halves.place = Half { last: Some(numbers), is_new: true };
        } else {
            halves.rotation = Half { last: Some(rotation(self.order, numbers)), is_new: true };
        }
        if is_alone || halves.place.is_new && halves.rotation.is_new {
            halves.finish(sensor, state);
        }
    }
}

impl Halves {
    fn finish(&mut self, sensor: usize, state: &mut DeviceState) {
        let place = self.place.last.unwrap_or_default();
        let rotation = self.rotation.last.unwrap_or_default();
        (self.place.is_new, self.rotation.is_new) = (false, false);
        let pose = Isometry3::from_parts(Translation3::from(place), rotation);
        state.take_pose(sensor as i32, pose, None, 1.0);
    }
}

impl Parser for Osc {
    fn parse(&mut self, datagram: &[u8], state: &mut DeviceState) -> bool {
        let deep =
            |part: &[u8]| datagram.windows(part.len()).filter(|window| *window == part).count() > DEEPEST;
        if datagram.len() > LARGEST || deep(b"#bundle") || deep(b"[") {
            return false;
        }
        match rosc::decoder::decode_udp(datagram) {
            Ok((_, packet)) => {
                self.packet(&packet, state);
                true
            }
            Err(_) => false,
        }
    }
}

/// The sensor's number, and `position` or `rotation`.
fn sensor_and_half(address: &str) -> Option<(usize, &str)> {
    let (name, half) = address.strip_prefix("/tracking/trackers/")?.split_once('/')?;
    let sensor = match name {
        "head" => 0,
        _ => name.parse().ok().filter(|number| (1..SENSORS).contains(number))?,
    };
    matches!(half, "position" | "rotation").then_some((sensor, half))
}

fn three(message: &OscMessage) -> Option<Vector3<f64>> {
    let number = |argument: &OscType| match argument {
        OscType::Float(value) => Some(f64::from(*value)),
        OscType::Double(value) => Some(*value),
        OscType::Int(value) => Some(f64::from(*value)),
        _ => None,
    };
    let [x, y, z] = &message.args[..] else { return None };
    let numbers = Vector3::new(number(x)?, number(y)?, number(z)?);
    numbers.iter().all(|value| value.is_finite()).then_some(numbers)
}

/// The rotation of three angles in degrees about x, y, z: `yxz` is R = Ry Rx Rz.
fn rotation(order: EulerOrder, degrees: Vector3<f64>) -> UnitQuaternion<f64> {
    let about = |axis: usize| {
        let mut vector = Vector3::zeros();
        vector[axis] = degrees[axis].to_radians();
        UnitQuaternion::from_scaled_axis(vector)
    };
    let [first, second, third] = match order {
        EulerOrder::Xyz => [0, 1, 2],
        EulerOrder::Xzy => [0, 2, 1],
        EulerOrder::Yxz => [1, 0, 2],
        EulerOrder::Yzx => [1, 2, 0],
        EulerOrder::Zxy => [2, 0, 1],
        EulerOrder::Zyx => [2, 1, 0],
    };
    about(first) * about(second) * about(third)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The places along x at which sensor 3 was seen, one after each message; of `p` places at 1, 2, … m and `r` rotations.
    fn seen(messages: &str) -> Vec<Option<f64>> {
        let (mut osc, mut state) = (Osc::new(EulerOrder::default()), DeviceState::default());
        let mut step = 0.0;
        let send = |half: char| {
            step += 1.0;
            let name = if half == 'p' { "position" } else { "rotation" };
            let before = state.sensors.get(&3).map_or(0, |reading| reading.count);
            osc.take(3, name, Vector3::new(step, 0.0, 0.0), &mut state);
            let reading = state.sensors.get(&3).filter(|reading| reading.count > before);
            reading.map(|reading| reading.value.translation.x)
        };
        messages.chars().map(send).collect()
    }

    #[test]
    fn a_pose_is_complete_with_its_second_half() {
        assert_eq!(seen("pppp"), [1.0, 2.0, 3.0, 4.0].map(Some), "a sender of places alone");
        assert_eq!(seen("rr"), [Some(0.0); 2], "a sender of rotations alone");
        // Until both are known each is sent on alone; from then on one pose for a pair, in either order.
        assert_eq!(seen("prprpr"), [Some(1.0), Some(1.0), None, Some(3.0), None, Some(5.0)]);
        assert_eq!(seen("rprprp"), [Some(0.0), Some(2.0), None, Some(4.0), None, Some(6.0)]);
    }

    /// A half that comes again before the other one, as when a packet was lost, is not held back.
    #[test]
    fn a_half_is_sent_on_when_it_comes_again() {
        assert_eq!(seen("prppr"), [Some(1.0), Some(1.0), None, Some(3.0), Some(4.0)]);
    }
}
