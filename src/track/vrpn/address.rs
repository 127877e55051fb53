//! How users name a VRPN device: `Tracker0@host`, `Tracker0@host:port`, `tcp://host:port/Tracker0`.
//!
//! As in VRPN itself, `tcp:` means that all goes over one TCP connection and nothing by UDP.

use super::codec::PORT;
use super::payload::is_device_name;
pub use crate::stage::tracking::Transport;
use std::fmt;
use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

/// A device, and where its server is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    pub device: String,
    pub host: String,
    pub port: u16,
    /// Trackers may come by UDP.
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
        let wrong = |fault| AddressError { name: name.to_owned(), fault };
        let (device, place, udp) = match name.split_once('@') {
            Some((device, place)) => {
                let tcp = place.strip_prefix("tcp:").map(|place| place.trim_start_matches('/'));
                let place = tcp.unwrap_or(place.trim_start_matches("x-vrpn://"));
                (device, place, tcp.is_none())
            }
            None => {
                let Some(place) = name.strip_prefix("tcp://") else { return Err(wrong("no @ in it")) };
                let (place, device) =
                    place.split_once('/').ok_or_else(|| wrong("no device behind the host"))?;
                (device, place, false)
            }
        };
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) => {
                (host, port.parse().ok().ok_or_else(|| wrong("the port is no number below 65536"))?)
            }
            None => (place, PORT),
        };
        if !is_device_name(device) {
            return Err(wrong("the device's name is empty, too long, or has blanks"));
        }
        if host.is_empty() || !host.chars().all(|c| c.is_alphanumeric() || "-._".contains(c)) {
            return Err(wrong("the host is no name or address"));
        }
        if port == 0 {
            return Err(wrong("port 0 is none"));
        }
        Ok(Address { device: device.to_owned(), host: host.to_owned(), port, udp })
    }

    /// The host's address, an IPv4 one where it has one: the lob knows no other.
    pub fn resolve(&self) -> std::io::Result<SocketAddr> {
        let found: Vec<SocketAddr> = (self.host.as_str(), self.port).to_socket_addrs()?.collect();
        let v4 = found.iter().find(|place| place.is_ipv4()).or(found.first());
        v4.copied().ok_or_else(|| std::io::Error::other("the host has no address"))
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tcp = if self.udp { "" } else { "tcp://" };
        write!(f, "{}@{tcp}{}", self.device, self.host)?;
        if self.port == PORT { Ok(()) } else { write!(f, ":{}", self.port) }
    }
}

/// What a client that asks by UDP sends: where the server is to connect to, `10.0.0.7 51234` and NUL.
pub fn encode_lob(place: SocketAddr) -> Vec<u8> {
    format!("{} {}\0", place.ip(), place.port()).into_bytes()
}

/// Where a server is asked to connect to. The address must be IPv4, since a name would let the asker choose whom
/// the server looks up, and must be the asker's own, so that nobody has a server connect to another; the port must
/// be one that users may open.
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
    fn names_as_users_write_them() {
        let parsed = |name: &str| {
            let Address { device, host, port, udp } = Address::parse(name).unwrap();
            (device, host, port, udp)
        };
        let of = |device: &str, host: &str, port, udp| (device.to_owned(), host.to_owned(), port, udp);
        assert_eq!(parsed("Tracker0@192.168.1.5"), of("Tracker0", "192.168.1.5", 3883, true));
        assert_eq!(parsed("Tracker0@lab-1:4000"), of("Tracker0", "lab-1", 4000, true));
        assert_eq!(parsed("tcp://localhost:3884/Wand"), of("Wand", "localhost", 3884, false));
        assert_eq!(parsed("Wand@tcp://localhost"), of("Wand", "localhost", 3883, false));
        assert_eq!(parsed("Wand@tcp:localhost:1"), of("Wand", "localhost", 1, false));
        for wrong in [
            "",
            "Tracker0",
            "@host",
            "a b@host",
            "a@",
            "a@h:x",
            "a@h:70000",
            "a@h:0",
            "tcp://h",
            "a@b@c",
            "a@h/x",
        ] {
            let error = Address::parse(wrong).unwrap_err().to_string();
            assert!(error.contains("Tracker0@host"), "{error}");
        }
        assert_eq!(Address::parse("Tracker0@h:4000").unwrap().to_string(), "Tracker0@h:4000");
        assert_eq!(Address::parse("tcp://h/T").unwrap().to_string(), "T@tcp://h");
    }

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
}
