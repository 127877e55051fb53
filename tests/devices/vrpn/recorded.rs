//! A stream that a vrpn_server 07.38 sent: its messages, poses, rates and buttons are the known ones.

use crate::common::shared;
use crate::tracking::pressed;
use greenstage::track::vrpn::codec::{self, Framer};
use greenstage::track::vrpn::listener::Listener;
use greenstage::track::vrpn::payload::{MessageKind, Payload, Rate};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Sender, time and payload of every message of a known type, and all messages' number.
struct Stream {
    senders: BTreeMap<i32, String>,
    read: Vec<(String, f64, Payload)>,
    messages: usize,
}

fn recorded() -> Option<Vec<u8>> {
    let path = shared("tracking/tcp_direct_server_to_client.bin")?;
    Some(std::fs::read(path).unwrap())
}

/// The stream read in pieces of `piece` bytes.
fn read(bytes: &[u8], piece: usize) -> Stream {
    let mut framer = Framer::default();
    let mut stream = Stream { senders: BTreeMap::new(), read: Vec::new(), messages: 0 };
    let mut kinds = BTreeMap::new();
    let mut version = None;
    for piece in bytes.chunks(piece) {
        framer.space()[..piece.len()].copy_from_slice(piece);
        framer.wrote(piece.len());
        if version.is_none() {
            version = framer.cookie().map(|cookie| codec::parse_cookie(&cookie).unwrap());
        }
        if version.is_none() {
            continue;
        }
        while let Some(message) = framer.message().unwrap() {
            stream.messages += 1;
            let id = message.header.sender;
            match message.header.kind {
                codec::SENDER_DESCRIPTION => {
                    stream.senders.insert(id, codec::decode_name(message.payload).unwrap().to_owned());
                }
                codec::TYPE_DESCRIPTION => {
                    kinds.insert(id, MessageKind::named(codec::decode_name(message.payload).unwrap()));
                }
                kind => {
                    let kind = kinds[&kind].unwrap();
                    let payload = Payload::decode(kind, message.payload).unwrap();
                    assert_eq!(payload.kind(), kind);
                    // Beside the second integer of a tracker's payload, which says nothing, we write the same bytes.
                    let again = payload.encode();
                    let differs = |at: usize| again[at] != message.payload[at];
                    assert!((0..again.len()).filter(|at| differs(*at)).all(|at| (4..8).contains(&at)));
                    stream.read.push((stream.senders[&id].clone(), message.header.time_s(), payload));
                }
            }
        }
    }
    assert_eq!(version, Some(codec::VERSION));
    stream
}

/// vrpn.cfg asks for a tracker that turns about y at 0.25 revolutions a second, 20 reports a second.
#[test]
fn the_spinning_tracker_spins_as_it_was_configured() {
    let Some(bytes) = recorded() else { return };
    let stream = read(&bytes, 1500);
    assert_eq!(stream.messages, 3118);
    assert_eq!(stream.senders[&1], "Spin0");
    let spin = || stream.read.iter().filter(|(sender, ..)| sender == "Spin0");
    let angles: Vec<(f64, f64)> = spin()
        .filter_map(|(_, time, payload)| match payload {
            Payload::Pose { sensor: 0, position: [0.0, 0.0, 0.0], quaternion: [x, y, z, w] } => {
                assert!((*x, *z) == (0.0, 0.0) && (y * y + w * w - 1.0).abs() < 1e-12);
                Some((*time, 2.0 * y.atan2(*w)))
            }
            _ => None,
        })
        .collect();
    assert_eq!(angles.len(), 39);
    for pair in angles.windows(2) {
        let (dt, turn) = (pair[1].0 - pair[0].0, (pair[1].1 - pair[0].1).rem_euclid(TAU));
        // 20 Hz, never early; the server slept a little longer. The angle follows the clock to its microsecond.
        assert!((0.05..0.056).contains(&dt), "{dt}");
        assert!((turn / (TAU * dt) - 0.25).abs() < 5e-6, "{} revolutions a second", turn / (TAU * dt));
    }
    let seconds = angles[38].0 - angles[0].0;
    assert!((38.0 / seconds - 19.58).abs() < 0.01, "{} Hz", 38.0 / seconds);
    let velocities = spin().filter(|(.., payload)| matches!(payload, Payload::Velocity(_)));
    assert_eq!(velocities.clone().count(), 39);
    for (.., payload) in velocities {
        let Payload::Velocity(Rate { quaternion: [_, y, _, w], dt, .. }) = payload else { unreachable!() };
        assert!((2.0 * y.atan2(*w) / (TAU * dt) - 0.25).abs() < 1e-12);
    }
}

/// Data that DTrack had sent to the server: two bodies, one turned by 90° about z, and eight buttons.
#[test]
fn the_optical_tracker_stands_where_it_stood() {
    let Some(bytes) = recorded() else { return };
    let mut listener = Listener::new("DTrack");
    let mut rest = &bytes[codec::COOKIE_BYTES..];
    while let Some((message, taken)) = codec::decode(rest).unwrap() {
        assert!(listener.take(&message));
        rest = &rest[taken..];
    }
    assert!(rest.is_empty() && listener.is_there());
    let state = &listener.state;
    assert_eq!(state.counters.messages, 2893);
    assert_eq!((state.counters.malformed, state.counters.dropped), (0, 0));
    assert_eq!(state.sensors.keys().copied().collect::<Vec<_>>(), [0, 2]);
    let quarter = nalgebra::Isometry3::new(
        nalgebra::Vector3::new(0.1, 0.2, 0.3),
        nalgebra::Vector3::z() * std::f64::consts::FRAC_PI_2,
    );
    let sensor = &state.sensors[&0];
    assert!((sensor.value.to_homogeneous() - quarter.to_homogeneous()).abs().max() < 1e-15);
    assert_eq!(state.sensors[&2].value, nalgebra::Isometry3::translation(0.01, 0.02, 0.03));
    assert_eq!((sensor.count, state.sensors[&2].count), (1446, 1446));
    // The clock is the tracker's own.
    assert!((sensor.measured_s.unwrap() - 1_795_172_823.168).abs() < 2e-6);
    assert_eq!((state.buttons.len(), pressed(state)), (8, vec![0, 2]));
}

#[test]
fn the_buttons_toggle_twice_a_second() {
    let Some(bytes) = recorded() else { return };
    // In pieces of one byte: half messages are no trouble.
    let stream = read(&bytes, 1);
    let changes: Vec<(f64, i32, i32)> = stream
        .read
        .iter()
        .filter_map(|(sender, time, payload)| match payload {
            Payload::ButtonChange { button, state } if sender == "Button0" => Some((*time, *button, *state)),
            _ => None,
        })
        .collect();
    assert_eq!(changes.len(), 16);
    for (n, (_, button, state)) in changes.iter().enumerate() {
        assert_eq!((*button, *state), (n as i32 % 2, i32::from(n / 2 % 2 == 0)));
    }
    // A change every 0.25 s for a rate of 4 Hz.
    let seconds = changes[14].0 - changes[0].0;
    assert!((seconds / 7.0 - 0.25).abs() < 2e-3, "{seconds}");
}
