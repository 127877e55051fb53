//! Names of VRPN devices: `Tracker0@host`, `Tracker0@host:port`, `Tracker0@tcp://host`, `tcp://host:port/Tracker0`.
//!
//! As in VRPN itself, `tcp:` means that everything goes over one TCP connection and nothing by UDP. Also here: the
//! datagram by which a client asks a server to connect back.

use std::fmt;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

/// The default port of a server, TCP and UDP.
pub const PORT: u16 = 3883;
/// The longest name of a device or a message type, in bytes without the NUL.
pub const LONGEST_NAME: usize = 100;
/// No host's name is longer (RFC 1035).
const LONGEST_HOST: usize = 253;

/// A device, and where its server is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    pub device: String,
    /// A name, or an address; an IPv6 one without its brackets.
    pub host: String,
    pub port: u16,
    /// Whether poses may come by UDP; `tcp:` asks for everything by the one TCP connection.
    pub udp: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{name}` names no VRPN device ({fault}): write Tracker0@host, Tracker0@host:3883 or tcp://host:3883/Tracker0"
)]
pub struct AddressError {
    pub name: String,
    pub fault: &'static str,
}

impl Address {
    pub fn parse(name: &str) -> Result<Address, AddressError> {
        let wrong = |fault| AddressError { name: name.chars().take(200).collect(), fault };
        let (device, place, udp) = match name.split_once('@') {
            Some((device, place)) => match place.strip_prefix("tcp:") {
                Some(place) => (device, place.strip_prefix("//").unwrap_or(place), false),
                None => (device, place.strip_prefix("x-vrpn://").unwrap_or(place), true),
            },
            None => {
                let place = name.strip_prefix("tcp://");
                let place = place.ok_or_else(|| wrong("it names no device before an `@`"))?;
                let parts = place.split_once('/');
                let (place, device) = parts.ok_or_else(|| wrong("it names no device behind the host"))?;
                (device, place, false)
            }
        };
        if !is_device_name(device) {
            return Err(wrong("the device's name is empty, too long, or has blanks"));
        }
        let (host, port) = host_and_port(place);
        if !is_host(host) {
            return Err(wrong("the host is no name or address"));
        }
        let port = port.map_or(Some(PORT), |port| port.parse().ok().filter(|port| *port > 0));
        let port = port.ok_or_else(|| wrong("the port is no number from 1 to 65535"))?;
        let host = host.trim_start_matches('[').trim_end_matches(']').to_owned();
        Ok(Address { device: device.to_owned(), host, port, udp })
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Address { device, host, port, udp } = self;
        let tcp = if *udp { "" } else { "tcp://" };
        match host.contains(':') {
            true => write!(f, "{device}@{tcp}[{host}]:{port}"),
            false => write!(f, "{device}@{tcp}{host}:{port}"),
        }
    }
}

/// Whether a device may have this name: no `@`, blank or control character, and 100 bytes at most.
pub fn is_device_name(name: &str) -> bool {
    let is_fit = |c: char| !c.is_control() && !c.is_whitespace() && c != '@';
    !name.is_empty() && name.len() <= LONGEST_NAME && name.chars().all(is_fit)
}

/// Splits off the port; an IPv6 address keeps its brackets.
fn host_and_port(place: &str) -> (&str, Option<&str>) {
    let host_bytes = match (place.starts_with('['), place.find(']')) {
        (true, Some(end)) => end + 1,
        _ => place.find(':').unwrap_or(place.len()),
    };
    let (host, rest) = place.split_at(host_bytes);
    match rest {
        "" => (host, None),
        rest => (host, Some(rest.strip_prefix(':').unwrap_or(""))),
    }
}

fn is_host(host: &str) -> bool {
    let (name, in_brackets) = match host.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
        Some(address) => (address, true),
        None => (host, false),
    };
    let is_fit = |c: char| c.is_ascii_alphanumeric() || "-._".contains(c) || in_brackets && c == ':';
    !name.is_empty() && name.len() <= LONGEST_HOST && name.chars().all(is_fit)
}

/// The transport between a client and its server.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Transport {
    /// TCP, directly.
    #[default]
    Tcp,
    /// A UDP datagram asks the server to connect back.
    Lob,
}

/// The host's address, IPv4 if it has one, because the lob supports no other.
pub fn resolve(address: &Address) -> std::io::Result<SocketAddr> {
    let found: Vec<SocketAddr> = (address.host.as_str(), address.port).to_socket_addrs()?.collect();
    let v4 = found.iter().find(|place| place.is_ipv4()).or(found.first());
    v4.copied().ok_or_else(|| std::io::Error::other("the host has no address"))
}

/// The datagram by which a client asks the server to connect back: `10.0.0.7 51234` and NUL.
pub fn encode_lob(place: SocketAddr) -> Vec<u8> {
    format!("{} {}\0", place.ip(), place.port()).into_bytes()
}

/// The address to which a lob asks the server to connect. It must be a numeric IPv4 address, so that no asker makes the
/// server look up names, and the asker's own, so that nobody makes it connect to a third machine; the port must be
/// unprivileged.
pub fn decode_lob(datagram: &[u8], asker: IpAddr) -> Option<SocketAddr> {
    let text = std::str::from_utf8(datagram.strip_suffix(b"\0")?).ok()?;
    let (host, port) = text.split_once(' ')?;
    let (host, port): (IpAddr, u16) = (host.parse().ok()?, port.parse().ok()?);
    (host.is_ipv4() && host == asker && port >= 1024).then_some(SocketAddr::new(host, port))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lob_names_the_asker_alone() {
        let asker: IpAddr = [127, 0, 0, 1].into();
        let place = SocketAddr::new(asker, 51234);
        assert_eq!(encode_lob(place), b"127.0.0.1 51234\0");
        assert_eq!(decode_lob(&encode_lob(place), asker), Some(place));
        for wrong in [
            &b"127.0.0.1 51234"[..],
            b"127.0.0.1 80\0",
            b"127.0.0.2 51234\0",
            b"localhost 51234\0",
            b"127.0.0.1 99999\0",
            b"127.0.0.1\0",
            b"\xff 51234\0",
            b"",
        ] {
            assert_eq!(decode_lob(wrong, asker), None, "{wrong:?}");
        }
    }

    #[test]
    fn names_as_users_write_them() {
        let parsed = |name: &str| {
            let address = Address::parse(name).unwrap();
            assert_eq!(Address::parse(&address.to_string()).as_ref(), Ok(&address), "{name}");
            let Address { device, host, port, udp } = address;
            (device, host, port, udp)
        };
        let of = |device: &str, host: &str, port, udp| (device.to_owned(), host.to_owned(), port, udp);
        assert_eq!(parsed("Tracker0@192.168.1.5"), of("Tracker0", "192.168.1.5", 3883, true));
        assert_eq!(parsed("Tracker0@lab-1:4000"), of("Tracker0", "lab-1", 4000, true));
        assert_eq!(parsed("Tracker0@x-vrpn://lab-1:4000"), of("Tracker0", "lab-1", 4000, true));
        assert_eq!(parsed("tcp://localhost:3884/Wand"), of("Wand", "localhost", 3884, false));
        assert_eq!(parsed("tcp://[fe80::1]/Wand"), of("Wand", "fe80::1", 3883, false));
        assert_eq!(parsed("Wand@tcp://localhost"), of("Wand", "localhost", 3883, false));
        assert_eq!(parsed("Wand@tcp:localhost:1"), of("Wand", "localhost", 1, false));
        assert_eq!(parsed("Wand@[::1]:99"), of("Wand", "::1", 99, true));
        for wrong in [
            "",
            "Tracker0",
            "@host",
            "a b@host",
            "a@",
            "a@h:x",
            "a@h:70000",
            "a@h:0",
            "a@h:",
            "tcp://h",
            "a@b@c",
            "a@h/x",
            "a@::1",
            "a@[]",
            "a@[::1",
            "a@[::1]99",
            "a@[::1]]",
            "a@h:1:2",
            "a@[h]:0",
        ] {
            let error = Address::parse(wrong).unwrap_err().to_string();
            assert!(error.contains("Tracker0@host"), "{error}");
        }
        assert_eq!(Address::parse("Tracker0@h:4000").unwrap().to_string(), "Tracker0@h:4000");
        assert_eq!(Address::parse("tcp://h/T").unwrap().to_string(), "T@tcp://h:3883");
        assert_eq!(Address::parse("T@[::1]:99").unwrap().to_string(), "T@[::1]:99");
    }
}
