//! Addresses of trackers: where to listen, and where a VRPN device is.

use super::fault::TrackingFault;
use super::vrpn::Address;
use super::{Listen, TrackerKind, Transport};
use std::net::{Ipv4Addr, SocketAddr};

/// Where to listen: an address with its port, or a port alone, which is this machine's own.
pub fn listen(
    tracker: &str,
    key: &'static str,
    address: &str,
    interface: Option<Ipv4Addr>,
) -> Result<Listen, TrackingFault> {
    let local = |port: &str| port.parse().ok().map(|port: u16| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    let port = address.strip_prefix("localhost:").or_else(|| address.strip_prefix(':')).unwrap_or(address);
    let at = local(port).or_else(|| address.parse().ok()).ok_or_else(|| TrackingFault::Listen {
        tracker: tracker.to_owned(),
        key,
        address: address.chars().take(100).collect(),
    })?;
    let is_group = matches!(at, SocketAddr::V4(at) if at.ip().is_multicast());
    if interface.is_some() && !is_group {
        let with = "an IPv4 multicast address in dtrack or osc";
        return Err(TrackingFault::LoneKey { tracker: tracker.to_owned(), key: "interface", with });
    }
    Ok(Listen { at, interface })
}

/// Where a VRPN device is, and how it is reached.
pub fn vrpn(tracker: &str, name: &str, transport: Option<Transport>) -> Result<TrackerKind, TrackingFault> {
    let fault = |why| TrackingFault::Vrpn {
        tracker: tracker.to_owned(),
        address: name.chars().take(100).collect(),
        why,
    };
    let address = Address::parse(name).map_err(|error| fault(error.fault))?;
    if transport == Some(Transport::Lob) && !address.udp {
        return Err(fault("it says tcp and `transport` says lob"));
    }
    Ok(TrackerKind::Vrpn { address, transport: transport.unwrap_or_default() })
}
