//! Messages as bytes: a stream composed by hand, round trips, and bytes that are none.

use greenstage::track::vrpn::codec::{self, CodecFault, Framer, Header, Message};
use greenstage::track::vrpn::listener::Listener;
use greenstage::track::vrpn::payload::{ForceField, MessageKind, Payload, Rate};
use nalgebra::Isometry3;
use proptest::prelude::*;

/// `vrpn: ver. 07.35  0` and five NUL.
const COOKIE: &str = "7672706e3a 20 7665722e 20 30372e3335 2020 30 0000000000";

/// Device 3 is `Wand`, type 7 is a pose, type 9 a button: what a server says, as hexadecimal.
const WAND: &str = "
    00000021 65000000 000f4240 00000003 ffffffff 00000000  00000005 57616e64 00 00000000000000
    00000032 65000000 00000000 00000007 fffffffe 00000001  00000016 7672706e5f547261636b657220506f735f5175617400 000000000000
    0000002f 65000000 00000000 00000009 fffffffe 00000002  00000013 7672706e5f427574746f6e204368616e676500 00
    00000058 65000001 0007a120 00000003 00000007 00000003  00000002 00000000
        3ff0000000000000 c000000000000000 3fe0000000000000
        0000000000000000 3ff0000000000000 0000000000000000 0000000000000000
    00000020 65000001 0007a120 00000003 00000009 00000004  00000001 00000001
    00000020 65000001 0007a120 00000004 00000009 00000005  00000000 00000001
";

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u32> = text.chars().filter_map(|c| c.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (16 * pair[0] + pair[1]) as u8).collect()
}

#[test]
fn a_stream_written_by_hand_is_understood() {
    let bytes = [hex(COOKIE), hex(WAND)].concat();
    assert_eq!(bytes.len(), 24 + 40 + 56 + 48 + 88 + 32 + 32);
    let (mut listener, mut version) = (Listener::new("Wand"), None);
    let mut framer = Framer::default();
    let mut messages = 0;
    for byte in &bytes {
        framer.space()[0] = *byte;
        framer.wrote(1);
        if version.is_none() {
            version = framer.cookie().map(|cookie| codec::parse_cookie(&cookie));
            continue;
        }
        while let Some(message) = framer.message().unwrap() {
            assert!(listener.take(&message));
            messages += 1;
        }
    }
    assert_eq!(version, Some(Ok(codec::Version { major: 7, minor: 35 })));
    assert_eq!(messages, 6);
    let sensor = &listener.state.sensors[&2];
    let half_turn = Isometry3::new([1.0, -2.0, 0.5].into(), nalgebra::Vector3::y() * std::f64::consts::PI);
    assert!((sensor.value.to_homogeneous() - half_turn.to_homogeneous()).abs().max() < 1e-15);
    assert_eq!(sensor.measured_s, Some(f64::from(0x6500_0001) + 0.5));
    // Another device's button is not ours.
    assert_eq!(listener.state.buttons.keys().copied().collect::<Vec<_>>(), [1]);
    assert!(listener.state.buttons[&1].value);
    assert_eq!((listener.state.counters.messages, listener.state.counters.malformed), (2, 0));
}

#[test]
fn cookies_of_other_versions() {
    let own = codec::cookie();
    assert_eq!(&own, b"vrpn: ver. 07.38  0\0\0\0\0\0");
    let with = |version: &str| {
        let mut cookie = own;
        cookie[11..16].copy_from_slice(version.as_bytes());
        codec::parse_cookie(&cookie)
    };
    assert_eq!(with("07.38"), Ok(codec::VERSION));
    assert_eq!(with("07.30").unwrap().minor, 30);
    assert_eq!(with("06.10"), Err(CodecFault::Version(6, 10)));
    assert_eq!(with("08.00"), Err(CodecFault::Version(8, 0)));
    assert!(matches!(with("7.380"), Err(CodecFault::NoCookie(_))));
    assert!(matches!(codec::parse_cookie(b"HTTP/1.1 400 Bad Request"), Err(CodecFault::NoCookie(_))));
}

