//! The force in the hand: it is that of the body, it does no work by itself, and it goes where it must when the device lies,
//! jumps, vanishes and returns. Nothing here asserts real time.

mod body;
use crate::common;

use common::{coarse_demo, folder};
use greenstage::deform::{ControlPose, ControlPoses, Deformer, find_model};
use greenstage::effect::haptics::grasp::device_from_handle;
use greenstage::effect::haptics::stability::{self, Verdict, boundary};
use greenstage::effect::haptics::tick::{FADE_S, RAMP_S, STALE_S};
use greenstage::effect::haptics::{
    Control, Device, Elastic, ElementHold, Grasp, Hand, HoldConstraint, Loop, Measures, Push, Reading,
    Report, Simulated, thread,
};
use greenstage::green::{self, CUBIC, GreenFile, Requirements, STIFFNESS};
use greenstage::scene::Scene;
use greenstage::solve::Silent;
use greenstage::stage::Haptic;
use nalgebra::{Isometry3, Matrix4, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The coarse demo tube with its handle stiffness.
fn tube() -> Arc<GreenFile> {
    static FILE: OnceLock<Arc<GreenFile>> = OnceLock::new();
    let make = || {
        let scene = Scene::load(&coarse_demo(&folder("haptics-tube"))).unwrap();
        let tube =
            green::precompute(&scene, "tube", &Requirements::new(&[STIFFNESS, CUBIC]), &Silent).unwrap();
        green::opened(&[tube]).unwrap()
    };
    FILE.get_or_init(make).clone()
}

fn deformer(model: &str) -> Deformer {
    Deformer::new(tube(), "tube", find_model(model).unwrap()).unwrap()
}

fn elastic(model: &str) -> Elastic {
    Elastic::from_deformer(&deformer(model)).unwrap()
}

/// Two ends in the hand: the right one turned by `angle` about an oblique axis and moved, the left one a little.
fn bent(angle: f64) -> ControlPoses {
    let turn = |axis: [f64; 3], angle: f64| {
        let axis = nalgebra::Unit::new_normalize(Vector3::from(axis));
        *Rotation3::from_axis_angle(&axis, angle).matrix()
    };
    vec![
        ControlPose {
            translation: Vector3::new(0.01, 0.02, -0.01),
            matrix: turn([1.0, 0.2, 0.1], 0.1 * angle),
        },
        ControlPose {
            translation: Vector3::new(-0.1, 0.15, 0.05) * angle,
            matrix: turn([0.3, -0.4, 1.0], angle),
        },
    ]
}

/// The tube at its place in the room, shrunk and turned, and a stylus that holds its right end from aside.
fn hold(body: &Deformer, grip: u64, poses: &ControlPoses, stylus: &Isometry3<f64>) -> ElementHold {
    let room_from_body = Similarity3::new(Vector3::new(0.3, 1.1, -0.2), Vector3::new(0.1, 0.7, -0.3), 0.4);
    let mut element: Matrix4<f64> = poses[1].matrix.to_homogeneous();
    let place = body.controls[1].origin + poses[1].translation;
    element.fixed_view_mut::<3, 1>(0, 3).copy_from(&place);
    ElementHold {
        grip,
        body: 0,
        element: 1,
        room_from_body,
        constraint: HoldConstraint::Rigid(
            stylus.inverse().to_homogeneous() * room_from_body.to_homogeneous() * element,
        ),
    }
}

fn stylus() -> Isometry3<f64> {
    Isometry3::new(Vector3::new(0.5, 1.2, 0.1), Vector3::new(0.4, -0.2, 1.0))
}

/// Fingers on a pen, and the wrist fast: the stylus hardly turns.
const FIST: Hand = Hand { rotational_stiffness: 10.0, rotational_damping: 0.05, ..Hand::FINGERS };

/// A loop on the tube in a simulated device's hand, in virtual time.
struct Bench {
    control: Control,
    device: Simulated,
    grasp: Grasp,
    time_s: f64,
}

impl Bench {
    fn new(haptic: Haptic, model: &str) -> Bench {
        let body = deformer(model);
        let poses = vec![ControlPose::REST; 2];
        let mut control = Control::new(haptic.clone(), vec![elastic(model)], 0.0);
        let mut device = Simulated::new(&haptic, FIST);
        device.device_from_handle = device_from_handle(&haptic, &stylus());
        device.hand(&device.device_from_handle.clone());
        let held = hold(&body, 1, &poses, &stylus());
        let grasp = Grasp { held: Some(held), poses, ..Grasp::default() };
        control.take(&grasp);
        Bench { control, device, grasp, time_s: 1.0 }
    }

    fn pull_to(&mut self, motion: Vector3<f64>) {
        let mut target = device_from_handle(&self.control.haptic, &stylus());
        target.translation.vector += motion;
        self.device.hand(&target);
    }

    /// One tick with the reading changed by `lie`.
    fn tick_with(&mut self, lie: impl FnOnce(Reading) -> Option<Reading>) -> Push {
        // A frame, a hundred times a second.
        let last_s = self.time_s;
        self.time_s += self.control.haptic.period_s();
        if (self.time_s * 100.0).floor() > (last_s * 100.0).floor() {
            self.control.take(&self.grasp);
        }
        let reading = self.device.read(self.time_s).and_then(lie);
        let push = self.control.tick(reading.as_ref(), self.time_s);
        self.device.push(&push, self.time_s);
        push
    }

    fn run(&mut self, seconds: f64) -> Vec<Push> {
        let ticks = (seconds * self.control.haptic.rate_hz).round() as usize;
        (0..ticks).map(|_| self.tick_with(Some)).collect()
    }
}

fn largest_step(pushes: &[Push]) -> f64 {
    pushes.windows(2).map(|pair| (pair[1].force - pair[0].force).norm()).fold(0.0, f64::max)
}

#[test]
fn a_hand_that_pulls_is_pulled_back_to_rest() {
    for model in ["linear", "rotation"] {
        let mut bench = Bench::new(Haptic::simulated("right"), model);
        bench.run(2.0 * RAMP_S);
        assert!(bench.control.state.push.force.norm() < 1e-6);
        let rest = bench.device.device_from_handle.translation.vector;
        for direction in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(-1.0, 0.5, 0.2)] {
            bench.pull_to(direction * 0.02);
            bench.run(1.0);
            let moved = bench.device.device_from_handle.translation.vector - rest;
            let push = bench.control.state.push;
            assert!(moved.dot(&direction) > 0.0 && push.force.dot(&moved) < 0.0, "{push:?} against {moved}");
            // At rest the hand's spring and the body balance.
            let pull = (direction * 0.02 - moved) * Hand::FINGERS.stiffness;
            assert!((pull + push.force).norm() < 0.01 * pull.norm(), "{model}: {pull} {push:?}");
        }
        bench.pull_to(Vector3::zeros());
        bench.run(2.0);
        let left = (bench.device.device_from_handle.translation.vector - rest).norm();
        assert!(
            left < 1e-5 && bench.control.state.push.force.norm() < 1e-2,
            "{left} {:?}",
            bench.control.state
        );
    }
}

