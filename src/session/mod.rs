//! What drives a world and what becomes of it: input, recording, force devices.
//!
//! In: a scene, a stage, and whoever moves head and styli ([`InputSource`]: a recording, trackers, a script, mouse and
//! keyboard; one place decides which of them leads). Out: a [`Session`] whose world [`Session::advance`] moves on, the
//! forces of haptic devices, and a file that plays the session again.

pub mod advance;
pub mod input;
pub mod keys;
pub mod lines;
pub mod open;
pub mod playback;
pub mod recording;
pub mod trackers;

pub use advance::{Progress, Session};
pub use input::{InputSource, Leader};
pub use open::Request;
pub use playback::Playback;
