//! One device of a VRPN server as a source: connects, receives, and connects again when the server is gone.
//!
//! In: the device's name, as `Tracker0@host`. Out: its newest state, without a lock. Reads the TCP stream on one thread
//! and, while connected, the UDP port that was offered for poses on a second one.

use super::address::{Address, Transport, encode_lob, resolve};
use super::codec::{self, Framer, Header};
use super::connection::{Control, SPOKEN, message};
use super::force::ForceSender;
use super::payload::Payload;
use crate::track::device::{DeviceState, Link, Source, now_s};
use crate::track::flow::{PUBLISH_S, RateLimiter};
use crate::track::listen::is_only_late;
use crate::track::source_entry::{ANY, SourceEntry, SourceSettings, keys};
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::{Builder, Thread, park_timeout};
use std::time::Duration;
use triple_buffer::Output;

pub const SOURCE: SourceEntry =
    SourceEntry { key: "vrpn", more_keys: &["transport"], sensors: ANY, has_buttons: true, read };

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    vrpn: String,
    transport: Option<Transport>,
}

fn read(tracker: &str, table: &toml::Table) -> Result<SourceSettings, String> {
    let Keys { vrpn, transport } = keys(tracker, table)?;
    let wrong = |why: &str| {
        let vrpn: String = vrpn.chars().take(100).collect();
        format!(
            "`vrpn` of tracker `{tracker}` is \"{vrpn}\": {why}; write \"Tracker0@host\", \"Tracker0@host:3883\" or \
             \"tcp://host:3883/Tracker0\""
        )
    };
    let address = Address::parse(&vrpn).map_err(|error| wrong(error.fault))?;
    if transport == Some(Transport::Lob) && !address.udp {
        return Err(wrong("it says tcp and `transport` says lob"));
    }
    let transport = transport.unwrap_or_default();
    let open = Box::new(move |_: &str| Ok(Box::new(Client::open(address, transport)) as Box<dyn Source>));
    Ok(SourceSettings { exclusive_use: None, open })
}

/// The times after which things happen, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Longest time until a server accepts the connection, and then until it sends its cookie, s.
    pub connect_s: f64,
    pub ping_s: f64,
    /// Silence for this long gives a warning, or ends the connection. A device that answers no ping within `quiet_s` does
    /// not exist.
    pub quiet_s: f64,
    pub down_s: f64,
    /// Time between two lobs, s.
    pub lob_s: f64,
    /// The wait before the first new attempt, doubled for each further one up to the longest.
    pub first_retry_s: f64,
    pub longest_retry_s: f64,
}

impl Default for Timing {
    fn default() -> Timing {
        Timing {
            connect_s: 3.0,
            ping_s: 1.0,
            quiet_s: 3.0,
            down_s: 10.0,
            lob_s: 2.0,
            first_retry_s: 0.5,
            longest_retry_s: 8.0,
        }
    }
}

pub struct Client {
    address: Address,
    output: Output<DeviceState>,
    control: Arc<Control>,
    thread: Option<Thread>,
}

/// Most bytes taken from the stream at once.
const MOST_BYTES: usize = 16 << 10;
/// The pause between two checks where no blocking call is possible.
const PAUSE: Duration = Duration::from_millis(5);
/// Time between two checks of a thread that receives nothing whether it must end.
const WAKE: Duration = Duration::from_millis(50);

impl Client {
    /// Starts to connect and receive, whether or not the server is there.
    pub fn open(address: Address, transport: Transport) -> Client {
        Client::with_timing(address, transport, Timing::default())
    }

    pub fn with_timing(address: Address, transport: Transport, timing: Timing) -> Client {
        let (control, output) = Control::new(&address.device);
        let control = Arc::new(control);
        let connection = Connection { address: address.clone(), transport, timing, control: control.clone() };
        let thread = match Builder::new().name("vrpn".into()).spawn(move || connection.run()) {
            Ok(thread) => Some(thread.thread().clone()),
            Err(error) => {
                control.hearing().set_link(Link::Down(format!("cannot start its thread: {error}")));
                None
            }
        };
        Client { address, output, control, thread }
    }

