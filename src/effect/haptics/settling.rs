//! The closed loop of a simulated device with delay: does the handle come to rest, and was energy generated?
//!
//! The body is a block of [`BLOCK_M`] between the hand and the ground: Young's modulus E is a spring of E · [`BLOCK_M`]. The
//! handle is held [`START_M`] aside until the loop has measured the device and reached its full force; then it is released. In:
//! how the device reports, E, the hand, the measures. Out: how far the handle still moves at the end, and the energy that it
//! gave the hand beyond what the body held at the release. Time is virtual, and so the same on every machine.

use super::device::Device;
use super::grasp::Grasp;
use super::loop_state::{LoopState, Measures};
use super::simulated::{Hand, Reports, Simulated};
use super::stability::{START_M, spring, tick_with};
use super::tick::Control;
use crate::stage::Haptic;
use nalgebra::{Isometry3, Translation3, Vector3};

/// Sides of the body, m.
pub const BLOCK_M: f64 = 0.1;
/// Time for which the handle is held, s.
const HELD_S: f64 = 1.0;
/// Time for which the handle is observed after its release, s.
const FREE_S: f64 = 10.0;
/// The time between two frames, s.
const FRAME_S: f64 = 1.0 / 60.0;

/// Young's moduli, Pa.
pub const MODULI: [f64; 6] = [1e3, 1e4, 1e5, 1e6, 1e7, 1e8];

/// Devices that report a thousand times a second with growing delay, and one that reports two hundred times with jitter.
pub const REPORTS: [Reports; 5] = [
    Reports { every_s: 1e-3, delay_s: 0.0, jitter_s: 0.0 },
    Reports { every_s: 1e-3, delay_s: 1e-3, jitter_s: 0.0 },
    Reports { every_s: 1e-3, delay_s: 1.6e-3, jitter_s: 0.0 },
    Reports { every_s: 1e-3, delay_s: 3e-3, jitter_s: 0.0 },
    Reports { every_s: 5e-3, delay_s: 0.0, jitter_s: 5e-3 },
];

/// The outcome of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettlingResult {
    /// Largest distance from rest in the last second, m.
    pub swing_m: f64,
    /// Largest turn from rest in the last second, rad.
    pub turned_rad: f64,
    /// Greatest speed in the last second, m/s.
    pub speed: f64,
    /// The maximum over time of the push's work, less the dissipation by the device's friction and the body's initial energy,
    /// J.
    pub made_j: f64,
    /// The loop's state at the end.
    pub state: LoopState,
}

/// The motion of the hand that holds the handle.
pub type Gesture = fn(f64) -> Vector3<f64>;

/// A hand at rest in the middle.
pub fn still(_time_s: f64) -> Vector3<f64> {
    Vector3::zeros()
}

/// 5 mm to and fro, three times a second along x and twice along y: it never settles.
pub fn shaking(time_s: f64) -> Vector3<f64> {
    let phase = std::f64::consts::TAU * time_s;
    Vector3::new((3.0 * phase).sin(), (2.0 * phase).sin(), 0.0) * 5e-3
}

/// Releases the handle of `haptic` on a body of Young's modulus `young`, Pa.
pub fn settle(
    haptic: &Haptic,
    reports: Reports,
    young: f64,
    hand: (Hand, Gesture),
    measures: Measures,
) -> Option<SettlingResult> {
    let (mut control, grasp) = spring(haptic, young * BLOCK_M)?;
    control.measures = measures;
    Some(release(control, &grasp, reports, hand, &Isometry3::translation(START_M, 0.0, 0.0)))
}

/// Releases the handle from `start`, where it is held at first; the body is at rest where the handle is at the origin.
pub(super) fn release(
    mut control: Control,
    grasp: &Grasp,
    reports: Reports,
    (hand, gesture): (Hand, Gesture),
    start: &Isometry3<f64>,
) -> SettlingResult {
    let haptic = control.haptic.clone();
    let mut device = Simulated::new(&haptic, hand);
    device.reports = reports;
    device.hand(&Isometry3::identity());
    let period_s = haptic.period_s();
    let frame = (FRAME_S / period_s).ceil() as u64;
    let mut held_j = 0.0;
    let mut settled =
        SettlingResult { swing_m: 0.0, turned_rad: 0.0, speed: 0.0, made_j: 0.0, state: control.state };
    for tick in 0..((HELD_S + FREE_S) / period_s) as u64 {
        let now_s = tick as f64 * period_s;
        if now_s <= HELD_S {
            device.device_from_handle = *start;
            device.velocity = [Vector3::zeros(); 2];
            (device.push_work, device.eaten, held_j) = (0.0, 0.0, control.state.stored_energy);
        } else {
            let hand = Translation3::from(gesture(now_s - HELD_S));
            device.hand(&Isometry3::from_parts(hand, device.device_from_handle.rotation));
        }
        if tick % frame == 0 {
            control.take(grasp);
        }
        tick_with(&mut control, &mut device, now_s);
        settled.made_j = settled.made_j.max(device.push_work - device.eaten - held_j);
        if now_s > HELD_S + FREE_S - 1.0 {
            settled.swing_m = settled.swing_m.max(device.device_from_handle.translation.vector.norm());
            settled.turned_rad = settled.turned_rad.max(device.device_from_handle.rotation.angle());
            settled.speed = settled.speed.max(device.velocity[0].norm());
        }
    }
    SettlingResult { state: control.state, ..settled }
}
