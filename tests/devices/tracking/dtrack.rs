//! DTrack's lines of text.

use super::{everything_is_finite, near, port, pressed, wait};
use crate::common::damaged;
use greenstage::track::device::{DeviceState, Link};
use greenstage::track::dtrack::Dtrack;
use greenstage::track::udp::{LARGEST, Parser, listen};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::net::{SocketAddr, UdpSocket};
use std::time::{SystemTime, UNIX_EPOCH};

/// Rx(η) Ry(θ) Rz(φ), degrees; millimetres.
fn pose(place: [f64; 3], angles: [f64; 3]) -> Isometry3<f64> {
    let about = |axis, degrees: f64| Rotation3::from_axis_angle(&axis, degrees.to_radians());
    let [a, b, c] = angles;
    let rotation = about(Vector3::x_axis(), a) * about(Vector3::y_axis(), b) * about(Vector3::z_axis(), c);
    let place = Translation3::from(Vector3::from(place) * 1e-3);
    Isometry3::from_parts(place, UnitQuaternion::from_rotation_matrix(&rotation))
}

fn columns(pose: &Isometry3<f64>) -> String {
    let matrix = pose.rotation.to_rotation_matrix();
    matrix.matrix().iter().map(|x| format!("{x:.6}")).collect::<Vec<_>>().join(" ")
}

fn parse(frames: &[&str]) -> DeviceState {
    let (mut parser, mut state) = (Dtrack::default(), DeviceState::default());
    for frame in frames {
        parser.parse(frame.replace('\n', "\r\n").as_bytes(), &mut state);
    }
    state
}

/// Whether sensor 0 was measured `since_midnight_s` seconds after a midnight, at most half a day from now.
fn is_of_day(state: &DeviceState, since_midnight_s: f64) -> bool {
    let measured_s = state.sensors[&0].measured_s.unwrap();
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64();
    let off_s = (measured_s - since_midnight_s).rem_euclid(86_400.0);
    off_s.min(86_400.0 - off_s) < 1e-5 && (measured_s - now_s).abs() < 43_300.0
}

/// A frame of our own, every kind of line in it.
fn frame(number: u32) -> String {
    let (head, wand) =
        (pose([100.0, -250.5, 1700.0], [10.0, -20.0, 135.0]), pose([5.0, 6.0, 7.0], [0.0, 45.0, 90.0]));
    let (head, wand) = (columns(&head), columns(&wand));
    format!(
        "fr {number}\nts2 1000 250000 4000\n6dcal 3\n\
         6d 2 [0 1.000][100.000 -250.500 1700.000 10.0000 -20.0000 135.0000][{head}] \
         [4 -1.000][0.000 0.000 0.000 0.0000 0.0000 0.0000][0 0 0 0 0 0 0 0 0]\n\
         6df2 2 1 [1 1.000 6 2][5.000 6.000 7.000][{wand}][5 0.50 -1.00]\n\
         6di 1 [7 2 0.1][1.000 2.000 3.000][{head}]\n\
         3d 2 [3 1.000][10.000 20.000 30.000] [5000 1.000][1.0 2.0 3.0]\n6dj 0\n"
    )
}

#[test]
fn every_kind_of_line_gives_its_poses() {
    let state = parse(&[&frame(1)]);
    let sensor = |id: i32| state.sensors[&id];
    assert!(near(&sensor(0).value, &pose([100.0, -250.5, 1700.0], [10.0, -20.0, 135.0]), 2e-6));
    assert!(near(&sensor(1001).value, &pose([5.0, 6.0, 7.0], [0.0, 45.0, 90.0]), 2e-6));
    assert!(near(&sensor(7).value, &pose([1.0, 2.0, 3.0], [10.0, -20.0, 135.0]), 2e-6));
    assert!(near(&sensor(2003).value, &pose([10.0, 20.0, 30.0], [0.0; 3]), 1e-12));
    assert_eq!(state.sensors.keys().copied().collect::<Vec<_>>(), [0, 4, 7, 1001, 2003]);
    assert_eq!((sensor(0).quality, sensor(4).quality), (1.0, 0.0), "body 4 is not tracked");
    assert_eq!(sensor(0).measured_s, Some(1000.25));
    assert_eq!((pressed(&state), state.buttons.len()), (vec![32, 34], 6), "bits 0 and 2 of flystick 1");
    assert_eq!((state.valuators[&16].value, state.valuators[&17].value), (0.5, -1.0));
    assert_eq!((state.counters.malformed, state.counters.dropped), (0, 1), "marker 5000 has no channel");
}

