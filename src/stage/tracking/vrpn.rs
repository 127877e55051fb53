//! How users name a VRPN device: `Tracker0@host`, `Tracker0@host:port`, `Tracker0@tcp://host`, `tcp://host:port/Tracker0`.
//!
//! As in VRPN itself, `tcp:` means that all goes over one TCP connection and nothing by UDP.

use std::fmt;

/// The port of a server that names none, TCP and UDP.
pub const PORT: u16 = 3883;
/// The longest name of a device or a message type, bytes without its NUL.
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
    /// Poses may come by UDP; false, as `tcp:` asks: all by the one TCP connection.
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

/// Whether a device may bear this name: letters, digits and signs without `@`, blank or NUL, 100 bytes at most.
pub fn is_device_name(name: &str) -> bool {
    let is_fit = |c: char| !c.is_control() && !c.is_whitespace() && c != '@';
    !name.is_empty() && name.len() <= LONGEST_NAME && name.chars().all(is_fit)
}

/// An IPv6 address keeps the brackets in which it stands.
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

#[cfg(test)]
mod tests {
    use super::*;

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
    }
}
