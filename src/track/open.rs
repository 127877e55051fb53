//! The list of sources: what a stage file can name, and what opens it.

use super::device::Source;
use crate::stage::tracking::TrackerKind;

/// Why a source could not be opened at all; one that is merely absent is waited for.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error("tracker `{tracker}`: cannot listen on {at}: {source}; does another program listen there?")]
    Listen { tracker: String, at: std::net::SocketAddr, source: std::io::Error },
    #[error("tracker `{tracker}`: cannot start its thread: {source}")]
    Thread { tracker: String, source: std::io::Error },
    #[error("tracker `{tracker}`: {why}")]
    Unsupported { tracker: String, why: String },
}

/// Opens a source: one line per kind.
pub fn open(tracker: &str, kind: &TrackerKind) -> Result<Box<dyn Source>, OpenError> {
    match kind {
        TrackerKind::Vrpn { .. } | TrackerKind::Dtrack { .. } | TrackerKind::Osc { .. } => {
            not_yet(tracker, kind)
        }
        TrackerKind::Fastrak { .. } | TrackerKind::Gamepad { .. } => not_yet(tracker, kind),
    }
}

fn not_yet(tracker: &str, kind: &TrackerKind) -> Result<Box<dyn Source>, OpenError> {
    Err(OpenError::Unsupported { tracker: tracker.to_owned(), why: format!("{kind} is not built in yet") })
}
