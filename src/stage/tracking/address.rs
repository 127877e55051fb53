//! Addresses of trackers: where to listen, and where a VRPN device is.

use super::{TrackerKind, TrackingFault, Transport};
use std::net::{Ipv4Addr, SocketAddr};

/// The port of a VRPN server that names none.
const VRPN_PORT: u16 = 3883;
/// No device's name is longer.
const LONGEST_NAME: usize = 99;
/// No host's name is longer (RFC 1035).
const LONGEST_HOST: usize = 253;

/// Where to listen: an address with its port, or a port alone, which is this machine's own.
pub fn listen(tracker: &str, key: &'static str, address: &str) -> Result<SocketAddr, TrackingFault> {
    let local = |port: &str| port.parse().ok().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    let port = address.strip_prefix("localhost:").or_else(|| address.strip_prefix(':')).unwrap_or(address);
    local(port).or_else(|| address.parse().ok()).ok_or_else(|| TrackingFault::Listen {
        tracker: tracker.to_owned(),
        key,
        address: address.chars().take(100).collect(),
    })
}

/// `Tracker0@host`, `Tracker0@host:port`, `Tracker0@tcp://host:port` or `tcp://host:port/Tracker0`.
pub fn vrpn(
    tracker: &str,
    address: &str,
    transport: Option<Transport>,
) -> Result<TrackerKind, TrackingFault> {
    let fault = |why| TrackingFault::Vrpn {
        tracker: tracker.to_owned(),
        address: address.chars().take(100).collect(),
        why,
    };
    let (device, place) = match address.split_once('@') {
        Some(parts) => parts,
        None => {
            let (place, device) = address
                .strip_prefix("tcp://")
                .and_then(|rest| rest.split_once('/'))
                .ok_or_else(|| fault("it names no device before an `@`"))?;
            (device, place)
        }
    };
    let by_tcp = address.starts_with("tcp://") || place.starts_with("tcp://");
    let place = place.strip_prefix("tcp://").unwrap_or(place);
    if transport == Some(Transport::Lob) && by_tcp {
        return Err(fault("it says tcp and `transport` says lob"));
    }
    let is_name = |c: char| c.is_ascii_graphic() && !matches!(c, '@' | '/' | '"');
    if device.is_empty() || device.len() > LONGEST_NAME || !device.chars().all(is_name) {
        return Err(fault(
            "the device's name is empty, too long, or has other signs than letters and digits",
        ));
    }
    let (host, port) = host_and_port(place).ok_or_else(|| fault("host or port does not parse"))?;
    let transport = transport.unwrap_or_default();
    Ok(TrackerKind::Vrpn { device: device.to_owned(), host, port, udp: !by_tcp, transport })
}

fn host_and_port(place: &str) -> Option<(String, u16)> {
    // An IPv6 address stands in brackets.
    let (host, port) = match place.strip_prefix('[').and_then(|rest| rest.split_once(']')) {
        Some((host, "")) => (host, None),
        Some((host, rest)) => (host, Some(rest.strip_prefix(':')?)),
        None => match place.split_once(':') {
            Some((host, port)) => (host, Some(port)),
            None => (place, None),
        },
    };
    let in_brackets = place.starts_with('[');
    let is_host =
        |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_') || in_brackets && c == ':';
    let port = port.map_or(Some(VRPN_PORT), |port| port.parse().ok().filter(|port| *port > 0))?;
    let is_good = !host.is_empty() && host.len() <= LONGEST_HOST && host.chars().all(is_host);
    is_good.then(|| (host.to_owned(), port))
}
