//! A VRPN server: serves any sources, each as a device with tracker, buttons and analog channels.
//!
//! In: the newest state of every source, as often as the caller likes. Out: whatever has changed in it, to several clients at
//! once by TCP; poses by UDP to clients that asked for it. Everything runs on the caller's thread and never blocks; slow and
//! hostile clients are dropped and counted. Untracked sensors are not sent, because VRPN cannot express them.

use super::address::{decode_lob, is_device_name};
use super::codec::{Header, VERSION, Version};
use super::payload::Payload;
use super::peer::{Gone, Peer};
use crate::track::device::{DeviceState, Reading, Source, now_s};
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

/// The most clients that are served, and the most that are being connected to after a lob.
pub const MOST_CLIENTS: usize = 16;
const MOST_LOBS: usize = MOST_CLIENTS;
const LOB_TIMEOUT: Duration = Duration::from_secs(2);
/// Connections and datagrams that are handled per tick.
const MOST_AT_ONCE: usize = 8;
/// A stamp that differs from the time of day by more than this belongs to a clock with another origin, s.
const OTHER_CLOCK_S: f64 = 86_400.0;
/// The number of analog channels that VRPN's own clients can hold.
const MOST_ANALOGS: usize = 128;

/// Counts of clients since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServerCounters {
    pub clients: usize,
    pub accepted: u64,
    /// Clients beyond [`MOST_CLIENTS`].
    pub refused: u64,
    pub slow: u64,
    /// Dropped because they did not speak VRPN 07 or sent no valid message.
    pub malformed: u64,
    /// Dropped because they never sent a cookie.
    pub silent: u64,
    pub pings: u64,
    /// Datagrams with poses that were sent.
    pub datagrams: u64,
    /// Lobs that named another host or could not be read.
    pub strange_lobs: u64,
}

pub struct Server {
    pub counters: ServerCounters,
    /// The address on which it listens.
    pub place: SocketAddr,
    pub names: Vec<String>,
    listener: TcpListener,
    lobs: UdpSocket,
    /// The state of each device that was sent last.
    sent: Vec<DeviceState>,
    peers: Vec<Peer>,
    lobbed: (mpsc::SyncSender<CallResult>, mpsc::Receiver<CallResult>),
    /// The clients to which threads are connecting, one thread for each.
    connecting: Vec<SocketAddr>,
}

/// A client that asked for a connection, and the connection if it succeeded.
type CallResult = (SocketAddr, Option<TcpStream>);

