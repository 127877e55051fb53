//! The step of a body that something holds.
//!
//! In: a motion, the poses to which held elements move, and the axes R in which the step is taken. Out: the motion at its end. The pieces
//! serve [`Moving::advanced`], where one step goes through the frame, and [`swing`](super::swing), where many do.

use super::coupled::{Phase, StepLoads};
use super::moving::{Motion, Moving, Stride, Strode};
use super::system::System;
use super::tables::{seen, squared};
use crate::deform::{ControlPose, PoseSlope, axial};
use crate::green::FIELDS;
use crate::world::vibration::VibrationStep;
use nalgebra::{DVector, DVectorView, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// A step, or a part of one.
pub struct Leg<'a> {
    pub last: &'a Motion,
    /// Poses to which held elements move.
    pub poses: &'a [ControlPose],
    pub held: &'a [bool],
    /// R, which stands still meanwhile.
    pub axes: UnitQuaternion<f64>,
    pub dt_s: f64,
}

/// Elements that are not released, over a leg.
pub struct Carried {
    /// Their speed, and by how much it jumps where the leg begins, in the axes R.
    pub even: DVector<f64>,
    pub jumps: DVector<f64>,
    /// All poses and speeds at the end, in the body's axes; those of released elements are as they were.
    poses: Vec<ControlPose>,
    speeds: Vec<f64>,
}

impl Leg<'_> {
    /// R and its inverse.
    pub fn matrices(&self) -> [Matrix3<f64>; 2] {
        let out = self.axes.to_rotation_matrix().into_inner();
        [out, out.transpose()]
    }
}

impl Moving {
    /// The whole step at once, with K of the body at rest.
    pub(super) fn advanced(&self, system: &System, stride: &Stride<'_>) -> Strode {
        let Stride { last, poses, held, turn: axes, dt_s, .. } = *stride;
        let leg = Leg { last, poses, held, axes, dt_s };
        let [_, into] = leg.matrices();
        let carried = self.carried(system, &leg);
        let even = carried.even.clone();
        let spin = self.spin(stride);
        let centrifugal = &system.centrifugal * DVectorView::from_slice(&squared(&spin), 9);
        let load = self.stride_load(system, stride, &into);
        let slope = -(&system.stiffness * &carried.even);
        let loads = StepLoads {
            impulse: -(&system.mass * &carried.jumps),
            load: load - system.all_from_own.tr_mul(&centrifugal),
            carried: [system.coupled.static_speed(&slope), DVector::zeros(slope.len())],
            slope,
            ..StepLoads::none(system.mass.nrows())
        };
        let from = self.phase(system, last, &into);
        let modes = system.coupled.begun(&from, &loads, dt_s);
        let to = system.coupled.ended(&modes, dt_s);
        let mut ended = self.ended(system, &leg, carried, [&from, &to], centrifugal);
        if system.released.contains(&true) {
            // The force of the momentum is the mean over the step, and that of the elements beside it must be, too.
            let mean = system.coupled.mean_place(&modes, &to, dt_s) - &to.place;
            let behind = &system.all_from_own * mean - even * (0.5 * dt_s);
            let lag = &self.tables.stiffness * behind;
            let [out, _] = leg.matrices();
            for (e, slope) in ended.slopes.iter_mut().enumerate().filter(|(e, _)| !system.released[*e]) {
                let own = PoseSlope::of_numbers(&seen(&out, &lag.as_slice()[FIELDS * e..][..FIELDS]));
                slope.translation += own.translation;
                slope.matrix += own.matrix;
            }
        }
        let motion = Motion { pressed: self.pressed_modes(stride), ..ended };
        Strode { motion, vibration: VibrationStep { dt_s, modes } }
    }

    /// -∂V/∂z where a stride begins, with what presses the body, in the axes `into`⁻¹.
    pub(super) fn stride_load(
        &self,
        system: &System,
        stride: &Stride<'_>,
        into: &Matrix3<f64>,
    ) -> DVector<f64> {
        let load = self.load(system, stride.acting, &stride.last.poses, into);
        match stride.pressed.mean.as_slice() {
            [] => load,
            pressed => load + system.all_from_own.tr_mul(&DVectorView::from_slice(pressed, pressed.len())),
        }
    }

