//! Force devices over the loopback device: servers of our own that a loop feels, that vanish and that lie.

use greenstage::effect::haptics::{Device, Haply, Push, Reading, VrpnDevice};
use greenstage::manual::CHAPTERS;
use greenstage::stage::{BUILT_IN, GripButton, Haptic, Stage};
use greenstage::track::device::now_s;
use greenstage::track::vrpn::codec::{self, Framer, Header};
use greenstage::track::vrpn::payload::{MessageKind, Payload};
use nalgebra::Vector3;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};
use tungstenite::{Message, WebSocket};

const PATIENCE: Duration = Duration::from_secs(30);
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
        if heard.recv_timeout(PATIENCE).is_ok_and(|message| wanted(&message)) {
            return;
        }
    }
    panic!("{what}: not heard");
}

fn state(x: f64) -> String {
    format!(
        r#"{{ "inverse3": [{{ "device_id": "0A1B", "state": {{ "cursor_position": {{ "x": {x}, "y": 0.1, "z": 0.0 }} }} }}],
        "wireless_verse_grip": [{{ "device_id": "7", "state": {{ "orientation": {{ "x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0 }},
        "buttons": {{ "a": true }} }} }}] }}"#
    )
}

/// Like the Inverse Service: a state, and another after each command. Gives the x of each force that it was sent.
fn serve_haply(listener: TcpListener, first: Vec<String>, forces: Sender<f64>, rounds: usize) {
    for _ in 0..rounds {
        let Ok((stream, _)) = listener.accept() else { return };
        let Ok(mut socket) = tungstenite::accept(stream) else { continue };
        for text in &first {
            if socket.send(Message::text(text.clone())).is_err() {
                break;
            }
        }
        converse(&mut socket, &forces);
    }
}

fn converse(socket: &mut WebSocket<TcpStream>, forces: &Sender<f64>) {
    for i in 0..100 {
        let Ok(Message::Text(text)) = socket.read() else { return };
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(value["inverse3"][0]["device_id"], "0A1B");
        let force = &value["inverse3"][0]["commands"]["set_cursor_force"]["values"];
        let _ = forces.send(force["x"].as_f64().unwrap());
        std::thread::sleep(Duration::from_millis(1));
        if socket.send(Message::text(state(0.001 * f64::from(i)))).is_err() {
            return;
        }
    }
}

/// A service that talks nonsense first, vanishes after a hundred states and returns.
#[test]
fn a_haply_service_is_felt_vanishes_and_returns() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap().to_string();
    let (forces, heard) = channel();
    let nonsense = ["nonsense", "{\"inverse3\": 7}", "{}"].map(str::to_owned);
    let first = nonsense.into_iter().chain([state(0.5)]).collect();
    let server = std::thread::spawn(move || serve_haply(listener, first, forces, 2));
    let mut device = Haply::open(&place, BUTTONS).unwrap();
    let push = Push { force: Vector3::new(1.25, 0.0, 0.0), torque: Vector3::x() };
    let reading = wait(&mut device, &push, "the first state", |reading| reading.is_some()).unwrap();
    assert_eq!((reading.buttons, reading.tracked), ([true, false], true));
    assert_eq!(reading.device_from_handle.translation.vector.y, 0.1);
    assert_eq!(device.malformed(), 2);
    device.push(&push, now_s());
    wait(&mut device, &push, "it vanishes", |reading| reading.is_none());
    hear(&heard, "the force was sent", |force| *force == 1.25);
    wait(&mut device, &push, "it returns", |reading| reading.is_some());
    drop(device);
    server.join().unwrap();
}