#[test]
fn a_body_that_is_not_tracked_keeps_its_pose_and_an_old_frame_is_dropped() {
    let lost = "fr 2\n6d 1 [0 -1.000][0 0 0 0 0 0][0 0 0 0 0 0 0 0 0]\n";
    let state = parse(&[&frame(1), lost]);
    assert!(near(&state.sensors[&0].value, &pose([100.0, -250.5, 1700.0], [10.0, -20.0, 135.0]), 2e-6));
    assert_eq!(state.sensors[&0].quality, 0.0);
    let unit = "[1 0 0 0 1 0 0 0 1]";
    let moved = |number: u32| format!("fr {number}\n6d 1 [0 1][9000 0 0 0 0 0]{unit}\n");
    let state = parse(&[&frame(100), &moved(99)]);
    assert_eq!((state.sensors[&0].count, state.counters.dropped), (1, 2));
    let state = parse(&[&frame(100_000), &moved(1)]);
    assert_eq!(state.sensors[&0].count, 2, "the controller began anew");
}

/// Numbers of the frames that were taken, by body 0's place, of frames `fr N` with body 0 at x = 1, 2, … mm.
fn taken(frames: &[i64]) -> Vec<usize> {
    let (mut parser, mut state) = (Dtrack::default(), DeviceState::default());
    let mut taken = Vec::new();
    for (i, frame) in frames.iter().enumerate() {
        let before = state.sensors.get(&0).map_or(0, |reading| reading.count);
        let text = format!("fr {frame}\n6d 1 [0 1.0][{}.0 0 0 0 0 0][1 0 0 0 1 0 0 0 1]\n", i + 1);
        assert!(parser.parse(text.as_bytes(), &mut state));
        if state.sensors[&0].count > before {
            taken.push(i);
        }
    }
    taken
}

#[test]
fn a_controller_that_begins_anew_is_heard_whenever_it_does() {
    assert_eq!(taken(&[500, 1, 2, 3]), [0, 1, 2, 3], "after 500 frames");
    assert_eq!(taken(&[10, 1, 2, 3, 4, 5]), [0, 3, 4, 5], "after ten");
    assert_eq!(taken(&[0, 0, 0, 0, 0]), [0, 3, 4], "one that does not count");
    assert_eq!(taken(&[10, 9, 11, 10, 12, 12, 13]), [0, 2, 4, 6], "overtaken and doubled frames");
    assert_eq!(taken(&[i64::MAX, i64::MIN, 0]), [0, 1, 2]);
}

#[test]
fn lines_that_are_not_as_they_should_be_are_counted() {
    let unit = "[1 0 0 0 1 0 0 0 1]";
    for line in [
        "6d 1 [0 1][1 2 3 4 5][1 0 0 0 1 0 0 0 1]".to_owned(),
        format!("6d 2 [0 1][1 2 3 4 5 6]{unit}"),
        "6d 4000000000 [0 1]".to_owned(),
        format!("6d 1 [0.5 1][1 2 3 4 5 6]{unit}"),
        format!("6d 1 [-1 1][1 2 3 4 5 6]{unit}"),
        format!("6d 1 [0 nan][1 2 3 4 5 6]{unit}"),
        format!("6d 1 [0 1][1 2 inf 4 5 6]{unit}"),
        format!("6d 1 [0 1][1 2 1e999 4 5 6]{unit}"),
        "6d 1 [0 1][1 2 3 4 5 6][1 0 0 0 1 0 0 0 -1]".to_owned(),
        "6d 1 [0 1][1 2 3 4 5 6][2 0 0 0 1 0 0 0 1]".to_owned(),
        "6d 1 [0 1][1 2 3 4 5 6][0 0 0 0 0 0 0 0 0]".to_owned(),
        format!("6d 1 [0 1][1 2 3 4 5 6]{unit}["),
        format!("6df2 1 1 [0 1 6 2][1 2 3]{unit}[0 0.0]"),
        format!("6df2 1 1 [0 1 1e9 2][1 2 3]{unit}[0 0.0 0.0]"),
        "3d 1 [1 1.0][1 2]".to_owned(),
    ] {
        let (mut parser, mut state) = (Dtrack::default(), DeviceState::default());
        assert!(!parser.parse(line.as_bytes(), &mut state), "{line}");
        assert!(state.sensors.is_empty(), "{line}");
        // Among good lines it costs itself alone.
        let state = parse(&[&format!("fr 1\n{line}\n3d 1 [1 1.0][1 2 3]\n")]);
        assert_eq!((state.counters.malformed, state.sensors.len()), (1, 1), "{line}");
    }
}

