//! Haply's Inverse3 through its Inverse Service: JSON over a WebSocket, one state message for each force command.
//!
//! In: `inverse3[0].state.cursor_position` in metres, and orientation and buttons of the first `wireless_verse_grip` or
//! `verse_grip`, if there is one. Out: `set_cursor_force` in newtons; the arm has no torque. The service answers every
//! command with the next state, so a thread of its own keeps the two in step at the service's own rate; the loop reads and
//! writes triple buffers. Written from the service's public documentation (version 3.1) and tried against a server of our
//! own alone. What comes is bounded and strictly read; a service that vanishes is tried again.

use super::device::{Device, News, Push, Reading};
use crate::base::peak::Peak;
use crate::track::device::{DeviceState, Stamp, now_s};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Duration;
use triple_buffer::{Input, Output, triple_buffer};
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message, WebSocket};

/// Where the service listens unless told otherwise.
pub const PORT: u16 = 10001;
/// A longer message is refused, bytes.
const LONGEST: usize = 64 << 10;
/// A command of the loop that is older than this is not passed on, s: no force instead.
const COMMAND_S: f64 = 0.02;
/// So much silence ends the connection, s.
const SILENT_S: f64 = 1.0;
/// Between two attempts to connect, s.
const RETRY_S: f64 = 1.0;
const WAKE: Duration = Duration::from_millis(50);
/// What an answer must be feared to take before the first has come, s.
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
    /// From a tick's command to the state that answers it, the longest of late: bits of an f64, s; 0 before the first.
    echo: AtomicU64,
}

