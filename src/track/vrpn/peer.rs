//! One client of the VRPN server: its connection, what its numbers mean, and what waits to be sent to it.
//!
//! Nothing here blocks. What waits is bounded: a client that does not take what it is sent is given up.

use super::codec::{self, COOKIE_BYTES, Fault, Framer, Header, Message};
use super::listener::PeerKinds;
use super::payload::{Kind, Payload};
use crate::track::device::now_s;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream, UdpSocket};

/// What may wait for a client. At 1 kHz and five messages a tick it is half a second's.
pub const MOST_WAITING: usize = 256 << 10;
/// Most bytes taken from one client at once.
const MOST_BYTES: usize = 16 << 10;
/// How long a client has to send its cookie, s.
const COOKIE_S: f64 = 3.0;
/// A client that is sent nothing hears from its devices at least so often, s: one that is gone is found out.
const ALIVE_S: f64 = 5.0;

/// The types that the server sends; their numbers are their places.
pub const SERVED: [Kind; 6] =
    [Kind::PosQuat, Kind::ButtonChange, Kind::ButtonStates, Kind::AnalogChannel, Kind::Ping, Kind::Pong];

/// Why a client was given up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gone {
    Closed,
    Slow,
    Malformed(Fault),
    Silent,
}

pub struct Peer {
    pub ip: IpAddr,
    /// Where it takes trackers by UDP.
    pub udp: Option<SocketAddr>,
    stream: TcpStream,
    framer: Framer,
    version: Option<codec::Version>,
    since_s: f64,
    told_s: f64,
    kinds: PeerKinds,
    /// Its numbers for our devices.
    senders: Vec<Option<i32>>,
    waiting: Vec<u8>,
    sequence: u32,
}

