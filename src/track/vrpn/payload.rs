//! Payloads of the messages of VRPN's devices: tracker, button, analog, force device, and the ping of all of them.
//!
//! All numbers are big-endian; metres, newtons, quaternions x, y, z, w.
//!
//! | type | payload | verified |
//! |---|---|---|
//! | `vrpn_Tracker Pos_Quat` | i32 sensor, i32 without meaning, 3 × f64, 4 × f64 | recorded bytes |
//! | `vrpn_Tracker Velocity`, `… Acceleration` | as above, then f64 dt | recorded bytes |
//! | `vrpn_Button Change` | i32 button, i32 state | recorded bytes |
//! | `vrpn_Button States` | i32 n, n × i32 | recorded bytes |
//! | `vrpn_Analog Channel` | f64 n, n × f64 | the protocol's description |
//! | `vrpn_Base ping_message`, `… pong_message` | none | the protocol's description |
//! | `vrpn_ForceDevice Force` | 3 × f64: the push of the device | the protocol's description |
//! | `vrpn_ForceDevice SCP` | 3 × f64, 4 × f64: the point of contact on a surface | the protocol's description |
//! | `vrpn_ForceDevice Force_Error` | i32 | the protocol's description |
//! | `vrpn_ForceDevice Force_Field` | 3 × f32 origin, 3 × f32 force, 9 × f32 Jacobian row by row, f32 radius | the protocol's description |

use super::codec::CodecFault;
use crate::track::device::MOST_CHANNELS;

/// The message types that are used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MessageKind {
    PosQuat,
    Velocity,
    Acceleration,
    ButtonChange,
    ButtonStates,
    AnalogChannel,
    Ping,
    Pong,
    Force,
    ContactPoint,
    ForceError,
    ForceField,
}

impl MessageKind {
    /// All types in the order of the enum, with their names on the wire.
    pub const ALL: [(MessageKind, &str); 12] = [
        (MessageKind::PosQuat, "vrpn_Tracker Pos_Quat"),
        (MessageKind::Velocity, "vrpn_Tracker Velocity"),
        (MessageKind::Acceleration, "vrpn_Tracker Acceleration"),
        (MessageKind::ButtonChange, "vrpn_Button Change"),
        (MessageKind::ButtonStates, "vrpn_Button States"),
        (MessageKind::AnalogChannel, "vrpn_Analog Channel"),
        (MessageKind::Ping, "vrpn_Base ping_message"),
        (MessageKind::Pong, "vrpn_Base pong_message"),
        (MessageKind::Force, "vrpn_ForceDevice Force"),
        (MessageKind::ContactPoint, "vrpn_ForceDevice SCP"),
        (MessageKind::ForceError, "vrpn_ForceDevice Force_Error"),
        (MessageKind::ForceField, "vrpn_ForceDevice Force_Field"),
    ];

    pub fn name(self) -> &'static str {
        MessageKind::ALL[self as usize].1
    }

    pub fn named(name: &str) -> Option<MessageKind> {
        MessageKind::ALL.into_iter().find(|(_, known)| *known == name).map(|(kind, _)| kind)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub enum Payload {
    Pose { sensor: i32, position: [f64; 3], quaternion: [f64; 4] },
    Velocity(Rate),
    Acceleration(Rate),
    ButtonChange { button: i32, state: i32 },
    ButtonStates(Vec<i32>),
    Analog(Vec<f64>),
    Ping,
    Pong,
    Force([f64; 3]),
    ContactPoint { position: [f64; 3], quaternion: [f64; 4] },
    ForceError(i32),
    ForceField(ForceField),
}

/// A velocity or an acceleration of a sensor: m/s or m/s², and the rotation within `dt` seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    pub sensor: i32,
    pub vector: [f64; 3],
    pub quaternion: [f64; 4],
    pub dt: f64,
}

