//! What a server's messages mean for the one device that is listened to. No sockets: bytes in, [`DeviceState`] out.
//!
//! In: messages of a TCP stream and of datagrams, in the order of their arrival. Out: the device's newest state, and
//! what is to be done about the connection. Nothing grows with what a peer sends.

use super::codec::{self, Message};
use super::payload::{Kind, Payload};
use crate::track::device::{DeviceState, now_s};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// So many of a server's devices are remembered, to name them where the one that was asked for is missing.
const MOST_OTHERS: usize = 16;

/// The numbers that a peer gives to the message types.
#[derive(Clone, Debug, Default)]
pub struct PeerKinds([Option<i32>; Kind::ALL.len()]);

/// One device's ear.
#[derive(Clone, Debug)]
pub struct Listener {
    pub device: String,
    pub state: DeviceState,
    /// When the device was last heard, s of [`now_s`].
    pub heard_s: f64,
    /// What a force device says that it pushes with, N, in its own frame.
    pub force: Option<[f64; 3]>,
    sender: Option<i32>,
    kinds: PeerKinds,
    others: Vec<String>,
}

impl PeerKinds {
    /// Takes a type's description; a number that meant another type means it no more.
    pub fn describe(&mut self, id: i32, name: &str) {
        for slot in &mut self.0 {
            *slot = slot.filter(|known| *known != id);
        }
        if let Some(kind) = Kind::named(name) {
            self.0[kind as usize] = Some(id);
        }
    }

    /// The type that the peer means; `None`: one that is of no use here, or was never described.
    pub fn kind(&self, id: i32) -> Option<Kind> {
        Kind::ALL.into_iter().find(|kind| self.0[*kind as usize] == Some(id))
    }
}

impl Listener {
    pub fn new(device: &str) -> Listener {
        Listener {
            device: device.to_owned(),
            state: DeviceState::default(),
            heard_s: now_s(),
            force: None,
            sender: None,
            kinds: PeerKinds::default(),
            others: Vec::new(),
        }
    }

    /// A new connection: what the last one's numbers meant is forgotten, what the device said is kept.
    pub fn connected(&mut self) {
        self.sender = None;
        self.kinds = PeerKinds::default();
        self.others.clear();
        self.heard_s = now_s();
    }

    /// Takes a message of the TCP stream; false: the server says good-bye.
    pub fn take(&mut self, message: &Message) -> bool {
        match message.header.kind {
            codec::SENDER_DESCRIPTION | codec::TYPE_DESCRIPTION => self.describe(message),
            codec::DISCONNECT => return false,
            kind if kind < 0 => {}
            _ => self.take_reading(message),
        }
        true
    }

    /// Takes a datagram, in which only readings may stand.
    pub fn take_datagram(&mut self, bytes: &[u8]) {
        self.state.counters.packets += 1;
        for message in codec::datagram(bytes) {
            match message {
                Ok(message) if message.header.kind >= 0 => self.take_reading(&message),
                Ok(_) => self.state.counters.dropped += 1,
                Err(_) => self.state.counters.malformed += 1,
            }
        }
    }

    /// Whether the server has said that it has the device.
    pub fn is_known(&self) -> bool {
        self.sender.is_some()
    }

    /// Why nothing is heard, as far as the server's descriptions tell.
    pub fn why_silent(&self) -> String {
        match self.sender {
            Some(_) => "says nothing".to_owned(),
            None if self.others.is_empty() => format!("has no device {}", self.device),
            None => format!("has no device {}, but {}", self.device, self.others.join(", ")),
        }
    }

    fn describe(&mut self, message: &Message) {
        let id = message.header.sender;
        let Ok(name) = codec::decode_name(message.payload) else {
            self.state.counters.malformed += 1;
            return;
        };
        if message.header.kind == codec::TYPE_DESCRIPTION {
            self.kinds.describe(id, name);
        } else if name == self.device {
            self.sender = Some(id);
        } else {
            self.sender = self.sender.filter(|known| *known != id);
            if self.others.len() < MOST_OTHERS {
                self.others.push(name.to_owned());
            }
        }
    }

    fn take_reading(&mut self, message: &Message) {
        if self.sender != Some(message.header.sender) {
            return;
        }
        self.heard_s = now_s();
        let Some(kind) = self.kinds.kind(message.header.kind) else { return };
        self.state.counters.messages += 1;
        let measured_s = Some(message.header.time_s());
        match Payload::decode(kind, message.payload) {
            Ok(Payload::Pose { sensor, position, quaternion }) => match pose(position, quaternion) {
                Some(pose) => self.state.take_pose(sensor, pose, measured_s, 1.0),
                None => self.state.counters.malformed += 1,
            },
            Ok(Payload::ButtonChange { button, state }) => {
                self.state.take_button(button, state != 0, measured_s);
            }
            Ok(Payload::ButtonStates(states)) => {
                for (button, state) in states.iter().enumerate() {
                    self.state.take_button(button as i32, *state != 0, measured_s);
                }
            }
            Ok(Payload::Analog(values)) => {
                for (channel, value) in values.iter().enumerate() {
                    self.state.take_valuator(channel as i32, *value, measured_s);
                }
            }
            Ok(Payload::Force(force)) if force.iter().all(|f| f.is_finite()) => self.force = Some(force),
            Ok(_) => {}
            Err(_) => self.state.counters.malformed += 1,
        }
    }
}

/// The pose, its rotation normalised; `None` if a number is not finite or the quaternion's length off by over 1 %.
fn pose(position: [f64; 3], [x, y, z, w]: [f64; 4]) -> Option<Isometry3<f64>> {
    let quaternion = Quaternion::new(w, x, y, z);
    let is_rotation = (quaternion.norm() - 1.0).abs() <= 0.01;
    (is_rotation && position.iter().all(|x| x.is_finite())).then(|| {
        Isometry3::from_parts(Translation3::from(position), UnitQuaternion::new_normalize(quaternion))
    })
}
