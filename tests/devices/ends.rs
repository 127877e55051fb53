//! Ends of the program while a device pushes: the last force that the device gets is zero. Each test ends a process in one way;
//! its device is a server of the test, which notes every force and when it came.
//!
//! `GREENSTAGE_ENDS=1000` ends that many programs instead of 24 and prints how long each way took.

use crate::common::folder;
use crate::display_common::{Display, wait_for};
use crate::render_common::require_gpu;
use greenstage::base::{fault, guard, memory, signal};
use greenstage::deform::{ControlPose, ControlRest, LINEAR};
use greenstage::effect::haptics::{
    Control, Device, Elastic, ElementHold, Grasp, Haply, HoldConstraint, Loop, VrpnDevice,
};
use greenstage::green::FIELDS;
use greenstage::stage::{GripButton, Haptic};
use greenstage::track::vrpn::codec::{self, Framer, Header};
use greenstage::track::vrpn::payload::{MessageKind, Payload};
use libc::{
    SIGABRT, SIGBUS, SIGCONT, SIGHUP, SIGINT, SIGKILL, SIGQUIT, SIGSEGV, SIGSTOP, SIGTERM, SIGUSR1, SIGXCPU,
};
use nalgebra::{DMatrix, Matrix4, Similarity3, Vector3};
use std::io::{self, BufRead, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};
use tungstenite::Message;

const DEVICE: &str = "GREENSTAGE_TEST_DEVICE";
const WAY_OUT: &str = "GREENSTAGE_TEST_WAY_OUT";
const PATIENCE: Duration = Duration::from_secs(120);

/// A loop on two control elements on springs, of which a hand holds the second.
fn control() -> (Control, Grasp) {
    let rest =
        |e: usize| ControlRest { name: e.to_string(), origin: Vector3::x() * (e as f64 - 0.5), nodes: 10 };
    let controls: Vec<ControlRest> = (0..2).map(rest).collect();
    let stiffness = DMatrix::from_diagonal_element(2 * FIELDS, 2 * FIELDS, 100.0);
    let table = |name: &str| (name == "stiffness").then(|| stiffness.clone());
    let body = Elastic::of_tables(&LINEAR, &controls, &table).unwrap();
    let held = ElementHold {
        grip: 1,
        body: 0,
        element: 1,
        room_from_body: Similarity3::identity(),
        constraint: HoldConstraint::Rigid(Matrix4::new_translation(&controls[1].origin)),
    };
    let grasp = Grasp { held: Some(held), poses: vec![ControlPose::REST; 2], ..Grasp::default() };
    (Control::new(Haptic::simulated("ends"), vec![body], 0.0), grasp)
}

/// The process that the other tests end, or that ends itself once a line comes on standard input; no separate test.
#[test]
fn child() -> Result<(), &'static str> {
    let Ok(device) = std::env::var(DEVICE) else { return Ok(()) };
    // A core is of no use to anybody.
    let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the limits outlive the call.
    unsafe { libc::setrlimit(libc::RLIMIT_CORE, &raw const none) };
    // As `main` does.
    memory::end_in_order();
    fault::end_by_what_is_sent();
    signal::watch().unwrap();
    guard::PROGRAM.set(env!("CARGO_BIN_EXE_greenstage").into()).unwrap();
    let device: Box<dyn Device> = match device.split_once(' ').unwrap() {
        ("vrpn", place) => Box::new(VrpnDevice::open(&format!("Phantom0@tcp://{place}")).unwrap()),
        (_, place) => Box::new(Haply::open(place, [GripButton::A, GripButton::B]).unwrap()),
    };
    let (control, grasp) = control();
    let mut running = Loop::start(control, device).unwrap();
    let (told, is_told) = channel();
    std::thread::spawn(move || told.send(std::io::stdin().lock().read_line(&mut String::new()).is_ok()));
    let started = Instant::now();
    while is_told.try_recv().is_err() {
        assert!(started.elapsed() < 2 * PATIENCE, "never ended");
        running.tell(|told| told.clone_from(&grasp));
        std::thread::sleep(Duration::from_millis(5));
    }
    match std::env::var(WAY_OUT).unwrap().as_str() {
        "end" => {}
        "error" => return Err("as of a frame"),
        "panic" => panic!("as of a frame"),
        "panic in a destructor" => {
            struct Falls;
            impl Drop for Falls {
                fn drop(&mut self) {
                    panic!("as of a swap chain");
                }
            }
            let _falls = Falls;
            panic!("as of a frame");
        }
        "abort" => std::process::abort(),
        // As a library does when its server has gone.
        "exit" => std::process::exit(7),
        "fault" => {
            // SAFETY: none: nobody has this page, and that is the way out.
            let byte = unsafe { std::ptr::without_provenance::<u8>(64).read_volatile() };
            println!("{byte}");
        }
        other => panic!("{other}?"),
    }
    Ok(())
}

