//! A session: the input that moves a world, the recording of it, and its force devices.
//!
//! In: a scene, a stage, and whoever moves head and styli: a recording, a script, trackers, or mouse and keyboard
//! ([`InputSource::leader`] decides). Out: a [`Session`] whose world [`Session::advance`] moves on, the forces of haptic
//! devices, and a file that plays the session again.

pub mod advance;
pub mod input;
pub mod keys;
pub mod lines;
pub mod open;
pub mod playback;
pub mod recording;
pub mod trackers;

pub use advance::{Session, SessionProgress};
pub use input::{InputSource, Leader};
pub use open::Request;
pub use playback::Playback;
