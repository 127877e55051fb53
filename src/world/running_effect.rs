//! An effect in a world: its part of each frame, its memory, its devices and its threads.

use super::frame::World;
use crate::base::plates::Words;
use crate::track::{Source, TrackerState};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;

/// An effect of a world, until it is dropped; a thread that it has started ends with it.
pub trait RunningEffect {
    /// As scenes name it.
    fn name(&self) -> &'static str;

    /// Changes what trackers, script or mouse say, before the world goes through a frame. A replay, whose recording holds what came
    /// of it, does not ask.
    fn input(&mut self, _state: &mut TrackerState) {}

    /// Sees the world at the end of a frame, and adds what it draws ([`World::strips`]).
    fn show(&mut self, _world: &mut World) {}

    /// Sees the world before a picture that is kept: waits for what comes from the background, and adds what it draws of it.
    fn before_picture(&mut self, _world: &mut World) {}

    /// What it keeps from one frame to the next; `None` where all that it shows follows from the frame.
    fn memory(&self) -> Option<Memory> {
        None
    }

    /// Goes on from what an effect of the same scene kept. The error says why it cannot.
    fn set_memory(&mut self, _memory: &Memory) -> Result<(), String> {
        Ok(())
    }

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

    /// Rows of the overlay for each of its devices, as they are now.
    fn readings(&mut self) -> Vec<Vec<Words>> {
        Vec::new()
    }

    /// How it went, in lines for the end of a session.
    fn summary(&mut self) -> String {
        String::new()
    }
}

/// An effect's part of the state, as JSON.
pub type Memory = Box<RawValue>;

/// Writes a memory. The error of what cannot be written is left to whoever reads it: plain data always can.
pub fn written(memory: &impl Serialize) -> Option<Memory> {
    serde_json::value::to_raw_value(memory).ok()
}

/// Reads a memory.
pub fn read<T: DeserializeOwned>(memory: &Memory) -> Result<T, String> {
    serde_json::from_str(memory.get()).map_err(|error| error.to_string())
}
