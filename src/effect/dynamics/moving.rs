//! One body with inertia, moved on by one step.
//!
//! In: the poses of a frame, which elements are held, the frame in which the model's displacements stand, and the slopes of the
//! body's energy. Out: amplitudes q of the modes, poses of released elements, and the inertial force on what is held.
//!
//! The force on what is held is the momentum that a step brings the body, over its length.
//!
//! Within a step the frame's axes R stand still, so that Newton's law holds in them as it is: held elements move evenly from the
//! last pose to the new one, and the coordinates z of all that nothing prescribes (coefficients of released elements, q) follow
//!
//! ```text
//! M z̈ + D ż + K z = -∂V/∂z - K_zh ċ_h t - C [ω]²     ż jumps by -M⁻¹ M_zh Δċ_h where the step begins
//! ```
//!
//! with ∂V/∂z of the model where the step begins, loads and other effects included. Each mode of M and K is stepped by its closed
//! form, so that the step is exact and stable where V is quadratic. R turns from step to step: velocities keep their
//! directions, q turns along with the body, and C \[ω\]² is what that leaves of the centrifugal force. Left out is what is of second
//! order in the displacements: centrifugal and Coriolis force of q itself, which stiffen and split modes of a body that spins about
//! as fast as it swings (A. Shabana, Dynamics of Multibody Systems, Cambridge 2013, section 5.5).
//!
//! In a model whose frame turns, a released element is rigid, and with more than one element the scene must not release it
//! ([`section`](super::section)): far from rest, K is not the curvature of V, and the step is not stable; in `linear` it moves by all its fields, as the theory has it.

use super::coupled::{Damping, Phase, StepLoads};
#[cfg(test)]
use super::flying::Twist;
use super::free_body::FreeBody;
use super::system::System;
use super::tables::{Tables, squared};
use crate::deform::{Contribution, ControlPose, PoseCurvature, PoseSlope, axial};
use crate::green::FIELDS;
use nalgebra::{DVector, DVectorView, Matrix3, Rotation3, SVector, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::ops::Range;

/// All that lasts from one step to the next. Velocities are those of the poses, in the body's axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Time of the last step, s; `None` before the first.
    time_s: Option<f64>,
    /// Length of the last step, s; 0 before the first.
    step_s: f64,
    poses: Vec<ControlPose>,
    /// Ṫ and Ṁ of each element, row by row.
    speeds: Vec<f64>,
    /// q and q̇.
    places: Vec<f64>,
    rates: Vec<f64>,
    /// R of the last step.
    #[serde(with = "crate::field::numbers::option")]
    turn: Option<UnitQuaternion<f64>>,
    /// The inertial part of the slope of each element.
    slopes: Vec<PoseSlope>,
}

/// What a step starts from.
pub struct Now<'a> {
    pub time_s: f64,
    pub poses: &'a [ControlPose],
    /// Whether the pose of each element is prescribed.
    pub held: &'a [bool],
    /// R: body_from_frame.
    pub turn: UnitQuaternion<f64>,
    /// ∂V/∂P at the poses of the last step, with what effects added to it; `None` where the model has none.
    pub slopes: Option<&'a [PoseSlope]>,
}

/// A body that has inertia.
pub struct Moving {
    pub tables: Tables,
    damping: Damping,
    /// Whether released elements move by all fields, in axes that never turn.
    is_linear: bool,
    pub motion: Motion,
    /// The modes for the elements that were released last.
    system: Option<System>,
    /// Poses to which the last step brought elements that nothing holds.
    pub moved: Vec<(usize, ControlPose)>,
    /// Whether each element was held in the last step.
    held: Vec<bool>,
}

/// Twelve numbers of an element seen in other axes: T and the columns of M turned by `by`.
fn seen(by: &Matrix3<f64>, numbers: &[f64]) -> [f64; FIELDS] {
    let turned = by * Vector3::from_column_slice(&numbers[..3]);
    let matrix = by * Matrix3::from_row_slice(&numbers[3..FIELDS]);
    std::array::from_fn(|i| if i < 3 { turned[i] } else { matrix[(i / 3 - 1, i % 3)] })
}

