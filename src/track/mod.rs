//! Where poses come from: each source is a file here and gives a [`TrackerState`] for an instant.
//!
//! In: mouse and keys, a script of key frames, or a tracker's packets. Out: the head and the styli in the room's frame
//! (metres, y up, right-handed), f32, as a tracker of the field would send them. A stylus' ray is its -z axis.

pub mod device;
pub mod dtrack;
pub mod fastrak;
mod flow;
pub mod gamepad;
mod interpolate;
pub mod mouse;
mod open;
mod open_error;
pub mod osc;
mod pace;
#[cfg(test)]
pub(crate) mod puppet;
pub mod rig;
pub mod script;
mod state;
pub mod udp;
pub mod vrpn;
mod worker;

pub use device::{DeviceState, Source};
pub use flow::Flow;
pub use mouse::{Mouse, MouseInput};
pub use open::open;
pub use open_error::OpenError;
pub use rig::Rig;
pub use script::{Script, ScriptError, ScriptSource};
pub use state::{HeldPose, Signal, StylusState, TrackerState, normalised, usable};
pub use worker::{Backoff, Publisher, Worker};