impl Haply {
    /// `host` or `host:port`; connects in the background.
    pub fn open(place: &str) -> std::io::Result<Haply> {
        let place = if place.contains(':') { place.to_owned() } else { format!("{place}:{PORT}") };
        let (reading, newest) = triple_buffer(&None);
        let (command, commands) = triple_buffer(&(Push::NONE, f64::NEG_INFINITY));
        let shared = Arc::new(Shared::default());
        let mut link = Link { place: place.clone(), reading, commands, shared: shared.clone() };
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

    /// A command waits for the state that it answers, goes its way, and is answered by the next state at the service's turn.
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
    reading: Input<Option<Reading>>,
    commands: Output<(Push, f64)>,
    shared: Arc<Shared>,
}

impl Link {
    fn run(&mut self) {
        let mut told = String::new();
        while !self.shared.stop.load(Relaxed) {
            let reason = self.connect().map(|mut socket| self.converse(&mut socket));
            // Once: it is tried every second.
            match reason {
                Ok(reason) => tracing::warn!("haply ws://{}: {reason}", self.place),
                Err(reason) if reason != told => {
                    tracing::warn!("haply ws://{}: {reason}; it is tried again", self.place);
                    told = reason;
                }
                Err(_) => {}
            }
            self.reading.write(None);
            let again_s = now_s() + RETRY_S;
            while now_s() < again_s && !self.shared.stop.load(Relaxed) {
                std::thread::sleep(WAKE);
            }
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

    /// One command for each state, until the connection or this side ends; says why.
    fn converse(&mut self, socket: &mut WebSocket<TcpStream>) -> String {
        let (mut heard_s, mut id) = (now_s(), None);
        let mut heard = DeviceState::default();
        let (mut commanded_s, mut echo) = (None, Peak::default());
        while !self.shared.stop.load(Relaxed) {
            match socket.read() {
                Ok(Message::Text(text)) => {
                    heard_s = now_s();
                    if let Some(commanded_s) = commanded_s {
                        echo.take(heard_s - commanded_s, heard_s);
                        self.shared.echo.store(echo.value.to_bits(), Relaxed);
                    }
                    match parse(&text, heard_s) {
                        Ok(state) => {
                            self.reading.write(state.reading.map(|reading| counted(&mut heard, reading)));
                            id = state.id.or(id);
                        }
                        Err(_) => {
                            self.shared.malformed.fetch_add(1, Relaxed);
                        }
                    }
                    // Whatever it said: it may say nothing more until it is answered.
                    if let Some(id) = &id {
                        let (push, at_s) = *self.commands.read();
                        let is_new = now_s() - at_s <= COMMAND_S;
                        let push = if is_new { push } else { Push::NONE };
                        commanded_s = is_new.then_some(at_s);
                        if let Err(error) = socket.send(Message::text(force_command(id, &push))) {
                            return error.to_string();
                        }
                    }
                }
                Ok(_) => {}
                Err(Error::Io(error))
                    if matches!(
                        error.kind(),
                        std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut
                    ) =>
                {
                    if now_s() - heard_s > SILENT_S {
                        return format!("silent for {SILENT_S} s");
                    }
                }
                Err(error) => return error.to_string(),
            }
        }
        if let Some(id) = &id {
            // Nobody hears of it if the connection is gone.
            let _ = socket.send(Message::text(force_command(id, &Push::NONE)));
        }
        "ended".to_owned()
    }
}

/// A reading with what is known of those before it.
fn counted(heard: &mut DeviceState, reading: Reading) -> Reading {
    let stamp = Stamp { arrived_s: reading.arrived_s, measured_s: None };
    heard.take_pose_at(stamp, 0, reading.device_from_handle, 1.0);
    let news =
        heard.sensors.get(&0).map(|pose| News { count: pose.count, flow: pose.flow, before: pose.before });
    Reading { news: news.unwrap_or_default(), ..reading }
}

/// What one message of the service says.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Name of the first arm.
    pub id: Option<String>,
    /// `None`: there is no arm, or it does not say where it is.
    pub reading: Option<Reading>,
}

#[derive(serde::Deserialize)]
struct Said {
    #[serde(default)]
    inverse3: Vec<Arm>,
    #[serde(default)]
    wireless_verse_grip: Vec<Grip>,
    #[serde(default)]
    verse_grip: Vec<Grip>,
}

#[derive(serde::Deserialize)]
struct Arm {
    device_id: String,
    state: Option<ArmState>,
}

#[derive(serde::Deserialize)]
struct ArmState {
    cursor_position: Option<Xyz>,
}

#[derive(serde::Deserialize)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(serde::Deserialize)]
struct Grip {
    state: Option<GripState>,
}

#[derive(serde::Deserialize)]
struct GripState {
    orientation: Option<Xyzw>,
    #[serde(default)]
    buttons: Buttons,
}

#[derive(serde::Deserialize)]
struct Xyzw {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Default, serde::Deserialize)]
struct Buttons {
    #[serde(default)]
    a: bool,
    #[serde(default)]
    b: bool,
}

/// Reads a message of the service; keys that are not needed here are passed over, as it adds some with every version.
pub fn parse(text: &str, arrived_s: f64) -> Result<State, String> {
    let said: Said = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let grip = said.wireless_verse_grip.into_iter().chain(said.verse_grip).find_map(|grip| grip.state);
    let Some(arm) = said.inverse3.into_iter().next() else { return Ok(State { id: None, reading: None }) };
    if arm.device_id.is_empty() || arm.device_id.len() > 64 {
        return Err(format!("a device_id of {} bytes", arm.device_id.len()));
    }
    let (buttons, rotation) = match grip {
        Some(GripState { orientation, buttons }) => {
            let Buttons { a, b } = buttons;
            let rotation = orientation.map(|q| Quaternion::new(q.w, q.x, q.y, q.z));
            ([a, b], rotation.map(|q| UnitQuaternion::try_new(q, 0.5).ok_or("an orientation of no length")))
        }
        None => ([false; 2], None),
    };
    let rotation = rotation.transpose()?.unwrap_or_else(UnitQuaternion::identity);
    let place = arm.state.and_then(|state| state.cursor_position);
    let reading = place.map(|Xyz { x, y, z }| Reading {
        device_from_handle: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        buttons,
        arrived_s,
        measured_s: None,
        tracked: true,
        news: News::default(),
    });
    Ok(State { id: Some(arm.device_id), reading })
}

/// The command for the arm `id` to push with a force.
pub fn force_command(id: &str, push: &Push) -> String {
    let [x, y, z] = push.force.into();
    let values = serde_json::json!({ "x": x, "y": y, "z": z });
    let command =
        serde_json::json!({ "device_id": id, "commands": { "set_cursor_force": { "values": values } } });
    serde_json::json!({ "inverse3": [command] }).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    const STATE: &str = r#"{ "inverse3": [{ "device_id": "0A1B", "config": { "handedness": "right" },
        "state": { "cursor_position": { "x": 0.01, "y": -0.12, "z": 0.2 }, "cursor_velocity": { "x": 0, "y": 0, "z": 0 } } }],
        "wireless_verse_grip": [{ "device_id": "77", "state": {
            "orientation": { "x": 0.0, "y": 0.6, "z": 0.0, "w": 0.8 }, "buttons": { "a": true, "b": false, "c": true } } }] }"#;

    #[test]
    fn a_state_message_is_read() {
        let state = parse(STATE, 7.0).unwrap();
        let reading = state.reading.unwrap();
        assert_eq!(
            (state.id.as_deref(), reading.buttons, reading.arrived_s),
            (Some("0A1B"), [true, false], 7.0)
        );
        assert_eq!(reading.device_from_handle.translation.vector, Vector3::new(0.01, -0.12, 0.2));
        assert!((reading.device_from_handle.rotation.angle() - 2.0 * 0.8f64.acos()).abs() < 1e-12);
        assert_eq!(parse("{}", 0.0).unwrap(), State { id: None, reading: None });
    }

    #[test]
    fn a_force_command_is_what_the_service_documents() {
        let push = Push { force: Vector3::new(1.0, -2.5, 0.0), torque: Vector3::x() };
        let text = force_command("0A\"1B", &push);
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        let arm = &value["inverse3"][0];
        assert_eq!(arm["device_id"], "0A\"1B");
        assert_eq!(
            arm["commands"]["set_cursor_force"]["values"],
            serde_json::json!({"x": 1.0, "y": -2.5, "z": 0.0})
        );
    }

    proptest! {
        #[test]
        fn no_text_panics(text in ".*") {
            let _ = parse(&text, 0.0);
        }

        #[test]
        fn no_mutation_panics(at in 0..STATE.len(), byte in 0u8..128, cut in 0..STATE.len()) {
            let mut bytes = STATE.as_bytes().to_vec();
            bytes[at] = byte;
            bytes.truncate(cut.max(1));
            if let Ok(text) = std::str::from_utf8(&bytes) {
                let _ = parse(text, 0.0);
            }
        }
    }
}
