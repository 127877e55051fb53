//! Haply's Inverse3 through its Inverse Service: JSON over a WebSocket, one state message for each force command.
//!
//! In: `inverse3[0].state.cursor_position` in metres, and orientation and buttons of the first `wireless_verse_grip`,
//! `verse_grip` or `custom_verse_grip`, if there is one. Out: `set_cursor_force` in newtons, under `vector`, or under
//! `values` where the messages are those of a service before 3.5; the arm has no torque. The service answers every
//! command with the next state and says nothing else after its greeting, so a thread alternates between the two at the
//! service's own rate; the loop reads and writes triple buffers. Written from the service's public documentation
//! (docs.haply.co/inverseSDK, versions 3.5 and 3.1) and tried against a server of our own alone. What comes is bounded and
//! strictly read; a service that vanishes is tried again.

use super::device::{Device, Push, Reading, SampleInfo};
use crate::base::last_word::LastWord;
use crate::base::peak::Peak;
use crate::stage::GripButton;
use crate::track::device::{DeviceState, Stamp, now_s};
use crate::track::is_only_late;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::de::IgnoredAny;
use std::collections::{BTreeMap, BTreeSet};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Duration;
use triple_buffer::{Input, Output, triple_buffer};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message, WebSocket};

/// The port of the service by default.
pub const PORT: u16 = 10001;
/// A longer message is refused, bytes.
const LONGEST: usize = 64 << 10;
/// A command of the loop that is older than this is replaced by no force, s.
const COMMAND_S: f64 = 0.02;
/// Silence for this long ends the connection, s.
const SILENT_S: f64 = 1.0;
/// Between two attempts to connect, s.
const RETRY_S: f64 = 1.0;
/// How often a service without an arm is asked whether there is one, s, since it sends nothing by itself.
const ASK_S: f64 = 0.25;
const ASK: &str = r#"{"session":{"force_render_full_state":{}}}"#;
const NO_ARM: &str =
    "the service is up, but has no Inverse3 that says where it is; it is asked again until one is plugged in";
/// The most different warnings per connection.
const MOST_TOLD: usize = 16;
const WAKE: Duration = Duration::from_millis(50);
/// The assumed time until an answer before the first one has come, s.
const UNHEARD_S: f64 = 2e-3;

/// A service, connected or not.
pub struct Haply {
    place: String,
    newest: Output<Option<Reading>>,
    command: Input<(Push, f64)>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    malformed: AtomicU64,
    /// The longest recent time from a tick's command to the state that answers it: bits of an f64, s; 0 before the first.
    echo: AtomicU64,
}

impl Haply {
    /// Connects in the background to `host` or `host:port`; `buttons` are the one that grabs and the second one.
    pub fn open(place: &str, buttons: [GripButton; 2]) -> std::io::Result<Haply> {
        let place = if place.contains(':') { place.to_owned() } else { format!("{place}:{PORT}") };
        let (reading, newest) = triple_buffer(&None);
        let (command, commands) = triple_buffer(&(Push::NONE, f64::NEG_INFINITY));
        let shared = Arc::new(Shared::default());
        let told = BTreeSet::new();
        let mut link =
            Link { place: place.clone(), buttons, reading, commands, shared: shared.clone(), told };
        let thread = std::thread::Builder::new().name("haply".into()).spawn(move || link.run())?;
        Ok(Haply { place, newest, command, shared, thread: Some(thread) })
    }
}

impl Device for Haply {
    fn describe(&self) -> String {
        format!("haply ws://{}", self.place)
    }

    fn read(&mut self, _now_s: f64) -> Option<Reading> {
        *self.newest.read()
    }

    fn push(&mut self, push: &Push, now_s: f64) {
        self.command.write((*push, now_s));
    }

    fn malformed(&mut self) -> u64 {
        self.shared.malformed.load(Relaxed)
    }

    /// A command waits for the state that it follows, travels, and is answered by the next state in the service's cycle.
    fn latency_s(&self) -> f64 {
        match f64::from_bits(self.shared.echo.load(Relaxed)) {
            echo_s if echo_s > 0.0 => echo_s,
            _ => UNHEARD_S,
        }
    }
}