/// A loop that says nothing more stops the force: its last command is not repeated.
#[test]
fn a_silent_loop_sends_no_force() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap().to_string();
    let (forces, heard) = channel();
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        let mut socket = tungstenite::accept(stream).unwrap();
        socket.send(Message::text(state(0.0))).unwrap();
        while let Ok(Message::Text(text)) = socket.read() {
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            let force = value["inverse3"][0]["commands"]["set_cursor_force"]["values"]["x"].as_f64().unwrap();
            std::thread::sleep(Duration::from_millis(2));
            if forces.send(force).is_err() || socket.send(Message::text(state(0.0))).is_err() {
                break;
            }
        }
    });
    let mut device = Haply::open(&place, BUTTONS).unwrap();
    let push = Push { force: Vector3::new(2.0, 0.0, 0.0), torque: Vector3::zeros() };
    wait(&mut device, &push, "a state", |reading| reading.is_some());
    let started = Instant::now();
    while !heard.try_iter().any(|force| force == 2.0) {
        assert!(started.elapsed() < PATIENCE);
        device.push(&push, now_s());
        std::thread::sleep(Duration::from_millis(1));
    }
    hear(&heard, "no force after silence", |force| *force == 0.0);
    drop(device);
    drop(heard);
    server.join().unwrap();
}

/// The service 3.5 without an arm says so once and then answers alone: it is asked again by the same connection until an
/// arm is plugged in, which gets its force under `vector`.
#[test]
fn a_service_without_an_arm_is_asked_until_there_is_one() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap().to_string();
    let (forces, heard) = channel();
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut socket = tungstenite::accept(stream).unwrap();
        let without = r#"{ "session_id": 3, "inverse3": [], "verse_grip": [], "wireless_verse_grip": [] }"#;
        socket.send(Message::text(without)).unwrap();
        for _ in 0..6 {
            let asked: serde_json::Value =
                serde_json::from_str(socket.read().unwrap().to_text().unwrap()).unwrap();
            assert_eq!(asked, serde_json::json!({ "session": { "force_render_full_state": {} } }));
            socket.send(Message::text(without)).unwrap();
        }
        let plugged = r#"{ "session_id": 3, "inverse3": [{ "device_id": "049D", "state": {
            "cursor_position": { "x": 0.0, "y": 0.1, "z": 0.0 }, "control_mode": "idle" } }],
            "verse_grip": [{ "device_id": "61548", "state": { "button": true, "hall": 0 } }] }"#;
        let _asked = socket.read().unwrap();
        socket.send(Message::text(plugged)).unwrap();
        while let Ok(Message::Text(text)) = socket.read() {
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            let arm = &value["inverse3"][0];
            assert_eq!(arm["device_id"], "049D");
            let _ = forces.send(arm["commands"]["set_cursor_force"]["vector"]["x"].as_f64().unwrap());
            std::thread::sleep(Duration::from_millis(1));
            if socket.send(Message::text(plugged)).is_err() {
                return;
            }
        }
    });
    let mut device = Haply::open(&place, BUTTONS).unwrap();
    let push = Push { force: Vector3::new(1.5, 0.0, 0.0), torque: Vector3::zeros() };
    let reading = wait(&mut device, &push, "an arm", |reading| reading.is_some()).unwrap();
    assert_eq!(reading.buttons, [true, false], "the only button of a grip on a wire");
    let started = Instant::now();
    while !heard.try_iter().any(|force| force == 1.5) {
        assert!(started.elapsed() < PATIENCE);
        device.push(&push, now_s());
        std::thread::sleep(Duration::from_millis(1));
    }
    drop(device);
    assert_eq!(heard.iter().last(), Some(0.0));
    server.join().unwrap();
}

