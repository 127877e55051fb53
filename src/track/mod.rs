//! Sources of poses: each kind has a file here; together they give a [`TrackerState`] for any time.
//!
//! In: mouse and keys, a script of key frames, or a tracker's packets. Out: head and styli in the room's frame (metres,
//! y up, right-handed), in f32. A stylus' ray is its -z axis.
//!
//! ```text
//! packets → one of SOURCES → DeviceState → TrackerSet (calibration, filter, prediction) → TrackerState
//! ```
//!
//! [`Mouse`] and [`Script`] make a [`TrackerState`] themselves; `session::trackers::merge` joins it with that of the
//! [`TrackerSet`].

pub mod device;
pub mod doubts;
pub mod dtrack;
pub mod fastrak;
mod flow;
pub mod gamepad;
mod interpolate;
mod listen;
pub mod mouse;
pub mod osc;
pub mod redirect;
pub mod script;
pub mod source_entry;
mod sources;
pub mod stand_in;
mod state;
pub mod tracker_set;
pub mod udp;
pub mod vrpn;
mod worker;

pub use device::{DeviceState, Source};
pub use flow::Flow;
pub use listen::{Listen, is_only_late};
pub use mouse::{Mouse, MouseInput};
pub use redirect::Redirect;
pub use script::{Script, ScriptError};
pub use source_entry::{OpenError, SourceEntry};
pub use sources::{SOURCES, checked, find_stage, open, source_faults};
pub use stand_in::{FakeSource, StandIn};
pub use state::{HeldPose, Signal, StylusState, TrackerState, normalised, usable};
pub use tracker_set::TrackerSet;
pub use worker::{Publisher, Worker};