    /// Φᵀf of what presses the body at the end of a stride.
    pub(super) fn pressed_modes(&self, stride: &Stride<'_>) -> Vec<f64> {
        stride.pressed.end.get(self.tables.fields()..).unwrap_or(&[]).to_vec()
    }

    /// Moves the elements that are not released.
    pub(super) fn carried(&self, system: &System, leg: &Leg<'_>) -> Carried {
        let Leg { last, poses: goals, held, dt_s, .. } = *leg;
        let [_, into] = leg.matrices();
        let all = self.tables.mass.nrows();
        let (mut even, mut jumps) = (DVector::zeros(all), DVector::zeros(all));
        let mut poses = last.poses.clone();
        let mut speeds = last.speeds.clone();
        for e in (0..poses.len()).filter(|e| !system.released[*e]) {
            let at = FIELDS * e..FIELDS * (e + 1);
            // What a released element was put to begins at rest; what is no number is not followed.
            let is_put = !held[e] && goals[e] != last.poses[e];
            let pose = if goals[e].is_finite() { goals[e] } else { last.poses[e] };
            let (then, new) = (last.poses[e].coefficients(), pose.coefficients());
            let own = &mut speeds[at.clone()];
            for i in 0..FIELDS {
                own[i] = if is_put { 0.0 } else { (new[i] - then[i]) / dt_s };
            }
            poses[e] = pose;
            let (new, old) = (seen(&into, own), seen(&into, &last.speeds[at.clone()]));
            for i in 0..FIELDS {
                even[at.start + i] = new[i];
                jumps[at.start + i] = if is_put { 0.0 } else { new[i] - old[i] };
            }
        }
        Carried { even, jumps, poses, speeds }
    }

    /// The motion after a leg that led z and ż from one phase to another, with the force on what is held.
    pub(super) fn ended(
        &self,
        system: &System,
        leg: &Leg<'_>,
        carried: Carried,
        [from, to]: [&Phase; 2],
        centrifugal: DVector<f64>,
    ) -> Motion {
        let [out, _] = leg.matrices();
        let (fields, modes) = (self.tables.fields(), self.tables.modes());
        let Carried { jumps, mut poses, mut speeds, .. } = carried;
        // The momentum that the leg has brought, its first impulse included.
        let gained = jumps + &system.all_from_own * (&to.speed - &from.speed);
        let force = &self.tables.mass * gained / leg.dt_s + centrifugal;

        let mut slopes = vec![PoseSlope::default(); fields / FIELDS];
        for e in (0..poses.len()).filter(|e| !system.released[*e]) {
            slopes[e] = PoseSlope::of_numbers(&seen(&out, &force.as_slice()[FIELDS * e..][..FIELDS]));
        }
        let count = to.place.len() - modes;
        let each = self.fields_of_released();
        let released = (0..poses.len()).filter(|e| system.released[*e]);
        for (k, e) in released.enumerate() {
            let own = |of: &DVector<f64>| of.as_slice()[each * k..][..each].to_vec();
            let at = FIELDS * e..FIELDS * (e + 1);
            let (pose, speed) = self.moved_on(e, &poses[e], &out, &own(&to.place), &own(&to.speed));
            poses[e] = pose;
            speeds[at].copy_from_slice(&speed);
        }
        Motion {
            time_s: leg.last.time_s.map(|time_s| time_s + leg.dt_s),
            step_s: leg.dt_s,
            frame_s: leg.last.frame_s,
            poses,
            speeds,
            places: to.place.as_slice()[count..].to_vec(),
            rates: to.speed.as_slice()[count..].to_vec(),
            turn: Some(leg.axes),
            slopes,
            pressed: Vec::new(),
            stopped: 0,
        }
    }

    /// Coordinates of a released element.
    pub(super) fn fields_of_released(&self) -> usize {
        if self.is_linear { FIELDS } else { 6 }
    }