    /// Sends forces to the device, on a thread that ends with the sender.
    pub fn force_sender(&self) -> ForceSender {
        ForceSender::new(self.control.clone())
    }

    /// The force that the device last reported, N, in its own frame.
    pub fn force(&self) -> Option<[f64; 3]> {
        self.control.hearing().listener.force
    }
}

impl Source for Client {
    fn describe(&self) -> String {
        format!("vrpn {}", self.address)
    }

    fn latest(&mut self) -> &DeviceState {
        self.output.read()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.control.stop.store(true, Relaxed);
        self.control.hang_up();
        self.thread.iter().for_each(Thread::unpark);
    }
}

/// Everything that the reading thread needs.
struct Connection {
    address: Address,
    transport: Transport,
    timing: Timing,
    control: Arc<Control>,
}

impl Connection {
    fn run(self) {
        let mut retry_s = self.timing.first_retry_s;
        let mut was_up = false;
        while !self.control.stop.load(Relaxed) {
            let began_s = now_s();
            let Err(reason) = self.connect().and_then(|stream| self.converse(stream, was_up));
            self.control.hang_up();
            let mut hearing = self.control.hearing();
            if hearing.listener.is_there() && hearing.listener.heard_s > began_s {
                (retry_s, was_up) = (self.timing.first_retry_s, true);
            }
            tracing::info!("vrpn {}: {reason}; again in {retry_s} s", self.address);
            hearing.listener.state.link = Link::Down(reason);
            hearing.listener.release();
            hearing.publish();
            drop(hearing);
            park_timeout(Duration::from_secs_f64(retry_s));
            retry_s = (2.0 * retry_s).min(self.timing.longest_retry_s);
        }
    }

    fn connect(&self) -> Result<TcpStream, String> {
        let Address { host, port, .. } = &self.address;
        let server = resolve(&self.address)
            .map_err(|error| format!("no host is known by the name {host}: try its IP address ({error})"))?;
        match self.transport {
            Transport::Tcp => {
                TcpStream::connect_timeout(&server, Duration::from_secs_f64(self.timing.connect_s))
                    .map_err(|error| format!("{host}:{port}: {error}"))
            }
            Transport::Lob => self.lob(server).map_err(|error| format!("{host}:{port}: {error}")),
        }
    }

    /// Asks the server by UDP to connect to this side.
    fn lob(&self, server: SocketAddr) -> std::io::Result<TcpStream> {
        if !server.is_ipv4() {
            return Err(std::io::Error::other("a lob needs an IPv4 address"));
        }
        let udp = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
        udp.connect(server)?;
        let listener = TcpListener::bind((udp.local_addr()?.ip(), 0))?;
        listener.set_nonblocking(true)?;
        let lob = encode_lob(listener.local_addr()?);
        let (began_s, mut next_s) = (now_s(), 0.0);
        while now_s() - began_s < self.timing.down_s && !self.control.stop.load(Relaxed) {
            if now_s() >= next_s {
                udp.send(&lob)?;
                next_s = now_s() + self.timing.lob_s;
            }
            match listener.accept() {
                Ok((stream, from)) if from.ip() == server.ip() => {
                    stream.set_nonblocking(false)?;
                    return Ok(stream);
                }
                Ok(_) => self.control.hearing().listener.state.counters.dropped += 1,
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => return Err(error),
            }
            std::thread::sleep(PAUSE);
        }
        Err(std::io::Error::other("no answer to the lob"))
    }