/// The size of a force, N, and when it came.
type Said = (f64, Instant);

/// A device that stands aside of rest with its button down, and gives each force that it is sent, until its client has gone
/// for good.
struct Played {
    name: String,
    forces: Receiver<Said>,
    has_ended: Arc<AtomicBool>,
}

impl Played {
    fn new(kind: &str, serve: fn(TcpStream, &Sender<Said>)) -> Played {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let name = format!("{kind} {}", listener.local_addr().unwrap());
        let (told, forces) = channel();
        let has_ended = Arc::new(AtomicBool::new(false));
        let ended = has_ended.clone();
        listener.set_nonblocking(true).unwrap();
        std::thread::spawn(move || {
            // On a busy machine it may have to connect anew.
            loop {
                let has_ended = ended.load(Relaxed);
                match listener.accept() {
                    Ok((stream, _)) => {
                        stream.set_nonblocking(false).unwrap();
                        serve(stream, &told);
                    }
                    Err(_) if has_ended => return,
                    Err(_) => std::thread::sleep(Duration::from_millis(2)),
                }
            }
        });
        Played { name, forces, has_ended }
    }

    /// Waits until it pushes.
    fn pushes(&self) {
        while self.forces.recv_timeout(PATIENCE).unwrap().0 == 0.0 {}
    }

    /// Waits until it does not.
    fn rests(&self) {
        while self.forces.recv_timeout(PATIENCE).unwrap().0 != 0.0 {}
    }

    /// The last force, once its client is known to have ended, and how long after `since` the device had it.
    fn last(&self, since: Instant) -> (f64, Duration) {
        self.has_ended.store(true, Relaxed);
        let mut last = (f64::NAN, since);
        for (force, at) in self.forces.iter() {
            // Of several zeros, the first.
            if force != 0.0 || last.0 != 0.0 {
                last = (force, at);
            }
        }
        (last.0, last.1.saturating_duration_since(since))
    }
}

fn vrpn() -> Played {
    Played::new("vrpn", |stream, told| serve_vrpn(stream, told, |_| 0.01))
}

/// The handle's x, m, by the time since the connection, s.
type Motion = fn(f64) -> f64;

fn serve_vrpn(mut stream: TcpStream, told: &Sender<Said>, x: Motion) {
    let started = Instant::now();
    stream.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
    let mut greeting = codec::cookie().to_vec();
    let described = |id: i32, kind: i32, name: &str, bytes: &mut Vec<u8>| {
        codec::encode(&Header::now(id, kind), &codec::encode_name(name), bytes);
    };
    described(0, codec::SENDER_DESCRIPTION, "Phantom0", &mut greeting);
    described(0, codec::TYPE_DESCRIPTION, MessageKind::PosQuat.name(), &mut greeting);
    described(1, codec::TYPE_DESCRIPTION, MessageKind::ButtonChange.name(), &mut greeting);
    stream.write_all(&greeting).unwrap();
    let (mut framer, mut field, mut has_cookie) = (Framer::default(), None, false);
    loop {
        let mut bytes = Vec::new();
        let x = x(started.elapsed().as_secs_f64());
        let (position, quaternion) = ([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
        let pose = Payload::Pose { sensor: 0, position, quaternion };
        codec::encode(&Header::now(0, 0), &pose.encode(), &mut bytes);
        let pressed = Payload::ButtonChange { button: 0, state: i32::from(x != 0.0) };
        codec::encode(&Header::now(0, 1), &pressed.encode(), &mut bytes);
        // Nobody to hear it: what was said by the one that has gone is read all the same.
        let _ = stream.write_all(&bytes);
        match stream.read(framer.space()) {
            Ok(0) => return,
            Ok(count) => framer.wrote(count),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
        has_cookie = has_cookie || framer.cookie().is_some();
        while has_cookie && let Some(message) = framer.message().unwrap() {
            let header = message.header;
            let is_field = || codec::decode_name(message.payload) == Ok(MessageKind::ForceField.name());
            if header.kind == codec::TYPE_DESCRIPTION && is_field() {
                field = Some(header.sender);
            } else if Some(header.kind) == field
                && let Ok(Payload::ForceField(field)) =
                    Payload::decode(MessageKind::ForceField, message.payload)
            {
                let size = field.force.iter().map(|f| f64::from(f.abs())).sum();
                told.send((size, Instant::now())).unwrap();
            }
        }
    }
}

fn haply() -> Played {
    Played::new("haply", serve_haply)
}

fn serve_haply(stream: TcpStream, told: &Sender<Said>) {
    let state = r#"{ "session_id": 1, "inverse3": [{ "device_id": "049D", "state": {
        "cursor_position": { "x": 0.01, "y": 0.0, "z": 0.0 } } }],
        "verse_grip": [{ "device_id": "7", "state": { "button": true } }] }"#;
    let Ok(mut socket) = tungstenite::accept(stream) else { return };
    let _ = socket.send(Message::text(state));
    while let Ok(message) = socket.read() {
        let Message::Text(text) = message else { continue };
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        // Else it asks whether there is an arm.
        if let Some(arm) = value["inverse3"].get(0) {
            let force = &arm["commands"]["set_cursor_force"]["vector"];
            let sizes = ["x", "y", "z"].map(|axis| force[axis].as_f64().unwrap().abs());
            told.send((sizes.iter().sum(), Instant::now())).unwrap();
        }
        let _ = socket.send(Message::text(state));
    }
}

