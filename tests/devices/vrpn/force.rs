//! A force device over the loopback device: the pushes that it gets, and the end of them.

use super::lab::{ANY, Peer, wait};
use greenstage::effect::haptics::{Device, Push, Reading, VrpnDevice};
use greenstage::track::device::now_s;
use greenstage::track::vrpn::payload::{MessageKind, Payload};
use greenstage::track::vrpn::{ForceField, codec};
use nalgebra::Vector3;
use std::net::TcpListener;

/// The next force field that the device gets, by the number that the other side gave to the type.
fn field(peer: &mut Peer, number: &mut Option<i32>) -> Option<ForceField> {
    loop {
        let (id, kind, payload) = peer.hear()?;
        let is_named = || codec::decode_name(&payload) == Ok(MessageKind::ForceField.name());
        if kind == codec::TYPE_DESCRIPTION && is_named() {
            *number = Some(id);
        } else if Some(kind) == *number {
            match Payload::decode(MessageKind::ForceField, &payload) {
                Ok(Payload::ForceField(field)) => return Some(field),
                other => panic!("{other:?}"),
            }
        }
    }
}

/// A force device, and the server that the test plays for it.
fn device() -> (VrpnDevice, Peer) {
    let listener = TcpListener::bind(ANY).unwrap();
    let device = VrpnDevice::open(&format!("Wand@{}", listener.local_addr().unwrap())).unwrap();
    let mut peer = Peer::accept(&listener);
    peer.hear_cookie();
    (device, peer)
}

#[test]
fn a_device_is_read_and_pushed_and_told_to_stop_when_it_is_dropped_under_force() {
    for round in 0..10 {
        let (mut device, mut peer) = device();
        peer.greet("Wand");
        assert!(peer.say(&pose()) && peer.say(&Payload::ButtonChange { button: 0, state: 1 }));
        let is_pressed = |reading: Reading| reading.tracked && reading.buttons == [true, false];
        wait("the device is there", || device.read(now_s()).is_some_and(is_pressed));
        let place = device.read(now_s()).unwrap().device_from_handle.translation.vector;
        assert_eq!(place, Vector3::new(0.1, 0.2, 0.3));
        let push = Push { force: Vector3::new(0.0, 3.0, -0.5), torque: Vector3::zeros() };
        let mut number = None;
        device.push(&push, now_s());
        let told = field(&mut peer, &mut number).unwrap();
        assert_eq!((told.force, told.origin), ([0.0, 3.0, -0.5], [0.1, 0.2, 0.3]), "round {round}");
        device.push(&Push::NONE, now_s());
        assert_eq!(field(&mut peer, &mut number).unwrap().force, [0.0; 3], "round {round}");
        device.push(&push.scaled(2.0), now_s());
        drop(device);
        let last = std::iter::from_fn(|| field(&mut peer, &mut number)).last();
        assert_eq!(last, Some(ForceField::default()), "round {round}");
    }
}

/// A loop that hangs says nothing more; its connection does not repeat its last word.
#[test]
fn a_force_that_is_not_said_again_is_taken_back() {
    let (mut device, mut peer) = device();
    peer.greet("Wand");
    wait("the device is there", || device.read(now_s()).is_some() || !peer.say(&pose()));
    device.push(&Push { force: Vector3::new(0.0, 3.0, 0.0), torque: Vector3::zeros() }, now_s());
    let mut number = None;
    assert_eq!(field(&mut peer, &mut number).unwrap().force, [0.0, 3.0, 0.0]);
    assert_eq!(field(&mut peer, &mut number), Some(ForceField::default()));
}

/// The time of a force and of the pose that answers it is measured by the server's answers to pings; before the first, a turn of
/// the server and a millisecond are assumed.
#[test]
fn the_way_of_a_force_is_measured() {
    let (mut device, mut peer) = device();
    peer.introduce("Wand");
    assert!(peer.say(&pose()));
    wait("the device is there", || device.read(now_s()).is_some());
    assert_eq!(device.latency_s(), 1e-3);
    let server = std::thread::spawn(move || {
        let (mut number, mut pongs) = (None, 0);
        while let Some((id, kind, payload)) = peer.hear() {
            let is_ping = || codec::decode_name(&payload) == Ok(MessageKind::Ping.name());
            if kind == codec::TYPE_DESCRIPTION && is_ping() {
                number = Some(id);
            } else if Some(kind) == number {
                std::thread::sleep(std::time::Duration::from_millis(30));
                pongs += 1;
                if !(peer.say(&Payload::Pong) && peer.say(&pose())) {
                    break;
                }
            }
        }
        pongs
    });
    wait("a pong is heard", || device.read(now_s()).is_some() && device.latency_s() >= 0.03);
    drop(device);
    assert!(server.join().unwrap() >= 1);
}

fn pose() -> Payload {
    Payload::Pose { sensor: 0, position: [0.1, 0.2, 0.3], quaternion: [0.0, 0.0, 0.0, 1.0] }
}
