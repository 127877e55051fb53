//! A stylus that comes by VRPN bends the tube: server, client, trackers and world together, over the loopback interface.

use super::*;
use crate::deform::ControlPose;
use crate::effect;
use crate::prepare::Resolved;
use crate::track::device::Link;
use crate::track::vrpn::{Address, Client, Timing, Transport};
use crate::track::{FakeSource, Signal, StylusState};
use crate::world::World;
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;

/// The stylus of a lab: a wand whose sensor sits 10 cm behind its tip, in a tracker whose frame is not the room's.
const TRACKING: &str = r#"
[tracker.lab]
vrpn = "Wand@127.0.0.1:PORT"
room_from_tracker = { position = [0.5, 1.25, -0.25], rotation = [0.0, 0.5, 0.0] }
[sensor.wand]
tracker = "lab"
id = 7
sensor_from_body = { position = [0.0, 0.0, -0.1], rotation = [0.0, 0.0, 0.25] }
[stylus.right]
sensor = "wand"
grab = { tracker = "lab", button = 2 }
"#;

/// The demo's tube with 1,920 nodes instead of 10,080.
fn demo(stage: Stage) -> World {
    let (fine, coarse) = ("radial = 3, around = 40, along = 62", "radial = 2, around = 20, along = 31");
    let text = include_str!("../../../configs/scenes/tube.toml");
    assert!(text.contains(fine));
    let scene = Resolved::parse(&text.replace(fine, coarse), Path::new("tube.toml")).unwrap();
    let file = effect::file_of(&scene).unwrap();
    World::new(&scene, &scene.models(), &file, stage).unwrap()
}

struct Lab {
    source: FakeSource,
    trackers: TrackerSet,
    tracker_from_room: Isometry3<f64>,
    body_from_sensor: Isometry3<f64>,
}

