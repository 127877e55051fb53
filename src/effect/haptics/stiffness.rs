//! The body's stiffness at the handle, found while the loop ticks: in each tick that has not taken long, a part of what the model
//! prepares for it, then one more evaluation of the body, beside its state where the model has such a way.
//!
//! In: the hold with the body's push there. Out: K, 6 × 6 in N/m, N and N·m of the device: minus the derivatives of the push by
//! the hold's motion (v, ω), by differences from the push that the tick has found anyway. It is the Hessian of the energy in
//! equilibrium, with what the turning of the element itself adds, and may have negative eigenvalues where the body gives
//! way. The hand moves on by a few millimetres at most while K is found, over which it hardly changes.

use super::elastic::Elastic;
use super::grasp::{ElementHold, room_from_handle};
use crate::stage::Haptic;
use nalgebra::{Isometry3, Matrix6, Translation3, UnitQuaternion, Vector6};

/// The step of the differences, rad, and as a part of the body's size.
const DIFFERENCE: f64 = 1e-4;
/// K is found anew after the handle has turned by this angle, rad,
pub const TURNED: f64 = 0.1;
/// or after a control element has turned by this angle, or moved by this part of the body.
const MOVED: f64 = 0.02;
/// Largest number of ticks over which a column waits for one in which the body's response is fast.
const MOST_WAITED: usize = 4;

/// The stiffness of one hold.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stiffness {
    /// K as it was found last; `None` at first.
    pub found: Option<Matrix6<f64>>,
    /// Rotation of the handle where the newest search began.
    begun_at: Option<UnitQuaternion<f64>>,
    columns: Matrix6<f64>,
    /// The next column of a search; `None` between two searches. Whether the body is prepared for it, `None` before that begins.
    next: Option<usize>,
    prepared: Option<bool>,
    /// Ticks in which that has waited.
    waited: usize,
}

impl Stiffness {
    /// Begins a search in a new hold, and where handle or body have moved since the last one began.
    pub fn follow(&mut self, handle: &Isometry3<f64>, body: &mut Elastic) {
        let is_near =
            |last: UnitQuaternion<f64>| last.angle_to(&handle.rotation) < TURNED && body.moved() < MOVED;
        if self.next.is_some() || self.begun_at.is_some_and(is_near) {
            return;
        }
        (self.begun_at, self.columns, self.next) = (Some(handle.rotation), Matrix6::zeros(), Some(0));
        self.prepared = None;
        body.mark();
    }

