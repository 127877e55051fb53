//! Helpers for the tests of client and server: servers and clients that a test controls, and a patient wait.

use greenstage::track::FakeSource;
use greenstage::track::device::{Link, Source, now_s};
use greenstage::track::vrpn::codec::{self, Framer, Header};
use greenstage::track::vrpn::payload::{MessageKind, Payload};
use greenstage::track::vrpn::{Address, Client, Server, ServerCounters, Serving, Timing, Transport};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

pub const ANY: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// Times that suit a test: everything sooner, but no silence ends a connection, since a busy machine may stand still.
pub const STEADY: Timing = Timing {
    connect_s: 300.0,
    ping_s: 0.05,
    quiet_s: 300.0,
    down_s: 300.0,
    lob_s: 0.2,
    first_retry_s: 0.05,
    longest_retry_s: 0.2,
};

/// Silence is noted soon.
pub const SOON: Timing = Timing { connect_s: 2.0, quiet_s: 0.3, down_s: 1.5, ..STEADY };

/// Asks until the answer is yes; a busy machine gets its time.
pub fn wait(what: &str, mut is_so: impl FnMut() -> bool) {
    let deadline_s = now_s() + 240.0;
    while !is_so() {
        assert!(now_s() < deadline_s, "waited in vain until {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

pub fn serve(place: SocketAddr, source: &FakeSource) -> Serving {
    let server = Server::bind(place, ["Wand"]).unwrap();
    assert_eq!(server.addresses().collect::<Vec<_>>(), [format!("Wand@{}", server.place)]);
    server.spawn(vec![Box::new(source.clone())]).unwrap()
}

pub fn listen(place: SocketAddr, udp: bool, transport: Transport) -> Client {
    let address = Address { device: "Wand".into(), host: place.ip().to_string(), port: place.port(), udp };
    Client::with_timing(address, transport, STEADY)
}

/// A client, and the server that the test plays for it; it has heard of the device.
pub fn played(udp: bool) -> (TcpListener, Client, Peer) {
    let listener = TcpListener::bind(ANY).unwrap();
    let mut client = listen(listener.local_addr().unwrap(), udp, Transport::Tcp);
    let mut peer = Peer::accept(&listener);
    peer.hear_cookie();
    peer.greet("Wand");
    wait("the device is known", || client.latest().link == Link::Up);
    (listener, client, peer)
}

/// [`wait`], during which each client that comes is greeted: one that was held up for too long comes anew.
pub fn wait_greeting(
    listener: &TcpListener,
    peer: &mut Option<Peer>,
    greet: impl Fn(&mut Peer),
    what: &str,
    mut is_so: impl FnMut(&mut Option<Peer>) -> bool,
) {
    listener.set_nonblocking(true).unwrap();
    wait(what, || {
        if let Ok((stream, _)) = listener.accept() {
            stream.set_nonblocking(false).unwrap();
            greet(peer.insert(Peer::new(stream)));
        }
        is_so(peer)
    });
}

pub fn counters_reach(serving: &Serving, what: &str, is_so: impl Fn(&ServerCounters) -> bool) {
    wait(what, || is_so(&serving.counters()));
}

/// A server, or a client, that the test plays by hand.
pub struct Peer {
    pub stream: TcpStream,
    framer: Framer,
}

impl Peer {
    pub fn new(stream: TcpStream) -> Peer {
        stream.set_read_timeout(Some(Duration::from_secs(240))).unwrap();
        Peer { stream, framer: Framer::default() }
    }

    /// Takes the next client.
    pub fn accept(listener: &TcpListener) -> Peer {
        Peer::new(listener.accept().unwrap().0)
    }

    /// [`Peer::introduce`], and that the device is there.
    pub fn greet(&mut self, name: &str) {
        self.introduce(name);
        self.say(&Payload::Pong);
    }

    /// Says a cookie, that device 0 is `name` and the types are numbered as in `MessageKind::ALL`.
    pub fn introduce(&mut self, name: &str) {
        // The other side may have gone.
        let _ = self.stream.write_all(&codec::cookie());
        self.describe(codec::SENDER_DESCRIPTION, 0, name);
        for (kind, name) in MessageKind::ALL {
            self.describe(codec::TYPE_DESCRIPTION, kind as i32, name);
        }
    }

    pub fn describe(&mut self, system: i32, id: i32, name: &str) {
        let mut bytes = Vec::new();
        codec::encode(&Header::now(id, system), &codec::encode_name(name), &mut bytes);
        let _ = self.stream.write_all(&bytes);
    }

    /// Says something of device 0; false if the other side has gone.
    pub fn say(&mut self, payload: &Payload) -> bool {
        self.stream.write_all(&bytes_of(payload)).is_ok()
    }

    /// The next message: sender, type, payload; `None` when the other side has closed.
    pub fn hear(&mut self) -> Option<(i32, i32, Vec<u8>)> {
        loop {
            if let Some(message) = self.framer.message().unwrap() {
                return Some((message.header.sender, message.header.kind, message.payload.to_vec()));
            }
            let read = self.stream.read(self.framer.space()).unwrap_or(0);
            if read == 0 {
                return None;
            }
            self.framer.wrote(read);
        }
    }

    pub fn hear_cookie(&mut self) -> [u8; 24] {
        let mut cookie = [0; 24];
        self.stream.read_exact(&mut cookie).unwrap();
        cookie
    }
}

/// A message of device 0, its type numbered as in `MessageKind::ALL`.
pub fn bytes_of(payload: &Payload) -> Vec<u8> {
    let mut bytes = Vec::new();
    codec::encode(&Header::now(0, payload.kind() as i32), &payload.encode(), &mut bytes);
    bytes
}