impl Server {
    /// Listens at `place` by TCP and UDP, with port 0 at any free port. Characters that VRPN does not allow in names are
    /// replaced.
    pub fn bind<'a>(place: SocketAddr, names: impl IntoIterator<Item = &'a str>) -> std::io::Result<Server> {
        let names: Vec<String> = names.into_iter().map(device_name).collect();
        let (listener, lobs) = bind_both(place)?;
        listener.set_nonblocking(true)?;
        lobs.set_nonblocking(true)?;
        Ok(Server {
            counters: ServerCounters::default(),
            place: listener.local_addr()?,
            sent: vec![DeviceState::default(); names.len()],
            names,
            listener,
            lobs,
            peers: Vec::new(),
            lobbed: mpsc::sync_channel(MOST_LOBS),
            connecting: Vec::new(),
        })
    }

    /// The address by which clients name each device.
    pub fn addresses(&self) -> impl Iterator<Item = String> {
        self.names.iter().map(|name| format!("{name}@{}", self.place))
    }

    /// Queues for all clients what has changed in device `device`.
    pub fn publish(&mut self, device: usize, state: &DeviceState) {
        let Some(sent) = self.sent.get(device) else { return };
        let news = news(sent, state);
        if news.is_empty() {
            return;
        }
        for peer in self.peers.iter_mut().filter(|peer| peer.protocol.version().is_some()) {
            let mut datagrams = Vec::new();
            for (time_s, payload) in &news {
                peer.protocol.tell(device, *time_s, payload, &mut datagrams);
            }
            self.counters.datagrams += peer.send_datagrams(&self.lobs, &datagrams);
        }
        self.sent[device] = state.clone();
    }

    /// Accepts new clients, handles what the others sent, and sends what waits.
    pub fn tick(&mut self) {
        self.welcome();
        let (names, counters, sent) = (&self.names, &mut self.counters, &self.sent);
        self.peers.retain_mut(|peer| {
            let was_greeted = peer.protocol.version().is_some();
            // Send first, so that a client that is refused still gets our version.
            let heard = peer.flush().and_then(|()| peer.hear(names));
            if let (false, Some(version)) = (was_greeted, peer.protocol.version()) {
                greet(peer, version, sent);
            }
            match heard.map(|pings| counters.pings += pings) {
                Ok(()) => true,
                Err(gone) => {
                    tracing::info!("vrpn: client {} is gone: {gone:?}", peer.ip);
                    match gone {
                        Gone::Closed => {}
                        Gone::Slow => counters.slow += 1,
                        Gone::Malformed(_) => counters.malformed += 1,
                        Gone::Silent => counters.silent += 1,
                    }
                    false
                }
            }
        });
        self.counters.clients = self.peers.len();
    }

    /// Serves `sources`, in the order of the names, on a thread that looks at them every millisecond.
    pub fn spawn(mut self, mut sources: Vec<Box<dyn Source>>) -> std::io::Result<Serving> {
        let (place, stop) = (self.place, Arc::new(AtomicBool::new(false)));
        let counters = Arc::new(Mutex::new(self.counters));
        let (shared, told) = (stop.clone(), counters.clone());
        let thread = Builder::new().name("vrpn server".into()).spawn(move || {
            while !shared.load(Relaxed) {
                for (device, source) in sources.iter_mut().enumerate() {
                    self.publish(device, source.latest());
                }
                self.tick();
                *told.lock().unwrap_or_else(PoisonError::into_inner) = self.counters;
                std::thread::sleep(Duration::from_millis(1));
            }
        })?;
        Ok(Serving { place, counters, stop, thread: Some(thread) })
    }

    fn welcome(&mut self) {
        for _ in 0..MOST_AT_ONCE {
            let Ok((stream, _)) = self.listener.accept() else { break };
            self.admit(stream);
        }
        let mut lob = [0; 64];
        for _ in 0..MOST_AT_ONCE {
            let Ok((bytes, from)) = self.lobs.recv_from(&mut lob) else { break };
            match decode_lob(&lob[..bytes], from.ip()) {
                // A client repeats its lob until it is connected.
                Some(place) if self.connecting.contains(&place) => {}
                Some(place) if self.connecting.len() < MOST_LOBS => self.connect(place),
                Some(_) => self.counters.refused += 1,
                None => self.counters.strange_lobs += 1,
            }
        }
        while let Ok((place, connected)) = self.lobbed.1.try_recv() {
            self.connecting.retain(|connecting| *connecting != place);
            if let Some(stream) = connected {
                self.admit(stream);
            }
        }
    }

    fn admit(&mut self, stream: TcpStream) {
        if self.peers.len() >= MOST_CLIENTS {
            self.counters.refused += 1;
        } else if let Ok(peer) = Peer::new(stream, &self.names) {
            self.counters.accepted += 1;
            self.peers.push(peer);
        }
    }

    /// Connects to a client that asked for it, on a separate thread.
    fn connect(&mut self, place: SocketAddr) {
        let done = self.lobbed.0.clone();
        let connect = move || {
            let _ = done.send((place, TcpStream::connect_timeout(&place, LOB_TIMEOUT).ok()));
        };
        match Builder::new().name("vrpn lob".into()).spawn(connect) {
            Ok(_) => self.connecting.push(place),
            Err(_) => self.counters.refused += 1,
        }
    }
}

