//! Where the server of a VRPN device is, and the datagram that asks it to connect back.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};

pub use crate::stage::tracking::Transport;
pub use crate::stage::tracking::vrpn::{Address, AddressError};

/// The host's address, an IPv4 one where it has one: the lob knows no other.
pub fn resolve(address: &Address) -> std::io::Result<SocketAddr> {
    let found: Vec<SocketAddr> = (address.host.as_str(), address.port).to_socket_addrs()?.collect();
    let v4 = found.iter().find(|place| place.is_ipv4()).or(found.first());
    v4.copied().ok_or_else(|| std::io::Error::other("the host has no address"))
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