impl Drop for Haply {
    fn drop(&mut self) {
        self.shared.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The thread's side.
struct Link {
    place: String,
    buttons: [GripButton; 2],
    reading: Input<Option<Reading>>,
    commands: Output<(Push, f64)>,
    shared: Arc<Shared>,
    /// The warnings since the arm's position last came.
    told: BTreeSet<String>,
}

impl Link {
    fn run(&mut self) {
        while !self.shared.stop.load(Relaxed) {
            let (Ok(reason) | Err(reason)) = self.connect().map(|mut socket| self.converse(&mut socket));
            if !self.shared.stop.load(Relaxed) {
                self.tell(&format!("{reason}; it is tried again"));
            }
            self.reading.write(None);
            let again_s = now_s() + RETRY_S;
            while now_s() < again_s && !self.shared.stop.load(Relaxed) {
                std::thread::sleep(WAKE);
            }
        }
    }

    /// Warns once about a lasting condition.
    fn tell(&mut self, what: &str) {
        if self.told.len() < MOST_TOLD && self.told.insert(what.to_owned()) {
            tracing::warn!("haply ws://{}: {what}", self.place);
        }
    }

    fn connect(&self) -> Result<WebSocket<TcpStream>, String> {
        let text = |error: std::io::Error| error.to_string();
        let address = self.place.to_socket_addrs().map_err(text)?.next().ok_or("the host has no address")?;
        let patience = Duration::from_secs_f64(SILENT_S);
        let stream = TcpStream::connect_timeout(&address, patience).map_err(text)?;
        stream.set_nodelay(true).map_err(text)?;
        stream.set_read_timeout(Some(patience)).map_err(text)?;
        stream.set_write_timeout(Some(patience)).map_err(text)?;
        let limits = WebSocketConfig::default().max_message_size(Some(LONGEST)).max_frame_size(Some(LONGEST));
        let url = format!("ws://{}/", self.place);
        let (socket, _) = tungstenite::client::client_with_config(url, stream, Some(limits))
            .map_err(|error| error.to_string())?;
        socket.get_ref().set_read_timeout(Some(WAKE)).map_err(text)?;
        Ok(socket)
    }

    /// Sends one command for each state until the connection or this side ends; returns the reason.
    fn converse(&mut self, socket: &mut WebSocket<TcpStream>) -> String {
        let (mut heard_s, mut asked_s) = (now_s(), now_s());
        let mut arm: Option<Commanded> = None;
        let mut heard = DeviceState::default();
        let (mut commanded_s, mut echo) = (None, Peak::default());
        while !self.shared.stop.load(Relaxed) {
            if arm.is_none() && now_s() - asked_s > ASK_S {
                asked_s = now_s();
                if let Err(error) = socket.send(Message::text(ASK)) {
                    return error.to_string();
                }
            }
            match socket.read() {
                Ok(Message::Text(text)) => {
                    heard_s = now_s();
                    if let Some(commanded_s) = commanded_s {
                        echo.take(heard_s - commanded_s, heard_s);
                        self.shared.echo.store(echo.value.to_bits(), Relaxed);
                    }
                    match parse(&text, heard_s, self.buttons) {
                        Ok(State { id, key, reading }) => {
                            match Commanded::next(arm, id, key, socket) {
                                Ok(next) => arm = next,
                                Err(error) => return format!("no force is sent: {error}"),
                            }
                            match reading {
                                Some(_) => self.told.clear(),
                                None => self.tell(NO_ARM),
                            }
                            self.reading.write(reading.map(|reading| counted(&mut heard, reading)));
                        }
                        Err(_) => {
                            self.shared.malformed.fetch_add(1, Relaxed);
                        }
                    }
                    // Whatever it said: it may say nothing more until it is answered.
                    if let Some(arm) = &arm {
                        let (push, at_s) = *self.commands.read();
                        let is_new = now_s() - at_s <= COMMAND_S;
                        let push = if is_new { push } else { Push::NONE };
                        commanded_s = is_new.then_some(at_s);
                        if let Err(error) = arm.send(socket, &push) {
                            return error;
                        }
                    }
                }
                Ok(_) => {}
                Err(Error::Io(error)) if is_only_late(&error) => {
                    if now_s() - heard_s > SILENT_S {
                        return format!("silent for {SILENT_S} s");
                    }
                }
                Err(error) => return error.to_string(),
            }
        }
        if let Some(arm) = &arm {
            // Nobody hears of it if the connection is gone.
            let _ = arm.send(socket, &Push::NONE);
        }
        "ended".to_owned()
    }
}

/// The arm that is commanded. However the program ends, its force is taken back.
struct Commanded {
    id: String,
    key: ForceKey,
    last_word: LastWord,
}

impl Commanded {
    /// The arm that a message names, or the previous one if it names none.
    fn next(
        before: Option<Commanded>,
        id: Option<String>,
        key: ForceKey,
        socket: &mut WebSocket<TcpStream>,
    ) -> std::io::Result<Option<Commanded>> {
        let Some(id) = id else { return Ok(before) };
        // A service that has once used 3.5's keys is 3.5, because not every message has all keys.
        let key =
            before.as_ref().filter(|before| before.key == ForceKey::Vector).map_or(key, |_| ForceKey::Vector);
        match before {
            Some(before) if before.id == id && before.key == key => return Ok(Some(before)),
            // Nobody hears of it if that arm is gone.
            Some(before) => drop(before.send(socket, &Push::NONE)),
            None => {}
        }
        let none = masked_text(&force_command(&id, key, &Push::NONE));
        Ok(Some(Commanded { last_word: LastWord::new(socket.get_ref(), &none)?, id, key }))
    }

    fn send(&self, socket: &mut WebSocket<TcpStream>, push: &Push) -> Result<(), String> {
        let command = Message::text(force_command(&self.id, self.key, push));
        let sent = self.last_word.before(|| socket.send(command)).ok_or("the program ends")?;
        sent.map_err(|error| error.to_string())
    }
}

/// A WebSocket's frame with a text of less than 64 KiB; masked, as a client's must be, with zeros, which change nothing.
fn masked_text(text: &str) -> Vec<u8> {
    const FINAL_TEXT: u8 = 0x81;
    const MASKED: u8 = 0x80;
    let mut frame = vec![FINAL_TEXT];
    match u8::try_from(text.len()) {
        Ok(length) if length < 126 => frame.push(MASKED | length),
        _ => {
            frame.push(MASKED | 126);
            frame.extend((text.len() as u16).to_be_bytes());
        }
    }
    frame.extend([0; 4]);
    frame.extend(text.bytes());
    frame
}

/// The reading with the statistics of those before it.
fn counted(heard: &mut DeviceState, reading: Reading) -> Reading {
    let stamp = Stamp { arrived_s: reading.arrived_s, measured_s: None };
    heard.take_pose_at(stamp, 0, reading.device_from_handle, 1.0);
    let info = heard.sensors.get(&0).map(|pose| SampleInfo {
        count: pose.count,
        flow: pose.flow,
        before: pose.before,
    });
    Reading { info: info.unwrap_or_default(), ..reading }
}

/// The contents of one message of the service.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Name of the first arm.
    pub id: Option<String>,
    /// Where such a service reads its force.
    pub key: ForceKey,
    /// `None`: there is no arm, or it does not say where it is.
    pub reading: Option<Reading>,
}

/// The key of the force in `set_cursor_force`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ForceKey {
    /// Since 3.5.
    Vector,
    /// Before: 3.1.
    Values,
}

