//! Tracking keys: what is read, and what is refused with line and remedy.

use super::*;
use crate::stage::tracking::{Axis, ButtonId, LostPolicy, OneEuro, TrackerFrame};
use crate::stage::{BUILT_IN, Survey, survey};
use nalgebra::{Isometry3, Matrix3, Vector3};
use std::path::Path;

const KEYS: &str = r#"
[tracker.polhemus]
vrpn = "Tracker0@192.168.1.5"
room_from_tracker = { position = [0.1, 0.2, 0.3], axes = [[1, 0, 0], [0, 0, 2.0], [0, -3, 0]], scale = 0.01 }
[tracker.art]
dtrack = "5000"
[tracker.pad]
gamepad = "/dev/input/js0"
[sensor.head]
tracker = "polhemus"
id = 0
filter = { min_cutoff = 1.0, beta = 0.05 }
predict = 0.02
[sensor.wand]
tracker = "art"
id = 100
sensor_from_body = { position = [0, 0, -0.1], rotation = [0, 1.5707963267948966, 0] }
lost = { after = 0.1, warn = 1.0 }
[stylus.right]
sensor = "wand"
grab = { tracker = "pad", button = 0 }
second = { tracker = "art", button = 1 }
"#;

fn parse(keys: &str, head: &str) -> Result<Tracking, String> {
    let text = BUILT_IN[0].1.replace("ipd = 0.064", &format!("ipd = 0.064\n{head}"));
    let text = format!("{text}{keys}");
    Stage::parse(&text, Path::new("bench.toml"))
        .and_then(checked)
        .map(|stage| stage.tracking)
        .map_err(|error| error.to_string())
}

/// The error for [`KEYS`] with one piece replaced; it must name the line of `table`.
fn refusal(from: &str, to: &str, table: &str) -> String {
    assert!(KEYS.contains(from), "`{from}` is not in the keys");
    let keys = KEYS.replacen(from, to, 1);
    let error = parse(&keys, "head = \"head\"").unwrap_err();
    let before = BUILT_IN[0].1.lines().count() + 1;
    let line = before + keys.lines().position(|line| line.contains(table)).unwrap() + 1;
    assert!(error.starts_with(&format!("bench.toml:{line}:")), "line {line}? {error}");
    error
}

#[test]
fn keys_are_read() {
    let tracking = parse(KEYS, "head = \"head\"").unwrap();
    assert_eq!(tracking.head.as_deref(), Some("head"));
    assert_eq!(tracking.trackers.keys().collect::<Vec<_>>(), ["polhemus", "art", "pad"]);
    assert_eq!(tracking.trackers["polhemus"].source.to_string(), "vrpn Tracker0@192.168.1.5");
    assert_eq!(tracking.trackers["art"].source.to_string(), "dtrack 5000");
    let head = &tracking.sensors["head"];
    assert_eq!((head.id, head.predict_s, head.lost), (0, 0.02, LostPolicy { after_s: 0.25, warn_s: 2.0 }));
    assert_eq!(head.filter, Some(OneEuro { min_cutoff: 1.0, beta: 0.05, speed_cutoff: 1.0 }));
    let wand = &tracking.sensors["wand"];
    assert!((wand.sensor_from_body.rotation * Vector3::x() + Vector3::z()).norm() < 1e-12);
    let stylus = &tracking.styli["right"];
    assert_eq!(stylus.grab, Some(ButtonId { tracker: "pad".into(), button: 0 }));
    // Centimetres; the tracker's y is the room's z, its z points down.
    let pose = Isometry3::translation(10.0, 20.0, 30.0);
    let place = tracking.trackers["polhemus"].frame.room_from_sensor(&pose).translation.vector;
    assert!((place - Vector3::new(0.2, -0.1, 0.5)).norm() < 1e-12, "{place}");
    assert_eq!(parse("", "").unwrap(), Tracking::default());
}

#[test]
fn a_mirrored_frame_gives_proper_rotations() {
    let frame = TrackerFrame { mirror: Some(Axis::Z), ..Default::default() };
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let pose = Isometry3::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, -0.7, 1.1));
    let room = frame.room_from_sensor(&pose);
    let expected = mirror * pose.rotation.to_rotation_matrix().matrix() * mirror;
    assert!((room.rotation.to_rotation_matrix().matrix() - expected).norm() < 1e-12);
    assert_eq!(room.translation.vector, Vector3::new(1.0, 2.0, -3.0));
}

