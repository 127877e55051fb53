//! The overlay in a picture: where a frame's time goes, how fresh the trackers are, how far bodies are bent, warnings.
//!
//! In: a world and the steps of its last frames, as plain [`Readings`] and [`History`]. Out: two columns of small
//! aligned letters at the left and right edge and a strip at the bottom ([`Panel`]); the middle stays free, and so does what is
//! held ([`Seats`]).

mod body_rows;
mod panel;
mod readings;
mod row;
mod seats;

pub use panel::Panel;
pub use readings::{
    ACQUIRE, BodyReading, ControlReading, ErrorReading, ForceReading, FrameSteps, HandDoes, HandReading,
    History, Readings, STEPS, SensorReading,
};
pub use seats::Seats;

#[cfg(test)]
mod tests;
