//! A tracker that dies, floods, sends nonsense, jumps or lies about the time, while a hand holds a body.

use super::*;
use crate::deform::{CATCH_UP, STRETCH};
use crate::track::device::{DeviceState, Link, Reading, Stamp};
use crate::track::{FakeSource, TrackerSet};
use crate::world::Highlight;
use nalgebra::UnitQuaternion;
use std::ops::Range;

const KEYS: &str = r#"
[tracker.t]
osc = "0"
[sensor.wand]
tracker = "t"
id = 0
[stylus.right]
sensor = "wand"
grab = { tracker = "t", button = 0 }
"#;

/// The frame from which on the button is pressed.
const PRESS: usize = 30;
const FRAMES: usize = 330;

/// The end of the block as it is in one frame.
#[derive(Clone, Copy, Debug)]
struct Frame {
    pose: ControlPose,
    held: bool,
}

fn stamp(arrived_s: f64, measured_s: f64) -> Stamp {
    Stamp { arrived_s, measured_s: Some(measured_s) }
}

/// Sixty frames a second: a hand takes the block's end and swings it up and down by a tenth of its length; in the frames of
/// `when`, `fault` makes the tracker's report. `keys` are the sensor's further keys.
fn play(
    keys: &str,
    when: Range<usize>,
    fault: impl Fn(f64, &Isometry3<f64>, &mut DeviceState),
) -> Vec<Frame> {
    let mut world = world();
    let text = crate::stage::BUILT_IN[0].1;
    let file = format!("{text}{}", KEYS.replace("id = 0\n", &format!("id = 0\n{keys}\n")));
    let tracking = Stage::parse(&file, Path::new("bench.toml")).unwrap().tracking;
    let source = FakeSource::default();
    let mut trackers = TrackerSet::with_sources(&tracking, vec![Box::new(source.clone())], 0.0);
    let mut frames: Vec<Frame> = Vec::new();
    for i in 0..FRAMES {
        let time_s = i as f64 / 60.0;
        let y = 0.2 * (2.0 * time_s).sin();
        let hand: Isometry3<f64> =
            state(&world, [1.5, y, 0.1], [0.0, y, 0.1], false).styli[0].room_from_stylus.cast();
        source.change(|device| {
            if when.contains(&i) {
                fault(time_s, &hand, device);
            } else {
                device.take_pose_at(stamp(time_s, 1000.0 + time_s), 0, hand, 1.0);
            }
            device.link = Link::Up;
            device.take_button(0, i >= PRESS, None);
        });
        world.step(&trackers.state(time_s).into());
        frames.push(check(&world, frames.last()));
    }
    frames
}

/// Checks what holds in every frame, whatever the tracker reports.
fn check(world: &World, last: Option<&Frame>) -> Frame {
    let body = &world.bodies[0];
    assert!(
        body.deformer.positions().iter().flatten().all(|x| x.is_finite()),
        "a picture of what is not finite"
    );
    let pose = body.deformer.poses[1];
    let stretches = pose.matrix.singular_values();
    assert!(stretches.iter().all(|s| (STRETCH[0] - 1e-9..=STRETCH[1] + 1e-9).contains(s)), "{stretches}");
    if let Some(last) = last {
        let turn = turn_between(&last.pose, &pose);
        assert!(turn < 2.0 * CATCH_UP, "turned by {}° in one frame", turn.to_degrees());
    }
    Frame { pose, held: world.frame.bodies[0].highlights[1] == Highlight::Held }
}

/// The turn between two poses, from the trace, as nothing here scales: exact at half a turn too.
fn turn_between(a: &ControlPose, b: &ControlPose) -> f64 {
    let cosine = ((a.matrix.transpose() * b.matrix).trace() - 1.0) / 2.0;
    cosine.clamp(-1.0, 1.0).acos()
}