/// The force, N, that a device applies at x: `force + jacobian · (x - origin)` within `radius` of the
/// origin, nothing beyond; x, origin and radius in metres of the device's own frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceField {
    pub origin: [f32; 3],
    pub force: [f32; 3],
    /// N/m, `jacobian[i][j]` = ∂force_i/∂x_j.
    pub jacobian: [[f32; 3]; 3],
    pub radius: f32,
}

impl Payload {
    pub fn kind(&self) -> MessageKind {
        match self {
            Payload::Pose { .. } => MessageKind::PosQuat,
            Payload::Velocity(_) => MessageKind::Velocity,
            Payload::Acceleration(_) => MessageKind::Acceleration,
            Payload::ButtonChange { .. } => MessageKind::ButtonChange,
            Payload::ButtonStates(_) => MessageKind::ButtonStates,
            Payload::Analog(_) => MessageKind::AnalogChannel,
            Payload::Ping => MessageKind::Ping,
            Payload::Pong => MessageKind::Pong,
            Payload::Force(_) => MessageKind::Force,
            Payload::ContactPoint { .. } => MessageKind::ContactPoint,
            Payload::ForceError(_) => MessageKind::ForceError,
            Payload::ForceField(_) => MessageKind::ForceField,
        }
    }

    /// The bytes, without padding.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Writer(Vec::with_capacity(72));
        match self {
            Payload::Pose { sensor, position, quaternion } => {
                bytes.i32s(&[*sensor, 0]).f64s(position).f64s(quaternion)
            }
            Payload::Velocity(rate) | Payload::Acceleration(rate) => {
                bytes.i32s(&[rate.sensor, 0]).f64s(&rate.vector).f64s(&rate.quaternion).f64s(&[rate.dt])
            }
            Payload::ButtonChange { button, state } => bytes.i32s(&[*button, *state]),
            Payload::ButtonStates(states) => bytes.i32s(&[states.len() as i32]).i32s(states),
            Payload::Analog(values) => bytes.f64s(&[values.len() as f64]).f64s(values),
            Payload::Ping | Payload::Pong => &mut bytes,
            Payload::Force(force) => bytes.f64s(force),
            Payload::ContactPoint { position, quaternion } => bytes.f64s(position).f64s(quaternion),
            Payload::ForceError(code) => bytes.i32s(&[*code]),
            Payload::ForceField(ForceField { origin, force, jacobian, radius }) => {
                bytes.f32s(origin).f32s(force).f32s(jacobian.as_flattened()).f32s(&[*radius])
            }
        };
        bytes.0
    }

    /// Reads the payload of a message of this type; it must have exactly the type's length.
    pub fn decode(kind: MessageKind, payload: &[u8]) -> Result<Payload, CodecFault> {
        let mut reader = Reader(payload);
        match reader.payload(kind) {
            Some(read) if reader.0.is_empty() => Ok(read),
            _ => Err(CodecFault::Payload(kind.name(), payload.len())),
        }
    }
}

struct Writer(Vec<u8>);

impl Writer {
    fn i32s(&mut self, numbers: &[i32]) -> &mut Writer {
        numbers.iter().for_each(|number| self.0.extend(number.to_be_bytes()));
        self
    }

    fn f32s(&mut self, numbers: &[f32]) -> &mut Writer {
        numbers.iter().for_each(|number| self.0.extend(number.to_be_bytes()));
        self
    }

