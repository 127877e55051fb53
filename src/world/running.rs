//! The memory of effects: what each keeps from one frame to the next, as JSON.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;

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
