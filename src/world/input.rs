//! All that comes into a world from outside in one frame.
//!
//! In: trackers, mouse or script, keys and panels, and the threads that compute in the background. Out: an [`Input`], which is
//! recorded as it is: the same state and the same inputs give the same frames, bit by bit.

use crate::interact::Action;
use crate::track::TrackerState;
use serde::{Deserialize, Serialize};

/// The input of a frame: all that comes from outside.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Input {
    /// Time since the start of the session, s; a script's own time ([`TrackerState::time_s`]) begins anew with every round.
    pub clock_s: f64,
    /// Commands of keys and panels, and what the session does for a script: its loads, and let go or reset at its end or new
    /// round. They are carried out in this order before the styli move.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub actions: Vec<Action>,
    /// The bodies for which the background has a new state ([`World::arrivals`](super::World::arrivals)).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub arrivals: Vec<usize>,
    /// Warnings of the session, such as that a script's press grabs nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Head and styli.
    pub trackers: TrackerState,
}

impl From<TrackerState> for Input {
    /// Head and styli alone, at the trackers' time.
    fn from(trackers: TrackerState) -> Input {
        Input { clock_s: trackers.time_s, trackers, ..Input::default() }
    }
}