fn largest_step_m(frames: &[Frame]) -> f64 {
    frames.windows(2).map(|w| (w[1].pose.translation - w[0].pose.translation).norm()).fold(0.0, f64::max)
}

/// The end of the block never went further in a frame, m; the hand goes 7 mm.
fn goes_no_further_than(limit_m: f64, frames: &[Frame]) {
    let step_m = largest_step_m(frames);
    println!("largest step {step_m:.4} m");
    assert!(step_m < limit_m, "it jumped by {step_m} m, of a block of 2 m");
}

/// The largest distance of the end from where it is without a fault, m; and the largest turn against it.
fn off(a: &[Frame], b: &[Frame]) -> [f64; 2] {
    a.iter().zip(b).fold([0.0; 2], |[off, turn], (a, b)| {
        [
            f64::max(off, (a.pose.translation - b.pose.translation).norm()),
            f64::max(turn, turn_between(&a.pose, &b.pose)),
        ]
    })
}

fn clean() -> Vec<Frame> {
    let frames = play("", 0..0, |_, _, _| {});
    assert!(frames[PRESS + 1..].iter().all(|frame| frame.held));
    let reach = frames.iter().map(|frame| frame.pose.translation.norm()).fold(0.0, f64::max);
    assert!(reach > 0.2, "it is carried: {reach} m");
    goes_no_further_than(0.0075, &frames);
    frames
}

#[test]
fn a_tracker_that_dies_holds_and_then_lets_go() {
    let frames = play("", 90..270, |_, _, _| {});
    goes_no_further_than(0.0075, &frames);
    let held = frames[89].pose.translation;
    for (i, frame) in frames.iter().enumerate().skip(90) {
        assert!((frame.pose.translation - held).norm() < 1e-9, "frame {i}: it stays where it was");
    }
    // The last reading is of frame 89; 2 s later it is given up.
    assert!(frames[89 + 119].held && !frames[89 + 121].held);
    assert!(frames[270..].iter().all(|frame| !frame.held), "back, but the button was never released");
}

#[test]
fn a_tracker_that_is_back_in_time_glides_to_the_hand() {
    let clean = clean();
    let frames = play("", 90..150, |_, _, _| {});
    assert!(frames[PRESS + 1..].iter().all(|frame| frame.held), "one second is held through");
    let [off_m, _] = off(&frames[165..], &clean[165..]);
    assert!(off_m < 1e-6, "a quarter of a second later it is where the hand is: {off_m} m off");
    goes_no_further_than(0.08, &frames);
}

#[test]
fn a_flood_is_followed_by_its_newest_pose() {
    let clean = clean();
    let frames = play("", 90..150, |time_s, hand, device| {
        for i in 0..1000 {
            let arrived_s = time_s - 1e-5 * f64::from(999 - i);
            device.take_pose_at(stamp(arrived_s, 1000.0 + arrived_s), 0, *hand, 1.0);
        }
    });
    let [off_m, turn] = off(&frames, &clean);
    assert!(off_m < 1e-9 && turn < 1e-4, "{off_m} m, {turn} rad");
    goes_no_further_than(0.0075, &frames);
}

#[test]
fn a_flood_with_filter_and_prediction_stays_near_the_hand() {
    let clean = clean();
    let keys = "filter = { min_cutoff = 1.0, beta = 5.0 }\npredict = 0.03";
    let frames = play(keys, 90..150, |time_s, hand, device| {
        // All at one instant, and none of them quite where the hand is.
        for i in 0..200 {
            let mut pose = *hand;
            pose.translation.x += 1e-3 * f64::from(i % 3);
            device.take_pose_at(stamp(time_s, 1000.0 + time_s), i32::from(i % 2 == 0), pose, 1.0);
        }
    });
    let [off_m, turn] = off(&frames[90..], &clean[90..]);
    println!("{off_m:.4} m and {turn:.4} rad off");
    goes_no_further_than(0.05, &frames);
    assert!(off_m < 0.15 && turn < 0.1, "{off_m} m, {turn} rad");
}

