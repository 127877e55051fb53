//! One client of the VRPN server: its connection, what its numbers mean, and what waits to be sent to it.
//!
//! [`Protocol`] is the protocol without a socket, [`Peer`] adds the socket. Nothing blocks, and the queue is bounded: a
//! client that does not read what it is sent is dropped.

use super::codec::{self, CodecFault, Framer, Header, Message};
use super::listener::PeerKinds;
use super::payload::{MessageKind, Payload};
use crate::track::device::now_s;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, TcpStream, UdpSocket};

/// The most that may wait for a client, bytes: half a second at 1 kHz and five messages a tick.
pub const MOST_WAITING: usize = 256 << 10;
/// The most bytes that are read from one client at once.
const MOST_BYTES: usize = 16 << 10;
/// Longest time until a client sends its cookie, s.
const COOKIE_S: f64 = 3.0;
/// An idle client is sent a sign of life this often, s, so that one that is gone is noticed.
const ALIVE_S: f64 = 5.0;

/// The types that the server sends; their numbers are their positions here.
pub const SERVED: [MessageKind; 6] = [
    MessageKind::PosQuat,
    MessageKind::ButtonChange,
    MessageKind::ButtonStates,
    MessageKind::AnalogChannel,
    MessageKind::Ping,
    MessageKind::Pong,
];

/// The reason why a client was dropped.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gone {
    Closed,
    Slow,
    Malformed(CodecFault),
    Silent,
}

/// The protocol with one client: bytes in, bytes out.
pub struct Protocol {
    /// Bytes that are to be sent to the client.
    pub waiting: Vec<u8>,
    /// The port at which it takes poses by UDP.
    pub udp_port: Option<u16>,
    framer: Framer,
    version: Option<codec::Version>,
    kinds: PeerKinds,
    /// The client's numbers for our devices.
    senders: Vec<Option<i32>>,
    sequence: u32,
}

impl Protocol {
    /// Starts with the cookie and the descriptions of our devices and types.
    pub fn new(devices: &[String]) -> Protocol {
        let mut protocol = Protocol {
            waiting: codec::cookie().to_vec(),
            udp_port: None,
            framer: Framer::default(),
            version: None,
            kinds: PeerKinds::default(),
            senders: vec![None; devices.len()],
            sequence: 0,
        };
        for (id, name) in devices.iter().enumerate() {
            protocol.describe(id, codec::SENDER_DESCRIPTION, name);
        }
        for (id, kind) in SERVED.iter().enumerate() {
            protocol.describe(id, codec::TYPE_DESCRIPTION, kind.name());
        }
        protocol
    }

    /// The client's version, once its cookie has come.
    pub fn version(&self) -> Option<codec::Version> {
        self.version
    }

    /// Queues a message of device `device`; poses go into `datagrams` if the client takes them by UDP. A client that is about
    /// to be dropped gets nothing more.
    pub fn tell(&mut self, device: usize, time_s: f64, payload: &Payload, datagrams: &mut Vec<u8>) {
        if self.waiting.len() > MOST_WAITING {
            return;
        }
        let kind = SERVED.iter().position(|kind| *kind == payload.kind()).unwrap_or(0);
        let header = Header { sequence: self.next(), ..Header::now(device as i32, kind as i32).at(time_s) };
        let by_udp = self.udp_port.is_some() && payload.kind() == MessageKind::PosQuat;
        codec::encode(&header, &payload.encode(), if by_udp { datagrams } else { &mut self.waiting });
    }

    /// Queues the message that device `device` is alive.
    pub fn pong(&mut self, device: usize) {
        let now_s = Header::now(0, 0).time_s();
        self.tell(device, now_s, &Payload::Pong, &mut Vec::new());
    }

    /// The buffer for the client's next bytes; then call [`hear`](Protocol::hear) with their number.
    pub fn space(&mut self) -> &mut [u8] {
        let space = self.framer.space();
        let most = space.len().min(MOST_BYTES);
        &mut space[..most]
    }