#[test]
fn a_length_is_never_believed() {
    for length in [0_u32, 23, 24 + 64 * 1024 + 1, 1 << 30, u32::MAX] {
        let mut bytes = hex("00000000 00000000 00000000 00000000 00000000 00000000");
        bytes[..4].copy_from_slice(&length.to_be_bytes());
        assert_eq!(codec::decode(&bytes), Err(CodecFault::Length(length)));
        assert_eq!(codec::datagram(&bytes).collect::<Vec<_>>(), [Err(CodecFault::Length(length))]);
    }
    // As many bytes as a name, a button or an analog message states, or it is none.
    assert_eq!(codec::decode_name(&hex("00000005 57616e6400")), Ok("Wand"));
    for wrong in ["", "00000005", "00000006 57616e6400", "00000005 57616e6457", "00000005 570061006400"] {
        assert!(codec::decode_name(&hex(wrong)).is_err(), "{wrong}");
    }
    assert!(codec::decode_name(&codec::encode_name(&"x".repeat(101))).is_err());
    for (kind, wrong) in [
        (MessageKind::ButtonStates, "00000002 00000001"),
        (MessageKind::ButtonStates, "ffffffff"),
        (MessageKind::ButtonStates, ""),
        (MessageKind::AnalogChannel, "7ff8000000000000"),
        (MessageKind::AnalogChannel, "3ff0000000000000"),
        (MessageKind::AnalogChannel, "bff0000000000000 0000000000000000"),
        (MessageKind::Ping, "00"),
    ] {
        assert!(Payload::decode(kind, &hex(wrong)).is_err(), "{kind:?} {wrong}");
    }
    let many = Payload::Analog(vec![0.0; 257]);
    assert!(Payload::decode(MessageKind::AnalogChannel, &many.encode()).is_err());
}

#[test]
fn what_was_never_described_means_nothing() {
    let mut listener = Listener::new("Wand");
    let pose = Payload::Pose { sensor: 0, position: [0.0; 3], quaternion: [0.0, 0.0, 0.0, 1.0] }.encode();
    let say = |listener: &mut Listener, sender, kind| {
        listener.take(&Message { header: Header::now(sender, kind), payload: &pose });
        listener.state.sensors.get(&0).map_or(0, |reading| reading.count)
    };
    let describe = |listener: &mut Listener, system, id, name: &str| {
        let payload = codec::encode_name(name);
        assert!(listener.take(&Message { header: Header::now(id, system), payload: &payload }));
    };
    assert_eq!(say(&mut listener, 0, 4), 0);
    describe(&mut listener, codec::SENDER_DESCRIPTION, 0, "Wand");
    assert_eq!(say(&mut listener, 0, 4), 0);
    describe(&mut listener, codec::TYPE_DESCRIPTION, 4, "vrpn_Tracker Pos_Quat");
    assert_eq!(say(&mut listener, 0, 4), 1);
    // A number that comes to mean another type or device means the old one no more.
    describe(&mut listener, codec::TYPE_DESCRIPTION, 4, "vrpn_Tracker Workspace");
    assert_eq!(say(&mut listener, 0, 4), 1);
    describe(&mut listener, codec::TYPE_DESCRIPTION, 5, "vrpn_Tracker Pos_Quat");
    describe(&mut listener, codec::SENDER_DESCRIPTION, 0, "Other");
    assert_eq!(say(&mut listener, 0, 5), 1);
    let said = listener.why_missing(3.0);
    assert!(said.contains("has no device Wand") && said.contains("(it names Other;"), "{said}");
    // Numbers in datagrams are not descriptions.
    let mut datagram = Vec::new();
    codec::encode(&Header::now(0, codec::SENDER_DESCRIPTION), &codec::encode_name("Wand"), &mut datagram);
    listener.take_datagram(&datagram);
    assert!(!listener.is_there());
    // A million descriptions are no more than one.
    for id in 0..100_000 {
        describe(&mut listener, codec::SENDER_DESCRIPTION, id, &format!("Device{id}"));
        describe(&mut listener, codec::TYPE_DESCRIPTION, id, &format!("type {id}"));
    }
    assert!(listener.why_missing(3.0).len() < 400);
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>().prop_filter("compared by ==", |x| !x.is_nan()), Just(0.0), Just(1.0)]
}

