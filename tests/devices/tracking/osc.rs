//! OSC trackers.

use super::{everything_is_finite, near, port, wait};
use greenstage::track::device::DeviceState;
use greenstage::track::osc::{EulerOrder, Osc};
use greenstage::track::udp::{Parser, listen};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};
use std::net::{SocketAddr, UdpSocket};

fn message(tracker: &str, half: &str, numbers: [f32; 3]) -> OscPacket {
    let args = numbers.map(OscType::Float).to_vec();
    OscPacket::Message(OscMessage { addr: format!("/tracking/trackers/{tracker}/{half}"), args })
}

fn bundle(content: Vec<OscPacket>) -> OscPacket {
    OscPacket::Bundle(OscBundle { timetag: OscTime { seconds: 0, fractional: 1 }, content })
}

fn bytes(packet: &OscPacket) -> Vec<u8> {
    encoder::encode(packet).unwrap()
}

/// R = Ry Rx Rz of degrees about x, y, z.
fn yxz(place: [f64; 3], [a, b, c]: [f64; 3]) -> Isometry3<f64> {
    let about = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, degrees.to_radians());
    let rotation = about(Vector3::y_axis(), b) * about(Vector3::x_axis(), a) * about(Vector3::z_axis(), c);
    Isometry3::from_parts(
        Translation3::from(Vector3::from(place)),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

#[test]
fn place_and_orientation_make_one_reading() {
    let (mut osc, mut state) = (Osc::new(EulerOrder::Yxz), DeviceState::default());
    for i in 0..5 {
        let place = [i as f32 * 0.25, 1.5, -0.5];
        assert!(osc.parse(&bytes(&message("3", "position", place)), &mut state));
        assert!(osc.parse(&bytes(&message("3", "rotation", [10.0, -70.0, 30.0])), &mut state));
    }
    assert_eq!(state.sensors.keys().copied().collect::<Vec<_>>(), [3]);
    assert!(near(&state.sensors[&3].value, &yxz([1.0, 1.5, -0.5], [10.0, -70.0, 30.0]), 1e-6));
    // The first two came alone, as from a sender that sends one half and never the other.
    assert_eq!((state.sensors[&3].count, state.counters.messages), (6, 10));
    let both = bundle(vec![
        message("head", "rotation", [0.0, 90.0, 0.0]),
        bundle(vec![message("head", "position", [0.0, 1.0, 0.0])]),
    ]);
    assert!(osc.parse(&bytes(&both), &mut state));
    assert!(near(&state.sensors[&0].value, &yxz([0.0, 1.0, 0.0], [0.0, 90.0, 0.0]), 1e-6));
}

#[test]
fn the_order_of_the_turns_is_a_key() {
    let turned = |order| {
        let (mut osc, mut state) = (Osc::new(order), DeviceState::default());
        osc.parse(&bytes(&message("1", "rotation", [90.0, 90.0, 0.0])), &mut state);
        state.sensors[&1].value.rotation * Vector3::z()
    };
    // z goes to x by Ry, where Rx leaves it; or to -y by Rx, where Ry leaves it.
    assert!((turned(EulerOrder::Xyz) - Vector3::x()).norm() < 1e-6);
    assert!((turned(EulerOrder::Yxz) + Vector3::y()).norm() < 1e-6);
}

#[test]
fn what_is_no_tracker_is_dropped_and_what_is_no_osc_malformed() {
    let (mut osc, mut state) = (Osc::new(EulerOrder::Yxz), DeviceState::default());
    for other in [
        message("0", "position", [0.0; 3]),
        message("9", "position", [0.0; 3]),
        message("99999999999999999999", "position", [0.0; 3]),
        message("1", "velocity", [0.0; 3]),
        message("1", "position", [f32::NAN, 0.0, 0.0]),
        message("1", "rotation", [f32::INFINITY, 0.0, 0.0]),
        OscPacket::Message(OscMessage {
            addr: "/tracking/trackers/1/position".into(),
            args: vec![OscType::Nil],
        }),
    ] {
        assert!(osc.parse(&bytes(&other), &mut state));
    }
    assert_eq!((state.counters.dropped, state.sensors.len()), (7, 0));
    for bad in [&b""[..], b"/tracking", b"#bundle\0", &[0; 64], &[b'/'; 5000]] {
        assert!(!osc.parse(bad, &mut state));
    }
}

/// The decoder recurses: bundles in bundles, and arrays in arrays, as deep as a datagram holds.
#[test]
fn nesting_does_not_overflow_the_stack() {
    let (mut osc, mut state) = (Osc::new(EulerOrder::Yxz), DeviceState::default());
    let mut nested = message("1", "position", [1.0, 2.0, 3.0]);
    for _ in 0..180 {
        nested = bundle(vec![nested]);
    }
    let nested = bytes(&nested);
    assert!(nested.len() < 4096);
    assert!(!osc.parse(&nested, &mut state), "180 deep");
    let arrays = [&b"/a\0\0,"[..], &vec![b'['; 4000], b"\0\0\0"].concat();
    assert!(!osc.parse(&arrays, &mut state));
    // As deep as is let through.
    let mut nested = message("1", "position", [1.0, 2.0, 3.0]);
    for _ in 0..32 {
        nested = bundle(vec![nested]);
    }
    assert!(osc.parse(&bytes(&nested), &mut state));
    assert_eq!(state.sensors[&1].value.translation.vector, Vector3::new(1.0, 2.0, 3.0));
}

#[test]
fn a_listener_hears() {
    let at: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let mut source = listen("vr", "osc", at.into(), Osc::new(EulerOrder::Yxz)).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.send_to(&bytes(&message("8", "position", [1.0, 2.0, 3.0])), ("127.0.0.1", port(&source))).unwrap();
    let state = wait(&mut source, "message", |state| !state.sensors.is_empty());
    assert_eq!(state.sensors[&8].value, Isometry3::translation(1.0, 2.0, 3.0));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_damaged_packet_panics(
        at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<prop::sample::Index>(),
        extra in proptest::collection::vec(any::<u8>(), 0..40),
    ) {
        let good = bundle(vec![
            message("1", "position", [1.0, 2.0, 3.0]),
            message("1", "rotation", [10.0, 20.0, 30.0]),
        ]);
        let mut damaged = bytes(&good);
        let place = at.index(damaged.len());
        damaged[place] = byte;
        damaged.truncate(cut.index(damaged.len()) + 1);
        damaged.extend(extra);
        let mut state = DeviceState::default();
        Osc::new(EulerOrder::Zyx).parse(&damaged, &mut state);
        prop_assert!(everything_is_finite(&state));
    }
}