#[test]
fn forces_ramp_up_when_a_bent_body_is_taken_and_down_when_it_is_let_go() {
    let mut bench = Bench::new(Haptic::simulated("right"), "rotation");
    bench.pull_to(Vector3::new(0.0, 0.05, 0.0));
    bench.run(1.0);
    let whole = bench.control.state.push.force.norm();
    assert!(whole > 1.0, "{whole} N {:?}", bench.control.state);
    bench.grasp = Grasp::default();
    bench.control.take(&bench.grasp);
    let fall = bench.run(0.2);
    assert!(largest_step(&fall) < 0.05 * whole + 1e-9, "{}", largest_step(&fall));
    let ticks = (FADE_S * 1000.0).round() as usize;
    assert!(fall[ticks - 10].force.norm() > 0.0, "it does not fall at once");
    assert!(fall[ticks..].iter().all(|push| *push == Push::NONE), "nothing is left after {FADE_S} s");
}

#[test]
fn limits_hold_whatever_the_body_wants() {
    let haptic = Haptic { max_force_n: 3.0, max_torque_nm: 0.05, ..Haptic::simulated("right") };
    let mut bench = Bench::new(haptic, "linear");
    bench.device.hand.stiffness = 5000.0;
    bench.pull_to(Vector3::new(0.3, 0.3, -0.2));
    let pushes = bench.run(1.0);
    let most = pushes.iter().map(|push| push.force.norm()).fold(0.0, f64::max);
    let torque = pushes.iter().map(|push| push.torque.norm()).fold(0.0, f64::max);
    assert!(most <= 3.0 + 1e-9 && torque <= 0.05 + 1e-12, "{most} N, {torque} N m");
    assert!(most > 2.9 || torque > 0.049, "{most} N, {torque} N m: a limit was reached");
    assert!(largest_step(&pushes) < 0.5, "{}", largest_step(&pushes));
    let silent = Haptic { max_torque_nm: 0.0, ..Haptic::simulated("right") };
    let mut bench = Bench::new(silent, "linear");
    bench.pull_to(Vector3::new(0.1, 0.1, 0.0));
    assert!(bench.run(0.5).iter().all(|push| push.torque == Vector3::zeros()));
}

