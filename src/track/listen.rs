//! The place at which a source listens for datagrams, and whether a read found none in time.

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};

/// An address to listen on, and the network on which a multicast group is joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Listen {
    /// An address of this machine, or that of a multicast group, which is joined.
    pub at: SocketAddr,
    /// The address of this machine on the network where the group is joined; the system's choice unless given.
    pub interface: Option<Ipv4Addr>,
}

impl Listen {
    /// Reads an address with its port, or a port alone, which is this machine's own. `key` of `tracker` is named in errors.
    pub fn parse(
        tracker: &str,
        key: &str,
        address: &str,
        interface: Option<Ipv4Addr>,
    ) -> Result<Listen, String> {
        let local =
            |port: &str| port.parse().ok().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
        let port =
            address.strip_prefix("localhost:").or_else(|| address.strip_prefix(':')).unwrap_or(address);
        let at = local(port).or_else(|| address.parse().ok()).ok_or_else(|| {
            let address: String = address.chars().take(100).collect();
            format!(
                "`{key}` of tracker `{tracker}` is \"{address}\": write \"127.0.0.1:5000\" (this machine) or \
                 \"0.0.0.0:5000\" (any network)"
            )
        })?;
        let is_group = matches!(at, SocketAddr::V4(at) if at.ip().is_multicast());
        if interface.is_some() && !is_group {
            let with = "an IPv4 multicast address in dtrack or osc";
            return Err(format!("`interface` of tracker `{tracker}` goes with `{with}` alone: remove it"));
        }
        Ok(Listen { at, interface })
    }
}

/// Whether the error only says that nothing came in time.
pub fn is_only_late(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

impl From<SocketAddr> for Listen {
    fn from(at: SocketAddr) -> Listen {
        Listen { at, interface: None }
    }
}

impl std::fmt::Display for Listen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.interface {
            Some(interface) => write!(f, "{} by {interface}", self.at),
            None => self.at.fmt(f),
        }
    }
}
