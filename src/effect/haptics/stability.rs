//! The closed loop of a simulated device, a hand and a stiff body, by stiffness and rate: stable, a limit cycle, or diverging.
//!
//! The body is one control element on a spring of K N/m in every direction; the handle starts [`START_M`] aside at rest.
//! In: rates, stiffnesses, the hand, the measures. Out: rows for a table, and the least stiffness that is not stable, to be
//! compared with K = 2b/T in theory. Time is virtual, and so the same on every machine.

use super::device::Device;
use super::elastic::Elastic;
use super::grasp::{ElementHold, Grasp, HoldConstraint};
use super::loop_state::Measures;
use super::simulated::{Hand, Simulated};
use super::tick::{Control, RAMP_S};
use crate::deform::{ControlPose, ControlRest, LINEAR};
use crate::green::{FIELDS, STIFFNESS};
use crate::stage::Haptic;
use nalgebra::{DMatrix, Isometry3, Matrix4, Similarity3, Vector3};

/// Distance of the handle from rest at its release, m.
pub const START_M: f64 = 5e-3;
/// Duration of each run, s.
const SPAN_S: f64 = 4.0;
/// The time between two frames, s.
const FRAME_S: f64 = 1.0 / 60.0;
/// The ratio of two consecutive stiffnesses in the search for the boundary.
const STEP: f64 = 1.05;
/// The range of that search, N/m.
const SCAN: [f64; 2] = [50.0, 1e6];

pub const RATES_HZ: [f64; 5] = [250.0, 500.0, 1000.0, 2000.0, 4000.0];
pub const STIFFNESSES: [f64; 7] = [20.0, 200.0, 1000.0, 2000.0, 5000.0, 20_000.0, 200_000.0];

/// The outcome of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The handle comes to rest: the last second stays within 2 % of the start, or 5 % below the second before.
    Stable,
    /// The handle goes on moving, no further than twice the start.
    Cycle,
    /// The handle leaves the neighbourhood.
    Diverges,
}

impl Verdict {
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Stable => "stable",
            Verdict::Cycle => "cycle",
            Verdict::Diverges => "diverges",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Run {
    pub stiffness: f64,
    pub rate_hz: f64,
    pub verdict: Verdict,
    /// Largest distance from rest in the last second, m.
    pub swing_m: f64,
    /// The most energy that the loop had generated at any time, J.
    pub generated_j: f64,
    /// The body's stiffness over what the device bears.
    pub stiffer: f64,
}

/// Releases the handle of `haptic` in `hand` on a spring, with the `measures`.
pub fn run(haptic: &Haptic, hand: Hand, stiffness: f64, measures: Measures) -> Run {
    let Some((mut control, grasp)) = spring(haptic, stiffness) else {
        let (rate_hz, verdict, nan) = (haptic.rate_hz, Verdict::Diverges, f64::NAN);
        return Run { stiffness, rate_hz, verdict, swing_m: nan, generated_j: nan, stiffer: nan };
    };
    control.measures = measures;
    let mut device = Simulated::new(haptic, hand);
    device.hand(&Isometry3::identity());
    let (period_s, mut swings_m) = (haptic.period_s(), [0.0f64; 2]);
    let ticks = ((SPAN_S + RAMP_S) / period_s) as u64;
    let frame = (FRAME_S / period_s).ceil() as u64;
    for tick in 0..ticks {
        let now_s = tick as f64 * period_s;
        // Held fast until the force has ramped up.
        if now_s <= RAMP_S {
            device.device_from_handle.translation.vector = Vector3::new(START_M, 0.0, 0.0);
            device.velocity = [Vector3::zeros(); 2];
        }
        if tick % frame == 0 {
            control.take(&grasp);
        }
        tick_with(&mut control, &mut device, now_s);
        let away = device.device_from_handle.translation.vector.norm();
        if away.is_nan() || away >= 100.0 * START_M {
            swings_m = [START_M, f64::INFINITY];
            break;
        }
        let left_s = SPAN_S + RAMP_S - now_s;
        if left_s < 2.0 {
            let second = usize::from(left_s < 1.0);
            swings_m[second] = swings_m[second].max(away);
        }
    }
    let [before_m, swing_m] = swings_m;
    let verdict = match swing_m {
        swing if swing <= 0.02 * START_M || swing < 0.95 * before_m => Verdict::Stable,
        swing if swing <= 2.0 * START_M => Verdict::Cycle,
        _ => Verdict::Diverges,
    };
    let state = control.state;
    let generated_j = state.observer.deepest;
    Run { stiffness, rate_hz: haptic.rate_hz, verdict, swing_m, generated_j, stiffer: state.stiffer }
}

/// One tick of the loop on a simulated device.
pub(super) fn tick_with(control: &mut Control, device: &mut Simulated, now_s: f64) {
    let reading = device.read(now_s);
    control.latency_s = device.latency_s();
    let push = control.tick(reading.as_ref(), now_s);
    device.push(&push, now_s);
}

/// The least stiffness that is not stable, N/m, to 1 %. The search goes upwards from 50 N/m in steps of 5 %, because some
/// greater stiffnesses may be stable again. `None` if all are stable up to 1 MN/m.
pub fn boundary(haptic: &Haptic, hand: Hand, measures: Measures) -> Option<f64> {
    let is_stable = |stiffness| run(haptic, hand, stiffness, measures).verdict == Verdict::Stable;
    let [mut low, most] = SCAN;
    let mut high = low;
    while is_stable(high) {
        if high >= most {
            return None;
        }
        (low, high) = (high, high * STEP);
    }
    while high > 1.01 * low {
        let middle = f64::sqrt(low * high);
        if is_stable(middle) { low = middle } else { high = middle }
    }
    Some(high)
}

/// One control element on springs in all directions, held at rest by a stylus at the origin.
pub(super) fn spring(haptic: &Haptic, stiffness: f64) -> Option<(Control, Grasp)> {
    let matrix = DMatrix::from_fn(FIELDS, FIELDS, |i, j| if i == j && i < 3 { stiffness } else { 0.0 });
    let rest = ControlRest { name: "spring".into(), origin: Vector3::zeros(), nodes: 1 };
    let body = Elastic::of_tables(&LINEAR, &[rest], &|name| (name == STIFFNESS.name).then(|| matrix.clone()))
        .ok()?;
    let control = Control::new(haptic.clone(), vec![body], 0.0);
    let held = ElementHold {
        grip: 1,
        body: 0,
        element: 0,
        room_from_body: Similarity3::identity(),
        constraint: HoldConstraint::Rigid(Matrix4::identity()),
    };
    Some((control, Grasp { held: Some(held), poses: vec![ControlPose::REST], ..Grasp::default() }))
}
