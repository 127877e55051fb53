//! Devices on a wire: a FASTRAK played through a pseudo-terminal, a gamepad through a pipe.

use super::{everything_is_finite, near};
use greenstage::track::device::DeviceState;
use greenstage::track::fastrak::Lines;
use greenstage::track::gamepad;
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

/// Station 1 at (10, -20, 30.5) cm, turned by a third of a turn about (1, 1, 1), its switch pressed.
const RECORD: &[u8] =
    b"01  1.00000E+01 -2.00000E+01  3.05000E+01  5.00000E-01  5.00000E-01  5.00000E-01  5.00000E-01 1\r\n";

fn thirds() -> Isometry3<f64> {
    let axis = Vector3::new(1.0, 1.0, 1.0).normalize() * (std::f64::consts::TAU / 3.0);
    Isometry3::new(Vector3::new(0.1, -0.2, 0.305), axis)
}

#[test]
fn records_are_read_however_they_are_cut() {
    for cut in 1..RECORD.len() {
        let (mut lines, mut state) = (Lines::default(), DeviceState::default());
        lines.take(&RECORD[..cut], &mut state);
        lines.take(&RECORD[cut..], &mut state);
        assert!(near(&state.sensors[&1].value, &thirds(), 1e-9), "cut at {cut}");
        assert!(state.buttons[&1].value);
        assert_eq!((state.counters.messages, state.counters.malformed), (1, 0));
    }
}

#[test]
fn the_middle_of_a_record_and_other_nonsense_are_counted() {
    let mut state = DeviceState::default();
    let mut lines = Lines::default();
    let ends: [&[u8]; 7] = [
        &RECORD[20..],
        b"21Sxyz\r\n",
        b"01 1 2 3 1 0 0 0\r\n",
        b"01 1 2 3 1 0 0 0 1 5\r\n",
        b"01 1 2 nan 1 0 0 0 0\r\n",
        b"01 1 2 3 0 0 0 0 0\r\n",
        b"01 1 2 3 1 0 0 0 7\r\n",
    ];
    for end in ends {
        assert!(!lines.take(end, &mut state), "{}", String::from_utf8_lossy(end));
    }
    lines.take(&vec![b'0'; 100_000], &mut state);
    lines.take(b"\n", &mut state);
    assert_eq!((state.counters.malformed, state.sensors.len()), (8, 0));
    assert!(lines.take(RECORD, &mut state), "and the next good one is read");
}

#[test]
fn gamepad_records_are_buttons_and_valuators() {
    let mut state = DeviceState::default();
    let mut take = |time_ms: u32, value: i16, kind: u8, number: u8| {
        let [t0, t1, t2, t3] = time_ms.to_ne_bytes();
        let [v0, v1] = value.to_ne_bytes();
        gamepad::take([t0, t1, t2, t3, v0, v1, kind, number], &mut state);
    };
    take(1500, 1, 0x81, 3);
    take(1501, 0, 0x01, 4);
    take(1502, i16::MIN, 0x02, 0);
    take(1503, 16384, 0x82, 1);
    take(1504, 0, 0x07, 1);
    assert!(state.buttons[&3].value && !state.buttons[&4].value);
    assert_eq!(state.buttons[&3].measured_s, Some(1.5));
    assert_eq!(state.valuators[&0].value, -1.0);
    assert!((state.valuators[&1].value - 0.5).abs() < 1e-4);
    assert_eq!(state.counters.malformed, 1);
}

#[cfg(target_os = "linux")]
mod played {
    use super::super::wait;
    use super::*;
    use crate::common::folder;
    use greenstage::track::device::{Link, now_s};
    use greenstage::track::{fastrak, gamepad};
    use serialport::{SerialPort, TTYPort};
    use std::io::{Read, Write};
    use std::time::Duration;

    /// Reads what the program commands until `end` stands there.
    fn read_until(port: &mut TTYPort, end: &str) -> String {
        let deadline_s = now_s() + 60.0;
        let mut heard = String::new();
        let mut bytes = [0; 256];
        while !heard.ends_with(end) && now_s() < deadline_s {
            match port.read(&mut bytes) {
                Ok(count) => heard.push_str(&String::from_utf8_lossy(&bytes[..count])),
                // Nobody has the other end open now.
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        heard
    }

    #[test]
    fn a_fastrak_is_commanded_and_heard_and_found_again() {
        let (mut device, line) = TTYPort::pair().unwrap();
        let path = line.name().unwrap();
        drop(line);
        device.set_timeout(Duration::from_millis(50)).unwrap();
        let mut source = fastrak::open("polhemus", path.as_ref(), 115_200).unwrap();
        let asked = read_until(&mut device, "C");
        assert_eq!(asked, "cFuO1,52,61,66,1\rO2,52,61,66,1\rO3,52,61,66,1\rO4,52,61,66,1\rC");
        device.write_all(&RECORD[30..]).unwrap();
        device.write_all(RECORD).unwrap();
        device.write_all(&[RECORD, b"02  0 0 0 1 0 0 0 0\r\n"].concat()).unwrap();
        let state = wait(&mut source, "record", |state| state.sensors.len() == 2);
        assert!(near(&state.sensors[&1].value, &thirds(), 1e-9));
        assert_eq!((state.link.clone(), state.counters.malformed), (Link::Up, 1));
        // Silence: it is commanded anew.
        wait(&mut source, "end", |state| matches!(&state.link, Link::Down(why) if why.contains("no record")));
        assert!(read_until(&mut device, "C").ends_with("O4,52,61,66,1\rC"));
        device.write_all(RECORD).unwrap();
        wait(&mut source, "return", |state| state.link == Link::Up && state.counters.reconnects > 0);
    }

    #[test]
    fn a_gamepad_that_is_plugged_in_later_is_heard_and_released_when_it_goes() {
        let path = folder("gamepad").join("js0");
        let mut source = gamepad::open("pad", &path).unwrap();
        wait(&mut source, "absence", |state| matches!(state.link, Link::Down(_)));
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        // Opens once the program reads.
        let mut pipe = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        pipe.write_all(&[0, 0, 0, 0, 1, 0, 1, 5]).unwrap();
        let state =
            wait(&mut source, "press", |state| state.buttons.get(&5).is_some_and(|button| button.value));
        assert_eq!(state.link, Link::Up);
        std::fs::remove_file(&path).unwrap();
        drop(pipe);
        let state = wait(&mut source, "end", |state| matches!(state.link, Link::Down(_)));
        assert!(!state.buttons[&5].value, "what nobody holds is not pressed");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_damaged_record_panics(
        at in any::<prop::sample::Index>(), filling in proptest::collection::vec(any::<u8>(), 0..30),
    ) {
        let start = at.index(RECORD.len());
        let damaged = [&RECORD[..start], &filling, &RECORD[start..], RECORD].concat();
        let (mut lines, mut state) = (Lines::default(), DeviceState::default());
        lines.take(&damaged, &mut state);
        prop_assert!(everything_is_finite(&state));
        prop_assert!(state.counters.messages >= 1, "the whole record at the end is read");
    }

    #[test]
    fn no_gamepad_record_panics(record in any::<[u8; 8]>()) {
        let mut state = DeviceState::default();
        gamepad::take(record, &mut state);
        prop_assert!(everything_is_finite(&state));
    }
}