    /// Goes on with a search by one column, or by a part of what comes before. The hold is at `at` in the device's frame, and
    /// `push` is the body's push there. A device without torque does not feel the columns of turns. True when the search is over;
    /// `None` if the hold or the push near it is not defined.
    pub fn search(
        &mut self,
        haptic: &Haptic,
        held: &ElementHold,
        (at, push): &(Isometry3<f64>, Vector6<f64>),
        body: &mut Elastic,
    ) -> Option<bool> {
        let Some(k) = self.next else { return Some(false) };
        if body.was_long() && self.waited < MOST_WAITED {
            self.waited += 1;
            return Some(false);
        }
        self.waited = 0;
        if self.prepared != Some(true) {
            let is_prepared = body.prepare_beside(self.prepared.is_none());
            self.prepared = Some(is_prepared);
            if !is_prepared {
                return Some(false);
            }
        }
        // A metre of the device is `motion` of the room's, of which the body has 1/scaling.
        let size = body.origin().norm().max(0.01) * held.room_from_body.scaling() / haptic.motion;
        let step = if k < 3 { DIFFERENCE * size } else { DIFFERENCE };
        let mut motion = Vector6::<f64>::zeros();
        motion[k] = step;
        let turn = UnitQuaternion::from_scaled_axis(motion.fixed_rows::<3>(3).into_owned());
        let place = at.translation.vector + motion.fixed_rows::<3>(0);
        let beside = Isometry3::from_parts(Translation3::from(place), turn * at.rotation);
        let reach = held.reach(&room_from_handle(haptic, &beside), &body.origin())?;
        let response = body.respond_beside(&reach.pose);
        let ahead = held.push(haptic, &reach, &response)?.stacked();
        self.columns.set_column(k, &((push - ahead) / step));
        let count = if haptic.max_torque_nm > 0.0 { 6 } else { 3 };
        self.next = Some(k + 1).filter(|next| *next < count);
        if self.next.is_some() {
            return Some(false);
        }
        let symmetric = (self.columns + self.columns.transpose()) * 0.5;
        self.found = Some(symmetric).filter(|k| k.iter().all(|k| k.is_finite()));
        self.found.map(|_| true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::deform::{BodyState, ControlPose, ControlRest, DeformationModel, PoseSlope, Response};
    use crate::effect::haptics::{Control, Grasp, HoldConstraint, Reading};
    use nalgebra::{Matrix3, Matrix4, Similarity3, Vector3};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    /// N/m.
    const SPRINGS: Vector3<f64> = Vector3::new(900.0, 500.0, 200.0);

    /// A spring along each axis; counts its evaluations, and reports whether one takes long.
    struct Springs(Arc<AtomicUsize>, bool);

    impl DeformationModel for Springs {
        fn state(&mut self, _poses: &[ControlPose]) -> BodyState {
            BodyState::at_rest(0)
        }

        fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
            self.0.fetch_add(1, Relaxed);
            let moved = poses[0].translation;
            let force = moved.component_mul(&SPRINGS);
            slopes[0] = PoseSlope { translation: force, matrix: Matrix3::zeros() };
            Some(Response { energy: 0.5 * force.dot(&moved), is_defined: true })
        }

        fn was_long(&self) -> bool {
            self.1
        }
    }

    /// Number of evaluations of the body in each of `ticks` ticks, and whether there is a force; and how much stiffer the
    /// coupling is.
    fn ticked(ticks: u32, is_long: bool) -> (Vec<(usize, bool)>, f64) {
        let count = Arc::new(AtomicUsize::new(0));
        let rest = ControlRest { name: "springs".into(), origin: Vector3::zeros(), nodes: 1 };
        let body = Elastic::new(Box::new(Springs(count.clone(), is_long)), &[rest]).unwrap();
        let mut control = Control::new(Haptic::simulated("counted"), vec![body], 0.0);
        let held = ElementHold {
            grip: 1,
            body: 0,
            element: 0,
            room_from_body: Similarity3::identity(),
            constraint: HoldConstraint::Rigid(Matrix4::identity()),
        };
        let grasp = Grasp { held: Some(held), poses: vec![ControlPose::REST], ..Grasp::default() };
        let tick = |tick: u32| {
            let now_s = 1e-3 * f64::from(tick);
            if tick.is_multiple_of(16) {
                control.take(&grasp);
            }
            count.store(0, Relaxed);
            let swing = (6.0 * now_s).sin();
            let at = Isometry3::new(Vector3::new(2e-3, 1e-3, -1e-3) * swing, Vector3::y() * swing);
            control.tick(Some(&Reading::at(at, now_s)), now_s);
            (count.load(Relaxed), control.state.gain > 0.0)
        };
        ((0..ticks).map(tick).collect(), control.state.stiffer)
    }

    /// Each tick evaluated the body thirteen times where the handle had moved: plates were late by ten ticks.
    #[test]
    fn a_tick_evaluates_the_body_twice_at_most() {
        let (ticks, stiffer) = ticked(1000, false);
        for (tick, (evaluations, is_felt)) in ticks.into_iter().enumerate() {
            assert!(evaluations <= 2, "tick {tick}: {evaluations} evaluations");
            assert_eq!(is_felt, tick >= 6, "tick {tick}: no force before the coupling suits all six columns");
        }
        // 0.8 · 2 b/T at 1 N·s/m and 1 kHz.
        assert!((stiffer - SPRINGS.max() / 1600.0).abs() < 1e-6, "{stiffer}");
    }

    /// A second equilibrium made long ticks twice as long.
    #[test]
    fn a_long_tick_finds_no_column_four_times_in_succession() {
        let (ticks, _) = ticked(34, true);
        for (tick, (evaluations, is_felt)) in ticks.into_iter().enumerate() {
            assert_eq!(evaluations, if tick % 5 == 4 { 2 } else { 1 }, "tick {tick}");
            assert_eq!(is_felt, tick >= 30, "tick {tick}");
        }
    }

    /// A body that has not moved, in a hand that has turned by more than [`TURNED`].
    #[test]
    fn a_turned_handle_alone_is_measured_anew() {
        let rest = ControlRest { name: "springs".into(), origin: Vector3::zeros(), nodes: 1 };
        let mut body = Elastic::new(Box::new(Springs(Arc::default(), false)), &[rest]).unwrap();
        let mut stiffness = Stiffness::default();
        for (angle, begins) in [(0.0, true), (0.5 * TURNED, false), (2.0 * TURNED, true)] {
            stiffness.next = None;
            stiffness.follow(&Isometry3::rotation(Vector3::y() * angle), &mut body);
            assert_eq!(stiffness.next.is_some(), begins, "{angle}");
        }
    }
}
