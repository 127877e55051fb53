//! Head, styli and their buttons, from fake sources.

use super::*;
use crate::stage::Stage;
use crate::track::FakeSource;
use crate::track::device::Stamp;
use std::path::Path;

const KEYS: &str = r#"
[tracker.a]
osc = "0"
room_from_tracker = { position = [1.0, 0.0, 0.0] }
[tracker.pad]
gamepad = "/dev/input/js0"
[sensor.head]
tracker = "a"
id = 0
[sensor.wand]
tracker = "a"
id = 1
sensor_from_body = { position = [0.0, 0.0, -0.1] }
[stylus.right]
sensor = "wand"
grab = { tracker = "pad", button = 3 }
"#;

fn tracking(keys: &str) -> Tracking {
    let text = crate::stage::BUILT_IN[0].1.replace("ipd = 0.064", "ipd = 0.064\nhead = \"head\"");
    Stage::parse(&format!("{text}{keys}"), Path::new("a.toml")).unwrap().tracking
}

/// Reports that a test has a fake source make.
impl FakeSource {
    fn pose(&self, id: i32, arrived_s: f64, x: f64) {
        let stamp = Stamp { arrived_s, measured_s: None };
        self.change(|state| state.take_pose_at(stamp, id, Isometry3::translation(x, 1.5, 0.0), 1.0));
    }
    fn button(&self, pressed: bool) {
        self.change(|state| state.take_button(3, pressed, None));
    }
    fn reconnected(&self) {
        self.change(|state| state.counters.reconnects += 1);
    }
    fn link(&self, link: Link) {
        self.change(|state| state.link = link);
    }
}

fn trackers() -> (TrackerSet, FakeSource, FakeSource) {
    trackers_of(KEYS)
}

fn trackers_of(keys: &str) -> (TrackerSet, FakeSource, FakeSource) {
    let (a, pad) = (FakeSource::default(), FakeSource::default());
    [&a, &pad].iter().for_each(|source| source.link(Link::Up));
    let trackers =
        TrackerSet::with_sources(&tracking(keys), vec![Box::new(a.clone()), Box::new(pad.clone())], 0.0);
    (trackers, a, pad)
}

#[test]
fn head_and_stylus_are_where_the_calibration_says() {
    let (mut trackers, a, pad) = trackers();
    let before = trackers.state(0.0);
    assert_eq!(before.head, None, "not seen yet: the static viewer");
    assert!(matches!(before.styli[0].signal, Signal::Lost { .. }));
    a.pose(0, 0.1, 0.5);
    a.pose(1, 0.1, 0.25);
    pad.button(false);
    let state = trackers.state(0.1);
    assert_eq!(state.head.unwrap().translation.vector, nalgebra::Vector3::new(1.5, 1.5, 0.0));
    let stylus = state.styli[0];
    assert_eq!(stylus.room_from_stylus.translation.vector, nalgebra::Vector3::new(1.25, 1.5, -0.1));
    assert_eq!((stylus.pressed, stylus.signal), (false, Signal::Live));
    pad.button(true);
    assert!(trackers.state(0.11).styli[0].pressed);
    let report = trackers.report(0.12);
    assert_eq!(report[0].sensors.len(), 2);
    assert_eq!(report[0].sensors[1].name.as_deref(), Some("wand"));
    assert!(report[1].buttons[0].value);
}

#[test]
fn a_lost_stylus_lets_go_and_takes_hold_again_only_at_a_new_press() {
    let (mut trackers, a, pad) = trackers();
    a.pose(1, 0.0, 0.0);
    pad.button(false);
    trackers.state(0.0);
    trackers.state(0.1);
    pad.button(true);
    assert!(trackers.state(0.11).styli[0].pressed);
    let held = trackers.state(1.0).styli[0];
    assert!(held.pressed && matches!(held.signal, Signal::Held { .. }), "{held:?}");
    let lost = trackers.state(2.5).styli[0];
    assert!(!lost.pressed && matches!(lost.signal, Signal::Lost { .. }), "{lost:?}");
    a.pose(1, 3.0, 0.0);
    assert!(!trackers.state(3.0).styli[0].pressed, "the button was not let go of meanwhile");
    pad.button(false);
    trackers.state(3.1);
    pad.button(true);
    a.pose(1, 3.15, 0.0);
    assert!(trackers.state(3.2).styli[0].pressed);
    let notices = trackers.take_notices();
    let of_wand: Vec<_> = notices.iter().filter(|notice| notice.contains("wand")).collect();
    assert_eq!(of_wand.len(), 2, "{notices:?}");
    assert!(of_wand[0].contains("lets go, and is gone until it is back"), "{notices:?}");
    assert!(of_wand[1].contains(" is back after "), "{notices:?}");
    assert!(trackers.take_notices().is_empty());
}