fn start(device: &Played, way_out: &str) -> Child {
    let mut command = Command::new(std::env::current_exe().unwrap());
    let (_, tests) = module_path!().split_once("::").unwrap();
    command
        .args(["--exact", &format!("{tests}::child"), "--nocapture"])
        .envs([(DEVICE, device.name.as_str()), (WAY_OUT, way_out)])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    // SAFETY: the call changes the signal mask and dispositions alone. The tests' own first thread must block the signals too, and
    // it runs before `child` can say so.
    unsafe { command.pre_exec(as_from_a_terminal) }.spawn().unwrap()
}

/// Restores the default of signals, which may be ignored by whatever starts the tests, as by nohup, or by a script for a command in
/// its background.
fn as_from_a_terminal() -> io::Result<()> {
    for signal in [SIGHUP, SIGINT, SIGQUIT] {
        // SAFETY: the default disposition runs no code of ours.
        unsafe { libc::signal(signal, libc::SIG_DFL) };
    }
    signal::block()
}

/// Sends a signal to a child that was not waited for yet, so that the number is its own.
fn send(child: &Child, signal: i32) {
    // SAFETY: takes numbers alone.
    assert_eq!(unsafe { libc::kill(child.id() as i32, signal) }, 0);
}

/// Ends a process while its device pushes; its status, the last force, and how long after the end it came.
fn ended(device: &Played, way_out: &str, signal: Option<i32>) -> (ExitStatus, f64, Duration) {
    let mut child = start(device, way_out);
    // Kept open: its end would be an order to end too.
    let mut input = child.stdin.take().unwrap();
    device.pushes();
    let sent = Instant::now();
    match signal {
        Some(signal) => send(&child, signal),
        None => input.write_all(b"go\n").unwrap(),
    }
    let status = child.wait().unwrap();
    // What it does itself before it ends, as unwinding, takes its time.
    let since = if signal.is_some() { sent } else { Instant::now() };
    let (last, after) = device.last(since);
    (status, last, after)
}

