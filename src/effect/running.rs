//! An effect in a session: what it does before and after each frame, its devices and its threads.

use super::haptics::reading::HapticReading;
use crate::track::{Source, TrackerState};
use crate::world::World;

/// An effect of a session, until it is dropped; a thread that it has started ends with it.
pub trait RunningEffect {
    /// May change what trackers, script or mouse say, before the world goes through a frame.
    fn before_frame(&mut self, _state: &mut TrackerState) {}

    /// Sees the world after a frame, and adds what it draws ([`World::strips`]).
    fn after_frame(&mut self, _world: &mut World) {}

    /// Sees the world before a picture that is kept: waits for what comes from the background, and adds what it draws of it.
    fn before_picture(&mut self, _world: &mut World) {}

    /// Forgets what was drawn of the past, such as a curve.
    fn clear(&mut self) {}

    /// What it has recorded, as a CSV table.
    fn table(&self) -> Option<String> {
        None
    }

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