    /// Handles the client's bytes. `devices` are our names; returns how many pings were answered.
    pub fn hear(&mut self, bytes: usize, devices: &[String]) -> Result<u64, Gone> {
        self.framer.wrote(bytes);
        if self.version.is_none() {
            let Some(cookie) = self.framer.cookie() else { return Ok(0) };
            self.version = Some(codec::parse_cookie(&cookie).map_err(Gone::Malformed)?);
        }
        let mut framer = std::mem::take(&mut self.framer);
        let mut pings = 0;
        while let Some(message) = framer.message().map_err(Gone::Malformed)? {
            pings += u64::from(self.take(&message, devices)?);
        }
        self.framer = framer;
        Ok(pings)
    }

    fn next(&mut self) -> u32 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn describe(&mut self, id: usize, system: i32, name: &str) {
        let header = Header { sequence: self.next(), ..Header::now(id as i32, system) };
        codec::encode(&header, &codec::encode_name(name), &mut self.waiting);
    }

    /// Handles a message; true if it was a ping of one of our devices, which is answered.
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
            // The address in the payload is ignored, so that no client can make us send to another machine.
            codec::UDP_DESCRIPTION => {
                self.udp_port = u16::try_from(id).ok().filter(|port| *port >= 1024);
            }
            codec::DISCONNECT => return Err(Gone::Closed),
            kind if self.kinds.kind(kind) == Some(MessageKind::Ping) => {
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

pub struct Peer {
    pub ip: IpAddr,
    pub protocol: Protocol,
    stream: TcpStream,
    since_s: f64,
    sent_s: f64,
}

impl Peer {
    pub fn new(stream: TcpStream, devices: &[String]) -> std::io::Result<Peer> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        let (ip, protocol) = (stream.peer_addr()?.ip(), Protocol::new(devices));
        Ok(Peer { ip, protocol, stream, since_s: now_s(), sent_s: now_s() })
    }

    /// Sends poses by UDP, as many whole messages per datagram as fit; returns the number of datagrams. A lost one is
    /// followed by a newer one.
    pub fn send_datagrams(&self, udp: &UdpSocket, bytes: &[u8]) -> u64 {
        let Some(port) = self.protocol.udp_port else { return 0 };
        let (mut first, mut end, mut sent) = (0, 0, 0);
        let mut send = |part: &[u8]| sent += u64::from(udp.send_to(part, (self.ip, port)).is_ok());
        while let Ok(Some((_, taken))) = codec::decode(&bytes[end..]) {
            if end + taken - first > codec::DATAGRAM_BYTES {
                send(&bytes[first..end]);
                first = end;
            }
            end += taken;
        }
        if end > first {
            send(&bytes[first..end]);
        }
        sent
    }

    /// Reads and handles a bounded number of bytes; returns how many pings came.
    pub fn hear(&mut self, devices: &[String]) -> Result<u64, Gone> {
        if self.protocol.version.is_none() && now_s() - self.since_s > COOKIE_S {
            return Err(Gone::Silent);
        }
        match self.stream.read(self.protocol.space()) {
            Ok(0) => Err(Gone::Closed),
            Ok(bytes) => self.protocol.hear(bytes, devices),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Ok(0),
            Err(_) => Err(Gone::Closed),
        }
    }

    /// Sends what waits, as far as the client accepts it.
    pub fn flush(&mut self) -> Result<(), Gone> {
        if self.protocol.version.is_some() && now_s() - self.sent_s > ALIVE_S {
            self.protocol.pong(0);
        }
        let mut sent = 0;
        while sent < self.protocol.waiting.len() {
            match self.stream.write(&self.protocol.waiting[sent..]) {
                Ok(bytes) => sent += bytes,
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Err(Gone::Closed),
            }
        }
        if sent > 0 {
            self.sent_s = now_s();
        }
        self.protocol.waiting.drain(..sent);
        if self.protocol.waiting.len() > MOST_WAITING { Err(Gone::Slow) } else { Ok(()) }
    }
}