fn payload() -> impl Strategy<Value = Payload> {
    let three = || prop::array::uniform3(number());
    let four = || prop::array::uniform4(number());
    let rate = move || {
        (any::<i32>(), three(), four(), number()).prop_map(|(sensor, vector, quaternion, dt)| Rate {
            sensor,
            vector,
            quaternion,
            dt,
        })
    };
    let single = || -1e6..1e6_f32;
    let row = move || [single(), single(), single()];
    prop_oneof![
        (any::<i32>(), three(), four()).prop_map(|(sensor, position, quaternion)| Payload::Pose {
            sensor,
            position,
            quaternion
        }),
        rate().prop_map(Payload::Velocity),
        rate().prop_map(Payload::Acceleration),
        any::<(i32, i32)>().prop_map(|(button, state)| Payload::ButtonChange { button, state }),
        prop::collection::vec(any::<i32>(), 0..=256).prop_map(Payload::ButtonStates),
        prop::collection::vec(number(), 0..=256).prop_map(Payload::Analog),
        Just(Payload::Ping),
        Just(Payload::Pong),
        three().prop_map(Payload::Force),
        (three(), four()).prop_map(|(position, quaternion)| Payload::ContactPoint { position, quaternion }),
        any::<i32>().prop_map(Payload::ForceError),
        (row(), row(), [row(), row(), row()], single()).prop_map(|(origin, force, jacobian, radius)| {
            Payload::ForceField(ForceField { origin, force, jacobian, radius })
        }),
    ]
}

fn header() -> impl Strategy<Value = Header> {
    any::<(u32, u32, i32, i32, u32)>().prop_map(|(seconds, microseconds, sender, kind, sequence)| Header {
        seconds,
        microseconds,
        sender,
        kind,
        sequence,
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    /// Any messages, in a stream cut anywhere or in one datagram, come out as they went in.
    #[test]
    fn messages_survive_the_wire(
        messages in prop::collection::vec((header(), payload()), 1..8),
        piece in 1_usize..5000,
    ) {
        let mut bytes = Vec::new();
        for (header, payload) in &messages {
            codec::encode(header, &payload.encode(), &mut bytes);
            prop_assert_eq!(bytes.len() % 8, 0);
        }
        let mut framer = Framer::default();
        let mut read = Vec::new();
        for piece in bytes.chunks(piece) {
            framer.space()[..piece.len()].copy_from_slice(piece);
            framer.wrote(piece.len());
            while let Some(Message { header, payload }) = framer.message().unwrap() {
                let kind = messages[read.len()].1.kind();
                read.push((header, Payload::decode(kind, payload).unwrap()));
            }
        }
        prop_assert_eq!(&read, &messages);
        let whole: Vec<Header> = codec::datagram(&bytes).map(|message| message.unwrap().header).collect();
        prop_assert_eq!(whole, messages.iter().map(|(header, _)| *header).collect::<Vec<_>>());
    }

    /// Any bytes at all: the frame is lost or found, nothing panics, and the framer always has room or an answer.
    #[test]
    fn any_bytes_are_taken_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
        let mut framer = Framer::default();
        framer.space()[..bytes.len()].copy_from_slice(&bytes);
        framer.wrote(bytes.len());
        let mut count = 0;
        while let Ok(Some(_)) = framer.message() {
            count += 1;
        }
        prop_assert!(count <= bytes.len() / codec::HEADER_BYTES);
        prop_assert!(!framer.space().is_empty());
        for (kind, _) in MessageKind::ALL {
            if let Ok(payload) = Payload::decode(kind, &bytes) {
                prop_assert_eq!(payload.encode().len(), bytes.len());
            }
        }
        let _ = codec::decode_name(&bytes);
        Listener::new("Wand").take_datagram(&bytes);
    }

    #[test]
    fn times_survive_the_wire(time_s in 0.0..4e9_f64) {
        let header = Header::default().at(time_s);
        prop_assert!(header.microseconds < 1_000_000 && (header.time_s() - time_s).abs() < 2e-6);
    }
}
