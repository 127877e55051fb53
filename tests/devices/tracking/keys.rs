//! The tracking keys of a stage file, damaged.

use crate::common::damaged;
use greenstage::stage::{BUILT_IN, Stage};
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;
use std::path::Path;

const KEYS: &str = r#"
[tracker.a]
vrpn = "Tracker0@tcp://lab-1:3884"
transport = "tcp"
room_from_tracker = { position = [0.1, 0.2, 0.3], axes = [[1, 0, 0], [0, 0, 1], [0, -1, 0]], scale = 0.01 }
[tracker.b]
osc = "127.0.0.1:9000"
euler = "zyx"
room_from_tracker = { mirror = "z", rotation = [0.0, 1.5, 0.0] }
[tracker.c]
fastrak = "/dev/ttyUSB0"
baud = 9600
[sensor.head]
tracker = "a"
id = 0
sensor_from_body = { position = [0.0, 0.0, -0.1] }
filter = { min_cutoff = 1.0, beta = 0.05, speed_cutoff = 2.0 }
predict = 0.02
lost = { after = 0.1, warn = 1.0 }
[sensor.wand]
tracker = "b"
id = 5
[stylus.right]
sensor = "wand"
grab = { tracker = "c", button = 1 }
"#;

/// Whatever is accepted turns any pose into a finite one with a rotation.
fn parse_and_use(keys: &str) -> bool {
    let text = BUILT_IN[0].1.replace("ipd = 0.064", "ipd = 0.064\nhead = \"head\"");
    let Ok(stage) =
        Stage::parse(&format!("{text}{keys}"), Path::new("any.toml")).and_then(greenstage::track::checked)
    else {
        return false;
    };
    let tracking = stage.tracking;
    let pose = Isometry3::new(Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.3, -2.0, 1.0));
    for sensor in tracking.sensors.values() {
        let room = tracking.trackers[&sensor.tracker].frame.room_from_sensor(&pose) * sensor.sensor_from_body;
        assert!(room.translation.vector.iter().all(|x| x.is_finite()), "{keys}");
        assert!((room.rotation.coords.norm() - 1.0).abs() < 1e-9, "{keys}");
        assert!(sensor.lost.after_s > 0.0 && sensor.lost.warn_s >= sensor.lost.after_s, "{keys}");
    }
    true
}

#[test]
fn the_keys_are_accepted() {
    assert!(parse_and_use(KEYS));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_damaged_keys_panic(
        from in any::<prop::sample::Index>(), length in 0..40usize, filling in "[\\[\\]=\"., \n0-9a-z@:/-]{0,20}",
    ) {
        parse_and_use(&damaged(KEYS, &from, length, &filling));
    }

    #[test]
    fn no_address_panics(address in "\\PC{0,60}") {
        let quoted = format!("{address:?}");
        parse_and_use(&KEYS.replace("\"Tracker0@tcp://lab-1:3884\"", &quoted));
        parse_and_use(&KEYS.replace("\"127.0.0.1:9000\"", &quoted));
    }

    #[test]
    fn no_number_panics(number in any::<f64>(), which in 0..6usize) {
        let old = ["0.01 }", "1.5", "-0.1]", "0.05", "= 0.02", "= 0.1,"][which];
        let kept = old.trim_start_matches(|c: char| "-0123456789.".contains(c) || c == '=' || c == ' ');
        let is_after_key = if old.starts_with('=') { "= " } else { "" };
        let text = format!("{number:?}").to_lowercase();
        parse_and_use(&KEYS.replacen(old, &format!("{is_after_key}{text}{kept}"), 1));
    }
}
