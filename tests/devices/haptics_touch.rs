//! A hand that feels what its tool presses: contacts of frames, sixty times a second, and the force loop between them, in virtual time.

use greenstage::effect::haptics::{Control, Device, Grasp, Hand, Simulated, TouchSpring};
use greenstage::effect::{self, EFFECTS, Resolved};
use greenstage::stage::{BUILT_IN, Haptic, Stage};
use greenstage::track::{StylusState, TrackerState};
use greenstage::world::World;
use nalgebra::{Isometry3, Vector3};
use std::path::Path;

type V3 = Vector3<f64>;

const DEVICE: &str = "[haptic.right]\ndevice = \"simulated\"\n";
/// Ticks of the loop, of 1 ms, in a frame.
const FRAME: u64 = 16;
/// Sides of the bar about the origin, m, and radius of the ball that presses it in the middle of its upper side.
const LENGTH: f64 = 1.0;
const SIDE: f64 = 0.1;
const RADIUS: f64 = 0.02;

/// A bar along x that is held at one end, a ball on the stylus, and a handle whose origin is the ball's.
struct Bar {
    world: World,
    control: Control,
    device: Simulated,
    grasp: Grasp,
    spring: TouchSpring,
    ticks: u64,
}

impl Bar {
    fn new(young: f64, keys: &str, hand: Hand) -> Bar {
        Bar::beside(young, keys, hand, "")
    }

    /// The same with more in the scene.
    fn beside(young: f64, keys: &str, hand: Hand, more: &str) -> Bar {
        let text = format!(
            "[tool.ball]\nshape = {{ ball = {{ radius = {RADIUS} }} }}\nstylus = 1\n\
             [body.b]\ngenerate = {{ block = {{ size = [{LENGTH:?}, {SIDE:?}, {SIDE:?}], cells = [20, 2, 2] }} }}\n\
             material = {{ young = {young:?}, poisson = 0.0 }}\nelement = \"tet10\"\n\
             effects = [\"haptics\", \"contact\"]\n{keys}\n\
             place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}\n\
             control.base = {{ nodes = {{ group = \"xmin\" }}, grab = \"fixed\" }}\n{more}"
        );
        Bar::of(&text, hand)
    }

    /// A scene with a body and a tool on the stylus.
    fn of(text: &str, hand: Hand) -> Bar {
        let scene = Resolved::parse(text, Path::new("bar.toml")).unwrap();
        let file = effect::file_of(&scene).unwrap();
        let stage = Stage::parse(&format!("{}\n{DEVICE}", BUILT_IN[0].1), Path::new("stage.toml")).unwrap();
        let mut haptic: Haptic = stage.haptics[0].clone();
        haptic.room_from_device = Isometry3::identity();
        let world = effect::world(EFFECTS, &scene, &file, stage).unwrap();
        let control = Control::new(haptic.clone(), Vec::new(), 0.0);
        let device = Simulated::new(&haptic, hand);
        Bar { world, control, device, grasp: Grasp::default(), spring: TouchSpring::default(), ticks: 0 }
    }

    /// The place at which the ball just touches.
    fn top() -> V3 {
        V3::new(0.0, SIDE / 2.0 + RADIUS, 0.0)
    }

    /// Puts the handle at rest above the bar.
    fn start(&mut self, above: f64) {
        self.device.device_from_handle =
            Isometry3::from(nalgebra::Translation3::from(Bar::top() + V3::y() * above));
        self.device.hand(&self.device.device_from_handle.clone());
    }

    fn time_s(&self) -> f64 {
        self.ticks as f64 * 1e-3
    }

    /// One tick with the hand above the bar, and every sixteenth time a frame; returns the push.
    fn tick(&mut self, hand: V3) -> V3 {
        if self.ticks.is_multiple_of(FRAME) {
            let stylus =
                StylusState { room_from_stylus: self.device.device_from_handle.cast(), ..Default::default() };
            let state = TrackerState { head: None, styli: vec![stylus], time_s: self.time_s() };
            self.world.step(&state.into());
            self.grasp.touch = self.world.frame.bodies[0].touches.first().cloned();
            let touch = self.grasp.touch.as_mut().expect("a tool on the stylus of a device is felt");
            self.spring.soften(&self.control.haptic, self.control.state.bearable, touch);
            self.control.take(&self.grasp);
        }
        self.ticks += 1;
        self.device.hand(&Isometry3::from(nalgebra::Translation3::from(Bar::top() + hand)));
        let now_s = self.time_s();
        let reading = self.device.read(now_s);
        let push = self.control.tick(reading.as_ref(), now_s);
        self.device.push(&push, now_s);
        push.force
    }

    fn above(&self) -> f64 {
        (self.device.device_from_handle.translation.vector - Bar::top()).y
    }
}