    /// Talks with the server until the connection ends; returns the reason.
    fn converse(&self, mut stream: TcpStream, again: bool) -> Result<std::convert::Infallible, String> {
        let text = |error: std::io::Error| error.to_string();
        stream.set_nodelay(true).map_err(text)?;
        stream.set_read_timeout(Some(WAKE)).map_err(text)?;
        stream.set_write_timeout(Some(Duration::from_secs_f64(self.timing.connect_s))).map_err(text)?;
        stream.write_all(&codec::cookie()).map_err(text)?;
        let mut framer = Framer::default();
        self.cookie(&mut stream, &mut framer)?;

        let server = stream.peer_addr().map_err(text)?.ip();
        let here = stream.local_addr().map_err(text)?.ip();
        let udp = if self.address.udp { UdpSocket::bind((here, 0)).ok() } else { None };
        stream.write_all(&self.introduction(here, udp.as_ref())).map_err(text)?;
        self.control.connected(stream.try_clone().map_err(text)?);
        let mut hearing = self.control.hearing();
        hearing.listener.connected();
        hearing.listener.state.counters.reconnects += u64::from(again);
        drop(hearing);

        let over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            if let Some(udp) = &udp {
                let thread = Builder::new().name("vrpn udp".into());
                thread.spawn_scoped(scope, || self.hear_datagrams(udp, server, &over)).map_err(text)?;
            }
            let result = self.hear(&mut stream, &mut framer);
            over.store(true, Relaxed);
            result
        })
    }

    fn cookie(&self, stream: &mut TcpStream, framer: &mut Framer) -> Result<(), String> {
        let deadline_s = now_s() + self.timing.connect_s;
        let cookie = loop {
            if let Some(cookie) = framer.cookie() {
                break cookie;
            }
            if now_s() > deadline_s || self.control.stop.load(Relaxed) {
                return Err("the peer sends no cookie: is it a VRPN server?".to_owned());
            }
            receive(stream, framer)?;
        };
        let version = codec::parse_cookie(&cookie).map_err(|fault| {
            self.control.hearing().listener.state.counters.malformed += 1;
            fault.to_string()
        })?;
        if version != codec::VERSION {
            let codec::Version { major, minor } = version;
            tracing::warn!("vrpn {}: the server speaks {major:02}.{minor:02}, this side 07.38", self.address);
        }
        Ok(())
    }

    /// Describes what this side sends, and where poses may be sent by UDP.
    fn introduction(&self, here: IpAddr, udp: Option<&UdpSocket>) -> Vec<u8> {
        let mut bytes = Vec::new();
        let described = |id, kind, name: &str, bytes: &mut Vec<u8>| {
            codec::encode(&Header::now(id, kind), &codec::encode_name(name), bytes);
        };
        described(0, codec::SENDER_DESCRIPTION, &self.address.device, &mut bytes);
        for (id, kind) in SPOKEN.iter().enumerate() {
            described(id as i32, codec::TYPE_DESCRIPTION, kind.name(), &mut bytes);
        }
        if let Some(port) = udp.and_then(|udp| udp.local_addr().ok()).map(|place| place.port()) {
            let header = Header::now(i32::from(port), codec::UDP_DESCRIPTION);
            codec::encode(&header, format!("{here}\0").as_bytes(), &mut bytes);
        }
        bytes
    }

    fn hear(&self, stream: &mut TcpStream, framer: &mut Framer) -> Result<std::convert::Infallible, String> {
        let (mut next_ping_s, mut limiter, mut was_waiting) = (0.0, RateLimiter::default(), false);
        loop {
            if self.control.stop.load(Relaxed) {
                return Err("not listened to any more".to_owned());
            }
            if now_s() >= next_ping_s && self.control.hearing().listener.pings(now_s()) {
                if !self.control.send(&message(&Payload::Ping)) {
                    return Err("the connection broke".to_owned());
                }
                next_ping_s = now_s() + self.timing.ping_s;
            }
            let began_s = now_s();
            let mut hearing = self.control.hearing();
            // Handle what came with the cookie before reading more.
            let mut heard = 0;
            loop {
                match framer.message() {
                    Ok(None) => break,
                    Ok(Some(message)) if hearing.listener.take(&message) => heard += 1,
                    Ok(Some(_)) => return Err("the server said good-bye".to_owned()),
                    Err(fault) => {
                        hearing.listener.state.counters.malformed += 1;
                        return Err(fault.to_string());
                    }
                }
            }
            let silent_s = now_s() - hearing.listener.heard_s;
            let link = match hearing.listener.is_there() {
                false if silent_s > self.timing.quiet_s => {
                    return Err(hearing.listener.why_missing(silent_s));
                }
                // A device that was missing is missing until it answers.
                false if matches!(hearing.listener.state.link, Link::Down(_)) => {
                    hearing.listener.state.link.clone()
                }
                false => Link::Waiting,
                true if silent_s > self.timing.down_s => {
                    return Err(format!("says nothing for {silent_s:.0} s"));
                }
                true if silent_s > self.timing.quiet_s => Link::Quiet,
                true => Link::Up,
            };
            if link == Link::Quiet && hearing.listener.state.link != link {
                tracing::warn!("vrpn {}: says nothing for {silent_s:.0} s", self.address);
            }
            hearing.set_link(link);
            hearing.listener.state.counters.packets += u64::from(heard > 0);
            let is_waiting = hearing.publish_changed(heard > 0);
            let wait = if heard > 0 { hearing.throttle(&mut limiter, began_s) } else { None };
            drop(hearing);
            wait.into_iter().for_each(std::thread::sleep);
            if std::mem::replace(&mut was_waiting, is_waiting) != is_waiting {
                stream.set_read_timeout(Some(wake(is_waiting))).map_err(|error| error.to_string())?;
            }
            receive(stream, framer)?;
        }
    }

    fn hear_datagrams(&self, udp: &UdpSocket, server: IpAddr, over: &AtomicBool) {
        if udp.set_read_timeout(Some(WAKE)).is_err() {
            return;
        }
        let mut buffer = [0; 2048];
        let (mut limiter, mut was_waiting) = (RateLimiter::default(), false);
        while !over.load(Relaxed) {
            let received = udp.recv_from(&mut buffer);
            let began_s = now_s();
            let mut hearing = self.control.hearing();
            let mut wait = None;
            let has_changed = match received {
                Ok((bytes, from)) if from.ip() == server => {
                    hearing.listener.take_datagram(&buffer[..bytes]);
                    true
                }
                Ok(_) => {
                    hearing.listener.state.counters.dropped += 1;
                    false
                }
                Err(error) => {
                    // Do not spin on a lasting error.
                    wait = (!is_only_late(&error)).then_some(WAKE);
                    false
                }
            };
            let is_waiting = hearing.publish_changed(has_changed);
            wait = wait.or_else(|| hearing.throttle(&mut limiter, began_s));
            drop(hearing);
            if std::mem::replace(&mut was_waiting, is_waiting) != is_waiting {
                let _ = udp.set_read_timeout(Some(wake(is_waiting)));
            }
            wait.into_iter().for_each(std::thread::sleep);
        }
    }
}

/// Reads once, at most `MOST_BYTES`; 0 if nothing came in time.
fn receive(stream: &mut TcpStream, framer: &mut Framer) -> Result<usize, String> {
    let space = framer.space();
    let most = space.len().min(MOST_BYTES);
    match stream.read(&mut space[..most]) {
        Ok(0) => Err("the server closed the connection".to_owned()),
        Ok(bytes) => {
            framer.wrote(bytes);
            Ok(bytes)
        }
        Err(error) if is_only_late(&error) => Ok(0),
        Err(error) => Err(error.to_string()),
    }
}

/// Time to wait for data: not long if a changed state still waits to be published.
fn wake(is_waiting: bool) -> Duration {
    if is_waiting { Duration::from_secs_f64(PUBLISH_S) } else { WAKE }
}
