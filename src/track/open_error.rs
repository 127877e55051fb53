//! Errors of opening a tracker, with what to do about them.

use super::listen::Listen;
use crate::base::failure::Failure;
use crate::stage::StageError;

/// The reason why a source could not be opened at all. A device that is merely absent is waited for.
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
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error("tracker `{tracker}`: {why}")]
    Unsupported { tracker: String, why: String },
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Failure {
        Failure::work(error)
    }
}
