//! The effect `haptics`: what a body resists with, in the hand that bends it, a thousand times a second or more.
//!
//! In: the device's newest pose in every tick, and from the frame which element is held and where the others are. Out:
//! force and torque on the hand. From the paper, "f_b = Bᵀu + Cb", which for control elements is S = Φᵀ(C - BᵀA⁻¹B)Φ of
//! 12E × 12E: small enough for a thread that knows nothing of surfaces or frames.
//!
//! [`Elastic`] is the body, [`Held`] the hold on it, [`Control`] a tick with all that keeps it safe, [`Loop`] the thread,
//! [`Device`] what is held.

pub mod acting;
pub mod coupling;
pub mod delay;
pub mod device;
pub mod elastic;
pub mod grasp;
pub mod haply;
pub mod passivity;
pub mod sensed;
pub mod settling;
pub mod simulated;
pub mod stability;
pub mod thread;
pub mod tick;
pub mod vrpn;

pub use device::{Device, News, Push, Reading};
pub use elastic::{Elastic, Response};
pub use grasp::{Grasp, Held, Way};
pub use haply::Haply;
pub use sensed::Sensed;
pub use simulated::{Hand, Reports, Simulated};
pub use thread::{Clockwork, Loop, Report};
pub use tick::{Control, Faults, Felt, Measures};
pub use vrpn::VrpnDevice;

use super::entry::EffectEntry;
use crate::green::STIFFNESS;

pub(super) const ENTRY: EffectEntry = EffectEntry {
    name: "haptics",
    summary: "force and torque on every control element, from the 12E × 12E handle stiffness; felt with a device of the stage",
    requirements: &[STIFFNESS],
    precompute: None,
};