/// A server that runs on a separate thread until it is dropped.
pub struct Serving {
    pub place: SocketAddr,
    counters: Arc<Mutex<ServerCounters>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Serving {
    pub fn counters(&self) -> ServerCounters {
        *self.counters.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.stop.store(true, Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Binds TCP and UDP to the same port; for port 0, finds one that is free for both.
fn bind_both(place: SocketAddr) -> std::io::Result<(TcpListener, UdpSocket)> {
    let mut attempts = if place.port() == 0 { 20 } else { 1 };
    loop {
        let tcp = TcpListener::bind(place)?;
        attempts -= 1;
        match UdpSocket::bind(tcp.local_addr()?) {
            Ok(udp) => return Ok((tcp, udp)),
            Err(error) if error.kind() != ErrorKind::AddrInUse || attempts == 0 => return Err(error),
            Err(_) => {}
        }
    }
}

/// The name, with every character that VRPN does not allow replaced by `_`.
fn device_name(name: &str) -> String {
    let fit = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = name.chars().take(64).map(fit).collect();
    if is_device_name(&name) { name } else { "Tracker0".to_owned() }
}

/// Sends a new client the state of buttons and valuators; poses follow anyway.
fn greet(peer: &mut Peer, version: Version, sent: &[DeviceState]) {
    if version != VERSION {
        tracing::warn!("vrpn: {} speaks {:02}.{:02}, this side 07.38", peer.ip, version.major, version.minor);
    }
    let time_s = Header::now(0, 0).time_s();
    for (device, state) in sent.iter().enumerate() {
        let buttons = dense(&state.buttons, 256).map(|pressed| i32::from(pressed.unwrap_or(false)));
        let buttons: Vec<i32> = buttons.collect();
        if !buttons.is_empty() {
            peer.protocol.tell(device, time_s, &Payload::ButtonStates(buttons), &mut Vec::new());
        }
        let values = analogs(state);
        if !values.is_empty() {
            peer.protocol.tell(device, time_s, &Payload::Analog(values), &mut Vec::new());
        }
    }
}

/// The changes from `old` to `new`, with their times.
fn news(old: &DeviceState, new: &DeviceState) -> Vec<(f64, Payload)> {
    let mut news = Vec::new();
    for (&sensor, reading) in &new.sensors {
        let is_new = old.sensors.get(&sensor).is_none_or(|old| old.count != reading.count);
        if is_new && reading.quality > 0.0 {
            let Isometry3 { rotation, translation } = reading.value;
            let position = translation.vector.into();
            let quaternion = [rotation.i, rotation.j, rotation.k, rotation.w];
            news.push((time_of(reading), Payload::Pose { sensor, position, quaternion }));
        }
    }
    for (&button, reading) in &new.buttons {
        if old.buttons.get(&button).map(|old| old.value) != Some(reading.value) {
            let state = i32::from(reading.value);
            news.push((time_of(reading), Payload::ButtonChange { button, state }));
        }
    }
    let changed = |(channel, reading): &(&i32, &Reading<f64>)| {
        old.valuators.get(channel).is_none_or(|old| old.count != reading.count)
    };
    if let Some((_, reading)) = new.valuators.iter().find(changed) {
        news.push((time_of(reading), Payload::Analog(analogs(new))));
    }
    news
}

fn analogs(state: &DeviceState) -> Vec<f64> {
    dense(&state.valuators, MOST_ANALOGS).map(|value| value.unwrap_or(0.0)).collect()
}

/// The values of the channels from 0 to the last one below `most`.
fn dense<T: Copy>(readings: &BTreeMap<i32, Reading<T>>, most: usize) -> impl Iterator<Item = Option<T>> {
    let last = readings.range(0..most as i32).next_back().map_or(-1, |(channel, _)| *channel);
    (0..=last).map(|channel| readings.get(&channel).map(|reading| reading.value))
}

/// Time at which a reading was measured, s since 1970: by the device's clock if that gives the time of day, else that of its
/// arrival.
fn time_of<T>(reading: &Reading<T>) -> f64 {
    let arrived_s = Header::now(0, 0).time_s() - (now_s() - reading.arrived_s);
    let is_time_of_day = |time_s: &f64| (time_s - arrived_s).abs() < OTHER_CLOCK_S;
    reading.measured_s.filter(is_time_of_day).unwrap_or(arrived_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_times_of_the_day_whatever_clock_a_device_has() {
        let time_s = Header::now(0, 0).time_s();
        let served_s = |measured_s: Option<f64>| {
            let mut state = DeviceState::default();
            state.take_button(0, true, measured_s);
            time_of(&state.buttons[&0])
        };
        assert_eq!(served_s(Some(time_s - 3600.0)), time_s - 3600.0);
        // Since the machine's start, as a gamepad's; no number; none.
        for other in [Some(12.5), Some(f64::NAN), Some(-1.0), None] {
            assert!((served_s(other) - time_s).abs() < 60.0, "{other:?}: {}", served_s(other));
        }
    }
}