impl Lab {
    /// Puts the wand's sensor where it is when the stylus is there, until trackers and world have it; returns what they got.
    fn show(&mut self, world: &mut World, room_from_stylus: &Isometry3<f32>, pressed: bool) -> StylusState {
        let sensor = self.tracker_from_room * room_from_stylus.cast::<f64>() * self.body_from_sensor;
        let deadline_s = now_s() + 60.0;
        loop {
            self.source.change(|state| {
                state.take_pose(7, sensor, None, 1.0);
                state.take_button(2, pressed, None);
            });
            let state = self.trackers.state(now_s());
            let stylus = state.styli[0];
            let off = stylus.room_from_stylus.to_homogeneous() - room_from_stylus.to_homogeneous();
            if off.amax() < 1e-6 && stylus.pressed == pressed && stylus.signal == Signal::Live {
                world.step(&state.clone().into());
                return stylus;
            }
            assert!(now_s() < deadline_s, "the stylus never came: {stylus:?}, {off}");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// A tracker that is there anew is not believed at once when it says that a button is down.
    fn settle(&mut self) {
        wait("it is there", || self.trackers.state(now_s()).styli[0].signal == Signal::Live);
        let until_s = now_s() + 0.2;
        while now_s() < until_s {
            self.trackers.state(now_s());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn link(&mut self) -> Link {
        self.trackers.devices().next().unwrap().link.clone()
    }
}

fn serve(place: SocketAddr, source: &FakeSource) -> crate::track::vrpn::Serving {
    Server::bind(place, ["Wand"]).unwrap().spawn(vec![Box::new(source.clone())]).unwrap()
}

fn wait(what: &str, mut is_so: impl FnMut() -> bool) {
    let deadline_s = now_s() + 60.0;
    while !is_so() {
        assert!(now_s() < deadline_s, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn a_stylus_that_comes_by_vrpn_bends_the_tube_and_a_dead_server_lets_it_go() {
    let source = FakeSource::default();
    let serving = serve((Ipv4Addr::LOCALHOST, 0).into(), &source);
    let place = serving.place;
    let text = crate::stage::BUILT_IN[0].1.to_owned() + &TRACKING.replace("PORT", &place.port().to_string());
    let stage = Stage::parse(&text, Path::new("lab.toml")).unwrap();
    let address = Address { device: "Wand".into(), host: "127.0.0.1".into(), port: place.port(), udp: true };
    let timing = Timing { first_retry_s: 0.05, longest_retry_s: 0.2, ..Timing::default() };
    let client = Client::with_timing(address, Transport::Tcp, timing);
    let trackers = TrackerSet::with_sources(&stage.tracking, vec![Box::new(client)], now_s());
    let frame = stage.tracking.trackers["lab"].frame.room_from_tracker;
    assert_eq!(frame.scaling(), 1.0);
    let mut lab = Lab {
        source: source.clone(),
        trackers,
        tracker_from_room: frame.isometry.inverse(),
        body_from_sensor: stage.tracking.sensors["wand"].sensor_from_body.inverse(),
    };
    let script = Script::find("bend").unwrap();
    let mut world = demo(stage.clone());
    let hand = |time_s: f64| script.sample(&stage, time_s).styli[0];

    // Until 1 s the stylus aims and takes hold, then it bends by 60°, as the script says.
    lab.show(&mut world, &hand(0.7).room_from_stylus, false);
    lab.settle();
    let taken = lab.show(&mut world, &hand(0.9).room_from_stylus, true).room_from_stylus;
    let mut last = taken;
    for step in 1..=44 {
        last =
            lab.show(&mut world, &hand(0.9 + 0.05 * f64::from(step)).room_from_stylus, true).room_from_stylus;
    }
    let turn = (last.rotation * taken.rotation.inverse()).angle().to_degrees();
    assert!((turn - 60.0).abs() < 0.01, "{turn}°");
    check(&world, &taken.cast(), &last.cast());

    // The server dies: the tube stays as it is, and the button counts as released.
    drop(serving);
    wait("the server is missed", || matches!(lab.link(), Link::Down(_)));
    let bent = world.bodies[0].deformer.poses.clone();
    for _ in 0..5 {
        let state = lab.trackers.state(now_s());
        assert!(!state.styli[0].pressed);
        world.step(&state.clone().into());
    }
    assert_eq!(world.bodies[0].deformer.poses, bent);
    let _serving = serve(place, &source);
    wait("the server is found again", || lab.link() == Link::Up);
    lab.show(&mut world, &last, false);
    lab.settle();

    // And back, held anew, the way it came: at rest to rounding.
    let taken = lab.show(&mut world, &last, true).room_from_stylus;
    assert_ne!(world.bodies[0].deformer.poses[1], ControlPose::REST);
    for step in (0..44).rev() {
        lab.show(&mut world, &hand(0.9 + 0.05 * f64::from(step)).room_from_stylus, true);
    }
    let rest = &world.bodies[0].deformer.poses[1];
    let (shift, turn) = (rest.translation.norm(), (rest.matrix - nalgebra::Matrix3::identity()).amax());
    assert!(shift < 1e-5 && turn < 1e-5, "{shift} m, {turn}, taken again at {taken}");
}

/// The held element has made the stylus' motion, in the room: x ↦ S S₀⁻¹ x; its nodes stand where that puts them, and another
/// deformer makes the same tube from the pose.
fn check(world: &World, taken: &Isometry3<f64>, now: &Isometry3<f64>) {
    let body = &world.bodies[0];
    let (deformer, motion) = (&body.deformer, now * taken.inverse());
    let room_from_body = body.room_from_body;
    let origin = Point3::from(deformer.controls[1].origin);
    let moved = room_from_body.inverse() * (motion * (room_from_body * origin));
    let body_motion =
        room_from_body.isometry.rotation.inverse() * motion.rotation * room_from_body.isometry.rotation;
    let pose = &deformer.poses[1];
    assert!((pose.translation - (moved - origin)).norm() < 1e-6, "{} {}", pose.translation, moved - origin);
    assert!((pose.matrix - body_motion.to_rotation_matrix().matrix()).amax() < 1e-6, "{}", pose.matrix);
    assert_eq!(deformer.poses[0], ControlPose::REST);
    let room_from_surface = body.room_from_surface();
    let room_from_rest = room_from_body;
    let mut furthest = 0.0_f64;
    for &vertex in deformer.control_nodes(1) {
        let rest = Point3::from(Vector3::from(deformer.rest()[vertex as usize]).cast::<f64>());
        let expected = motion * (room_from_rest * rest);
        let stands = Point3::from(Vector3::from(deformer.positions()[vertex as usize]).cast::<f64>());
        let stands = room_from_surface * stands;
        furthest = furthest.max((expected - stands).norm());
    }
    // Single precision over a workspace of metres.
    assert!(furthest < 2e-6, "{furthest} m");
}