impl Peer {
    pub fn new(stream: TcpStream, devices: &[String]) -> std::io::Result<Peer> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        let mut peer = Peer {
            ip: stream.peer_addr()?.ip(),
            udp: None,
            stream,
            framer: Framer::default(),
            version: None,
            since_s: now_s(),
            told_s: now_s(),
            kinds: PeerKinds::default(),
            senders: vec![None; devices.len()],
            waiting: codec::cookie().to_vec(),
            sequence: 0,
        };
        for (id, name) in devices.iter().enumerate() {
            peer.describe(id, codec::SENDER_DESCRIPTION, name);
        }
        for (id, kind) in SERVED.iter().enumerate() {
            peer.describe(id, codec::TYPE_DESCRIPTION, kind.name());
        }
        Ok(peer)
    }

    /// Whether it has shown that it speaks the protocol.
    pub fn is_greeted(&self) -> bool {
        self.version.is_some()
    }

    /// Queues a message of device `device`; by UDP, where the client takes that and the message may get lost. A client
    /// that is about to be given up gets no more.
    pub fn tell(&mut self, device: usize, time_s: f64, payload: &Payload, datagrams: &mut Vec<u8>) {
        if self.waiting.len() > MOST_WAITING {
            return;
        }
        let kind = SERVED.iter().position(|kind| *kind == payload.kind()).unwrap_or(0);
        let header = Header { sequence: self.next(), ..Header::now(device as i32, kind as i32).at(time_s) };
        let by_udp = self.udp.is_some() && payload.kind() == Kind::PosQuat;
        codec::encode(&header, &payload.encode(), if by_udp { datagrams } else { &mut self.waiting });
        self.told_s = now_s();
    }

    /// Sends what was queued for UDP, as many whole messages in a datagram as it holds, and says how many datagrams
    /// went. One that is lost is followed by a newer one.
    pub fn send_datagrams(&self, udp: &UdpSocket, bytes: &[u8]) -> u64 {
        let Some(place) = self.udp else { return 0 };
        let (mut first, mut end, mut sent) = (0, 0, 0);
        while let Ok(Some((_, taken))) = codec::decode(&bytes[end..]) {
            if end + taken - first > codec::DATAGRAM_BYTES {
                sent += u64::from(udp.send_to(&bytes[first..end], place).is_ok());
                first = end;
            }
            end += taken;
        }
        if end > first {
            sent += u64::from(udp.send_to(&bytes[first..end], place).is_ok());
        }
        sent
    }

    /// Takes what the client says, up to a bound. `devices` are our names; the result says how many pings came.
    pub fn hear(&mut self, devices: &[String]) -> Result<u64, Gone> {
        let space = self.framer.space();
        let most = space.len().min(MOST_BYTES);
        match self.stream.read(&mut space[..most]) {
            Ok(0) => return Err(Gone::Closed),
            Ok(bytes) => self.framer.wrote(bytes),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            Err(_) => return Err(Gone::Closed),
        }
        if self.version.is_none() {
            let Some(cookie) = self.framer.cookie() else {
                let is_late = now_s() - self.since_s > COOKIE_S;
                return if is_late { Err(Gone::Silent) } else { Ok(0) };
            };
            self.greet(&cookie)?;
        }
        let mut framer = std::mem::take(&mut self.framer);
        let mut pings = 0;
        while let Some(message) = framer.message().map_err(Gone::Malformed)? {
            pings += u64::from(self.take(&message, devices)?);
        }
        self.framer = framer;
        Ok(pings)
    }

    /// Sends what waits, as far as the client takes it.
    pub fn flush(&mut self) -> Result<(), Gone> {
        if self.is_greeted() && now_s() - self.told_s > ALIVE_S {
            self.pong(0);
        }
        let mut sent = 0;
        while sent < self.waiting.len() {
            match self.stream.write(&self.waiting[sent..]) {
                Ok(bytes) => sent += bytes,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(Gone::Closed),
            }
        }
        self.waiting.drain(..sent);
        if self.waiting.len() > MOST_WAITING { Err(Gone::Slow) } else { Ok(()) }
    }

    fn next(&mut self) -> u32 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn describe(&mut self, id: usize, system: i32, name: &str) {
        let header = Header { sequence: self.next(), ..Header::now(id as i32, system) };
        codec::encode(&header, &codec::encode_name(name), &mut self.waiting);
    }

    fn greet(&mut self, cookie: &[u8; COOKIE_BYTES]) -> Result<(), Gone> {
        let version = codec::parse_cookie(cookie).map_err(Gone::Malformed)?;
        if version != codec::VERSION {
            let codec::Version { major, minor } = version;
            tracing::warn!("vrpn: {} speaks {major:02}.{minor:02}, this side 07.38", self.ip);
        }
        self.version = Some(version);
        Ok(())
    }

    fn pong(&mut self, device: usize) {
        let now_s = Header::now(0, 0).time_s();
        self.tell(device, now_s, &Payload::Pong, &mut Vec::new());
    }

    /// Whether the message was a ping of one of our devices; it is answered.
    fn take(&mut self, message: &Message, devices: &[String]) -> Result<bool, Gone> {
        let id = message.header.sender;
        match message.header.kind {
            codec::SENDER_DESCRIPTION => {
                let name = codec::decode_name(message.payload).map_err(Gone::Malformed)?;
                for (sender, device) in self.senders.iter_mut().zip(devices) {
                    let is_named = device == name;
                    *sender = if is_named { Some(id) } else { sender.filter(|known| *known != id) };
                }
            }
            codec::TYPE_DESCRIPTION => {
                let name = codec::decode_name(message.payload).map_err(Gone::Malformed)?;
                self.kinds.describe(id, name);
            }
            // The client's own address counts, whatever it writes: nobody has us send to another.
            codec::UDP_DESCRIPTION => {
                let port = u16::try_from(id).ok().filter(|port| *port >= 1024);
                self.udp = port.map(|port| SocketAddr::new(self.ip, port));
            }
            codec::DISCONNECT => return Err(Gone::Closed),
            kind if self.kinds.kind(kind) == Some(Kind::Ping) => {
                if let Some(device) = self.senders.iter().position(|sender| *sender == Some(id)) {
                    self.pong(device);
                    return Ok(true);
                }
            }
            _ => {}
        }
        Ok(false)
    }
}
