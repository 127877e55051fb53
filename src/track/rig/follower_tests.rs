//! A sensor whose tracker drops out, jumps, floods, lies about the time or sends nonsense.

use super::*;
use crate::stage::tracking::LostPolicy;

fn follower(predict_s: f64) -> Follower {
    let sensor = Sensor {
        tracker: "t".into(),
        id: 0,
        sensor_from_body: Isometry3::identity(),
        filter: None,
        predict_s,
        lost: LostPolicy { after_s: 0.25, warn_s: 2.0 },
    };
    Follower::new(sensor, TrackerFrame::default(), 0.0)
}

struct Device {
    count: u64,
}

impl Device {
    fn say(&mut self, follower: &mut Follower, arrived_s: f64, value: Isometry3<f64>) {
        self.count += 1;
        let (count, flow) = (self.count, Default::default());
        follower.take(&Reading { value, arrived_s, measured_s: None, quality: 1.0, count, flow });
    }
}

fn at(x: f64) -> Isometry3<f64> {
    Isometry3::translation(x, 1.0, 0.0)
}

#[test]
fn live_then_held_then_lost_and_back_each_said_once() {
    let (mut follower, mut device) = (follower(0.0), Device { count: 0 });
    assert_eq!(follower.pose(0.0), (None, None));
    device.say(&mut follower, 0.1, at(0.5));
    assert_eq!(follower.pose(0.2), (Some(at(0.5)), None));
    assert_eq!(follower.signal, Signal::Live);
    let mut events = Vec::new();
    for i in 0..100 {
        let now_s = 0.2 + f64::from(i) * 0.05;
        let (pose, event) = follower.pose(now_s);
        assert_eq!(pose, Some(at(0.5)), "held at {now_s}");
        events.extend(event);
    }
    assert!(matches!(events[..], [Event::Lost { age_s }] if age_s > 2.0 && age_s < 2.1), "{events:?}");
    assert_eq!(follower.faults.drop_outs, 1);
    device.say(&mut follower, 6.0, at(0.6));
    let (pose, event) = follower.pose(6.0);
    assert!(matches!(event, Some(Event::Back { gap_s }) if gap_s > 4.0), "{event:?}");
    assert_eq!(pose, Some(at(0.5)), "it starts where it was held");
    assert_eq!(follower.pose(6.2), (Some(at(0.6)), None), "and glides");
}

#[test]
fn one_that_was_never_heard_of_is_said_once() {
    let mut follower = follower(0.0);
    let events: Vec<Event> = (0..200).filter_map(|i| follower.pose(f64::from(i) * 0.05).1).collect();
    assert!(matches!(events[..], [Event::Lost { .. }]), "{events:?}");
}

#[test]
fn one_wrong_reading_is_never_seen() {
    let (mut follower, mut device) = (follower(0.02), Device { count: 0 });
    for i in 0..200 {
        let now_s = f64::from(i) * 0.01;
        let wrong = i == 100 || i == 130;
        let flip = Isometry3::new(Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.0, std::f64::consts::PI, 0.0));
        device.say(&mut follower, now_s, if wrong { flip } else { at(0.0) });
        let pose = follower.pose(now_s).0.unwrap();
        assert!((pose.translation.vector - at(0.0).translation.vector).norm() < 1e-12);
        assert!(pose.rotation.angle() < 1e-12, "{i}: {pose}");
    }
    assert_eq!(follower.faults.jumps, 2);
}

#[test]
fn a_jump_that_stands_is_believed_and_glided_to_even_if_nothing_more_is_said() {
    let (mut follower, mut device) = (follower(0.0), Device { count: 0 });
    device.say(&mut follower, 0.00, at(0.0));
    device.say(&mut follower, 0.01, at(3.0));
    assert_eq!(follower.pose(0.05).0, Some(at(0.0)));
    let mut last = 0.0;
    for i in 0..60 {
        let now_s = 0.05 + f64::from(i) * 0.01;
        let x = follower.pose(now_s).0.unwrap().translation.x;
        assert!(x - last <= 0.26 && x >= last, "from {last} to {x} in 10 ms");
        last = x;
    }
    assert_eq!(last, 3.0);
}

#[test]
fn nonsense_is_counted_and_the_last_pose_stands() {
    let (mut follower, mut device) = (follower(0.05), Device { count: 0 });
    device.say(&mut follower, 0.0, at(0.0));
    let zero = nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0);
    let nan = nalgebra::Quaternion::new(f64::NAN, 0.0, 0.0, 0.0);
    for bad in [
        Isometry3::translation(f64::NAN, 0.0, 0.0),
        Isometry3::translation(0.0, f64::INFINITY, 0.0),
        Isometry3::translation(0.0, 0.0, 1e30),
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::new_unchecked(zero)),
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::new_unchecked(nan)),
    ] {
        device.say(&mut follower, 0.01, bad);
        assert_eq!(follower.pose(0.02).0, Some(at(0.0)));
    }
    assert_eq!(follower.faults.invalid, 5);
}

#[test]
fn a_thousand_readings_at_one_instant_give_a_finite_pose() {
    let (mut follower, mut device) = (follower(0.1), Device { count: 0 });
    for i in 0..1000 {
        device.say(&mut follower, 1.0, at(0.01 * f64::from(i % 7)));
    }
    let pose = follower.pose(1.01).0.unwrap();
    assert!(pose.translation.vector.norm() < 3.5, "{pose}");
}

#[test]
fn prediction_looks_ahead_of_now_by_what_was_asked() {
    let (mut follower, mut device) = (follower(0.03), Device { count: 0 });
    for i in 0..50 {
        device.say(&mut follower, f64::from(i) * 0.01, at(f64::from(i) * 0.005));
    }
    // 0.5 m/s; the last reading is of 0.49 s, now is 0.495 s, shown is 0.525 s.
    let x = follower.pose(0.495).0.unwrap().translation.x;
    assert!((x - 0.5 * 0.525).abs() < 1e-12, "{x}");
}