/// Each fault lasts; the force is gone in the stated time without a step, stays gone, and comes back by a ramp.
#[test]
fn whatever_the_device_says_the_force_goes_to_zero_and_comes_back_slowly() {
    let at = |device_from_handle, r| Some(Reading { device_from_handle, ..r });
    let none = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(0.0, 0.0, 0.0, 0.0));
    let unturned = Isometry3::from_parts(Translation3::identity(), none);
    type Lie<'a> = &'a dyn Fn(Reading) -> Option<Reading>;
    let lies: [(&str, Lie<'_>); 6] = [
        ("gone", &|_| None),
        ("not tracked", &|r| Some(Reading { tracked: false, ..r })),
        ("stale", &|r| Some(Reading { arrived_s: 1.2, ..r })),
        ("not a number", &|r| at(Isometry3::translation(f64::NAN, 0.0, 0.0), r)),
        ("out of the world", &|r| at(Isometry3::translation(0.0, 1e30, 0.0), r)),
        ("no rotation", &|r| at(unturned, r)),
    ];
    for (what, lie) in lies {
        let mut bench = Bench::new(Haptic::simulated("right"), "rotation");
        bench.pull_to(Vector3::new(0.0, 0.03, 0.02));
        bench.run(1.0);
        let before = bench.control.state.push;
        let mut pushes = vec![before];
        pushes.extend((0..200).map(|_| bench.tick_with(lie)));
        let gone = 1 + ((FADE_S + STALE_S) * 1000.0).round() as usize;
        assert!(before.force.norm() > 1.0 && pushes[gone..].iter().all(|push| *push == Push::NONE), "{what}");
        assert!(largest_step(&pushes) < 0.05 * before.force.norm(), "{what}: {}", largest_step(&pushes));
        let back = bench.run(0.6);
        assert!(largest_step(&back) < 0.05 * before.force.norm(), "{what}: {}", largest_step(&back));
        assert!(back[20].force.norm() < 0.3 * before.force.norm(), "{what}: it comes slowly");
        let after = back.last().unwrap();
        assert!((after.force - before.force).norm() < 0.05 * before.force.norm(), "{what}: {after:?}");
    }
}

#[test]
fn a_jump_by_half_a_turn_fades_and_ramps_instead_of_kicking() {
    let mut bench = Bench::new(Haptic::simulated("right"), "rotation");
    bench.pull_to(Vector3::new(0.0, 0.02, 0.0));
    bench.run(1.0);
    let before = bench.control.state;
    let half = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    let flip = |mut r: Reading| {
        r.device_from_handle.rotation = half * r.device_from_handle.rotation;
        Some(r)
    };
    let mut pushes = vec![before.push];
    pushes.extend((0..30).map(|_| bench.tick_with(flip)));
    assert_eq!(bench.control.state.faults.jumps, before.faults.jumps + 1);
    assert!(pushes.iter().all(|push| push.is_finite() && push.force.norm() <= 8.0 + 1e-9));
    // The hold there pulls hard, but only by its ramp: 30 of 250 ticks.
    assert!(largest_step(&pushes) <= 8.0 / 50.0, "{} {:?}", largest_step(&pushes), bench.control.state);
    assert!(bench.control.state.gain < 0.13, "{}", bench.control.state.gain);
    bench.run(0.5);
    assert_eq!(bench.control.state.faults.jumps, before.faults.jumps + 2, "and back");
}

#[test]
fn a_clock_that_goes_back_is_not_followed() {
    let mut bench = Bench::new(Haptic::simulated("right"), "rotation");
    bench.pull_to(Vector3::new(0.0, 0.02, 0.0));
    bench.run(1.0);
    let before = bench.control.state.push;
    // A packet from the past among good ones: far away, and a tenth of a second old.
    let far = Isometry3::translation(1.0, 0.0, 0.0);
    let push =
        bench.tick_with(|r| Some(Reading { device_from_handle: far, arrived_s: r.arrived_s - 0.1, ..r }));
    assert_eq!(bench.control.state.faults.backward, 1);
    assert!((push.force - before.force).norm() < 0.02 * before.force.norm(), "{push:?} {before:?}");
    assert_eq!(bench.control.state.gain, 1.0);
}

