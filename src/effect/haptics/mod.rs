//! The effect `haptics`: the force with which a body resists, rendered to the hand a thousand times a second or more.
//!
//! In: the device's newest pose in every tick, and from each frame the held element and the poses of the others, or the
//! contacts of the tool in the hand. Out: force and torque on the hand. From the paper, "f_b = Bᵀu + Cb", which for control
//! elements is S = Φᵀ(C - BᵀA⁻¹B)Φ of 12E × 12E: small enough for a thread of its own that knows no surface.
//!
//! [`Elastic`] is the body, [`ElementHold`] the hold on it, [`TouchPotential`](crate::deform::TouchPotential) a touch,
//! [`Control`] one tick with all safety measures, [`Loop`] the thread, and [`Device`] the force-feedback device.
pub mod bent;
mod bond;
pub mod coupling;
pub mod delay;
pub mod device;
pub mod elastic;
pub mod grasp;
pub mod haply;
pub mod haply_messages;
pub mod haptic_source;
pub mod live;
pub mod loop_state;
mod passivity;
pub mod reading;
pub mod settling;
pub mod simulated;
pub mod stability;
mod stiffness;
pub mod thread;
pub mod tick;
pub mod vrpn;

pub use bond::TouchSpring;
pub use device::{Device, Push, Reading, SampleInfo};
pub use elastic::{Elastic, ElasticResponse};
pub use grasp::{ElementHold, Grasp, HoldConstraint};
pub use haply::{Haply, HaplyTiming};
pub use haptic_source::HapticSource;
pub use live::HapticSession;
pub use loop_state::{LoopFaults, LoopState, Measures};
pub use reading::HapticReading;
pub use simulated::{Hand, Reports, Simulated};
pub use thread::{Loop, LoopTiming, Report};
pub use tick::Control;
pub use vrpn::VrpnDevice;