#[derive(serde::Deserialize)]
struct Said {
    /// Since 3.5.
    session_id: Option<IgnoredAny>,
    #[serde(default)]
    inverse3: Vec<Arm>,
    #[serde(default)]
    wireless_verse_grip: Vec<Grip>,
    #[serde(default)]
    verse_grip: Vec<Grip>,
    #[serde(default)]
    custom_verse_grip: Vec<Grip>,
}

#[derive(serde::Deserialize)]
struct Arm {
    device_id: String,
    state: Option<ArmState>,
}

#[derive(serde::Deserialize)]
struct ArmState {
    cursor_position: Option<Xyz>,
    /// Since 3.5; before it is `mode`.
    control_mode: Option<IgnoredAny>,
}

#[derive(serde::Deserialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(serde::Deserialize)]
struct Grip {
    #[serde(default)]
    device_id: String,
    state: Option<GripState>,
}

#[derive(serde::Deserialize)]
struct GripState {
    orientation: Option<Xyzw>,
    /// Of a wireless grip, by their names.
    #[serde(default)]
    buttons: BTreeMap<String, bool>,
    /// The one of a grip on a wire.
    #[serde(default)]
    button: bool,
}

#[derive(serde::Deserialize)]
struct Xyzw {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

/// Reads a message of the service. Other keys are ignored, because every version adds some.
pub fn parse(text: &str, arrived_s: f64, buttons: [GripButton; 2]) -> Result<State, String> {
    let said: Said = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let has_mode = |arm: &Arm| arm.state.as_ref().is_some_and(|state| state.control_mode.is_some());
    let is_new = said.session_id.is_some() || said.inverse3.iter().any(has_mode);
    let key = if is_new { ForceKey::Vector } else { ForceKey::Values };
    let Some(arm) = said.inverse3.into_iter().next() else {
        return Ok(State { id: None, key, reading: None });
    };
    if arm.device_id.is_empty() || arm.device_id.len() > 64 {
        return Err(format!("a device_id of {} bytes", arm.device_id.len()));
    }
    let lists = [said.wireless_verse_grip, said.verse_grip, said.custom_verse_grip];
    let told = |grip: Grip| grip.state.map(|state| (grip.device_id, state));
    let grips: Vec<(String, GripState)> = lists.into_iter().flatten().filter_map(told).collect();
    let first = grips.first();
    let orientation = first.and_then(|(_, state)| state.orientation.as_ref());
    let rotation = orientation.map(|q| Quaternion::new(q.w, q.x, q.y, q.z));
    let rotation = rotation.map(|q| UnitQuaternion::try_new(q, 0.5).ok_or("an orientation of no length"));
    let rotation = rotation.transpose()?.unwrap_or_else(UnitQuaternion::identity);
    // Some grips stand in two lists, each with other buttons.
    let is_pressed = |button: GripButton| {
        let is_same = |(id, _): &&(String, GripState)| first.is_some_and(|(first, _)| first == id);
        grips.iter().filter(is_same).any(|(_, state)| {
            let is_named = state.buttons.get(button.name()).copied().unwrap_or(false);
            is_named || button == GripButton::A && state.button
        })
    };
    let buttons = buttons.map(is_pressed);
    let place = arm.state.and_then(|state| state.cursor_position);
    let reading = place.map(|Xyz { x, y, z }| {
        let pose = Isometry3::from_parts(Translation3::new(x, y, z), rotation);
        Reading { buttons, ..Reading::at(pose, arrived_s) }
    });
    Ok(State { id: Some(arm.device_id), key, reading })
}

/// The command for the arm `id` to push with a force.
pub fn force_command(id: &str, key: ForceKey, push: &Push) -> String {
    let [x, y, z] = push.force.into();
    let force = serde_json::json!({ "x": x, "y": y, "z": z });
    let set = match key {
        ForceKey::Vector => serde_json::json!({ "vector": force }),
        ForceKey::Values => serde_json::json!({ "values": force }),
    };
    let command = serde_json::json!({ "device_id": id, "commands": { "set_cursor_force": set } });
    serde_json::json!({ "inverse3": [command] }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const USUAL: [GripButton; 2] = [GripButton::A, GripButton::B];

    const STATE: &str = r#"{ "inverse3": [{ "device_id": "0A1B", "config": { "handedness": "right" },
        "state": { "cursor_position": { "x": 0.01, "y": -0.12, "z": 0.2 }, "cursor_velocity": { "x": 0, "y": 0, "z": 0 } } }],
        "wireless_verse_grip": [{ "device_id": "77", "state": {
            "orientation": { "x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8 }, "buttons": { "a": true, "b": false, "c": true } } }] }"#;

    #[test]
    fn a_state_message_is_read() {
        let state = parse(STATE, 7.0, USUAL).unwrap();
        let reading = state.reading.unwrap();
        assert_eq!((state.id.as_deref(), reading.buttons), (Some("0A1B"), [true, false]));
        assert_eq!(reading.arrived_s, 7.0);
        assert_eq!(reading.device_from_handle.translation.vector, Vector3::new(0.01, -0.12, 0.2));
        assert!((reading.device_from_handle.rotation.angle() - 2.0 * 0.8f64.acos()).abs() < 1e-12);
        let nothing = State { id: None, key: ForceKey::Values, reading: None };
        assert_eq!((state.key, parse("{}", 0.0, USUAL).unwrap()), (ForceKey::Values, nothing));
        assert_eq!(pressed(STATE, [GripButton::C, GripButton::B]), [true, false]);
    }

    fn pressed(text: &str, buttons: [GripButton; 2]) -> [bool; 2] {
        parse(text, 0.0, buttons).unwrap().reading.unwrap().buttons
    }

    /// As the documentation of 3.5 has them: an arm with `control_mode`, a grip on a wire with one `button`, and one grip
    /// in two lists.
    #[test]
    fn messages_of_the_service_3_5_are_read() {
        let wired = r#"{ "session_id": 7, "inverse3": [{ "device_id": "049D", "state": {
            "cursor_position": { "x": 0.0, "y": -0.12, "z": 0.15 }, "control_domain": "cartesian", "control_mode": "idle" },
            "status": { "calibrated": true, "in_use": false, "power_supply": true, "ready": true, "started": true } }],
            "verse_grip": [{ "device_id": "61548", "state": { "button": true, "hall": 0,
            "orientation": { "x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8 } }, "status": { "error": 0, "ready": true } }],
            "wireless_verse_grip": [], "custom_verse_grip": [] }"#;
        let state = parse(wired, 0.0, USUAL).unwrap();
        assert_eq!((state.id.as_deref(), state.key), (Some("049D"), ForceKey::Vector));
        assert_eq!(state.reading.unwrap().buttons, [true, false]);
        assert_eq!(pressed(wired, [GripButton::C, GripButton::B]), [false, false]);
        let without = wired.replace("\"session_id\": 7, ", "");
        assert_eq!(parse(&without, 0.0, USUAL).unwrap().key, ForceKey::Vector, "by the arm's control_mode");
        let twice = wired.replace(
            "\"wireless_verse_grip\": []",
            r#""wireless_verse_grip": [{ "device_id": "3", "state": {
            "buttons": { "down": false, "up": true, "right": false, "left": false }, "trigger": 3 } }]"#,
        );
        let twice = twice.replace(
            "\"custom_verse_grip\": []",
            r#""custom_verse_grip": [{ "device_id": "3", "state": {
            "buttons": { "a": false, "b": true, "c": false }, "extension_data": [0, 3] } }]"#,
        );
        assert_eq!(pressed(&twice, [GripButton::Up, GripButton::B]), [true, true]);
        assert_eq!(pressed(&twice, USUAL), [false, true], "the wired one is another");
    }

    #[test]
    fn a_force_command_is_what_the_service_documents() {
        let push = Push { force: Vector3::new(1.0, -2.5, 0.0), torque: Vector3::x() };
        let force = serde_json::json!({"x": 1.0, "y": -2.5, "z": 0.0});
        for (key, expected) in [
            (ForceKey::Vector, serde_json::json!({ "vector": force })),
            (ForceKey::Values, serde_json::json!({ "values": force })),
        ] {
            let text = force_command("0A\"1B", key, &push);
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            let arm = &value["inverse3"][0];
            assert_eq!(arm["device_id"], "0A\"1B");
            assert_eq!(arm["commands"]["set_cursor_force"], expected);
        }
    }

    /// The longest name an arm may have, each character escaped, fits the last word.
    #[test]
    fn the_last_word_is_a_frame_that_a_server_reads() {
        for id in ["049D".to_owned(), "\u{1}".repeat(64)] {
            let text = force_command(&id, ForceKey::Values, &Push::NONE);
            let frame = masked_text(&text);
            assert!(frame.len() <= 512, "{}", frame.len());
            let pipe = std::io::Cursor::new(frame);
            let role = tungstenite::protocol::Role::Server;
            let heard = WebSocket::from_raw_socket(pipe, role, None).read().unwrap();
            assert_eq!(heard, Message::text(text));
        }
    }

    proptest! {
        #[test]
        fn no_text_panics(text in ".*") {
            let _ = parse(&text, 0.0, USUAL);
        }

        #[test]
        fn no_mutation_panics(at in 0..STATE.len(), byte in 0u8..128, cut in 0..STATE.len()) {
            let mut bytes = STATE.as_bytes().to_vec();
            bytes[at] = byte;
            bytes.truncate(cut.max(1));
            if let Ok(text) = std::str::from_utf8(&bytes) {
                let _ = parse(text, 0.0, USUAL);
            }
        }
    }
}