impl Moving {
    pub fn new(tables: Tables, damping: Damping, is_linear: bool) -> Moving {
        let motion = Motion::default();
        Moving { tables, damping, is_linear, motion, system: None, moved: Vec::new(), held: Vec::new() }
    }

    /// Goes on from a motion. The error says why it cannot.
    pub fn set_motion(&mut self, motion: Motion) -> Result<(), String> {
        let (modes, elements) = (self.tables.modes(), self.tables.fields() / FIELDS);
        let Motion { poses, speeds, places, rates, slopes, .. } = &motion;
        let lists = [poses.len() * FIELDS, slopes.len() * FIELDS, speeds.len()];
        let is_begun = motion.time_s.is_some();
        if is_begun && (lists != [elements * FIELDS; 3] || [places.len(), rates.len()] != [modes; 2]) {
            let found = format!("{} control elements and {} modes", poses.len(), places.len());
            return Err(format!(
                "its motion is that of another body, with {found}; this one has {elements} and {modes}"
            ));
        }
        (self.motion, self.system) = (motion, None);
        self.moved.clear();
        Ok(())
    }

    /// Moves the body on to the poses of this frame. A time that does not go on moves nothing and excites nothing.
    pub fn step(&mut self, now: &Now<'_>) {
        self.moved.clear();
        self.held.clear();
        self.held.extend(now.held);
        let Some(last_s) = self.motion.time_s else {
            self.begin(now);
            return;
        };
        let dt_s = now.time_s - last_s;
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            // The script began anew, or the clock stands: what was put elsewhere meanwhile rests there.
            self.motion.time_s = Some(if now.time_s.is_finite() { now.time_s } else { last_s });
            self.motion.poses.iter_mut().zip(now.poses).for_each(|(last, pose)| {
                if pose.is_finite() {
                    *last = *pose;
                }
            });
            return;
        }
        let released: Vec<bool> = (0..now.poses.len())
            .map(|e| !now.held[e] && now.slopes.is_some() && now.poses[e] == self.motion.poses[e])
            .collect();
        let system = match self.system.take() {
            Some(system) if system.released == released => system,
            _ => System::new(&self.tables, released, self.is_linear, self.damping),
        };
        let after = match &system.whole {
            Some(whole) => self.flown(&system, whole, now, dt_s),
            None => self.advanced(&system, now, dt_s),
        };
        self.system = Some(system);
        if after.is_finite() {
            self.motion = after;
        } else {
            // Poses that no number can follow: it stands where it is, without a memory of them.
            self.begin(now);
        }
        let released = self.system.iter().flat_map(|system| system.released.iter().enumerate());
        let moved = released.filter(|(_, released)| **released).map(|(e, _)| (e, self.motion.poses[e]));
        self.moved = moved.collect();
    }

    /// Rests at these poses.
    fn begin(&mut self, now: &Now<'_>) {
        let (elements, modes) = (now.poses.len(), self.tables.modes());
        let place = |(e, pose): (usize, &ControlPose)| match self.motion.poses.get(e) {
            Some(last) if !pose.is_finite() => *last,
            _ => *pose,
        };
        self.motion = Motion {
            time_s: Some(now.time_s).filter(|time| time.is_finite()),
            poses: now.poses.iter().enumerate().map(place).collect(),
            speeds: vec![0.0; FIELDS * elements],
            places: vec![0.0; modes],
            rates: vec![0.0; modes],
            slopes: vec![PoseSlope::default(); elements],
            ..Motion::default()
        };
    }

    fn advanced(&self, system: &System, now: &Now<'_>, dt_s: f64) -> Motion {
        let last = &self.motion;
        let turn = now.turn.to_rotation_matrix();
        let (out, into) = (turn.matrix(), turn.matrix().transpose());
        let (fields, modes) = (self.tables.fields(), self.tables.modes());
        // Of held elements, in the axes of the frame.
        let (mut even, mut jumps) = (DVector::zeros(fields + modes), DVector::zeros(fields + modes));
        let mut poses = last.poses.clone();
        let mut speeds = last.speeds.clone();
        for e in (0..poses.len()).filter(|e| !system.released[*e]) {
            let at = FIELDS * e..FIELDS * (e + 1);
            // What a released element was put to begins at rest; what is no number is not followed.
            let is_put = !now.held[e] && now.poses[e] != last.poses[e];
            let pose = if now.poses[e].is_finite() { now.poses[e] } else { last.poses[e] };
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
        let spin = self.spin(now);
        let centrifugal = &system.centrifugal * DVectorView::from_slice(&squared(&spin), 9);
        let loads = StepLoads {
            impulse: -(&system.mass * &jumps),
            load: self.load(system, now, &into) - system.all_from_own.tr_mul(&centrifugal),
            carried: self.carried_along(system, &even, &spin, dt_s),
            slope: -(&system.stiffness * &even),
        };
        let from = self.phase(system, &into);
        let to = system.coupled.advanced(&from, &loads, dt_s);
        // The momentum that the step has brought, its first impulse included.
        let gained = jumps + &system.all_from_own * (&to.speed - &from.speed);
        let force = &self.tables.mass * gained / dt_s + centrifugal;

        let mut slopes = vec![PoseSlope::default(); poses.len()];
        for e in (0..poses.len()).filter(|e| !system.released[*e]) {
            slopes[e] = PoseSlope::of_numbers(&seen(out, &force.as_slice()[FIELDS * e..][..FIELDS]));
        }
        let count = to.place.len() - modes;
        let each = if self.is_linear { FIELDS } else { 6 };
        let released = (0..poses.len()).filter(|e| system.released[*e]);
        for (k, e) in released.enumerate() {
            let own = |of: &DVector<f64>| of.as_slice()[each * k..][..each].to_vec();
            let at = FIELDS * e..FIELDS * (e + 1);
            let (pose, speed) = self.moved_on(e, &poses[e], out, &own(&to.place), &own(&to.speed));
            poses[e] = pose;
            speeds[at].copy_from_slice(&speed);
        }
        Motion {
            time_s: Some(now.time_s),
            step_s: dt_s,
            poses,
            speeds,
            places: to.place.as_slice()[count..].to_vec(),
            rates: to.speed.as_slice()[count..].to_vec(),
            turn: Some(now.turn),
            slopes,
        }
    }

    /// The velocity as a whole of a body that nothing holds, in the body's axes.
    #[cfg(test)]
    pub fn twist(&self, turn: &UnitQuaternion<f64>) -> Option<Twist> {
        let (system, turn) = (self.system.as_ref()?, turn.to_rotation_matrix());
        let phase = self.phase(system, &turn.matrix().transpose());
        let (Twist { velocity, spin }, _) = system.whole.as_ref()?.split(&phase.speed);
        Some(Twist { velocity: turn * velocity, spin: turn * spin })
    }

    /// The step of a body that nothing holds: as a whole by [`Inertia::flown`](super::flying::Inertia::flown), about that motion by its
    /// modes.
    fn flown(&self, system: &System, whole: &FreeBody, now: &Now<'_>, dt_s: f64) -> Motion {
        let last = &self.motion;
        let turn = now.turn.to_rotation_matrix();
        let (out, into) = (turn.matrix(), turn.matrix().transpose());
        let Phase { place, speed } = self.phase(system, &into);
        let (twist, speed) = whole.split(&speed);
        let ([force, torque], load) = whole.split_force(&self.load(system, now, &into));
        let centrifugal = &system.centrifugal * DVectorView::from_slice(&squared(&twist.spin), 9);
        let (_, outward) = whole.split_force(&system.all_from_own.tr_mul(&centrifugal));
        let loads = StepLoads { load: load - &outward, ..StepLoads::none(outward.len()) };
        let to = system.coupled.advanced(&Phase { place, speed }, &loads, dt_s);
        let flight = whole.inertia.flown(&twist, &force, &torque, dt_s);

        let turned = out * flight.turn.to_rotation_matrix().matrix() * into;
        let spin = out * flight.twist.spin;
        let places: Vec<Vector3<f64>> =
            self.tables.origins.iter().zip(&last.poses).map(|(o, pose)| o + pose.translation).collect();
        let apart = self.tables.origins.iter().zip(&places).map(|(o, place)| place - out * o);
        let centre = out * whole.inertia.centre + apart.sum::<Vector3<f64>>() / places.len() as f64;
        let moved = centre + out * flight.shift;
        let (mut poses, mut speeds) = (Vec::new(), Vec::new());
        for (e, pose) in last.poses.iter().enumerate() {
            let vector = |of: &DVector<f64>, at: usize| {
                out * Vector3::from_column_slice(&of.as_slice()[6 * e + at..][..3])
            };
            let place = moved + turned * (places[e] + vector(&to.place, 0) - centre);
            let matrix = turned * Rotation3::from_scaled_axis(vector(&to.place, 3)).matrix() * pose.matrix;
            let spin_of_element = spin + turned * vector(&to.speed, 3);
            let velocity =
                out * flight.twist.velocity + spin.cross(&(place - moved)) + turned * vector(&to.speed, 0);
            let rate = PoseSlope { translation: velocity, matrix: spin_of_element.cross_matrix() * matrix };
            poses.push(ControlPose { translation: place - self.tables.origins[e], matrix });
            speeds.extend(rate.numbers());
        }
        let count = 6 * poses.len();
        Motion {
            time_s: Some(now.time_s),
            step_s: dt_s,
            slopes: vec![PoseSlope::default(); poses.len()],
            poses,
            speeds,
            places: to.place.as_slice()[count..].to_vec(),
            rates: to.speed.as_slice()[count..].to_vec(),
            turn: Some(now.turn),
        }
    }

    /// ω of the frame, in its own axes, in the mean over the last step, rad/s.
    fn spin(&self, now: &Now<'_>) -> Vector3<f64> {
        match self.motion.turn {
            Some(before) if self.motion.step_s > 0.0 && !self.is_linear => {
                (before.inverse() * now.turn).scaled_axis() / self.motion.step_s
            }
            _ => Vector3::zeros(),
        }
    }

    /// Speed with which held elements carry the released ones along in the middle of the step, and its rate where their way is bent.
    ///
    /// The chord of a held element is that of the middle; but its turn carries others along as it does at the beginning, for the axes
    /// stand still.
    fn carried_along(
        &self,
        system: &System,
        even: &DVector<f64>,
        spin: &Vector3<f64>,
        dt_s: f64,
    ) -> [DVector<f64>; 2] {
        let speed_of = |even: &DVector<f64>| system.coupled.static_speed(&-(&system.stiffness * even));
        let speed = speed_of(even);
        if self.is_linear {
            return [speed, DVector::zeros(system.mass.nrows())];
        }
        let bent = |speed: &DVector<f64>| {
            let mut rate = DVector::zeros(speed.len());
            for first in (0..speed.len() - self.tables.modes()).step_by(6) {
                let own = spin.cross(&Vector3::from_column_slice(&speed.as_slice()[first..first + 3]));
                rate.rows_mut(first, 3).copy_from(&own);
            }
            rate
        };
        let mut turns = even.clone();
        (0..self.tables.fields()).step_by(FIELDS).for_each(|first| turns.rows_mut(first, 3).fill(0.0));
        let by_turns = bent(&speed_of(&turns));
        let rate = bent(&speed);
        [speed + by_turns * (0.5 * dt_s), rate]
    }

    /// -∂V/∂z at the beginning of the step, without the inertia of elements that were held until then.
    fn load(&self, system: &System, now: &Now<'_>, into: &Matrix3<f64>) -> DVector<f64> {
        let mut all = DVector::zeros(self.tables.mass.nrows());
        for e in (0..now.poses.len()).filter(|e| system.released[*e]) {
            let Some(slope) = now.slopes.and_then(|slopes| slopes.get(e)) else { continue };
            let inertia = &self.motion.slopes[e];
            let mut force = PoseSlope {
                translation: slope.translation - inertia.translation,
                matrix: slope.matrix - inertia.matrix,
            };
            if !self.is_linear {
                // The slope by a turn of the element as it stands, not as it rested.
                force.matrix = force.matrix * self.motion.poses[e].matrix.transpose() * into.transpose();
            }
            let own = seen(into, &force.numbers());
            (0..FIELDS).for_each(|i| all[FIELDS * e + i] = -own[i]);
        }
        system.all_from_own.tr_mul(&all)
    }

    /// z, measured from the beginning of the step for released elements, and ż.
    fn phase(&self, system: &System, into: &Matrix3<f64>) -> Phase {
        let mut speed: Vec<f64> = Vec::with_capacity(system.mass.nrows());
        for e in (0..self.motion.poses.len()).filter(|e| system.released[*e]) {
            let own = &self.motion.speeds[FIELDS * e..][..FIELDS];
            if self.is_linear {
                speed.extend(own);
                continue;
            }
            let matrix = &self.motion.poses[e].matrix;
            let back = matrix.try_inverse().unwrap_or_else(|| matrix.transpose());
            let spin = axial(&(Matrix3::from_row_slice(&own[3..]) * back)) * 0.5;
            speed.extend((into * Vector3::from_column_slice(&own[..3])).iter());
            speed.extend((into * spin).iter());
        }
        let mut place = vec![0.0; speed.len()];
        place.extend(&self.motion.places);
        speed.extend(&self.motion.rates);
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

    /// Adds what the body's inertia does in this frame: q in `columns`, the energy of the modes, and of what is held force and
    /// stiffness. `turn` is that of the step.
    pub fn add(&self, columns: Range<usize>, turn: &UnitQuaternion<f64>, to: &mut Contribution) {
        let motion = &self.motion;
        to.coefficients[columns].iter_mut().zip(&motion.places).for_each(|(c, q)| *c += q);
        to.energy += self.energy();
        for e in (0..motion.slopes.len()).filter(|e| self.held[*e]) {
            to.slopes[e].translation += motion.slopes[e].translation;
            to.slopes[e].matrix += motion.slopes[e].matrix;
            to.curvatures[e] += self.curvature(e, turn);
        }
    }

    /// Elastic energy of the modes, J.
    fn energy(&self) -> f64 {
        let pairs = self.motion.places.iter().zip(&self.tables.squares);
        pairs.map(|(q, square)| 0.5 * square * q * q).sum()
    }

    /// The stiffness with which modes resist a motion of a held element, in the mean over a step as long as the last: q takes up
    /// all of a sudden motion at first, and swings back. Modes of more than half a period in a step resist nothing in the mean.
    fn curvature(&self, e: usize, turn: &UnitQuaternion<f64>) -> PoseCurvature {
        let (mut sum, fields) = (PoseCurvature::zeros(), self.tables.fields());
        let out = turn.to_rotation_matrix();
        for (k, square) in self.tables.squares.iter().enumerate() {
            let angle = square.sqrt() * self.motion.step_s;
            if angle >= PI || self.motion.step_s == 0.0 {
                continue;
            }
            let own = self.tables.mass.column(fields + k).rows(FIELDS * e, FIELDS).into_owned();
            let coupling = SVector::<f64, FIELDS>::from(seen(out.matrix(), own.as_slice()));
            sum += coupling * coupling.transpose() * (square * angle.sin() / angle);
        }
        sum
    }
}

impl Motion {
    /// ċ, then q̇.
    #[cfg(test)]
    pub fn all_speeds(&self) -> Vec<f64> {
        self.speeds.iter().chain(&self.rates).copied().collect()
    }

    fn is_finite(&self) -> bool {
        let slopes = self.slopes.iter().flat_map(|slope| slope.numbers());
        let numbers = self.speeds.iter().chain(&self.places).chain(&self.rates).copied();
        self.poses.iter().all(ControlPose::is_finite) && numbers.chain(slopes).all(f64::is_finite)
    }
}