#[test]
fn nonsense_holds_the_last_pose() {
    let clean = clean();
    let frames = play("predict = 0.05", 90..150, |time_s, hand, device| {
        let bad = [f64::NAN, f64::INFINITY, 1e300, -1e30];
        let bad = bad[(time_s * 60.0) as usize % bad.len()];
        let mut pose = *hand;
        pose.translation.y = bad;
        device.take_pose_at(stamp(time_s, bad), 0, pose, 1.0);
        // And past the first check, as a source with an error would.
        let count = device.sensors[&0].count + 1;
        let rotation = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(bad, 0.0, 0.0, 0.0));
        let value = Isometry3::from_parts(hand.translation, rotation);
        let flow = Default::default();
        let before = None;
        let wrong = Reading { value, arrived_s: time_s, before, measured_s: None, quality: 1.0, count, flow };
        device.sensors.insert(0, wrong);
    });
    assert!(frames[PRESS + 1..].iter().all(|frame| frame.held));
    goes_no_further_than(0.05, &frames);
    // Live for a quarter of a second, then back within a fifth of one from what was predicted to what was measured last.
    let held = frames[118].pose.translation;
    for (i, frame) in frames[118..150].iter().enumerate() {
        let off_m = (frame.pose.translation - held).norm();
        assert!(off_m < 1e-9, "frame {}: {off_m} m", 118 + i);
    }
    // The hand took hold where it was predicted to be, 0.05 s on at 0.4 cos(1) / 0.95 m/s.
    let ahead_m = clean[89].pose.translation.y - held.y;
    assert!((ahead_m - 0.0114).abs() < 0.0015, "{ahead_m} m");
}

#[test]
fn half_a_turn_in_single_frames_is_not_seen() {
    let clean = clean();
    let frames = play("", 90..150, |time_s, hand, device| {
        let flip = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, std::f64::consts::PI, 0.0));
        let is_flipped = (time_s * 60.0).round() as i64 % 4 == 0;
        let pose =
            if is_flipped { Isometry3::from_parts(hand.translation, flip * hand.rotation) } else { *hand };
        device.take_pose_at(stamp(time_s, 1000.0 + time_s), 0, pose, 1.0);
    });
    let [off_m, turn] = off(&frames, &clean);
    assert!(off_m < 2.0 * largest_step_m(&clean) && turn < 1e-4, "{off_m} m, {turn} rad");
    goes_no_further_than(0.016, &frames);
}

#[test]
fn half_a_turn_that_stays_is_glided_to_and_back() {
    let clean = clean();
    let frames = play("", 90..150, |time_s, hand, device| {
        let flip = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, std::f64::consts::PI, 0.0));
        let pose = Isometry3::from_parts(hand.translation, flip * hand.rotation);
        device.take_pose_at(stamp(time_s, 1000.0 + time_s), 0, pose, 1.0);
    });
    goes_no_further_than(0.3, &frames);
    assert!(turn_between(&frames[149].pose, &clean[149].pose) > 3.0, "it stood for a second: it is believed");
    let [off_m, turn] = off(&frames[200..], &clean[200..]);
    assert!(off_m < 1e-6 && turn < 1e-4, "{off_m} m, {turn} rad");
}

#[test]
fn stamps_that_go_back_or_far_ahead_change_nothing() {
    let clean = clean();
    for measured_s in [-1.0, 1e7] {
        let frames = play("predict = 0.02", 90..150, |time_s, hand, device| {
            device.take_pose_at(stamp(time_s, 1000.0 + measured_s * time_s), 0, *hand, 1.0);
        });
        let [off_m, turn] = off(&frames, &clean);
        println!("{measured_s}: {off_m:.4} m off, by prediction");
        goes_no_further_than(0.03, &frames);
        assert!(off_m < 0.02 && turn < 1e-4, "{off_m} m, {turn} rad");
    }
}