/// The work of the hand is the energy that the body stores, and the loss in friction and the fingers: the loop adds nothing.
#[test]
fn nothing_comes_out_that_was_not_put_in() {
    let haptic = Haptic { max_force_n: 100.0, max_torque_nm: 10.0, ..Haptic::simulated("right") };
    let mut bench = Bench::new(haptic, "rotation");
    bench.run(0.5);
    for (i, direction) in [Vector3::x(), -Vector3::y(), Vector3::new(0.3, 1.0, 1.0)].into_iter().enumerate() {
        bench.pull_to(direction * (0.01 + 0.01 * i as f64));
        bench.run(0.5);
        let state = bench.control.state;
        assert!(state.stored_energy > 1e-4 && state.gain == 1.0);
        assert!(bench.device.hand_work >= state.stored_energy, "{} J {state:?}", bench.device.hand_work);
    }
    let state = bench.control.state;
    assert!(state.stiffer > 1.0, "the tube is too stiff for 1 N·s/m at 1 kHz");
    assert!(state.observer.deepest < 1e-6 && state.observer.braked < 1e-6, "{:?}", state.observer);
}

/// Real time is measured, never asserted: the loop runs, follows the frame's grasp, and stops with its owner.
#[test]
fn the_thread_ticks_tells_and_ends() {
    let haptic = Haptic::simulated("right");
    let body = deformer("rotation");
    let poses = vec![ControlPose::REST; 2];
    let device = Simulated::new(&haptic, Hand::FINGERS);
    let control = Control::new(haptic.clone(), vec![elastic("rotation")], 0.0);
    assert_eq!(thread::running(), 0);
    let mut running = Loop::start(control, Box::new(device)).unwrap();
    assert_eq!(thread::running(), 1);
    let held = hold(&body, 1, &poses, &stylus());
    // The hand takes the handle where it is, and lifts it then.
    let mut lift = |y: f64, until: &dyn Fn(&Report) -> bool| {
        let mut hand = stylus();
        hand.translation.vector.y += y;
        let started = Instant::now();
        loop {
            running.tell(|grasp| {
                grasp.held = Some(held);
                grasp.poses.clone_from(&poses);
                grasp.room_from_hand = Some(hand);
            });
            let report = *running.report();
            if until(&report) {
                return report;
            }
            assert!(started.elapsed() < Duration::from_secs(60), "{report:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    let report = lift(0.0, &|report| report.state.gain == 1.0 && report.timing.ticks >= 300);
    assert!(report.state.push.force.norm() < 0.5, "it was not flung there: {report:?}");
    let report = lift(0.03, &|report| report.state.push.force.y < -0.1);
    println!("{:?}", report.timing);
    drop(running);
    assert_eq!(thread::running(), 0);
}

/// The boundary that is measured without measures is the theory's, with the hand's friction beside the device's, and it
/// goes as the rate; with the coupling there is none.
#[test]
fn the_largest_stable_stiffness_is_that_of_theory() {
    for (rate_hz, hand) in
        [(500.0, Hand::NONE), (1000.0, Hand::NONE), (2000.0, Hand::NONE), (1000.0, Hand::FINGERS)]
    {
        let haptic = Haptic { rate_hz, ..Haptic::simulated("right") };
        let theory = 2.0 * (haptic.damping + hand.damping) * rate_hz;
        let found = boundary(&haptic, hand, Measures::NONE).unwrap();
        println!("{rate_hz} Hz, {hand:?}: {found:.0} N/m, theory {theory:.0} N/m");
        assert!((found / theory - 1.0).abs() < 0.1, "{rate_hz} Hz: {found} N/m, theory {theory} N/m");
    }
    let haptic = Haptic::simulated("right");
    let run = |measures| stability::run(&haptic, Hand::NONE, 2e4, measures);
    assert_eq!(run(Measures::NONE).verdict, Verdict::Diverges);
    let kept = run(Measures::ALL);
    assert!(kept.verdict == Verdict::Stable && kept.generated_j == 0.0, "{kept:?}");
    assert!((kept.stiffer - 2e4 / 1600.0).abs() < 1e-6, "{kept:?}");
    // A slew limit of 5 ms made these diverge.
    for (rate_hz, stiffness) in [(2000.0, 5e3), (4000.0, 2e4), (4000.0, 2e5)] {
        let kept =
            stability::run(&Haptic { rate_hz, ..haptic.clone() }, Hand::NONE, stiffness, Measures::ALL);
        assert!(kept.verdict == Verdict::Stable && kept.generated_j == 0.0, "{rate_hz} Hz: {kept:?}");
    }
}