    /// ω of the frame, in its own axes, in the mean over the last step, rad/s.
    fn spin(&self, stride: &Stride<'_>) -> Vector3<f64> {
        let Stride { last, turn, .. } = *stride;
        match last.turn {
            Some(before) if last.step_s > 0.0 && !self.is_linear => {
                (before.inverse() * turn).scaled_axis() / last.step_s
            }
            _ => Vector3::zeros(),
        }
    }

    /// -∂V/∂z with these slopes ∂V/∂P of the elements at these poses.
    pub(super) fn load(
        &self,
        system: &System,
        slopes: &[PoseSlope],
        poses: &[ControlPose],
        into: &Matrix3<f64>,
    ) -> DVector<f64> {
        let mut all = DVector::zeros(self.tables.mass.nrows());
        for (e, slope) in slopes.iter().enumerate().filter(|(e, _)| system.released[*e]) {
            let mut force = *slope;
            if !self.is_linear {
                // The slope by a turn of the element as it stands, not as it rested.
                force.matrix = force.matrix * poses[e].matrix.transpose() * into.transpose();
            }
            let own = seen(into, &force.numbers());
            (0..FIELDS).for_each(|i| all[FIELDS * e + i] = -own[i]);
        }
        system.all_from_own.tr_mul(&all)
    }

    /// z, measured from the beginning of the step for released elements, and ż.
    pub(super) fn phase(&self, system: &System, at: &Motion, into: &Matrix3<f64>) -> Phase {
        let mut speed: Vec<f64> = Vec::with_capacity(system.mass.nrows());
        for e in (0..at.poses.len()).filter(|e| system.released[*e]) {
            let own = &at.speeds[FIELDS * e..][..FIELDS];
            if self.is_linear {
                speed.extend(own);
                continue;
            }
            let matrix = &at.poses[e].matrix;
            let back = matrix.try_inverse().unwrap_or_else(|| matrix.transpose());
            let spin = axial(&(Matrix3::from_row_slice(&own[3..]) * back)) * 0.5;
            speed.extend((into * Vector3::from_column_slice(&own[..3])).iter());
            speed.extend((into * spin).iter());
        }
        let mut place = vec![0.0; speed.len()];
        place.extend(&at.places);
        speed.extend(&at.rates);
        Phase { place: place.into(), speed: speed.into() }
    }

    /// Pose and velocity of a released element after it has moved by `shift` at the end of a step.
    fn moved_on(
        &self,
        e: usize,
        from: &ControlPose,
        out: &Matrix3<f64>,
        shift: &[f64],
        speed: &[f64],
    ) -> (ControlPose, [f64; FIELDS]) {
        let vector = |of: &[f64], at: usize| out * Vector3::from_column_slice(&of[at..at + 3]);
        if self.is_linear {
            let mut c = from.coefficients();
            c.iter_mut().zip(shift).for_each(|(c, shift)| *c += shift);
            let c = self.within_range(e, &c);
            let matrix = Matrix3::identity() + Matrix3::from_row_slice(&c[3..]);
            let pose = ControlPose { translation: Vector3::from_column_slice(&c[..3]), matrix };
            return (pose, std::array::from_fn(|i| speed[i]));
        }
        let matrix = Rotation3::from_scaled_axis(vector(shift, 3)).matrix() * from.matrix;
        let pose = ControlPose { translation: from.translation + vector(shift, 0), matrix };
        let (shifting, turning) = (vector(speed, 0), vector(speed, 3).cross_matrix() * matrix);
        let rate = PoseSlope { translation: shifting, matrix: turning };
        (pose, rate.numbers())
    }

    /// The coefficients without those of fields that vanish: the turn that a hand left in them would never come back.
    fn within_range(&self, e: usize, c: &[f64; FIELDS]) -> [f64; FIELDS] {
        let own = |i: usize| self.tables.mass[(FIELDS * e + i, FIELDS * e + i)];
        let largest = (3..FIELDS).map(own).fold(0.0, f64::max);
        std::array::from_fn(|i| if i < 3 || own(i) > 1e-20 * largest { c[i] } else { 0.0 })
    }
}
