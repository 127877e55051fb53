//! What a force device and its loop do now, for the overlay.

use super::thread::LoopTiming;
use super::tick::LoopState;

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