/// A service that only answers, and says something that cannot be read once in a while, is answered all the same.
#[test]
fn a_malformed_state_is_answered() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let place = listener.local_addr().unwrap().to_string();
    let server = std::thread::spawn(move || {
        let (stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut socket = tungstenite::accept(stream).unwrap();
        for said in [state(0.0), "nonsense".into(), "{}".into(), "{\"inverse3\": 7}".into(), state(0.0)] {
            socket.send(Message::text(said)).unwrap();
            assert!(matches!(socket.read(), Ok(Message::Text(_))));
        }
        // A service that ends takes its readings with it.
        while socket.send(Message::text(state(0.0))).is_ok() && socket.read().is_ok() {}
    });
    let mut device = Haply::open(&place, BUTTONS).unwrap();
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

/// A VRPN server with one force device: poses out, force fields in.
fn serve_vrpn(listener: &TcpListener, fields: &Sender<[f32; 3]>) -> std::io::Result<()> {
    let (mut stream, _) = listener.accept()?;
    stream.set_read_timeout(Some(Duration::from_millis(5)))?;
    stream.write_all(&codec::cookie())?;
    let mut bytes = Vec::new();
    let described = |id: i32, kind: i32, name: &str, bytes: &mut Vec<u8>| {
        codec::encode(&Header::now(id, kind), &codec::encode_name(name), bytes);
    };
    described(0, codec::SENDER_DESCRIPTION, "Phantom0", &mut bytes);
    for (id, kind) in
        [MessageKind::PosQuat, MessageKind::ButtonChange, MessageKind::Pong].into_iter().enumerate()
    {
        described(id as i32, codec::TYPE_DESCRIPTION, kind.name(), &mut bytes);
    }
    stream.write_all(&bytes)?;
    let (mut framer, mut known, mut has_cookie) = (Framer::default(), Vec::new(), false);
    for i in 0u32.. {
        let mut bytes = Vec::new();
        let pose = Payload::Pose {
            sensor: 0,
            position: [0.01 * f64::from(i % 7), 0.2, 0.0],
            quaternion: [0.0, 0.0, 0.0, 1.0],
        };
        codec::encode(&Header::now(0, 0), &pose.encode(), &mut bytes);
        let button = Payload::ButtonChange { button: 0, state: 1 };
        codec::encode(&Header::now(0, 1), &button.encode(), &mut bytes);
        stream.write_all(&bytes)?;
        let space = framer.space();
        match stream.read(space) {
            Ok(0) => return Ok(()),
            Ok(count) => framer.wrote(count),
            Err(error)
                if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {}
            Err(error) => return Err(error),
        }
        has_cookie = has_cookie || framer.cookie().is_some();
        while has_cookie && let Ok(Some(message)) = framer.message() {
            let header = message.header;
            if header.kind == codec::TYPE_DESCRIPTION {
                known.push((header.sender, codec::decode_name(message.payload).unwrap().to_owned()));
            }
            let name = known.iter().find(|(id, _)| *id == header.kind).map(|(_, name)| name.as_str());
            if name == Some(MessageKind::ForceField.name())
                && let Ok(Payload::ForceField(field)) =
                    Payload::decode(MessageKind::ForceField, message.payload)
            {
                let _ = fields.send(field.force);
            }
        }
    }
    Ok(())
}

#[test]
fn a_vrpn_force_device_is_read_and_pushed() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let name = format!("tcp://{}/Phantom0", listener.local_addr().unwrap());
    let (fields, heard) = channel();
    let server = std::thread::spawn(move || {
        let _ = serve_vrpn(&listener, &fields);
    });
    let mut device = VrpnDevice::open(&name).unwrap();
    let push = Push { force: Vector3::new(0.0, -1.5, 0.5), torque: Vector3::zeros() };
    let reading = wait(&mut device, &push, "a pose with its button", |reading| {
        reading.is_some_and(|reading| reading.buttons == [true, false] && reading.tracked)
    });
    assert_eq!(reading.unwrap().device_from_handle.translation.vector.y, 0.2);
    device.push(&push, now_s());
    hear(&heard, "the field", |force| *force == [0.0, -1.5, 0.5]);
    device.push(&Push::NONE, now_s());
    hear(&heard, "the end of it", |force| *force == [0.0; 3]);
    drop(device);
    server.join().unwrap();
}

/// The table in the manual's chapter, with its defaults.
#[test]
fn the_stage_in_the_manual_is_read() {
    let (_, _, chapter) = CHAPTERS.iter().find(|(name, ..)| *name == "haptics").unwrap();
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
    let manual = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/manual/haptics.md");
    let copy = Path::new(env!("CARGO_TARGET_TMPDIR")).join("haptics.md");
    std::fs::copy(&manual, &copy).unwrap();
    let said = Command::new(env!("CARGO_BIN_EXE_greenstage"))
        .args(["verify", "haptics", "--readme"])
        .arg(&copy)
        .output()
        .unwrap();
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let [told, printed] = [&manual, &copy].map(|path| std::fs::read_to_string(path).unwrap());
    assert!(
        told == printed,
        "`greenstage verify haptics --readme src/manual/haptics.md` writes other tables"
    );
}
