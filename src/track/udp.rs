//! Sources that receive datagrams on one address of this machine.
//!
//! In: a parser of one datagram. Out: a running [`Worker`]. Datagrams have a greatest size, a flood gets a limited share of
//! the time, and lengths stated in a datagram are never trusted.

use super::device::{DeviceState, Link, now_s};
use super::flow::{PUBLISH_S, RateLimiter};
use super::listen::{Listen, is_only_late};
use super::source_entry::{ExclusiveUse, OpenError, SourceSettings};
use super::worker::{Publisher, Worker};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::Duration;

/// Longer datagrams are malformed, bytes. DTrack's frame of 40 bodies has 8,000.
pub const LARGEST: usize = 16 << 10;
const WAKE: Duration = Duration::from_millis(50);

/// Reads datagrams of one protocol into a state.
pub trait Parser: Send + 'static {
    /// False if nothing in it could be read; the listener counts that.
    fn parse(&mut self, datagram: &[u8], state: &mut DeviceState) -> bool;
}

/// Settings of a source that listens on `place`.
pub fn settings(kind: &'static str, place: Listen, parser: impl Parser) -> SourceSettings {
    SourceSettings {
        exclusive_use: Some(ExclusiveUse::Listens(place.at)),
        open: Box::new(move |tracker| Ok(Box::new(listen(tracker, kind, place, parser)?))),
    }
}

/// A tracker is quiet, and then gone, after these times without a datagram that could be read, s.
const SILENCE_S: [f64; 2] = [2.0, 10.0];

/// Listens on an address (port 0: any free one, which [`Source::describe`](super::Source::describe) contains), or joins a
/// multicast group and listens to that alone.
pub fn listen(tracker: &str, kind: &str, place: Listen, parser: impl Parser) -> Result<Worker, OpenError> {
    let at = place.at;
    let failed = |source| OpenError::Listen { tracker: tracker.to_owned(), at, source };
    let socket = UdpSocket::bind(at).map_err(failed)?;
    join(&socket, place).map_err(|source| OpenError::Join { tracker: tracker.to_owned(), place, source })?;
    socket.set_read_timeout(Some(WAKE)).map_err(failed)?;
    let description = format!("{kind} on {}", socket.local_addr().map_err(failed)?);
    Worker::spawn(description, move |publisher| run(&socket, parser, publisher, SILENCE_S))
        .map_err(|source| OpenError::Thread { tracker: tracker.to_owned(), source })
}

/// Joins the multicast group, if the address is that of one.
fn join(socket: &UdpSocket, Listen { at, interface }: Listen) -> std::io::Result<()> {
    match at {
        SocketAddr::V4(at) if at.ip().is_multicast() => {
            socket.join_multicast_v4(at.ip(), &interface.unwrap_or(Ipv4Addr::UNSPECIFIED))
        }
        // The interface is the number that follows `%`; 0 leaves the choice to the system.
        SocketAddr::V6(at) if at.ip().is_multicast() => socket.join_multicast_v6(at.ip(), at.scope_id()),
        _ => Ok(()),
    }
}

fn run(socket: &UdpSocket, mut parser: impl Parser, mut publisher: Publisher, silence_s: [f64; 2]) {
    let mut datagram = vec![0; LARGEST + 1];
    let (mut heard_s, mut limiter, mut is_waiting) = (None, RateLimiter::default(), false);
    while !publisher.is_stopped() {
        let received = socket.recv(&mut datagram);
        let began_s = now_s();
        let is_news = received.is_ok();
        match received {
            Ok(length) => {
                publisher.state.counters.packets += 1;
                if length <= LARGEST && parser.parse(&datagram[..length], &mut publisher.state) {
                    heard_s = Some(began_s);
                    publisher.state.link = Link::Up;
                } else {
                    publisher.state.counters.malformed += 1;
                }
            }
            Err(error) if is_only_late(&error) => {}
            // For example an interface that went down: keep the socket, and do not spin on a lasting error.
            Err(_) => {
                publisher.pause(0.05);
            }
        }
        judge(&mut publisher, heard_s.map_or(0.0, |heard_s| began_s - heard_s), silence_s);
        let waited = std::mem::replace(&mut is_waiting, publisher.publish_changed(is_news));
        if waited != is_waiting {
            let wake = if is_waiting { Duration::from_secs_f64(PUBLISH_S) } else { WAKE };
            // If this fails, a state waits for the next datagram, at most as long as where nothing changed.
            let _ = socket.set_read_timeout(Some(wake));
        }
        if is_news {
            publisher.throttle(&mut limiter, began_s).into_iter().for_each(std::thread::sleep);
        }
    }
}

/// Changes the link after `silent_s` without a packet that could be read.
fn judge(publisher: &mut Publisher, silent_s: f64, [quiet_s, gone_s]: [f64; 2]) {
    if silent_s > gone_s {
        publisher.down(format!("no packet that could be read for {gone_s} s"));
    } else if silent_s > quiet_s && publisher.state.link == Link::Up {
        publisher.state.link = Link::Quiet;
        publisher.publish();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::device::{DeviceState, Source};

    /// `1` is a good datagram, anything else is none.
    struct Ones;

    impl Parser for Ones {
        fn parse(&mut self, datagram: &[u8], _state: &mut DeviceState) -> bool {
            datagram == b"1"
        }
    }

    #[test]
    fn garbage_does_not_keep_a_dead_tracker_up() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(WAKE)).unwrap();
        let (at, sender) = (socket.local_addr().unwrap(), UdpSocket::bind("127.0.0.1:0").unwrap());
        let silence_s = [0.1, 0.4];
        let mut worker =
            Worker::spawn("ones".into(), move |publisher| run(&socket, Ones, publisher, silence_s)).unwrap();
        let mut seen = vec![Link::Waiting];
        let deadline_s = now_s() + 60.0;
        sender.send_to(b"1", at).unwrap();
        while !matches!(seen.last(), Some(Link::Down(_))) || worker.latest().counters.malformed <= 10 {
            assert!(now_s() < deadline_s, "{seen:?}, {:?}", worker.latest().counters);
            let link = worker.latest().link.clone();
            if seen.last() != Some(&link) {
                seen.push(link);
            }
            sender.send_to(b"0", at).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
        while worker.latest().link != Link::Up {
            assert!(now_s() < deadline_s, "it is not found again");
            sender.send_to(b"1", at).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    /// The loopback device is used, whose network is no other's.
    #[test]
    fn what_is_sent_to_a_group_is_heard_once_it_is_joined() {
        let place = Listen { at: "239.255.77.3:0".parse().unwrap(), interface: Some(Ipv4Addr::LOCALHOST) };
        let mut worker = listen("art", "ones", place, Ones).unwrap();
        let port: u16 = worker.describe().rsplit_once(':').unwrap().1.parse().unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let deadline_s = now_s() + 60.0;
        while worker.latest().link != Link::Up {
            assert!(now_s() < deadline_s, "nothing is heard");
            sender.send_to(b"1", ("239.255.77.3", port)).unwrap();
            std::thread::sleep(Duration::from_millis(2));
        }
        // A group cannot be joined on a network that this machine is not on.
        let elsewhere = Listen { interface: Some(Ipv4Addr::new(192, 0, 2, 77)), ..place };
        let error = listen("art", "ones", elsewhere, Ones).err().unwrap().to_string();
        assert!(error.contains("multicast group 239.255.77.3:0 by 192.0.2.77"), "{error}");
        assert!(error.contains("`interface`"), "{error}");
    }
}
