//! An effect that runs beside the frames of a session: devices, threads.

use super::haptics::reading::HapticReading;
use crate::track::{Source, TrackerState};
use crate::world::World;

/// What an effect has started, until it is dropped.
pub trait RunningEffect {
    /// May change what trackers, script or mouse say, before the world goes through a frame.
    fn before_frame(&mut self, _state: &mut TrackerState) {}

    /// Learns what the world is like after a frame.
    fn after_frame(&mut self, _world: &World) {}

    /// What the effect's device of this name measures, as a tracker's source; once.
    fn source(&mut self, _tracker: &str) -> Option<Box<dyn Source>> {
        None
    }

    /// What force devices do now, for the overlay.
    fn haptic_readings(&mut self) -> Vec<HapticReading> {
        Vec::new()
    }

    /// How it went, in lines for the end of a session.
    fn summary(&mut self) -> String {
        String::new()
    }
}