/// The hand's spring and the bar in series: Timoshenko's cantilever, pressed halfway.
#[test]
fn a_pressed_bar_pushes_the_hand_as_in_theory() {
    let young = 1e6;
    let mut bar = Bar::new(young, "effect.contact = { friction = 0.0 }", Hand::FINGERS);
    bar.start(0.01);
    let want = -0.02;
    let mut push = V3::zeros();
    for tick in 0..3000 {
        let share = (f64::from(tick) / 1000.0).min(1.0);
        push = bar.tick(V3::y() * (0.01 + (want - 0.01) * share));
    }
    let (arm, inertia) = (LENGTH / 2.0, SIDE.powi(4) / 12.0);
    let soft = arm.powi(3) / (3.0 * young * inertia) + arm / (5.0 / 6.0 * SIDE * SIDE * young / 2.0);
    let expected = -want / (soft + 1.0 / Hand::FINGERS.stiffness);
    println!("{push:?} N, theory {expected} N; {} m", bar.above());
    assert!((push.y / expected - 1.0).abs() < 0.02, "{push} N, theory {expected} N");
    // The bar slopes by 0.04 where it is pressed.
    assert!(push.x.abs() < 0.1 * expected && push.z.abs() < 1e-2 * expected, "{push}");
}

/// A blade that a hand pulls down through a block of 0.1 m × 0.06 m with 50 J/m²: 3 N in the mean, and the work that the cut has taken; then
/// up and down in the slit, and pressed on. The loop gives no energy.
#[test]
fn a_hand_feels_what_cutting_takes() {
    let text = "[tool.scalpel]\nshape = { blade = { length = 0.2, width = 0.02 } }\nstylus = 1\n\
                [body.b]\ngenerate = { block = { size = [0.3, 0.1, 0.06], cells = [17, 8, 6] } }\n\
                material = { young = 1.0e6, poisson = 0.3 }\nelement = \"tet4\"\n\
                effects = [\"haptics\", \"cut\"]\neffect.cut = { toughness = 50.0 }\n\
                place = { position = [0.0, 0.0, 0.0], scale = 1.0 }\n\
                control.left = { nodes = { group = \"xmin\" }, grab = \"fixed\" }\n\
                control.right = { nodes = { group = \"xmax\" }, grab = \"fixed\" }\n";
    let mut bar = Bar::of(text, Hand::FIRM);
    let at = |y: f64| V3::new(0.011, y, -0.1) - Bar::top();
    bar.start(0.0);
    for _ in 0..300 {
        bar.tick(at(0.08));
    }
    let way = |bar: &Bar| bar.device.device_from_handle.translation.y;
    let (mut work, mut pushes, mut made, mut last) = (0.0, Vec::new(), 0.0_f64, way(&bar));
    for tick in 0..1100 {
        let push = bar.tick(at(0.08 - 1e-4 * f64::from(tick)));
        work -= push.y * (way(&bar) - last);
        last = way(&bar);
        if (-0.02..0.02).contains(&last) {
            pushes.push(push.y);
        }
        made = made.max(bar.device.push_work - bar.device.eaten);
    }
    let mean = pushes.iter().sum::<f64>() / pushes.len() as f64;
    let memories = bar.world.effects.iter().filter_map(|effect| effect.memory());
    let memories: Vec<serde_json::Value> =
        memories.map(|memory| serde_json::from_str(memory.get()).unwrap()).collect();
    let done =
        memories.iter().find_map(|memory| memory["bodies"][0]["resistances"][0]["done"].as_f64()).unwrap();
    let mut loosest = f64::MAX;
    for tick in 0..2000 {
        let push = bar.tick(at(-0.03 + 0.02 * (f64::from(tick) * 0.01).sin().abs()));
        loosest = loosest.min(push.norm());
        made = made.max(bar.device.push_work - bar.device.eaten);
    }
    println!("{mean} N of 3 N, {work} J of {done} J, made {made:.1e} J, least {loosest:.1e} N in the slit");
    assert!((mean / 3.0 - 1.0).abs() < 0.2, "{mean} N");
    assert!((work / done - 1.0).abs() < 0.1, "{work} J of {done} J");
    assert!(made < 1e-5 && loosest < 1e-2, "{made} J, {loosest} N");
}