/// Written by hand: a body turned by 90° about z, one by the angle with cosine 0.6 and sine 0.8 about x, a flystick with
/// buttons 0, 2 and 5 pressed. The nine numbers of a rotation are its columns.
const BY_HAND: &str = "fr 21753\r\nts 39596.024831\r\n6dcal 3\r\n\
    6d 2 [0 1.000][326.848 -187.216 503.527 0.0000 0.0000 90.0000][0.0 1.0 0.0 -1.0 0.0 0.0 0.0 0.0 1.0] \
    [1 1.000][-1000.0 250.0 0.5 53.1301 0.0 0.0][1.0 0.0 0.0 0.0 0.6 0.8 0.0 -0.8 0.6]\r\n\
    6df2 1 1 [0 1.000 8 2][10.0 20.0 30.0][1 0 0 0 1 0 0 0 1][37 0.25 -1.00]\r\n";

#[test]
fn a_frame_written_by_hand_is_understood() {
    let state = parse(&[BY_HAND]);
    let matrix = |id: i32| state.sensors[&id].value.to_homogeneous();
    let a = nalgebra::matrix![
        0.0, -1.0, 0.0, 0.326848; 1.0, 0.0, 0.0, -0.187216; 0.0, 0.0, 1.0, 0.503527; 0.0, 0.0, 0.0, 1.0];
    let b = nalgebra::matrix![
        1.0, 0.0, 0.0, -1.0; 0.0, 0.6, -0.8, 0.25; 0.0, 0.8, 0.6, 0.0005; 0.0, 0.0, 0.0, 1.0];
    assert!((matrix(0) - a).amax() < 1e-12, "{}", matrix(0));
    assert!((matrix(1) - b).amax() < 1e-12, "{}", matrix(1));
    assert_eq!(state.sensors[&1000].value, Isometry3::translation(0.01, 0.02, 0.03));
    assert!(is_of_day(&state, 39596.024831));
    assert_eq!((state.buttons.len(), pressed(&state)), (8, vec![0, 2, 5]));
    assert_eq!((state.valuators[&0].value, state.valuators[&1].value), (0.25, -1.0));
    assert_eq!((state.counters.malformed, state.counters.dropped), (0, 0));
}

