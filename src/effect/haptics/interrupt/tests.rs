//! However a program ends while a device pushes, the last force that it sends to the device is zero. Each test ends a child
//! process in one way; its device is a server of the test, which notes every force.

use super::*;
use crate::base::signal;
use crate::cli::bench_haptics::control;
use crate::effect::haptics::{Device, Haply, Loop, VrpnDevice};
use crate::stage::GripButton;
use crate::track::vrpn::codec::{self, Framer, Header};
use crate::track::vrpn::payload::{MessageKind, Payload};
use libc::{SIGABRT, SIGBUS, SIGHUP, SIGINT, SIGQUIT, SIGSEGV, SIGTERM, SIGUSR1, SIGXCPU};
use std::io::{self, BufRead, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;
use tungstenite::Message;

const DEVICE: &str = "GREENSTAGE_TEST_DEVICE";
const WAY_OUT: &str = "GREENSTAGE_TEST_WAY_OUT";

/// Not a test of its own: the process that the others end, or that ends itself once it is told to on standard input.
#[test]
fn child() -> Result<(), &'static str> {
    let Ok(device) = std::env::var(DEVICE) else { return Ok(()) };
    // A core of it is of no use to anybody.
    let none = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: the limits outlive the call.
    unsafe { libc::setrlimit(libc::RLIMIT_CORE, &raw const none) };
    signal::watch().unwrap();
    end_without_force();
    let device: Box<dyn Device> = match device.split_once(' ').unwrap() {
        ("vrpn", place) => Box::new(VrpnDevice::open(&format!("Phantom0@tcp://{place}")).unwrap()),
        (_, place) => Box::new(Haply::open(place, [GripButton::A, GripButton::B]).unwrap()),
    };
    let (control, grasp) = control("linear", 2).unwrap();
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
        "fault" => {
            // SAFETY: none: nobody has this page, and that is the way out.
            let byte = unsafe { std::ptr::without_provenance::<u8>(64).read_volatile() };
            println!("{byte}");
        }
        other => panic!("{other}?"),
    }
    Ok(())
}

/// A device that stands aside of rest with its button down, and gives the size of each force that it is told, N; until
/// its client has gone for good.
struct Played {
    name: String,
    forces: Receiver<f64>,
    has_ended: Arc<AtomicBool>,
}

impl Played {
    fn new(kind: &str, serve: fn(TcpStream, &Sender<f64>)) -> Played {
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
        while self.forces.recv_timeout(PATIENCE).unwrap() == 0.0 {}
    }

    /// The last force, once its client is known to have ended.
    fn last(&self) -> Option<f64> {
        self.has_ended.store(true, Relaxed);
        self.forces.iter().last()
    }
}

const PATIENCE: Duration = Duration::from_secs(120);

fn vrpn() -> Played {
    Played::new("vrpn", serve_vrpn)
}

fn serve_vrpn(mut stream: TcpStream, told: &Sender<f64>) {
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
        let (position, quaternion) = ([0.01, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]);
        let pose = Payload::Pose { sensor: 0, position, quaternion };
        codec::encode(&Header::now(0, 0), &pose.encode(), &mut bytes);
        codec::encode(
            &Header::now(0, 1),
            &Payload::ButtonChange { button: 0, state: 1 }.encode(),
            &mut bytes,
        );
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
                told.send(size).unwrap();
            }
        }
    }
}

fn haply() -> Played {
    Played::new("haply", serve_haply)
}

fn serve_haply(stream: TcpStream, told: &Sender<f64>) {
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
            told.send(sizes.iter().sum()).unwrap();
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

/// What starts the tests may ignore signals, as a script does for a command in its background.
fn as_from_a_terminal() -> io::Result<()> {
    for signal in [SIGINT, SIGQUIT] {
        // SAFETY: the default disposition runs no code of ours.
        unsafe { libc::signal(signal, libc::SIG_DFL) };
    }
    signal::block()
}

/// Ends a process while its device pushes; its status, and the last force.
fn ended(device: &Played, way_out: &str, signal: Option<i32>) -> (ExitStatus, f64) {
    let mut child = start(device, way_out);
    device.pushes();
    match signal {
        // SAFETY: takes numbers alone; the child was not waited for yet, so the number is its own.
        Some(signal) => assert_eq!(unsafe { libc::kill(child.id() as i32, signal) }, 0),
        None => child.stdin.take().unwrap().write_all(b"go\n").unwrap(),
    }
    let status = child.wait().unwrap();
    (status, device.last().unwrap_or(f64::NAN))
}

#[test]
fn a_program_that_is_told_to_end_leaves_no_force() {
    for device in [vrpn(), haply()] {
        let (status, last) = ended(&device, "", Some(SIGTERM));
        assert_eq!((status.signal(), last), (Some(SIGTERM), 0.0), "{}", device.name);
    }
    for signal in [SIGINT, SIGHUP] {
        let (status, last) = ended(&vrpn(), "", Some(signal));
        assert_eq!((status.signal(), last), (Some(signal), 0.0), "as the signal ends a program");
    }
}

#[test]
fn a_program_that_is_ended_by_a_fault_or_a_limit_leaves_no_force() {
    for signal in [SIGBUS, SIGSEGV, SIGABRT, SIGQUIT, SIGUSR1, SIGXCPU] {
        let (status, last) = ended(&vrpn(), "", Some(signal));
        assert_eq!((status.signal(), last), (Some(signal), 0.0));
    }
    let (status, last) = ended(&haply(), "", Some(SIGBUS));
    assert_eq!((status.signal(), last), (Some(SIGBUS), 0.0));
}

/// Ctrl-Z would stop it while its device pushes.
#[test]
fn a_program_that_pushes_is_not_stopped() {
    let device = vrpn();
    let mut child = start(&device, "end");
    device.pushes();
    // SAFETY: takes numbers alone; the child was not waited for yet, so the number is its own.
    assert_eq!(unsafe { libc::kill(child.id() as i32, libc::SIGTSTP) }, 0);
    child.stdin.take().unwrap().write_all(b"go\n").unwrap();
    assert!(child.wait().unwrap().success());
    assert_eq!(device.last(), Some(0.0));
}

#[test]
fn a_program_that_ends_itself_in_any_way_leaves_no_force() {
    for (way_out, signal, code) in [
        ("end", None, Some(0)),
        ("error", None, Some(101)),
        ("panic", None, Some(101)),
        ("panic in a destructor", Some(SIGABRT), None),
        ("abort", Some(SIGABRT), None),
        ("fault", Some(SIGSEGV), None),
    ] {
        let (status, last) = ended(&vrpn(), way_out, None);
        assert_eq!((status.signal(), status.code(), last), (signal, code, 0.0), "{way_out}");
    }
    for (way_out, signal) in [("end", None), ("abort", Some(SIGABRT))] {
        let (status, last) = ended(&haply(), way_out, None);
        assert_eq!((status.signal(), last), (signal, 0.0), "{way_out}");
    }
}