/// Taps, shakes and rubs, on bodies that are felt as they are and on such as are too stiff: the loop never gives more than the device's
/// friction eats, and is calm after the hand is.
#[test]
fn contacts_give_no_energy() {
    for (young, friction) in [(1e4, 0.0), (1e5, 0.5), (1e6, 0.3), (1e7, 0.0), (1e8, 0.5)] {
        let mut bar =
            Bar::new(young, &format!("effect.contact = {{ friction = {friction:?} }}"), Hand::FINGERS);
        bar.start(0.01);
        // A force that still fades in gives back more than it took: it is at its full size before anything is touched.
        for _ in 0..300 {
            bar.tick(V3::y() * 0.01);
        }
        let (mut made, mut reached) = (0.0_f64, 0.0_f64);
        for tick in 0..3000 {
            let t = f64::from(tick) * 1e-3;
            let hand =
                V3::new(0.01 * (5.0 * t).sin(), 0.012 * (18.0 * t).cos() - 0.004, 0.006 * (11.0 * t).sin());
            let push = bar.tick(hand);
            made = made.max(bar.device.push_work - bar.device.eaten);
            reached = reached.max(push.norm());
        }
        for _ in 0..1000 {
            bar.tick(V3::y() * -0.004);
        }
        let speed = bar.device.velocity[0].norm();
        println!(
            "{young:e} Pa, friction {friction}: made {made:.2e} J, up to {reached:.2} N, deepest {:.2e} J, braked {:.2e} J, {speed:.1e} m/s \
             at the end, {:.1} times too stiff",
            bar.control.state.observer.deepest, bar.control.state.observer.braked, bar.control.state.stiffer
        );
        assert!(reached > 0.01, "{reached} N");
        assert!(made < 1e-5, "{young:e} Pa: made {made} J");
        let deepest = bar.control.state.observer.deepest;
        assert!(deepest < 3e-4, "{young:e} Pa: {deepest} J had to be taken back");
        assert!(speed < 6e-5, "{young:e} Pa: {speed} m/s");
    }
}

/// A tool that comes down at 0.3 m/s, 5 mm a frame, is held back from where it touches, not from the next frame on; and one that is pulled
/// away is let go there.
#[test]
fn the_force_begins_and_ends_between_frames() {
    let mut bar = Bar::new(1e6, "effect.contact = { friction = 0.0 }", Hand::FIRM);
    bar.start(0.05);
    // The loop reaches its full force before anything is touched.
    for _ in 0..500 {
        bar.tick(V3::y() * 0.05);
    }
    assert!(bar.control.state.gain >= 1.0, "{:?}", bar.control.state);
    let mut first = None;
    let mut hand = 0.05;
    while hand > -0.02 {
        hand -= 0.3e-3;
        let push = bar.tick(V3::y() * hand);
        if first.is_none() && push.y > 1e-3 {
            first = Some(bar.above());
        }
        assert!(push.y > -1e-3, "pulled by {push} N at {} m", bar.above());
    }
    let first = first.unwrap();
    println!("the first force at {first} m");
    assert!(first.abs() < 3e-4, "the first force at {first} m");
    while hand < 0.05 {
        hand += 0.3e-3;
        let push = bar.tick(V3::y() * hand);
        assert!(push.y > -1e-3, "held back by {push} N at {} m", bar.above());
        assert!(bar.above() < 2e-3 || push.y < 1e-2, "{push} N at {} m", bar.above());
    }
}

/// A bar whose end lies on a pad is as stiff between two frames as it is from frame to frame: several times stiffer than without the pad.
#[test]
fn a_bar_on_a_pad_is_felt_with_the_pad() {
    // Between two frames surfaces with friction are taken to stick, which makes them stiffer where they slide.
    for (keys, most) in
        [("effect.contact = { friction = 0.0 }", 0.01), ("effect.contact = { friction = 0.5 }", 0.25)]
    {
        let pad = format!(
            "[body.pad]\ngenerate = {{ block = {{ size = [0.1, 0.1, 0.2], cells = [3, 3, 6] }} }}\n\
             material = {{ young = 1e6, poisson = 0.0 }}\neffects = [\"contact\"]\n{keys}\n\
             place = {{ position = [0.45, -0.1001, 0.0], scale = 1.0 }}\n\
             control.base = {{ nodes = {{ group = \"ymin\" }}, grab = \"fixed\" }}\n"
        );
        let slope = |more: &str| {
            let mut bar = Bar::beside(1e6, keys, Hand::FINGERS, more);
            let mut touch_at = |depth: f64| {
                bar.ticks += 16;
                let pose = Isometry3::from(nalgebra::Translation3::from(Bar::top() - V3::y() * depth));
                let stylus = StylusState { room_from_stylus: pose.cast(), ..Default::default() };
                let state = TrackerState { head: None, styli: vec![stylus], time_s: bar.time_s() };
                bar.world.step(&state.into());
                let touch = bar.world.frame.bodies.iter().find_map(|body| body.touches.first().cloned());
                (touch.expect("the tool is felt"), pose)
            };
            let step = 1e-4;
            (0..10).for_each(|k| drop(touch_at(2e-3 * f64::from(k) / 10.0)));
            let (first, pose) = touch_at(2e-3);
            let (second, beyond) = touch_at(2e-3 + step);
            let [now, foreseen, then] =
                [first.respond(&pose), first.respond(&beyond), second.respond(&beyond)].map(|r| r.force.y);
            println!("{keys}: {now} N, foreseen {foreseen} N, then {then} N");
            ((foreseen - now) / step, (then - now) / step)
        };
        let ((foreseen, found), (_, alone)) = (slope(&pad), slope(""));
        println!("{keys}: {foreseen} N/m foreseen, {found} N/m found, {alone} N/m without the pad");
        assert!((foreseen / found - 1.0).abs() < most, "{foreseen} N/m foreseen, {found} N/m found");
        assert!(found > 3.0 * alone, "{found} N/m with the pad, {alone} N/m without");
    }
}
