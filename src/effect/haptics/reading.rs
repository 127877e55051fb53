//! What a force device and its loop do now, for the overlay.

use super::loop_state::LoopState;
use super::thread::LoopTiming;

/// What a force device and its loop do now.
#[derive(Clone, Debug, PartialEq)]
pub struct HapticReading {
    pub name: String,
    pub state: LoopState,
    pub timing: LoopTiming,
    pub max_force_n: f64,
    /// Its stylus holds something that is felt.
    pub holds: bool,
}
