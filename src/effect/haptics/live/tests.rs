//! Hands that feel what they hold: through a simulated device, VRPN, and Haply's service, over the loopback interface.

use super::*;
use crate::effect::haptics::grasp::device_from_handle;
use crate::effect::haptics::thread::running;
use crate::effect::{self, Resolved};
use crate::green::GreenFile;
use crate::interact::{Action, Axis, Freedom};
use crate::session::trackers;
use crate::stage::{BUILT_IN, rotation_towards};
use crate::track::device::{DeviceState, Link as Line, Source, now_s};
use crate::track::vrpn::Server;
use crate::track::{Signal, StylusState};
use crate::world::Highlight;
use nalgebra::{Translation3, UnitQuaternion, Vector3, Vector6};
use std::cell::RefCell;
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::path::Path;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use tungstenite::WebSocket;

/// The loops of the process are counted: only one test at a time has some.
static LOOPS: Mutex<()> = Mutex::new(());

/// A block in the workbench, with or without the effect, with or without a device.
fn session(effects: &str, device: &str) -> (Resolved, Arc<GreenFile>, World) {
    let text = format!(
        "[body.block]\ngenerate = {{ block = {{ size = [2.0, 1.0, 1.0], cells = [4, 2, 2] }} }}\n\
         material = {{ young = 100.0, poisson = 0.3 }}\nmodel = \"rotation\"\neffects = [{effects}]\n\
         [body.block.control.fixed]\nnodes = {{ group = \"xmin\" }}\ngrab = \"fixed\"\n\
         [body.block.control.end]\nnodes = {{ group = \"xmax\" }}\ngrab = \"dragger\"\n"
    );
    let scene = Resolved::parse(&text, Path::new("scene.toml")).unwrap();
    let file = effect::file_of(&scene).unwrap();
    let stage = Stage::parse(&format!("{}\n{device}", BUILT_IN[0].1), Path::new("stage.toml")).unwrap();
    let world = World::new(&scene, &scene.models(), &file, stage).unwrap();
    (scene, file, world)
}

/// The effect of the block, started.
fn started(scene: &Resolved, file: &GreenFile, world: &World) -> HapticSession {
    let listed = EffectInput { scene, file, bodies: vec![(0, "block")] };
    HapticSession::start(&listed, world).unwrap().unwrap()
}

/// A busy machine gets its time.
const PATIENCE: Duration = Duration::from_secs(120);

const DEVICE: &str = "[haptic.right]\ndevice = \"simulated\"\n";

/// No thread unless a body asks and the stage has a device; and
/// with both the stylus feels what it holds, stays behind the hand, and feels nothing after it lets go.
#[test]
fn a_loop_runs_only_where_it_is_asked_for_and_the_hand_feels_what_it_holds() {
    let _alone = LOOPS.lock();
    for (effects, device) in [("", ""), ("", DEVICE), ("\"haptics\"", "")] {
        let (scene, file, world) = session(effects, device);
        assert!(effect::start(&scene, &file, &world).unwrap().is_empty(), "{effects} {device}");
        assert_eq!(running(), 0, "{effects} {device}");
    }
    let (scene, file, mut world) = session("\"haptics\"", DEVICE);
    let mut haptics = started(&scene, &file, &world);
    assert_eq!(running(), 1);
    let workspace = world.assets.stage.workspace;
    let started = Instant::now();
    let mut follow =
        |world: &mut World, y: f64, pressed: bool, until: &dyn Fn(&LoopState, &TrackerState) -> bool| {
            let deadline = Instant::now() + PATIENCE;
            loop {
                let place = |x: f64| workspace.centre + Vector3::new(x, y, 0.1) * workspace.radius_m;
                let rotation = rotation_towards(&(place(0.0) - place(1.5)), 0.0).unwrap();
                let pose = Isometry3::from_parts(Translation3::from(place(1.5).coords), rotation).cast();
                let stylus = StylusState { room_from_stylus: pose, pressed, ..Default::default() };
                let time_s = started.elapsed().as_secs_f64();
                let mut state = TrackerState { head: None, styli: vec![stylus], time_s };
                haptics.input(&mut state);
                world.step(&state.clone().into());
                world.show_by(&mut haptics);
                let felt = haptics.links[0].running.report().state;
                if until(&felt, &state) {
                    return felt;
                }
                assert!(Instant::now() < deadline, "{felt:?} {state:?}");
                std::thread::sleep(Duration::from_millis(5));
            }
        };
    follow(&mut world, 0.0, false, &|felt, _| felt.room_from_handle.is_some());
    follow(&mut world, 0.0, true, &|felt, _| felt.gain == 1.0);
    let felt = follow(&mut world, 0.3, true, &|felt, _| felt.push.force.norm() > 0.1);
    assert!(felt.push.force.y < 0.0, "it pulls back down: {felt:?}");
    assert!(world.bodies[0].deformer.poses[1].translation.y > 0.0, "the picture shows what is felt");
    follow(&mut world, 0.3, false, &|felt, _| felt.push.force.norm() == 0.0);
    drop(haptics);
    assert_eq!(running(), 0);
}