#[test]
fn a_button_of_a_tracker_that_is_gone_is_released() {
    let (mut trackers, a, pad) = trackers();
    a.pose(1, 0.0, 0.0);
    pad.button(false);
    pad.link(Link::Up);
    trackers.state(0.0);
    trackers.state(0.1);
    pad.button(true);
    assert!(trackers.state(0.11).styli[0].pressed);
    pad.link(Link::Down("unplugged".into()));
    assert!(!trackers.state(0.15).styli[0].pressed);
    trackers.state(0.16);
    let notices = trackers.take_notices();
    assert_eq!(notices, ["tracker pad (fake source) is gone: unplugged; it is tried again"]);
}

/// A stylus whose second button was on an absent tracker could not grab.
#[test]
fn a_button_on_an_absent_tracker_keeps_no_other_from_counting() {
    let second = "second = { tracker = \"a\", button = 3 }\n";
    let (mut trackers, a, pad) = trackers_of(&format!("{KEYS}{second}"));
    a.link(Link::Down("unplugged".into()));
    a.button(true);
    a.pose(1, 0.0, 0.0);
    pad.button(false);
    trackers.state(0.0);
    trackers.state(0.1);
    pad.button(true);
    let stylus = trackers.state(0.11).styli[0];
    assert!(stylus.pressed && !stylus.second);
}

#[test]
fn a_button_that_a_returned_tracker_says_is_down_counts_once_it_was_seen_released() {
    let (mut trackers, a, pad) = trackers();
    let mut is_pressed = |now_s: f64| trackers.state(now_s).styli[0].pressed;
    a.pose(1, 0.0, 0.0);
    pad.button(false);
    assert!(!is_pressed(0.0) && !is_pressed(0.1));
    pad.button(true);
    assert!(is_pressed(0.11));
    // It goes, and comes back with what it said last, or says it a moment later.
    for (link, pressed, now_s) in [
        (Link::Down("gone".into()), true, 0.12),
        (Link::Waiting, true, 0.13),
        (Link::Up, false, 0.14),
        (Link::Up, true, 0.15),
        (Link::Up, true, 0.40),
    ] {
        pad.link(link.clone());
        pad.button(pressed);
        a.pose(1, now_s, 0.0);
        assert!(!is_pressed(now_s), "{link:?} at {now_s} s");
    }
    pad.button(false);
    assert!(!is_pressed(0.41));
    pad.button(true);
    assert!(is_pressed(0.42));
    // Away and back between two frames.
    pad.reconnected();
    assert!(!is_pressed(0.43) && !is_pressed(0.60));
    // It is silent, as a button box is while nobody presses: what is held is held.
    a.pose(1, 0.61, 0.0);
    pad.button(false);
    assert!(!is_pressed(0.61));
    pad.button(true);
    pad.link(Link::Quiet);
    assert!(is_pressed(0.62));
}

#[test]
fn a_sensor_is_placed_in_the_room_before_any_has_a_name() {
    let keys = "[tracker.a]\nosc = \"0\"\nroom_from_tracker = { position = [1.0, 0.0, 0.0] }\n";
    let text = format!("{}{keys}", crate::stage::BUILT_IN[0].1);
    let tracking = Stage::parse(&text, Path::new("a.toml")).unwrap().tracking;
    let a = FakeSource::default();
    let mut trackers = TrackerSet::with_sources(&tracking, vec![Box::new(a.clone())], 0.0);
    a.pose(5, 0.0, 0.5);
    let reports = trackers.report(0.1);
    assert_eq!(reports[0].sensors[0].in_room, Some(Isometry3::translation(1.5, 1.5, 0.0)));
}

#[test]
fn a_dead_sensor_without_a_name_is_not_called_live() {
    let (mut trackers, a, _pad) = trackers();
    a.pose(5, 0.0, 0.0);
    a.pose(5, 0.01, 0.0);
    let mut of_5 = |now_s: f64| {
        let report = trackers.report(now_s);
        let sensor = report[0].sensors.iter().find(|sensor| sensor.id == 5).unwrap();
        (sensor.signal, sensor.faults.drop_outs)
    };
    assert_eq!(of_5(0.1), (Signal::Live, 0));
    assert!(matches!(of_5(1.01), (Signal::Held { age_s }, 1) if (age_s - 1.0).abs() < 1e-9));
    assert!(matches!(of_5(3.0), (Signal::Lost { .. }, 1)));
    a.pose(5, 3.1, 0.0);
    assert_eq!(of_5(3.11), (Signal::Live, 1));
}
