//! A sensor whose tracker drops out, jumps, floods, sends wrong times or nonsense.

use super::*;
use crate::stage::tracking::LostPolicy;
use crate::track::device::{DeviceState, Stamp};

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

#[derive(Default)]
struct Device(DeviceState);

impl Device {
    /// Says it where nobody looks yet.
    fn say_unseen(&mut self, arrived_s: f64, value: Isometry3<f64>) {
        self.0.take_pose_at(Stamp { arrived_s, measured_s: None }, 0, value, 1.0);
    }

    fn say(&mut self, follower: &mut Follower, arrived_s: f64, value: Isometry3<f64>) {
        self.say_unseen(arrived_s, value);
        follower.take(&self.0.sensors[&0]);
    }
}

fn at(x: f64) -> Isometry3<f64> {
    Isometry3::translation(x, 1.0, 0.0)
}

#[test]
fn live_then_held_then_lost_and_back_each_said_once() {
    let (mut follower, mut device) = (follower(0.0), Device::default());
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
    let (mut follower, mut device) = (follower(0.02), Device::default());
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
    let (mut follower, mut device) = (follower(0.0), Device::default());
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
    let (mut follower, mut device) = (follower(0.05), Device::default());
    device.say(&mut follower, 0.0, at(0.0));
    let zero = nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0);
    let nan = nalgebra::Quaternion::new(f64::NAN, 0.0, 0.0, 0.0);
    let bad = [
        Isometry3::translation(f64::NAN, 0.0, 0.0),
        Isometry3::translation(0.0, f64::INFINITY, 0.0),
        Isometry3::translation(0.0, 0.0, 1e30),
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::new_unchecked(zero)),
        Isometry3::from_parts(Translation3::identity(), UnitQuaternion::new_unchecked(nan)),
    ];
    for (count, value) in (2..).zip(bad) {
        // A device that lets such a thing through.
        let (before, flow) = (None, Default::default());
        follower.take(&Reading {
            value,
            arrived_s: 0.01,
            before,
            measured_s: None,
            quality: 1.0,
            count,
            flow,
        });
        assert_eq!(follower.pose(0.02).0, Some(at(0.0)));
    }
    assert_eq!(follower.faults.invalid, 5);
}

#[test]
fn a_thousand_readings_at_one_instant_give_a_finite_pose() {
    let (mut follower, mut device) = (follower(0.1), Device::default());
    for i in 0..1000 {
        device.say(&mut follower, 1.0, at(0.01 * f64::from(i % 7)));
    }
    let pose = follower.pose(1.01).0.unwrap();
    assert!(pose.translation.vector.norm() < 3.5, "{pose}");
}

#[test]
fn prediction_looks_ahead_of_now_by_what_was_asked() {
    let (mut follower, mut device) = (follower(0.03), Device::default());
    for i in 0..50 {
        device.say(&mut follower, f64::from(i) * 0.01, at(f64::from(i) * 0.005));
    }
    // 0.5 m/s; the last reading is of 0.49 s, now is 0.495 s, shown is 0.525 s.
    let x = follower.pose(0.495).0.unwrap().translation.x;
    assert!((x - 0.5 * 0.525).abs() < 1e-12, "{x}");
}

/// The poses of a follower that looks `fps` times a second at a device of `rate` readings a second, each with the newest reading.
fn seldom(fps: f64, rate: f64, hand: impl Fn(f64) -> Isometry3<f64>) -> (Follower, Vec<[Isometry3<f64>; 2]>) {
    let (mut follower, mut device) = (follower(0.0), Device::default());
    let (mut said, mut shown) = (0_u32, Vec::new());
    for frame in 1..=(5.0 * fps) as u32 {
        let now_s = f64::from(frame) / fps;
        while f64::from(said) / rate <= now_s {
            device.say_unseen(f64::from(said) / rate, hand(f64::from(said) / rate));
            said += 1;
        }
        let reading = device.0.sensors[&0];
        follower.take(&reading);
        shown.push([follower.pose(now_s).0.unwrap(), reading.value]);
    }
    (follower, shown)
}

#[test]
fn frames_slower_than_the_policy_for_gaps_freeze_nothing() {
    for (fps, rate) in [(3.9, 60.0), (1.0, 100.0), (10.0, 10.0), (3.9, 1000.0)] {
        let (follower, shown) = seldom(fps, rate, |time_s| at(0.2 * time_s));
        for [shown, truth] in shown {
            assert!((shown.translation.vector - truth.translation.vector).norm() < 1e-9, "{fps} Hz: {shown}");
        }
        assert_eq!(follower.faults, SensorFaults::default(), "{fps} Hz");
    }
}

#[test]
fn a_hand_that_turns_fast_does_not_jump_at_ten_frames_a_second() {
    for (fps, rate) in [(10.0, 100.0), (60.0, 10.0), (10.0, 60.0)] {
        let turn = |time_s: f64| Isometry3::rotation(Vector3::y() * 15.0 * time_s);
        let (follower, shown) = seldom(fps, rate, turn);
        assert_eq!(follower.faults.jumps, 0, "{fps} frames, {rate} readings a second");
        for [shown, truth] in shown {
            assert!(shown.rotation.angle_to(&truth.rotation) < 1e-6, "{fps}, {rate}: {shown}");
        }
    }
}

#[test]
fn one_wrong_reading_is_not_shown_by_slow_frames_either() {
    let flip = Isometry3::new(Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.0, std::f64::consts::PI, 0.0));
    // The frames are at 0.1 s, 0.2 s, …; each 100th reading is wrong, and is the one that the frame sees.
    let hand = |time_s: f64| if (time_s * 100.0).round() % 100.0 == 50.0 { flip } else { at(0.0) };
    let (follower, shown) = seldom(10.0, 100.0, hand);
    assert!(shown.iter().any(|[_, said]| *said == flip));
    assert!(shown.iter().all(|[shown, _]| shown.rotation.angle() < 1e-9), "{:?}", follower.faults);
}

#[test]
fn what_was_predicted_goes_back_to_the_last_measured_pose_and_stays_there() {
    let (mut follower, mut device) = (follower(0.05), Device::default());
    for i in 0..50 {
        device.say(&mut follower, f64::from(i) * 0.01, at(f64::from(i) * 0.01));
    }
    // 1 m/s; the last reading is of 0.49 s.
    let mut last = follower.pose(0.59).0.unwrap().translation.x;
    assert!((last - 0.59).abs() < 1e-9, "carried on by a tenth of a second at most: {last}");
    for i in 60..200 {
        let x = follower.pose(f64::from(i) * 0.01).0.unwrap().translation.x;
        assert!(x <= last + 1e-12 && last - x < 0.01, "from {last} to {x}");
        last = x;
    }
    assert!((last - 0.49).abs() < 1e-12, "{last}");
    assert!(matches!(follower.signal, Signal::Held { .. }));
}

#[test]
fn a_bridge_that_runs_is_not_begun_anew() {
    let (mut follower, mut device) = (follower(0.0), Device::default());
    follower.sensor.lost.after_s = 0.02;
    for i in 0..400 {
        let now_s = f64::from(i) * 0.01;
        if i % 10 == 0 {
            device.say(&mut follower, now_s, at(0.2 * now_s));
        }
        let x = follower.pose(now_s).0.unwrap().translation.x;
        assert!((x - 0.2 * now_s).abs() < 0.05, "{now_s} s: {x}");
    }
}
