//! The list of sources: what a stage file can name, and what opens it.

use super::device::Source;
use super::open_error::OpenError;
use super::{dtrack, fastrak, gamepad, osc, udp, vrpn};
use crate::stage::tracking::TrackerKind;

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
