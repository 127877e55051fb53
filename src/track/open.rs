//! The list of sources: what a stage file can name, and what opens it.

use super::device::Source;
use super::{dtrack, fastrak, gamepad, osc, udp, vrpn};
use crate::stage::tracking::{Listen, TrackerKind};

/// Why a source could not be opened at all; one that is merely absent is waited for.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error(
        "tracker `{tracker}`: cannot listen on {at}: {source}; does another program listen there, and is it an address \
         of this machine?"
    )]
    Listen { tracker: String, at: std::net::SocketAddr, source: std::io::Error },
    #[error(
        "tracker `{tracker}`: cannot join the multicast group {place}: {source}; give `interface`, the address that this \
         machine has on the tracker's network"
    )]
    Join { tracker: String, place: Listen, source: std::io::Error },
    #[error("tracker `{tracker}`: cannot start its thread: {source}")]
    Thread { tracker: String, source: std::io::Error },
    #[error("tracker `{tracker}`: {why}")]
    Unsupported { tracker: String, why: String },
}

/// Opens a source: one line per kind.
pub fn open(tracker: &str, kind: &TrackerKind) -> Result<Box<dyn Source>, OpenError> {
    Ok(match kind {
        TrackerKind::Vrpn { address, transport } => Box::new(vrpn::Client::open(address.clone(), *transport)),
        TrackerKind::Dtrack { listen } => {
            Box::new(udp::listen(tracker, "dtrack", *listen, dtrack::Dtrack::default())?)
        }
        TrackerKind::Osc { listen, euler } => {
            Box::new(udp::listen(tracker, "osc", *listen, osc::Osc::new(*euler))?)
        }
        TrackerKind::Fastrak { device, baud } => Box::new(fastrak::open(tracker, device, *baud)?),
        TrackerKind::Gamepad { device } => Box::new(gamepad::open(tracker, device)?),
        TrackerKind::Haptic(_) => {
            let why = "a force device is opened by whoever gives it forces".to_owned();
            return Err(OpenError::Unsupported { tracker: tracker.to_owned(), why });
        }
    })
}
