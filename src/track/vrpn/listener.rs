//! Turns a server's messages into the state of one device. No sockets: bytes in, [`DeviceState`] out.
//!
//! In: messages of a TCP stream and of datagrams, in the order of their arrival. Out: the device's newest state, and whether
//! the connection is to be kept. Memory does not grow with what a peer sends.

use super::codec::{self, Message};
use super::payload::{MessageKind, Payload};
use crate::base::peak::Peak;
use crate::track::device::{DeviceState, Stamp, now_s};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// The most other devices of a server that are remembered, to list them if the requested one is missing.
const MOST_OTHERS: usize = 16;

/// The numbers that a peer gives to the message types.
#[derive(Clone, Debug, Default)]
pub struct PeerKinds([Option<i32>; MessageKind::ALL.len()]);

/// A pose by UDP was overtaken if its stamp is older than its sensor's last one by less than this and that one came just
/// now; otherwise the server's clock was set, s.
const OVERTAKEN_S: f64 = 1.0;
const JUST_NOW_S: f64 = 0.1;

/// A ping that was not answered within this time never will be, s.
const UNANSWERED_S: f64 = 0.9;

/// The receiving side of one device.
#[derive(Clone, Debug)]
pub struct Listener {
    pub device: String,
    pub state: DeviceState,
    /// Time at which the device last sent something, s of [`now_s`].
    pub heard_s: f64,
    /// The force that a force device reports, N, in its own frame.
    pub force: Option<[f64; 3]>,
    sender: Option<i32>,
    /// Whether the device itself has sent something on this connection.
    is_there: bool,
    kinds: PeerKinds,
    others: Vec<String>,
    /// Time at which the ping was sent that still awaits its pong, s.
    pinged_s: Option<f64>,
    round_trip: Peak,
}

impl PeerKinds {
    /// Takes a type's description, which replaces any earlier meaning of its number.
    pub fn describe(&mut self, id: i32, name: &str) {
        for slot in &mut self.0 {
            *slot = slot.filter(|known| *known != id);
        }
        if let Some(kind) = MessageKind::named(name) {
            self.0[kind as usize] = Some(id);
        }
    }

