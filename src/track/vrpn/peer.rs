//! One client of the VRPN server: its connection, what its numbers mean, and what waits to be sent to it.
//!
//! [`Protocol`] is the protocol without a socket, [`Peer`] the socket. Nothing blocks. What waits is bounded: a client
//! that does not take what it is sent is given up.

use super::codec::{self, CodecFault, Framer, Header, Message};
use super::listener::PeerKinds;
use super::payload::{MessageKind, Payload};
use crate::track::device::now_s;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, TcpStream, UdpSocket};

/// What may wait for a client. At 1 kHz and five messages a tick it is half a second's.
pub const MOST_WAITING: usize = 256 << 10;
/// Most bytes taken from one client at once.
const MOST_BYTES: usize = 16 << 10;
/// How long a client has to send its cookie, s.
const COOKIE_S: f64 = 3.0;
/// A client that is sent nothing hears from its devices at least so often, s: one that is gone is found out.
const ALIVE_S: f64 = 5.0;

/// The types that the server sends; their numbers are their places.
pub const SERVED: [MessageKind; 6] = [
    MessageKind::PosQuat,
    MessageKind::ButtonChange,
    MessageKind::ButtonStates,
    MessageKind::AnalogChannel,
    MessageKind::Ping,
    MessageKind::Pong,
];

/// Why a client was given up.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Gone {
    Closed,
    Slow,
    Malformed(CodecFault),
    Silent,
}

/// A client as far as the protocol goes: bytes in, bytes out.
pub struct Protocol {
    /// What is to be sent to the client.
    pub waiting: Vec<u8>,
    /// At which port it takes trackers by UDP.
    pub udp_port: Option<u16>,
    framer: Framer,
    version: Option<codec::Version>,
    kinds: PeerKinds,
    /// Its numbers for our devices.
    senders: Vec<Option<i32>>,
    sequence: u32,
}

impl Protocol {
    /// Begins with the cookie and the descriptions of our devices and types.
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

    /// The client's version, once it has shown that it speaks the protocol.
    pub fn version(&self) -> Option<codec::Version> {
        self.version
    }

    /// Queues a message of device `device`; among `datagrams`, where the client takes poses by UDP. A client that is
    /// about to be given up gets no more.
    pub fn tell(&mut self, device: usize, time_s: f64, payload: &Payload, datagrams: &mut Vec<u8>) {
        if self.waiting.len() > MOST_WAITING {
            return;
        }
        let kind = SERVED.iter().position(|kind| *kind == payload.kind()).unwrap_or(0);
        let header = Header { sequence: self.next(), ..Header::now(device as i32, kind as i32).at(time_s) };
        let by_udp = self.udp_port.is_some() && payload.kind() == MessageKind::PosQuat;
        codec::encode(&header, &payload.encode(), if by_udp { datagrams } else { &mut self.waiting });
    }

    /// Tells that device `device` is alive.
    pub fn pong(&mut self, device: usize) {
        let now_s = Header::now(0, 0).time_s();
        self.tell(device, now_s, &Payload::Pong, &mut Vec::new());
    }

    /// Where the client's next bytes are to be written, and [`hear`](Protocol::hear) how many were.
    pub fn space(&mut self) -> &mut [u8] {
        let space = self.framer.space();
        let most = space.len().min(MOST_BYTES);
        &mut space[..most]
    }

    /// Takes what the client said. `devices` are our names; the result says how many pings were answered.
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
            // The address beside it does not count: nobody has us send to another.
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

/// A client and its connection.
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

    /// Sends poses by UDP, as many whole messages in a datagram as it holds, and says how many datagrams went. One
    /// that is lost is followed by a newer one.
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

    /// Takes what the client says, up to a bound; how many pings came.
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

    /// Sends what waits, as far as the client takes it.
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