    fn f64s(&mut self, numbers: &[f64]) -> &mut Writer {
        numbers.iter().for_each(|number| self.0.extend(number.to_be_bytes()));
        self
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn payload(&mut self, kind: MessageKind) -> Option<Payload> {
        Some(match kind {
            MessageKind::PosQuat => {
                let [sensor, _] = self.i32s()?;
                Payload::Pose { sensor, position: self.f64s()?, quaternion: self.f64s()? }
            }
            MessageKind::Velocity => Payload::Velocity(self.rate()?),
            MessageKind::Acceleration => Payload::Acceleration(self.rate()?),
            MessageKind::ButtonChange => {
                let [button, state] = self.i32s()?;
                Payload::ButtonChange { button, state }
            }
            MessageKind::ButtonStates => {
                let [count] = self.i32s()?;
                let there = self.0.len() / 4;
                if there > MOST_CHANNELS || usize::try_from(count) != Ok(there) {
                    return None;
                }
                Payload::ButtonStates((0..there).map_while(|_| self.i32s()).map(|[state]| state).collect())
            }
            MessageKind::AnalogChannel => {
                let [count] = self.f64s()?;
                let there = self.0.len() / 8;
                if there > MOST_CHANNELS || count != there as f64 {
                    return None;
                }
                Payload::Analog((0..there).map_while(|_| self.f64s()).map(|[value]| value).collect())
            }
            MessageKind::Ping => Payload::Ping,
            MessageKind::Pong => Payload::Pong,
            MessageKind::Force => Payload::Force(self.f64s()?),
            MessageKind::ContactPoint => {
                Payload::ContactPoint { position: self.f64s()?, quaternion: self.f64s()? }
            }
            MessageKind::ForceError => {
                let [code] = self.i32s()?;
                Payload::ForceError(code)
            }
            MessageKind::ForceField => {
                let (origin, force) = (self.f32s()?, self.f32s()?);
                let jacobian = [self.f32s()?, self.f32s()?, self.f32s()?];
                let [radius] = self.f32s()?;
                Payload::ForceField(ForceField { origin, force, jacobian, radius })
            }
        })
    }

    fn rate(&mut self) -> Option<Rate> {
        let [sensor, _] = self.i32s()?;
        let (vector, quaternion) = (self.f64s()?, self.f64s()?);
        let [dt] = self.f64s()?;
        Some(Rate { sensor, vector, quaternion, dt })
    }

    fn bytes<const WIDTH: usize, const N: usize>(&mut self) -> Option<[[u8; WIDTH]; N]> {
        let (numbers, rest) = self.0.split_at_checked(WIDTH * N)?;
        self.0 = rest;
        let (numbers, _) = numbers.as_chunks();
        <[[u8; WIDTH]; N]>::try_from(numbers).ok()
    }

    fn i32s<const N: usize>(&mut self) -> Option<[i32; N]> {
        self.bytes().map(|numbers| numbers.map(i32::from_be_bytes))
    }

    fn f32s<const N: usize>(&mut self) -> Option<[f32; N]> {
        self.bytes().map(|numbers| numbers.map(f32::from_be_bytes))
    }

    fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        self.bytes().map(|numbers| numbers.map(f64::from_be_bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A list whose count is not that of its numbers is damaged, and so is one that is longer than any device's.
    #[test]
    fn lists_have_as_many_numbers_as_they_count() {
        let analog = |count: f64, there: usize| {
            let mut bytes = Writer(Vec::new());
            bytes.f64s(&[count]).f64s(&vec![0.5; there]);
            Payload::decode(MessageKind::AnalogChannel, &bytes.0).ok()
        };
        assert_eq!(analog(3.0, 3), Some(Payload::Analog(vec![0.5; 3])));
        assert_eq!(analog(0.0, 0), Some(Payload::Analog(Vec::new())));
        for (count, there) in [(2.0, 3), (4.0, 3), (-3.0, 3), (2.5, 2), (f64::NAN, 3), (1e300, 3)] {
            assert_eq!(analog(count, there), None, "{count} of {there}");
        }
        assert!(analog(MOST_CHANNELS as f64, MOST_CHANNELS).is_some());
        assert_eq!(analog(MOST_CHANNELS as f64 + 1.0, MOST_CHANNELS + 1), None);
        let buttons = |count: i32, there: usize| {
            let mut bytes = Writer(Vec::new());
            bytes.i32s(&[count]).i32s(&vec![1; there]);
            Payload::decode(MessageKind::ButtonStates, &bytes.0).ok()
        };
        assert_eq!(buttons(2, 2), Some(Payload::ButtonStates(vec![1; 2])));
        for (count, there) in [(1, 2), (3, 2), (-2, 2)] {
            assert_eq!(buttons(count, there), None, "{count} of {there}");
        }
    }
}