    /// The type that the peer means; `None` if it is of no use here or was never described.
    pub fn kind(&self, id: i32) -> Option<MessageKind> {
        let (kind, _) = MessageKind::ALL.into_iter().find(|(kind, _)| self.0[*kind as usize] == Some(id))?;
        Some(kind)
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
            is_there: false,
            kinds: PeerKinds::default(),
            others: Vec::new(),
            pinged_s: None,
            round_trip: Peak::default(),
        }
    }

    /// Notes a ping at `now_s`; false if an earlier one still awaits its answer.
    pub fn pings(&mut self, now_s: f64) -> bool {
        let is_free = self.pinged_s.is_none_or(|pinged_s| now_s - pinged_s > UNANSWERED_S);
        if is_free {
            self.pinged_s = Some(now_s);
        }
        is_free
    }

    /// Starts a new connection: forgets what the previous one's numbers meant, keeps the device's readings.
    pub fn connected(&mut self) {
        (self.sender, self.is_there) = (None, false);
        self.kinds = PeerKinds::default();
        self.others.clear();
        self.heard_s = now_s();
        self.pinged_s = None;
    }

    /// Releases all buttons, because the connection is gone.
    pub fn release(&mut self) {
        self.state.buttons.values_mut().for_each(|button| button.value = false);
    }

    /// Takes a message of the TCP stream; false if the server ends the connection.
    pub fn take(&mut self, message: &Message) -> bool {
        self.take_at(message, now_s())
    }

    fn take_at(&mut self, message: &Message, now_s: f64) -> bool {
        match message.header.kind {
            codec::SENDER_DESCRIPTION | codec::TYPE_DESCRIPTION => self.describe(message),
            codec::DISCONNECT => return false,
            kind if kind < 0 => {}
            _ => self.take_reading(message, false, now_s),
        }
        true
    }

    /// Takes a datagram, which may contain only readings.
    pub fn take_datagram(&mut self, bytes: &[u8]) {
        self.take_datagram_at(bytes, now_s());
    }

    fn take_datagram_at(&mut self, bytes: &[u8], now_s: f64) {
        self.state.counters.packets += 1;
        for message in codec::datagram(bytes) {
            match message {
                Ok(message) if message.header.kind >= 0 => self.take_reading(&message, true, now_s),
                Ok(_) => self.state.counters.dropped += 1,
                Err(_) => self.state.counters.malformed += 1,
            }
        }
    }

    /// Whether the device has sent anything on this connection, if only an answer to a ping. That the server names it proves
    /// nothing: VRPN's own server names whatever a client has asked for.
    pub fn is_there(&self) -> bool {
        self.is_there && self.sender.is_some()
    }

    /// The reason to give if a device has answered no ping for `silent_s`.
    pub fn why_missing(&self, silent_s: f64) -> String {
        let Listener { device, others, .. } = self;
        let named = if others.is_empty() {
            "it names no other".to_owned()
        } else {
            format!("it names {}", others.join(", "))
        };
        format!(
            "the server is up, but has no device {device}: no answer from it in {silent_s:.0} s ({named}; its vrpn.cfg says \
             which it has)"
        )
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
            // VRPN's name for the connection itself.
            let is_device = name != "VRPN Control" && !self.others.iter().any(|other| other == name);
            if is_device && self.others.len() < MOST_OTHERS {
                self.others.push(name.to_owned());
            }
        }
    }

    fn take_reading(&mut self, message: &Message, by_udp: bool, now_s: f64) {
        if self.sender != Some(message.header.sender) {
            return;
        }
        (self.heard_s, self.is_there) = (now_s, true);
        let Some(kind) = self.kinds.kind(message.header.kind) else { return };
        self.state.counters.messages += 1;
        let measured_s = Some(message.header.time_s());
        match Payload::decode(kind, message.payload) {
            Ok(Payload::Pose { sensor, .. })
                if by_udp && self.is_overtaken(sensor, message.header.time_s(), now_s) =>
            {
                self.state.counters.dropped += 1;
            }
            Ok(Payload::Pose { sensor, position, quaternion }) => match pose(position, quaternion) {
                Some(pose) => {
                    self.state.take_pose_at(Stamp { arrived_s: now_s, measured_s }, sensor, pose, 1.0)
                }
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
            Ok(Payload::Pong) => {
                if let Some(pinged_s) = self.pinged_s.take() {
                    self.round_trip.take(self.heard_s - pinged_s, self.heard_s);
                    self.state.round_trip_s = Some(self.round_trip.value);
                }
            }
            Ok(Payload::Force(force)) if force.iter().all(|f| f.is_finite()) => self.force = Some(force),
            Ok(_) => {}
            Err(_) => self.state.counters.malformed += 1,
        }
    }

    fn is_overtaken(&self, sensor: i32, measured_s: f64, now_s: f64) -> bool {
        self.state.sensors.get(&sensor).is_some_and(|last| {
            let older_s = last.measured_s.map_or(0.0, |last_s| last_s - measured_s);
            older_s > 0.0 && older_s < OVERTAKEN_S && now_s - last.arrived_s < JUST_NOW_S
        })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::vrpn::codec::{Header, encode};

    fn described(id: i32, system: i32, name: &str) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode(&Header::now(id, system), &codec::encode_name(name), &mut bytes);
        bytes
    }

    fn listener() -> Listener {
        let mut listener = Listener::new("Wand");
        let mut bytes = described(0, codec::SENDER_DESCRIPTION, "Wand");
        bytes.extend(described(0, codec::TYPE_DESCRIPTION, MessageKind::PosQuat.name()));
        codec::datagram(&bytes).for_each(|message| assert!(listener.take(&message.unwrap())));
        listener
    }

    fn pose_at(time_s: f64, x: f64) -> Vec<u8> {
        let pose = Payload::Pose { sensor: 0, position: [x, 0.0, 0.0], quaternion: [0.0, 0.0, 0.0, 1.0] };
        let mut bytes = Vec::new();
        encode(&Header::now(0, 0).at(time_s), &pose.encode(), &mut bytes);
        bytes
    }

    #[test]
    fn a_pose_that_was_overtaken_on_its_way_is_not_shown() {
        let mut listener = listener();
        let mut x_after = |now_s: f64, time_s: f64, x: f64| {
            listener.take_datagram_at(&pose_at(time_s, x), now_s);
            (listener.state.sensors[&0].value.translation.x, listener.state.counters.dropped)
        };
        assert_eq!(x_after(7.0, 1000.0, 1.0), (1.0, 0));
        assert_eq!(x_after(7.02, 1000.02, 2.0), (2.0, 0));
        assert_eq!(x_after(7.02, 1000.01, 3.0), (2.0, 1), "overtaken");
        assert_eq!(x_after(7.03, 1000.03, 4.0), (4.0, 1));
        assert_eq!(x_after(7.04, 990.0, 5.0), (5.0, 1), "the server's clock was set");
        // Set back by little: heard again as soon as nothing else has come for a moment.
        assert_eq!(x_after(7.04 + 2.0 * JUST_NOW_S, 989.9, 6.0), (6.0, 1));
    }

    /// The longest of late round trips counts; a pong without a ping is ignored, and while one is awaited no other ping is sent.
    #[test]
    fn a_round_trip_is_from_a_ping_to_its_pong() {
        let mut listener = listener();
        let mut pong = described(1, codec::TYPE_DESCRIPTION, MessageKind::Pong.name());
        codec::datagram(&pong).for_each(|message| assert!(listener.take(&message.unwrap())));
        pong.clear();
        encode(&Header::now(0, 1), &Payload::Pong.encode(), &mut pong);
        let answer = |listener: &mut Listener, now_s: f64| {
            codec::datagram(&pong).for_each(|message| assert!(listener.take_at(&message.unwrap(), now_s)));
            listener.state.round_trip_s
        };
        assert_eq!(answer(&mut listener, 7.0), None);
        assert!(listener.pings(7.0) && !listener.pings(7.0));
        assert_eq!(answer(&mut listener, 7.02), Some(7.02 - 7.0));
        assert!(listener.pings(7.02));
        let (longest_s, after_s) = (7.02 - 7.0, answer(&mut listener, 7.021).unwrap());
        assert!(after_s < longest_s && after_s > 0.9 * longest_s, "{longest_s} {after_s}");
        assert!(listener.pings(8.0) && !listener.pings(8.0 + 0.9 * UNANSWERED_S));
        assert!(listener.pings(8.1 + UNANSWERED_S), "one that is lost is not waited for");
        listener.connected();
        assert!(listener.pings(8.1 + UNANSWERED_S));
    }

    #[test]
    fn a_name_that_would_command_a_terminal_is_refused() {
        let mut listener = Listener::new("Wand");
        for name in ["Wand\u{1b}[2J", "Wa\nnd", "\u{9b}31mWand", "Wand\u{7f}"] {
            let bytes = described(0, codec::SENDER_DESCRIPTION, name);
            codec::datagram(&bytes).for_each(|message| assert!(listener.take(&message.unwrap())));
        }
        assert_eq!(listener.state.counters.malformed, 4);
        assert!(listener.why_missing(3.0).contains("(it names no other;"), "{}", listener.why_missing(3.0));
    }
}
