//! A session: the input that moves a world, the effects that take part in it, and the recording of it.
//!
//! In: a scene, a stage, and whoever moves head and styli: a recording, a script, trackers, or mouse and keyboard
//! ([`InputSource::leader`] decides). Out: a [`Session`] whose world [`Session::advance`] moves on, what its effects do, and
//! a file that plays the session again.

pub mod advance;
pub mod change;
pub mod input;
pub mod keys;
pub mod lines;
pub mod open;
pub mod playback;
mod presses;
pub mod recording;
mod sound_file;
pub mod trackers;

pub use advance::{Session, SessionProgress};
pub use change::{Change, ChangeResult, Steps};
pub use input::{InputSource, Leader};
pub use open::{Making, Request};
pub use playback::Playback;