/// The frames that were recorded in two laboratories.
#[test]
fn recorded_frames_parse_to_their_poses() {
    let Some(path) = crate::common::shared("tracking/dtrack_frames.txt") else { return };
    let text = std::fs::read_to_string(path).unwrap();
    let frames: Vec<String> = text
        .split("# frame")
        .skip(1)
        .map(|frame| frame.lines().skip(1).map(|line| format!("{line}\n")).collect())
        .collect();
    let a = parse(&[&frames[0]]);
    let head = pose([-475.292, -567.632, -53.704], [135.5743, 5.7618, -3.3069]);
    println!("head off by {} rad", a.sensors[&0].value.rotation.angle_to(&head.rotation));
    assert!(near(&a.sensors[&0].value, &head, 1e-5), "{}", a.sensors[&0].value);
    let flystick = a.sensors[&1000].value;
    assert!((flystick.translation.vector - Vector3::new(-0.048603, -0.122146, -0.38922)).norm() < 1e-12);
    let x = flystick.rotation * Vector3::x();
    assert!((x - Vector3::new(0.175884, 0.118374, -0.977268)).norm() < 1e-5, "the first column: {x}");
    assert_eq!((a.buttons.len(), a.valuators.len(), a.counters.malformed), (6, 2, 0));
    let b = parse(&[&frames[1]]);
    assert!(near(&b.sensors[&0].value, &pose([84.203, 37.681, 172.102], [99.1970, 6.7130, 9.6575]), 1e-5));
    assert!(is_of_day(&b, 44597.741924));
    assert_eq!(b.sensors[&1000].quality, 0.0);
    assert_eq!((b.buttons.len(), b.valuators.len(), b.counters.malformed), (8, 3, 0));
}

#[test]
fn a_listener_hears_survives_damage_and_a_flood_and_stops() {
    let at: SocketAddr = "127.0.0.1:0".parse().unwrap();
    let mut source = listen("art", "dtrack", at.into(), Dtrack::default()).unwrap();
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = ("127.0.0.1", port(&source));
    sender.send_to(frame(1).as_bytes(), to).unwrap();
    let state = wait(&mut source, "first frame", |state| state.sensors.len() == 5);
    assert_eq!(state.link, Link::Up);
    sender.send_to(&vec![b'6'; LARGEST + 1], to).unwrap();
    sender.send_to(b"", to).unwrap();
    sender.send_to(&[0xff; 100], to).unwrap();
    wait(&mut source, "damage", |state| state.counters.malformed == 3);
    let flood: Vec<String> = (2..2002).map(frame).collect();
    let flooded = wait(&mut source, "flood", |state| {
        for frame in &flood {
            sender.send_to(frame.as_bytes(), to).unwrap();
        }
        state.counters.throttled > 0
    });
    // The system may have dropped any of the flood, but not what is sent again and again after it.
    let (mut number, before) = (3000, flooded.sensors[&0].count);
    let last = wait(&mut source, "frame after the flood", |state| {
        number += 1;
        sender.send_to(frame(number).as_bytes(), to).unwrap();
        state.sensors[&0].count > before + 300
    });
    assert!(everything_is_finite(&last) && last.sensors.len() == 5);
    drop(source);
    assert!(UdpSocket::bind(to).is_ok(), "the port is free again");
}

#[test]
fn a_port_that_is_taken_is_an_error_with_the_remedy() {
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let at = taken.local_addr().unwrap();
    let error = listen("art", "dtrack", at.into(), Dtrack::default()).err().unwrap().to_string();
    assert!(error.contains("tracker `art`: cannot listen on"), "{error}");
    assert!(error.contains("another program"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let mut state = DeviceState::default();
        Dtrack::default().parse(&bytes, &mut state);
        prop_assert!(everything_is_finite(&state));
    }

    #[test]
    fn no_damaged_frame_panics(
        from in any::<prop::sample::Index>(), length in 0..30usize, filling in "[\\[\\] 0-9.e+na-]{0,12}",
    ) {
        let damaged = damaged(&frame(1), &from, length, &filling);
        let mut state = DeviceState::default();
        Dtrack::default().parse(damaged.as_bytes(), &mut state);
        prop_assert!(everything_is_finite(&state), "{damaged}");
        prop_assert!(state.sensors.len() <= 256 && state.buttons.len() <= 256 && state.valuators.len() <= 256);
    }

    #[test]
    fn any_pose_is_read_back(place in prop::array::uniform3(-5000.0..5000.0f64), angles in prop::array::uniform3(-180.0..180.0f64)) {
        let expected = pose(place, angles);
        let [x, y, z] = place;
        let line = format!("6d 1 [3 0.5][{x} {y} {z} 0 0 0][{}]\n", columns(&expected));
        let state = parse(&[&line]);
        prop_assert!(near(&state.sensors[&3].value, &expected, 1e-5), "{line}");
    }
}
