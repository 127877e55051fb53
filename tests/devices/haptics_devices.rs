//! Force devices over the loopback device: servers of our own that a loop feels, that vanish and that lie.

use crate::common::{program, text};
use greenstage::effect::haptics::{Device, Haply, HaplyTiming, Push, Reading};
use greenstage::manual;
use greenstage::stage::{BUILT_IN, GripButton, Haptic, Stage};
use greenstage::track::device::now_s;
use nalgebra::Vector3;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

const PATIENCE: Duration = Duration::from_secs(60);
/// Whatever stands still for a moment, the connection lasts.
const STEADY: HaplyTiming = HaplyTiming { silent_s: 60.0, retry_s: 0.05, ask_s: 60.0 };
const BUTTONS: [GripButton; 2] = [GripButton::A, GripButton::B];

/// Reads the device until its reading is as wanted, pushing with `push` meanwhile as the loop does.
fn wait(
    device: &mut dyn Device,
    push: &Push,
    what: &str,
    wanted: impl Fn(Option<Reading>) -> bool,
) -> Option<Reading> {
    let started = Instant::now();
    loop {
        let reading = device.read(now_s());
        if wanted(reading) {
            return reading;
        }
        assert!(started.elapsed() < PATIENCE, "{what}: {reading:?}");
        device.push(push, now_s());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Waits for a message that is as wanted.
fn hear<T: std::fmt::Debug>(heard: &Receiver<T>, what: &str, wanted: impl Fn(&T) -> bool) {
    let started = Instant::now();
    while started.elapsed() < PATIENCE {
        match heard.recv_timeout(PATIENCE) {
            Ok(message) if wanted(&message) => return,
            Ok(_) => {}
            Err(error) => panic!("{what}: {error}"),
        }
    }
    panic!("{what}: not heard");
}

/// Pushes until the service has received this force.
fn push_until(device: &mut dyn Device, push: &Push, heard: &Receiver<f64>) {
    let started = Instant::now();
    while !heard.try_iter().any(|force| force == push.force.x) {
        assert!(started.elapsed() < PATIENCE);
        device.push(push, now_s());
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A device, and the thread that plays its service.
fn served(timing: HaplyTiming, serve: impl FnOnce(TcpListener) + Send + 'static) -> (Haply, JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap().to_string();
    let server = std::thread::spawn(move || serve(listener));
    (Haply::with_timing(&place, BUTTONS, timing).unwrap(), server)
}

fn accept(listener: &TcpListener) -> WebSocket<TcpStream> {
    let (stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    tungstenite::accept(stream).unwrap()
}

/// The x of the force in a command to the arm `id`; `None` for the question whether there is an arm.
fn force_of(command: &str, id: &str, key: &str) -> Option<f64> {
    let value: serde_json::Value = serde_json::from_str(command).unwrap();
    if value == asked() {
        return None;
    }
    let arm = &value["inverse3"][0];
    assert_eq!(arm["device_id"], id);
    Some(arm["commands"]["set_cursor_force"][key]["x"].as_f64().unwrap())
}

fn asked() -> serde_json::Value {
    serde_json::json!({ "session": { "force_render_full_state": {} } })
}

fn state(x: f64) -> String {
    format!(
        r#"{{ "inverse3": [{{ "device_id": "0A1B", "state": {{ "cursor_position": {{ "x": {x}, "y": 0.1, "z": 0.0 }} }} }}],
        "wireless_verse_grip": [{{ "device_id": "7", "state": {{ "orientation": {{ "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 }},
        "buttons": {{ "a": true }} }} }}] }}"#
    )
}

/// Plays the Inverse Service: a state, and another after each command. Sends on the x of each force that it received. It
/// vanishes, and comes back on a signal.
fn serve_haply(listener: TcpListener, first: Vec<String>, forces: Sender<f64>, back: Receiver<()>) {
    loop {
        let mut socket = accept(&listener);
        for text in &first {
            if socket.send(Message::text(text.clone())).is_err() {
                break;
            }
        }
        converse(&mut socket, &forces);
        drop(socket);
        if back.recv().is_err() {
            return;
        }
    }
}

fn converse(socket: &mut WebSocket<TcpStream>, forces: &Sender<f64>) {
    for i in 0..100 {
        let Ok(Message::Text(text)) = socket.read() else { return };
        if let Some(force) = force_of(&text, "0A1B", "values") {
            let _ = forces.send(force);
        }
        std::thread::sleep(Duration::from_millis(1));
        if socket.send(Message::text(state(0.001 * f64::from(i)))).is_err() {
            return;
        }
    }
}

/// A service that talks nonsense first, vanishes after a hundred states and returns.
#[test]
fn a_haply_service_is_felt_vanishes_and_returns() {
    let (forces, heard) = channel();
    let nonsense = ["nonsense", "{\"inverse3\": 7}", "{}"].map(str::to_owned);
    let first = nonsense.into_iter().chain([state(0.5)]).collect();
    let (back, is_back) = channel();
    let (mut device, server) = served(STEADY, move |listener| serve_haply(listener, first, forces, is_back));
    let push = Push { force: Vector3::new(1.25, 0.0, 0.0), torque: Vector3::x() };
    let reading = wait(&mut device, &push, "the first state", |reading| reading.is_some()).unwrap();
    assert_eq!((reading.buttons, reading.tracked), ([true, false], true));
    assert_eq!(reading.device_from_handle.translation.vector.y, 0.1);
    assert_eq!(device.malformed(), 2);
    device.push(&push, now_s());
    wait(&mut device, &push, "it vanishes", |reading| reading.is_none());
    hear(&heard, "the force was sent", |force| *force == 1.25);
    back.send(()).unwrap();
    wait(&mut device, &push, "it returns", |reading| reading.is_some());
    drop((device, back));
    server.join().unwrap();
}

/// A loop that says nothing more stops the force: its last command is not repeated.
#[test]
fn a_silent_loop_sends_no_force() {
    let (forces, heard) = channel();
    let (mut device, server) = served(STEADY, move |listener| {
        let mut socket = accept(&listener);
        socket.send(Message::text(state(0.0))).unwrap();
        while let Ok(Message::Text(text)) = socket.read() {
            let force = force_of(&text, "0A1B", "values");
            std::thread::sleep(Duration::from_millis(2));
            if force.is_some_and(|force| forces.send(force).is_err())
                || socket.send(Message::text(state(0.0))).is_err()
            {
                break;
            }
        }
    });
    let push = Push { force: Vector3::new(2.0, 0.0, 0.0), torque: Vector3::zeros() };
    wait(&mut device, &push, "a state", |reading| reading.is_some());
    push_until(&mut device, &push, &heard);
    hear(&heard, "no force after silence", |force| *force == 0.0);
    drop(device);
    drop(heard);
    server.join().unwrap();
}

/// The service 3.5 without an arm says so once and then answers alone: it is asked again by the same connection until an
/// arm is plugged in, which gets its force under `vector`.
#[test]
fn a_service_without_an_arm_is_asked_until_there_is_one() {
    let (forces, heard) = channel();
    let timing = HaplyTiming { ask_s: 0.02, ..STEADY };
    let (mut device, server) = served(timing, move |listener| {
        let mut socket = accept(&listener);
        let without = r#"{ "session_id": 3, "inverse3": [], "verse_grip": [], "wireless_verse_grip": [] }"#;
        socket.send(Message::text(without)).unwrap();
        for _ in 0..6 {
            let said: serde_json::Value =
                serde_json::from_str(socket.read().unwrap().to_text().unwrap()).unwrap();
            assert_eq!(said, asked());
            socket.send(Message::text(without)).unwrap();
        }
        let plugged = r#"{ "session_id": 3, "inverse3": [{ "device_id": "049D", "state": {
            "cursor_position": { "x": 0.0, "y": 0.1, "z": 0.0 }, "control_mode": "idle" } }],
            "verse_grip": [{ "device_id": "61548", "state": { "button": true, "hall": 0 } }] }"#;
        let _asked = socket.read().unwrap();
        socket.send(Message::text(plugged)).unwrap();
        while let Ok(Message::Text(text)) = socket.read() {
            if let Some(force) = force_of(&text, "049D", "vector") {
                let _ = forces.send(force);
            }
            std::thread::sleep(Duration::from_millis(1));
            // Nobody to hear it: what was said by the one that has gone is read all the same.
            let _ = socket.send(Message::text(plugged));
        }
    });
    let push = Push { force: Vector3::new(1.5, 0.0, 0.0), torque: Vector3::zeros() };
    let reading = wait(&mut device, &push, "an arm", |reading| reading.is_some()).unwrap();
    assert_eq!(reading.buttons, [true, false], "the only button of a grip on a wire");
    push_until(&mut device, &push, &heard);
    drop(device);
    assert_eq!(heard.iter().last(), Some(0.0));
    server.join().unwrap();
}

/// A service that only answers, and says something that cannot be read once in a while, is answered all the same.
#[test]
fn a_malformed_state_is_answered() {
    let (mut device, server) = served(STEADY, |listener| {
        let mut socket = accept(&listener);
        for said in [state(0.0), "nonsense".into(), "{}".into(), "{\"inverse3\": 7}".into(), state(0.0)] {
            socket.send(Message::text(said)).unwrap();
            assert!(matches!(socket.read(), Ok(Message::Text(_))));
        }
        // A service that ends takes its readings with it.
        while socket.send(Message::text(state(0.0))).is_ok() && socket.read().is_ok() {}
    });
    let started = Instant::now();
    while device.malformed() < 2 {
        assert!(started.elapsed() < PATIENCE, "{} malformed", device.malformed());
        std::thread::sleep(Duration::from_millis(1));
    }
    wait(&mut device, &Push::NONE, "a state", |reading| reading.is_some());
    assert_eq!(device.malformed(), 2);
    drop(device);
    server.join().unwrap();
}

/// The table in the manual's chapter, with its defaults.
#[test]
fn the_stage_in_the_manual_is_read() {
    let chapter = manual::find("haptics").unwrap().text;
    let block = chapter.split("```").find(|block| block.contains("[haptic.right]")).unwrap();
    let table = block.strip_prefix("text\n").unwrap();
    let stage = Stage::parse(&format!("{}\n{table}", BUILT_IN[0].1), Path::new("manual.toml")).unwrap();
    let haptic = &stage.haptics[0];
    let usual = Haptic { room_from_device: haptic.room_from_device, ..Haptic::simulated("right") };
    assert_eq!((haptic, haptic.room_from_device.translation.y), (&usual, 0.9));
}

/// The tables of the closed loop are as the program prints them, and its judgement of them is good.
#[test]
fn the_tables_in_the_manual_are_those_of_verify_haptics() {
    let manual = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/manual/reference/stability.md");
    let copy = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stability.md");
    std::fs::copy(&manual, &copy).unwrap();
    let place = Path::new(env!("CARGO_MANIFEST_DIR"));
    let said = program(place, &["verify", "haptics", "--readme"]).arg(&copy).output().unwrap();
    assert!(said.status.success(), "{}", text(&said.stderr));
    let [told, printed] = [&manual, &copy].map(|path| std::fs::read_to_string(path).unwrap());
    assert!(
        told == printed,
        "`greenstage verify haptics --readme src/manual/reference/stability.md` writes other tables"
    );
}
