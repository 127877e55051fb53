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
use super::haply_messages::{ForceKey, State, force_command, parse};
use crate::base::guard::Guard;
use crate::base::peak::Peak;
use crate::stage::GripButton;
use crate::track::device::{DeviceState, Stamp, now_s};
use crate::track::is_only_late;
use std::collections::BTreeSet;
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
const ASK: &str = r#"{"session":{"force_render_full_state":{}}}"#;
const NO_ARM: &str =
    "the service is up, but has no Inverse3 that says where it is; it is asked again until one is plugged in";
/// The most different warnings per connection.
const MOST_TOLD: usize = 16;
/// Longest sleep of a thread that hears nothing: short enough for the guard to see that the program lives.
const WAKE: Duration = Duration::from_millis(5);
/// The assumed time until an answer before the first one has come, s.
const UNHEARD_S: f64 = 2e-3;

/// Waiting times of this side, s.
#[derive(Clone, Copy, Debug)]
pub struct HaplyTiming {
    /// Silence for this long ends the connection.
    pub silent_s: f64,
    /// Time between two attempts to connect, s.
    pub retry_s: f64,
    /// Time between two questions to a service without an arm, which sends nothing by itself.
    pub ask_s: f64,
}

impl Default for HaplyTiming {
    fn default() -> HaplyTiming {
        HaplyTiming { silent_s: 1.0, retry_s: 1.0, ask_s: 0.25 }
    }
}

/// A service, connected or not.
pub struct Haply {
    place: String,
    newest: Output<Option<Reading>>,
    command: Input<(Push, f64)>,
    shared: Arc<SharedState>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct SharedState {
    stop: AtomicBool,
    malformed: AtomicU64,
    /// The longest recent time from a tick's command to the state that answers it: bits of an f64, s; 0 before the first.
    echo: AtomicU64,
}

impl Haply {
    /// Connects in the background to `host` or `host:port`; `buttons` are the one that grabs and the second one.
    pub fn open(place: &str, buttons: [GripButton; 2]) -> std::io::Result<Haply> {
        Haply::with_timing(place, buttons, HaplyTiming::default())
    }

    pub fn with_timing(place: &str, buttons: [GripButton; 2], timing: HaplyTiming) -> std::io::Result<Haply> {
        let place = if place.contains(':') { place.to_owned() } else { format!("{place}:{PORT}") };
        let (reading, newest) = triple_buffer(&None);
        let (command, commands) = triple_buffer(&(Push::NONE, f64::NEG_INFINITY));
        let shared = Arc::new(SharedState::default());
        let told = BTreeSet::new();
        let mut link =
            Link { place: place.clone(), buttons, timing, reading, commands, shared: shared.clone(), told };
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
    timing: HaplyTiming,
    reading: Input<Option<Reading>>,
    commands: Output<(Push, f64)>,
    shared: Arc<SharedState>,
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
            let again_s = now_s() + self.timing.retry_s;
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
        let patience = Duration::from_secs_f64(self.timing.silent_s);
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
        let mut arm: Option<CommandedArm> = None;
        let mut heard = DeviceState::default();
        let (mut commanded_s, mut echo) = (None, Peak::default());
        while !self.shared.stop.load(Relaxed) {
            if let Some(Err(error)) = arm.as_mut().map(|arm| arm.guard.beat()) {
                return format!("the guard of its force is gone: {error}");
            }
            if arm.is_none() && now_s() - asked_s > self.timing.ask_s {
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
                            match CommandedArm::next(arm, id, key, socket) {
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
                    if let Some(arm) = &mut arm {
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
                    let silent_s = self.timing.silent_s;
                    if now_s() - heard_s > silent_s {
                        return format!("silent for {silent_s} s");
                    }
                }
                Err(error) => return error.to_string(),
            }
        }
        if let Some(arm) = &mut arm {
            // Nobody hears of it if the connection is gone.
            let _ = arm.send(socket, &Push::NONE);
        }
        "ended".to_owned()
    }
}

/// The arm that is commanded. However the program ends, its guard takes the force back.
struct CommandedArm {
    id: String,
    key: ForceKey,
    guard: Guard,
}

impl CommandedArm {
    /// The arm that a message names, or the previous one if it names none.
    fn next(
        before: Option<CommandedArm>,
        id: Option<String>,
        key: ForceKey,
        socket: &mut WebSocket<TcpStream>,
    ) -> std::io::Result<Option<CommandedArm>> {
        let Some(id) = id else { return Ok(before) };
        // A service that has once used 3.5's keys is 3.5, because not every message has all keys.
        let key =
            before.as_ref().filter(|before| before.key == ForceKey::Vector).map_or(key, |_| ForceKey::Vector);
        let none = masked_text(&force_command(&id, key, &Push::NONE));
        let guard = match before {
            Some(before) if before.id == id && before.key == key => return Ok(Some(before)),
            Some(mut before) => {
                // Nobody hears of it if that arm is gone.
                let _ = before.send(socket, &Push::NONE);
                before.guard.sends(&none)?;
                before.guard
            }
            None => Guard::start(socket.get_ref(), &none)?,
        };
        Ok(Some(CommandedArm { id, key, guard }))
    }

    fn send(&mut self, socket: &mut WebSocket<TcpStream>, push: &Push) -> Result<(), String> {
        let is_force = *push != Push::NONE;
        let said = |said: std::io::Result<()>| {
            said.map_err(|error| format!("the guard of its force is gone: {error}"))
        };
        if is_force {
            said(self.guard.pushes())?;
        }
        let command = Message::text(force_command(&self.id, self.key, push));
        socket.send(command).map_err(|error| error.to_string())?;
        if is_force { Ok(()) } else { said(self.guard.rests()) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_message_is_a_frame_that_a_server_reads() {
        for id in ["049D".to_owned(), "\u{1}".repeat(64)] {
            let text = force_command(&id, ForceKey::Values, &Push::NONE);
            let frame = masked_text(&text);
            let pipe = std::io::Cursor::new(frame);
            let role = tungstenite::protocol::Role::Server;
            let heard = WebSocket::from_raw_socket(pipe, role, None).read().unwrap();
            assert_eq!(heard, Message::text(text));
        }
    }
}
