//! One body with inertia, moved on by one step.
//!
//! In: the poses of a frame, which elements are held, and the body with the slopes of its energy. Out: amplitudes q of the modes, poses
//! of released elements, and the inertial force on what is held: the momentum that a step brings the body, over its length.
//!
//! Within a step the axes R stand still, so that Newton's law holds in them as it is: held elements move evenly from the last pose to
//! the new one, and the coordinates z of all that nothing prescribes (coefficients of released elements, q) follow
//!
//! ```text
//! M z̈ + D ż + K z = -∂V/∂z - K_zh ċ_h t - C [ω]²     ż jumps by -M⁻¹ M_zh Δċ_h where the step begins
//! ```
//!
//! with ∂V/∂z of the model where the step begins, loads and other effects included. Each mode of M and K is stepped by its closed
//! form. In `linear`, where V is quadratic, and where nothing is released, K is that of the body at rest, and one step goes through
//! the frame ([`held_step`](super::held_step)); in other models K is that of V, and many do ([`swing`](super::swing)). R turns from step
//! to step: velocities keep their directions, q turns along with the body, and C \[ω\]² is what that leaves of the centrifugal force.
//! Left out is what is of second order in the displacements: centrifugal and Coriolis force of q itself, which stiffen and split modes of
//! a body that spins about as fast as it swings (A. Shabana, Dynamics of Multibody Systems, Cambridge 2013, section 5.5).
//!
//! A released element moves by all its fields in `linear`, as the theory has it, and is rigid in other models.

use super::coupled::Damping;
#[cfg(test)]
use super::flying::Twist;
use super::forces::Forces;
use super::system::System;
use super::tables::{Tables, seen};
use crate::deform::{Contribution, ControlPose, Deformer, PoseCurvature, PoseSlope};
use crate::green::FIELDS;
use nalgebra::{SVector, UnitQuaternion};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
use std::ops::Range;

/// All that lasts from one step to the next. Velocities are those of the poses, in the body's axes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Time of the last step, s; `None` before the first.
    pub(super) time_s: Option<f64>,
    /// Length of the last step, s; 0 before the first.
    pub(super) step_s: f64,
    pub(super) poses: Vec<ControlPose>,
    /// Ṫ and Ṁ of each element, row by row.
    pub(super) speeds: Vec<f64>,
    /// q and q̇.
    pub(super) places: Vec<f64>,
    pub(super) rates: Vec<f64>,
    /// R of the last step.
    #[serde(with = "crate::field::numbers::option")]
    pub(super) turn: Option<UnitQuaternion<f64>>,
    /// The inertial part of the slope of each element.
    pub(super) slopes: Vec<PoseSlope>,
}

/// The beginning of a step.
pub struct Now<'a> {
    pub time_s: f64,
    pub poses: &'a [ControlPose],
    /// Whether the pose of each element is prescribed.
    pub held: &'a [bool],
    /// The body as it was in the last frame, at the poses of the last step.
    pub deformer: &'a Deformer,
}

impl Now<'_> {
    /// R: body_from_frame, the axes of the model's displacements.
    pub fn turn(&self) -> UnitQuaternion<f64> {
        self.deformer.state.body_from_surface().rotation
    }
}

/// A body that has inertia.
pub struct Moving {
    pub tables: Tables,
    pub(super) damping: Damping,
    /// Whether released elements move by all fields, in axes that never turn.
    pub(super) is_linear: bool,
    pub motion: Motion,
    /// Forces of a body whose elements may swing in a model whose frame turns.
    forces: Option<Forces>,
    /// The modes for the elements that were released last.
    system: Option<System>,
    /// Poses to which the last step brought elements that nothing holds.
    pub moved: Vec<(usize, ControlPose)>,
    /// Whether each element was held in the last step.
    held: Vec<bool>,
}

impl Moving {
    /// A body at rest, of which elements are released or not. The error says why its model cannot be made once more.
    pub fn new(
        tables: Tables,
        damping: Damping,
        deformer: &Deformer,
        has_released: bool,
    ) -> Result<Moving, String> {
        let is_linear = deformer.entry.is_linear();
        let swings = has_released && !is_linear && deformer.controls.len() > 1;
        Ok(Moving {
            tables,
            damping,
            is_linear,
            motion: Motion::default(),
            forces: if swings { Some(Forces::new(deformer)?) } else { None },
            system: None,
            moved: Vec::new(),
            held: Vec::new(),
        })
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
            .map(|e| !now.held[e] && now.deformer.slopes().is_some() && now.poses[e] == self.motion.poses[e])
            .collect();
        let system = match self.system.take() {
            Some(system) if system.released == released => system,
            _ => System::new(&self.tables, released, self.is_linear, self.damping),
        };
        let mut forces = self.forces.take();
        let after = match (&system.whole, &mut forces) {
            (Some(whole), _) => self.flown(&system, whole, now, dt_s),
            (None, Some(forces)) if system.released.contains(&true) => self.swung(forces, &system, now, dt_s),
            _ => self.advanced(&system, now, dt_s),
        };
        (self.system, self.forces) = (Some(system), forces);
        if after.is_finite() {
            self.motion = Motion { time_s: Some(now.time_s), ..after };
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

    /// The velocity as a whole of a body that nothing holds, in the body's axes.
    #[cfg(test)]
    pub fn twist(&self, turn: &UnitQuaternion<f64>) -> Option<Twist> {
        let (system, turn) = (self.system.as_ref()?, turn.to_rotation_matrix());
        let phase = self.phase(system, &self.motion, &turn.matrix().transpose());
        let (Twist { velocity, spin }, _) = system.whole.as_ref()?.split(&phase.speed);
        Some(Twist { velocity: turn * velocity, spin: turn * spin })
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

    pub(super) fn is_finite(&self) -> bool {
        let slopes = self.slopes.iter().flat_map(|slope| slope.numbers());
        let numbers = self.speeds.iter().chain(&self.places).chain(&self.rates).copied();
        self.poses.iter().all(ControlPose::is_finite) && numbers.chain(slopes).all(f64::is_finite)
    }
}