/// SIGKILL left the force on, and SIGSEGV, SIGBUS and SIGABRT from outside left the program running.
#[test]
fn a_program_that_is_ended_in_any_way_leaves_no_force() {
    let signals = [SIGKILL, SIGTERM, SIGABRT, SIGSEGV, SIGBUS, SIGINT, SIGHUP, SIGQUIT, SIGUSR1, SIGXCPU];
    let itself = [
        ("end", None, Some(0)),
        ("error", None, Some(101)),
        ("panic", None, Some(101)),
        ("panic in a destructor", Some(SIGABRT), None),
        ("abort", Some(SIGABRT), None),
        ("exit", None, Some(7)),
        ("fault", Some(SIGSEGV), None),
    ];
    let by_signal = signals.map(|signal| ("", Some(signal), None));
    let ways: Vec<_> = by_signal.into_iter().chain(itself).collect();
    let count = std::env::var("GREENSTAGE_ENDS").map_or(24, |count| count.parse().unwrap());
    let mut slowest = vec![Duration::ZERO; ways.len()];
    let mut late = 0;
    for i in 0..count {
        let (way_out, signal, code) = ways[i % ways.len()];
        // Each way with each device, since the number of ways is odd.
        let device = if i % 2 == 0 { vrpn() } else { haply() };
        let (status, last, after) = ended(&device, way_out, signal.filter(|_| way_out.is_empty()));
        let what = format!("{i}: {} {way_out} {signal:?}", device.name);
        assert_eq!((status.signal(), status.code(), last), (signal, code, 0.0), "{what}");
        late += usize::from(after > Duration::from_millis(30));
        slowest[i % ways.len()] = slowest[i % ways.len()].max(after);
    }
    for ((way_out, signal, _), slowest) in ways.iter().zip(slowest) {
        println!("{way_out} {signal:?}: at most {:.1} ms", 1e3 * slowest.as_secs_f64());
    }
    println!("{count} ends, {late} of them with a force after 30 ms");
}

/// A program that was stopped, as by Ctrl-Z or a debugger, pushed on.
#[test]
fn a_program_that_is_stopped_leaves_no_force_and_pushes_again_when_it_goes_on() {
    for device in [vrpn(), haply()] {
        let mut child = start(&device, "end");
        device.pushes();
        let since = Instant::now();
        send(&child, SIGSTOP);
        device.rests();
        println!("{}: {:.1} ms", device.name, 1e3 * since.elapsed().as_secs_f64());
        send(&child, SIGCONT);
        device.pushes();
        child.stdin.take().unwrap().write_all(b"go\n").unwrap();
        assert!(child.wait().unwrap().success());
        assert_eq!(device.last(since).0, 0.0);
    }
}

const SCENE: &str = r#"
[body.block]
generate = { block = { size = [2.0, 1.0, 1.0], cells = [4, 2, 2] } }
material = { young = 1e4, poisson = 0.3 }
effects = ["haptics"]
control.fixed = { nodes = { group = "xmin" }, grab = "fixed" }
control.end = { nodes = { group = "xmax" }, grab = "dragger" }
"#;

/// The X library exits by itself when its server has gone.
#[test]
fn a_view_whose_x_server_ends_leaves_no_force() {
    let Some(_) = require_gpu() else { return };
    let count = std::env::var("GREENSTAGE_ENDS").map_or(1, |count| count.parse::<usize>().unwrap() / 50);
    for _ in 0..count.max(1) {
        let Some(display) = Display::start([700, 460]) else { return };
        // It takes the right end after a second, and moves to and fro for as long as it is served: on a busy machine the view may draw
        // its first picture later.
        let device = Played::new("vrpn", |stream, told| {
            serve_vrpn(stream, told, |t| match t < 1.0 {
                true => 0.0,
                false => 1e-6 + 0.015 * (1.0 - (std::f64::consts::PI * (t - 1.0)).cos()),
            });
        });
        let place = folder("ends-view");
        let desktop = greenstage::stage::BUILT_IN.iter().find(|(name, _)| *name == "desktop").unwrap().1;
        let pen = format!(
            "{desktop}\n[haptic.pen]\ndevice = \"vrpn://{}/Phantom0\"\nmax_force = 8.0\n\
             room_from_device = {{ position = [0.15, -0.035, -0.05], axes = [[0, 0, -1], [0, 1, 0], [1, 0, 0]] }}\n",
            device.name.split_once(' ').unwrap().1
        );
        std::fs::write(place.join("block.toml"), SCENE).unwrap();
        std::fs::write(place.join("pen.toml"), pen).unwrap();
        let arguments = ["view", "block.toml", "--stage", "pen.toml", "--samples", "1"];
        let mut view = display.run(
            Command::new(env!("CARGO_BIN_EXE_greenstage"))
                .current_dir(&place)
                .args(arguments)
                .stdout(Stdio::null()),
        );
        wait_for("the window", || display.windows().into_iter().next());
        device.pushes();
        drop(display);
        view.0.wait().unwrap();
        let since = Instant::now();
        let (last, after) = device.last(since);
        println!("after a view ended with its X server: {:.1} ms", 1e3 * after.as_secs_f64());
        assert_eq!(last, 0.0);
    }
}