/// A VRPN device that reports its pose at every question, as a real one does a thousand times a second.
#[derive(Clone, Default)]
struct Phantom {
    said: Arc<Mutex<(Isometry3<f64>, bool)>>,
    state: DeviceState,
}

impl Source for Phantom {
    fn describe(&self) -> String {
        "phantom".into()
    }

    fn latest(&mut self) -> &DeviceState {
        let (pose, pressed) = *self.said.lock().unwrap();
        self.state.take_pose(0, pose, None, 1.0);
        self.state.take_button(0, pressed, None);
        &self.state
    }
}

/// The device stands askew in the room and is scaled; its own pose and button are the stylus, and it pushes back.
#[test]
fn a_vrpn_device_is_the_stylus_and_feels_what_its_button_grabbed() {
    let _alone = LOOPS.lock();
    let phantom = Phantom::default();
    let server = Server::bind((Ipv4Addr::LOCALHOST, 0).into(), ["Phantom0"]).unwrap();
    let serving = server.spawn(vec![Box::new(phantom.clone())]).unwrap();
    let table = format!(
        "[haptic.pen]\ndevice = \"vrpn://127.0.0.1:{}/Phantom0\"\nmax_force = 20.0\nmotion = 2.0\n\
         room_from_device = {{ position = [0.1, 0.9, 0.4], axes = [[0, 0, -1], [0, 1, 0], [1, 0, 0]] }}\n\
         sensor_from_body = {{ position = [0.0, 0.0, -0.05] }}\n",
        serving.place.port()
    );
    let (scene, file, mut world) = session("\"haptics\"", &table);
    let haptics = Rc::new(RefCell::new(started(&scene, &file, &world)));
    let mut effects: Vec<Box<dyn RunningEffect>> = vec![Box::new(Shared(haptics.clone()))];
    let mut trackers = trackers::start(&world.assets.stage, &mut effects).unwrap().unwrap();
    assert_eq!(world.fields.stylus_name(0), "pen");
    let (haptic, workspace) = (world.assets.stage.haptics[0].clone(), world.assets.stage.workspace);
    let place = |x: f64, y: f64| workspace.centre + Vector3::new(x, y, 0.1) * workspace.radius_m;
    let rotation = rotation_towards(&(place(0.0, 0.0) - place(1.5, 0.0)), 0.0).unwrap();
    let mut y = 0.0;
    let mut follow = |up_to: f64, pressed: bool, until: &dyn Fn(&World, &LoopState) -> bool| {
        let deadline = Instant::now() + PATIENCE;
        loop {
            y += (up_to - y).clamp(-0.01, 0.01);
            let stylus = Isometry3::from_parts(Translation3::from(place(1.5, y).coords), rotation);
            let handle = device_from_handle(&haptic, &(stylus * haptic.sensor_from_body.inverse()));
            *phantom.said.lock().unwrap() = (handle, pressed);
            let mut state = trackers::merge(
                trackers.state(now_s()),
                TrackerState { time_s: now_s(), ..Default::default() },
            );
            let mut haptics = haptics.borrow_mut();
            haptics.input(&mut state);
            world.step(&state.clone().into());
            world.show_by(&mut *haptics);
            let felt = haptics.links[0].running.report().state;
            drop(haptics);
            if y == up_to && until(&world, &felt) {
                return felt;
            }
            assert!(Instant::now() < deadline, "{felt:?} {state:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    };
    follow(0.0, false, &|world, _| world.frame.bodies[0].highlights[1] == Highlight::Hovered);
    // It is there; now it is known for a while with its button up.
    let there = Instant::now();
    follow(0.0, false, &|_, _| there.elapsed() > GREETED);
    follow(0.0, true, &|world, _| world.frame.bodies[0].highlights[1] == Highlight::Held);
    // 0.2 of the workspace's radius are 0.2 / 0.95 of the block's half length of 1 m.
    let carried = |world: &World| world.bodies[0].deformer.poses[1].translation;
    let there = Vector3::y() * (0.2 / 0.95);
    let felt = follow(0.2, true, &|world, felt| {
        (carried(world) - there).norm() < 1e-5 && felt.push.force.norm() > 0.1
    });
    let in_room = haptic.room_from_device.rotation * felt.push.force;
    assert!(in_room.y < -0.9 * in_room.norm(), "{in_room} pulls it back down");
    follow(0.2, false, &|_, felt| felt.push.force.norm() == 0.0);
}

/// A session whose trackers are started by the list of effects.
struct Shared(Rc<RefCell<HapticSession>>);

impl RunningEffect for Shared {
    fn name(&self) -> &'static str {
        self.0.borrow().name()
    }

    fn source(&mut self, tracker: &str) -> Option<Box<dyn Source>> {
        self.0.borrow_mut().source(tracker)
    }
}

/// Time for which the buttons that a new device reports are its greeting, not a press.
const GREETED: Duration = Duration::from_millis(400);

/// A service that reports where its arm is, and whether button a is down: `[pressed, has_ended]`. Returns the forces it was sent
/// until a connection comes after the end.
fn serve_haply(listener: TcpListener, told: Arc<[AtomicBool; 2]>) -> std::thread::JoinHandle<Vec<f64>> {
    std::thread::spawn(move || {
        let [pressed, has_ended] = &*told;
        let mut forces = Vec::new();
        loop {
            let (stream, _) = listener.accept().unwrap();
            if has_ended.load(Relaxed) {
                return forces;
            }
            // On a busy machine it may have to connect anew.
            if let Ok(mut socket) = tungstenite::accept(stream) {
                converse(&mut socket, pressed, &mut forces);
            }
        }
    })
}

fn converse(socket: &mut WebSocket<TcpStream>, pressed: &AtomicBool, forces: &mut Vec<f64>) {
    loop {
        let state = serde_json::json!({
            "inverse3": [{ "device_id": "1", "state": { "cursor_position": { "x": 0.0, "y": 0.1, "z": 0.05 } } }],
            "verse_grip": [{ "device_id": "2", "state": {
                "orientation": { "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 }, "buttons": { "a": pressed.load(Relaxed) } } }]
        });
        if socket.send(tungstenite::Message::text(state.to_string())).is_err() {
            break;
        }
        let Ok(tungstenite::Message::Text(text)) = socket.read() else { break };
        let command: serde_json::Value = serde_json::from_str(&text).unwrap();
        // Else it asks whether there is an arm.
        if let Some(arm) = command["inverse3"].get(0) {
            let force = &arm["commands"]["set_cursor_force"]["values"];
            forces.extend(["x", "y", "z"].map(|axis| force[axis].as_f64().unwrap()));
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// No loop runs if no body asks for forces, yet the device is a stylus, and gets no forces.
#[test]
fn a_haply_device_is_a_stylus_without_a_loop() {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    let told = Arc::new([const { AtomicBool::new(false) }; 2]);
    let [pressed, has_ended] = &*told;
    let server = serve_haply(listener, told.clone());
    let table = format!(
        "[haptic.right]\ndevice = \"haply://127.0.0.1:{port}\"\nmax_force = 5.0\n\
         room_from_device = {{ position = [0.0, 0.9, 0.4] }}\n"
    );
    let stage = Stage::parse(&format!("{}\n{table}", BUILT_IN[0].1), Path::new("stage.toml")).unwrap();
    let mut trackers = trackers::start(&stage, &mut []).unwrap().unwrap();
    let mut follow = |until: &dyn Fn(&StylusState) -> bool| {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let stylus = trackers.state(now_s()).styli[0];
            if until(&stylus) {
                return stylus;
            }
            assert!(Instant::now() < deadline, "{stylus:?}");
            std::thread::sleep(Duration::from_millis(2));
        }
    };
    follow(&|stylus| stylus.signal == Signal::Live);
    let there = Instant::now();
    follow(&|stylus| {
        assert!(!stylus.pressed);
        there.elapsed() > GREETED
    });
    pressed.store(true, Relaxed);
    let stylus = follow(&|stylus| stylus.pressed);
    let off = stylus.room_from_stylus.translation.vector - Vector3::new(0.0, 1.0, 0.45);
    assert!(off.norm() < 1e-6, "{stylus:?}");
    let report = trackers.report(now_s()).remove(0);
    assert_eq!(report.sensors[0].name.as_deref(), Some("haptic.right"));
    assert!(report.sensors[0].rate_hz > 0.0 && report.link == Line::Up, "{report:?}");
    drop(trackers);
    has_ended.store(true, Relaxed);
    let _last = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap();
    let forces = server.join().unwrap();
    assert!(!forces.is_empty() && forces.iter().all(|force| *force == 0.0), "{forces:?}");
}

/// Actions of the hands in one case: the mode, whether a second hand holds the other edge, whether the first one scales.
struct Case {
    name: &'static str,
    mode: Mode,
    two: bool,
    scales: bool,
}

fn cases() -> Vec<Case> {
    let only = |freedom| Mode { freedom, axis: None };
    let case = |name, mode, two, scales| Case { name, mode, two, scales };
    vec![
        case("free", Mode::FREE, false, false),
        case("translate", only(Freedom::Translate), false, false),
        case("rotate", only(Freedom::Rotate), false, false),
        case("along and about y", Mode::FREE.along(Axis::Y), false, false),
        case("along its own x", only(Freedom::Translate).along(Axis::X).along(Axis::X), false, false),
        case("about z", only(Freedom::Rotate).along(Axis::Z), false, false),
        case("two hands", Mode::FREE, true, false),
        case("two hands along y", Mode::FREE.along(Axis::Y), true, false),
        case("scaled", Mode::FREE, false, true),
    ]
}

/// Hands beside the block's end at `z` of the workspace's radius, moved and turned by `by`.
fn hand(world: &World, z: f64, by: f64, pressed: bool) -> StylusState {
    let workspace = world.assets.stage.workspace;
    let place =
        workspace.centre + Vector3::new(1.5 - 0.3 * by, 0.2 * by, z * (1.0 + by)) * workspace.radius_m;
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.3, 0.5) * by * z.signum());
    let rotation = turn * rotation_towards(&-Vector3::x(), 0.0).unwrap();
    let room_from_stylus = Isometry3::from_parts(Translation3::from(place.coords), rotation).cast();
    StylusState { room_from_stylus, pressed, ..Default::default() }
}

/// The push against differences of the energy of the body that the picture shows, the world stepped with the hand a
/// little aside: through pick, hold, mode, guard and model.
#[test]
fn in_every_mode_and_with_two_hands_the_push_is_the_slope_of_the_energy_that_is_shown() {
    let _alone = LOOPS.lock();
    for Case { name, mode, two, scales } in cases() {
        let (scene, file, mut world) = session("\"haptics\"", DEVICE);
        let mut haptics = started(&scene, &file, &world);
        let link = &mut haptics.links[0];
        let mut time_s = 0.0;
        let mut go = |world: &mut World, styli: &[StylusState]| {
            time_s += 0.5;
            world.step(&TrackerState { head: None, styli: styli.to_vec(), time_s }.into());
        };
        let styli = |world: &World, by: f64, pressed: bool| -> Vec<StylusState> {
            let zs = if two { &[0.3, -0.3][..] } else { &[0.3] };
            zs.iter().map(|&z| hand(world, z, by, pressed)).collect()
        };
        for (by, pressed) in [(0.0, false), (0.0, true)] {
            let now = styli(&world, by, pressed);
            go(&mut world, &now);
        }
        // Bent first, so that there is a force whatever the mode lets through after it.
        let bent = styli(&world, 0.3, true);
        go(&mut world, &bent);
        world.carry_out(Action::SetMode(mode));
        let mut now = styli(&world, 0.3, true);
        now[0].second = scales;
        go(&mut world, &now);
        let mut now = styli(&world, 0.5, true);
        now[0].second = scales;
        go(&mut world, &now);

        let held = link.held(&world).unwrap_or_else(|| panic!("{name}: nothing is felt"));
        let body = &world.bodies[0];
        let controls = &body.deformer.controls;
        let mut elastic = Elastic::from_deformer(&body.deformer).unwrap();
        elastic.set(held.element, &body.deformer.poses);
        let handle = world.graph.get(world.fields.hands).hands.room_from_stylus(0).unwrap();
        let reach = held.reach(&handle, &controls[held.element].origin).unwrap();
        let shown = body.deformer.poses[held.element];
        assert!((reach.pose.translation - shown.translation).norm() < 1e-9, "{name}");
        assert!((reach.pose.matrix - shown.matrix).norm() < 1e-9, "{name}");
        let push = held.push(&link.haptic, &reach, &elastic.respond(&reach.pose)).unwrap().stacked();
        let scale = held.energy_scale(&link.haptic);
        const H: f64 = 1e-3;
        let slope = Vector6::from_fn(|k, _| {
            let mut energy = |by: f64| {
                let mut motion = Vector6::zeros();
                motion[k] = by;
                let turn = UnitQuaternion::from_scaled_axis(motion.fixed_rows::<3>(3).into_owned());
                let place = handle.translation.vector + motion.fixed_rows::<3>(0);
                let moved = Isometry3::from_parts(Translation3::from(place), turn * handle.rotation);
                let mut there = now.clone();
                there[0].room_from_stylus = moved.cast();
                go(&mut world, &there);
                world.bodies[0].deformer.wrenches().unwrap().1 * scale
            };
            (energy(H) - energy(-H)) / (2.0 * H)
        });
        // Differences over 1 mm and mrad of poses in single precision.
        let [off, size] = [0, 3]
            .map(|k| {
                let part = |v: &Vector6<f64>| v.fixed_rows::<3>(k).norm();
                [part(&(push + slope)), part(&slope)]
            })
            .into_iter()
            .fold([0.0, 0.0], |sum, [off, size]| [sum[0] + off, sum[1] + size]);
        println!("{name}: off by {:.1e} of {size:.2}", off / size);
        assert!(size > 1e-2 && off < 5e-4 * size, "{name}: {push} is not minus {slope}");
        // The other hand moves: the same hold.
        if two {
            now[1] = hand(&world, -0.3, 0.52, true);
            go(&mut world, &now);
            assert_eq!(link.held(&world).unwrap().grip, held.grip);
        }
    }
}
