//! State of the force loop after a tick, with its faults, and the safety measures that are active.

use super::device::Push;
use super::passivity::Observer;
use nalgebra::Isometry3;

/// The safety measures that are active. Stages use all; the tables of stability leave some out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measures {
    /// Force and slew limits.
    pub limits: bool,
    /// The coupling that softens bodies that are too stiff.
    pub coupling: bool,
    /// The observer's brake.
    pub brake: bool,
    /// The age of a pose when its force acts, in addition to the time between two poses.
    pub age: bool,
}

impl Measures {
    pub const ALL: Measures = Measures { limits: true, coupling: true, brake: true, age: true };
    pub const NONE: Measures = Measures { limits: false, coupling: false, brake: false, age: false };
}

/// Numbers of ticks without force, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoopFaults {
    /// No device, no report for [`STALE_S`](super::tick::STALE_S), or a device that reports no tracked pose.
    pub lost: u64,
    /// Poses that are not a number, outside the room, or no rotation.
    pub absurd: u64,
    /// Motions faster than [`MOST_SPEED`](super::tick::MOST_SPEED).
    pub jumps: u64,
    /// A reading older than the last one, which is ignored.
    pub backward: u64,
    /// Something is held or touched, but no frame has come for [`UNATTENDED_S`](super::tick::UNATTENDED_S).
    pub unattended: u64,
    /// The body's frame or equilibrium was not found, so the force is that of an earlier one.
    pub undefined: u64,
}

/// The loop's state after a tick, which the frame can show.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoopState {
    /// Pose of the handle in the room; `None` while the device is lost.
    pub room_from_handle: Option<Isometry3<f64>>,
    pub buttons: [bool; 2],
    /// Push on the hand, in the device's frame.
    pub push: Push,
    /// Share of the push that acts: from 0, no force, to 1, all of it.
    pub gain: f64,
    /// The body pulls harder than the device can push.
    pub limited: bool,
    /// The stiffness of the body, or of the touch, over what the device bears, in the stiffest direction; up to 1 nothing is softened.
    pub stiffer: f64,
    /// The largest stiffness that the device bears, N/m.
    pub bearable: f64,
    /// Mean time between two reports of the device, s: [`Delay::period_s`](super::delay::Delay::period_s).
    pub spacing_s: f64,
    /// The greatest age of a pose when its force begins to act, s: [`Delay::age_s`](super::delay::Delay::age_s).
    pub age_s: f64,
    /// Energy of the body, or of the contacts, J.
    pub strain_energy: f64,
    /// The energy whose gradient is the full force, J: of body and coupling in the hand's units. At the force limit it grows
    /// only by force times distance.
    pub stored_energy: f64,
    pub observer: Observer,
    pub faults: LoopFaults,
}
