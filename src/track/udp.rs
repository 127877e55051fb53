//! A source that listens for datagrams on one address of this machine.
//!
//! In: a parser of one datagram. Out: a running [`Worker`]. Nothing that arrives costs more than a counter: a datagram
//! has a greatest size, a flood a greatest rate, and no length in it is believed.

use super::device::{DeviceState, Link, now_s};
use super::open::OpenError;
use super::worker::{Publisher, Worker};
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// A longer datagram is malformed, bytes. DTrack's frame of 40 bodies has 8,000.
pub const LARGEST: usize = 16 << 10;
/// So many datagrams are read in [`SLOT_S`]; the system's own buffer drops what comes beyond that.
const MOST_IN_SLOT: u32 = 100;
const SLOT_S: f64 = 0.01;
/// A tracker that is silent for longer is quiet, and then gone, s.
const QUIET_S: f64 = 2.0;
const GONE_S: f64 = 10.0;
const WAKE: Duration = Duration::from_millis(50);

/// Reads datagrams of one protocol into a state.
pub trait Parser: Send + 'static {
    /// False if nothing of it could be read; the listener counts that.
    fn parse(&mut self, datagram: &[u8], state: &mut DeviceState) -> bool;
}

/// Listens on `at` (port 0: any free one, which [`Source::describe`](super::Source::describe) tells).
pub fn listen(tracker: &str, kind: &str, at: SocketAddr, parser: impl Parser) -> Result<Worker, OpenError> {
    let failed = |source| OpenError::Listen { tracker: tracker.to_owned(), at, source };
    let socket = UdpSocket::bind(at).map_err(failed)?;
    socket.set_read_timeout(Some(WAKE)).map_err(failed)?;
    let description = format!("{kind} on {}", socket.local_addr().map_err(failed)?);
    Worker::spawn(description, move |publisher| run(&socket, parser, publisher))
        .map_err(|source| OpenError::Thread { tracker: tracker.to_owned(), source })
}

fn run(socket: &UdpSocket, mut parser: impl Parser, mut publisher: Publisher) {
    let mut datagram = vec![0; LARGEST + 1];
    let mut heard_s = None;
    let (mut slot_s, mut in_slot) = (0.0, 0);
    while !publisher.is_stopped() {
        let received = socket.recv(&mut datagram);
        let now_s = now_s();
        let Ok(length) = received else {
            listen_on(&mut publisher, heard_s.map(|heard_s| now_s - heard_s), received.err());
            continue;
        };
        let counters = &mut publisher.state.counters;
        counters.packets += 1;
        let is_good = length <= LARGEST && parser.parse(&datagram[..length], &mut publisher.state);
        if is_good {
            heard_s = Some(now_s);
            publisher.state.link = Link::Up;
        } else {
            publisher.state.counters.malformed += 1;
        }
        publisher.publish();
        in_slot += 1;
        if now_s - slot_s >= SLOT_S {
            (slot_s, in_slot) = (now_s, 1);
        } else if in_slot >= MOST_IN_SLOT {
            publisher.state.counters.throttled += 1;
            std::thread::sleep(Duration::from_secs_f64(SLOT_S - (now_s - slot_s)));
        }
    }
}

/// Nothing came.
fn listen_on(publisher: &mut Publisher, silent_s: Option<f64>, error: Option<std::io::Error>) {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    match silent_s {
        Some(silent_s) if silent_s > GONE_S => publisher.down(format!("no packet for {GONE_S} s")),
        Some(silent_s) if silent_s > QUIET_S && publisher.state.link == Link::Up => {
            publisher.state.link = Link::Quiet;
            publisher.publish();
        }
        _ => {}
    }
    // A refused answer to nothing we sent, an interface that went down: the socket stays, and no error spins.
    if error.is_some_and(|error| !matches!(error.kind(), Interrupted | TimedOut | WouldBlock)) {
        publisher.pause(0.05);
    }
}