#[test]
fn axes_are_straightened_to_the_nearest_rotation_half_turns_too() {
    let turned = |axes: &str| {
        let keys = format!("[tracker.t]\nosc = \"9000\"\nroom_from_tracker = {{ axes = {axes} }}\n");
        parse(&keys, "").unwrap().trackers["t"].frame.room_from_tracker.isometry.rotation
    };
    let half = turned("[[-1, 0, 0], [0, 1, 0], [0, 0, -1]]");
    assert!((half * Vector3::x() + Vector3::x()).norm() < 1e-12, "{half}");
    // x and y are 2° too near to each other: each gives way by one.
    let (s, c) = 2f64.to_radians().sin_cos();
    let skewed = turned(&format!("[[1, 0, 0], [{s}, {c}, 0], [0, 0, 1]]"));
    assert!((skewed.angle().to_degrees() - 1.0).abs() < 1e-9 && skewed.scaled_axis().z < 0.0, "{skewed}");
}

#[test]
fn unknown_names_are_answered_with_the_nearest() {
    let error = refusal("tracker = \"art\"\nid", "tracker = \"arts\"\nid", "[sensor.wand]");
    assert!(error.contains("sensor `wand`: unknown tracker \"arts\""), "{error}");
    assert!(error.contains("mean \"art\"?"), "{error}");
    let error = refusal("sensor = \"wand\"", "sensor = \"wond\"", "[stylus.right]");
    assert!(error.contains("unknown sensor \"wond\"") && error.contains("mean \"wand\"?"), "{error}");
    let error = refusal("tracker = \"pad\"", "tracker = \"pat\"", "[stylus.right]");
    assert!(error.contains("mean \"pad\"?"), "{error}");
    let error = parse(KEYS, "head = \"haed\"").unwrap_err();
    assert!(error.contains("the viewer's head: unknown sensor \"haed\""), "{error}");
    assert!(error.contains("\"head\"?"), "{error}");
    let error = parse("[sensor.a]\ntracker = \"b\"\nid = 0\nfiltre = {}\n", "").unwrap_err();
    assert!(error.contains("did you mean `filter`?"), "{error}");
}

#[test]
fn clashes_are_named() {
    let error = refusal("tracker = \"art\"\nid = 100", "tracker = \"polhemus\"\nid = 0", "[sensor.wand]");
    assert!(error.contains("`head` and `wand` are both number 0 of tracker `polhemus`"), "{error}");
    let error = refusal(
        "[tracker.pad]\n",
        "[tracker.art2]\nosc = \"0.0.0.0:5000\"\n[tracker.pad]\n",
        "[tracker.art2]",
    );
    assert!(error.contains("`art` and `art2` both use port 5000"), "{error}");
    let two = |first: &str, second: &str| {
        parse(&format!("[tracker.a]\ndtrack = \"{first}:6000\"\n[tracker.b]\nosc = \"{second}:6000\"\n"), "")
    };
    assert!(two("192.168.1.5", "10.0.0.5").is_ok(), "two addresses of one machine");
    for (first, second) in [("10.0.0.5", "10.0.0.5"), ("10.0.0.5", "0.0.0.0"), ("0.0.0.0", "10.0.0.5")] {
        assert!(two(first, second).is_err(), "{first} and {second}");
    }
    let error =
        refusal("{ tracker = \"pad\", button = 0 }", "{ tracker = \"art\", button = 1 }", "[stylus.right]");
    assert!(error.contains("`grab` and `second` of stylus `right` are the same button"), "{error}");
    let error =
        refusal("[stylus.right]\n", "[stylus.left]\nsensor = \"wand\"\n[stylus.right]\n", "[stylus.right]");
    assert!(error.contains("`left` and `right` both follow sensor `wand`"), "{error}");
}

#[test]
fn kinds_and_addresses_are_checked() {
    for (from, to, part) in [
        ("dtrack = \"5000\"", "", "none of them"),
        ("dtrack = \"5000\"", "dtrack = \"5000\"\nosc = \"9000\"", "has dtrack and osc"),
        ("dtrack = \"5000\"", "dtrak = \"5000\"", "did you mean \"dtrack\"?"),
        (
            "dtrack = \"5000\"",
            "dtrack = 5000",
            "tracker `art`: invalid type: integer `5000`, expected a string",
        ),
        ("dtrack = \"5000\"", "dtrack = \"70000\"", "(this machine)"),
        (
            "dtrack = \"5000\"",
            "dtrack = \"5000\"\ninterface = \"10.0.0.5\"",
            "`interface` of tracker `art` goes with `an IPv4 multicast",
        ),
        ("dtrack = \"5000\"", "dtrack = \"bench:5000\"", "127.0.0.1:5000"),
        (
            "dtrack = \"5000\"",
            "dtrack = \"5000\"\nbaud = 9600",
            "`baud` of tracker `art` goes with `fastrak`",
        ),
        ("dtrack = \"5000\"", "fastrak = \"\"", "give the device's path"),
        ("dtrack = \"5000\"", "fastrak = \"/dev/ttyS0\"\nbaud = 1", "baud is 1"),
        ("dtrack = \"5000\"", "vrpn = \"Tracker0\"", "names no device"),
        ("dtrack = \"5000\"", "vrpn = \"@host\"", "the device's name"),
        ("dtrack = \"5000\"", "vrpn = \"T@ho st\"", "the host is no name"),
        ("dtrack = \"5000\"", "vrpn = \"T@host:0\"", "the port is no number from 1"),
        ("dtrack = \"5000\"", "vrpn = \"tcp://host/T\"\ntransport = \"lob\"", "says lob"),
    ] {
        let error = refusal(from, to, "[tracker.art]");
        assert!(error.contains(part), "{to}: {error}");
    }
}

#[test]
fn sensors_and_buttons_that_a_tracker_never_reports_are_refused() {
    for (from, to, table, part) in [
        ("\"art\"\nid = 100", "\"pad\"\nid = 0", "[tracker.pad]", "tracker `pad` (gamepad) has no sensors"),
        (
            "dtrack = \"5000\"",
            "osc = \"9000\"",
            "[tracker.art]",
            "has id = 100, and tracker `art` (osc) has the sensors 0 to 8",
        ),
        (
            "gamepad = \"/dev/input/js0\"",
            "osc = \"9000\"",
            "[tracker.pad]",
            "button of tracker `pad` (osc), which has none",
        ),
    ] {
        let error = refusal(from, to, table);
        assert!(error.contains(part), "{to}: {error}");
    }
}

#[test]
fn numbers_out_of_range_and_axes_that_are_no_rotation_are_refused() {
    for (from, to, table, part) in [
        ("min_cutoff = 1.0", "min_cutoff = 0", "[sensor.head]", "filter.min_cutoff of sensor `head` is 0"),
        ("beta = 0.05", "beta = -1", "[sensor.head]", "filter.beta of sensor `head` is -1"),
        ("predict = 0.02", "predict = 20", "[sensor.head]", "seconds between 0 and 0.1"),
        ("after = 0.1, warn = 1.0", "after = 2, warn = 1", "[sensor.wand]", "swap them"),
        ("after = 0.1", "after = nan", "[sensor.wand]", "lost.after of sensor `wand` is NaN"),
        ("[0, 0, -0.1]", "[0, 0, 1e9]", "[sensor.wand]", "`position` in sensor_from_body of sensor `wand`"),
        (
            "[0, 1.5707963267948966, 0]",
            "[0, 90, 0]",
            "[sensor.wand]",
            "is 90: it must be a number of radians",
        ),
        (
            "scale = 0.01",
            "scale = 0",
            "[tracker.polhemus]",
            "scale in room_from_tracker of tracker `polhemus` is 0",
        ),
        ("[0, -3, 0]", "[0, 3, 0]", "[tracker.polhemus]", "the axes are left-handed"),
        ("[0, -3, 0]", "[0, -3, 1]", "[tracker.polhemus]", "the axes y and z meet at 71.6°"),
        ("[0, -3, 0]", "[0, 0, 0]", "[tracker.polhemus]", "the z axis has no length"),
        ("scale = 0.01", "rotation = [0, 0, 0]", "[tracker.polhemus]", "keep one"),
    ] {
        let error = refusal(from, to, table);
        assert!(error.contains(part), "{to}: {error}");
    }
}

#[test]
fn every_fault_of_tracking_is_told_and_none_that_follows_from_another() {
    let keys = "[tracker.a]\nvrpn = \"\"\n[tracker.b]\n[sensor.head]\ntracker = \"a\"\nid = 0\n[sensor.wand]\n\
                tracker = \"a\"\nid = 1\npredict = 5\n[stylus.right]\nsensor = \"wand\"\n[stylus.left]\n\
                sensor = \"hand\"\n";
    let text = BUILT_IN[0].1.replace("ipd = 0.064", "ipd = 0.064\nhead = \"head\"") + keys;
    let survey = survey(&text, Path::new("bench.toml")).unwrap();
    let Survey { stage, tracking, faults } = survey;
    let told: Vec<String> =
        source_faults(&tracking).chain(faults).map(|located| located.fault.to_string()).collect();
    let expected =
        ["`vrpn` of tracker `a`", "tracker `b` has none", "predict of sensor `wand`", "stylus `left`: "];
    assert_eq!(told.len(), expected.len(), "{told:#?}");
    assert!(told.iter().zip(expected).all(|(told, part)| told.contains(part)), "{told:#?}");
    let lints = crate::stage::lint(&stage.unwrap(), &[]);
    assert!(!lints.iter().any(|lint| lint.place == "viewer.head"), "the head has a sensor: {lints:#?}");
}
