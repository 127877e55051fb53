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
use super::forces::{Forces, difference};
use super::system::System;
use super::tables::{Tables, seen};
use crate::deform::{Contribution, ControlPose, Deformer, PoseCurvature, PoseSlope};
use crate::green::FIELDS;
#[cfg(test)]
use crate::world::flight::Twist;
use crate::world::vibration::VibrationStep;
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
    /// Length of the last step, and of the last frame, s; 0 before the first.
    pub(super) step_s: f64,
    pub(super) frame_s: f64,
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
    /// Φᵀf of the forces that press the body at the end of the step, N/√kg; nothing where none does. The columns of these forces contain
    /// what they move the modes by at rest.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) pressed: Vec<f64>,
    /// Frames in a row in which released elements stopped although forces would move them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub(super) stopped: u32,
}

fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// A step whose axes R stand still.
pub struct Stride<'a> {
    pub last: &'a Motion,
    /// Poses at its end, and whether each is prescribed.
    pub poses: &'a [ControlPose],
    pub held: &'a [bool],
    /// R where it begins.
    pub turn: UnitQuaternion<f64>,
    /// ∂V/∂P where it begins, of all but inertia and pressing forces.
    pub acting: &'a [PoseSlope],
    /// Whether that is of the body's weight and of what it does to itself.
    pub is_weight_alone: bool,
    pub pressed: &'a Pressed,
    pub dt_s: f64,
}

/// A motion at the end of a stride, and the modes in it.
pub struct Strode {
    pub motion: Motion,
    pub vibration: VibrationStep,
}

/// Pressing forces on all coordinates, in the axes R, in the mean over a step and at its end; empty without.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pressed {
    pub mean: Vec<f64>,
    pub end: Vec<f64>,
}

/// A frame that the body goes through in steps ([`course`](super::course)).
pub struct Course {
    /// Time of its end, and its length, s.
    pub(super) time_s: f64,
    pub(super) dt_s: f64,
    pub(super) start: Vec<ControlPose>,
    pub(super) poses: Vec<ControlPose>,
    pub(super) acting: Vec<PoseSlope>,
    pub(super) is_weight_alone: bool,
    /// Share of the frame that is behind.
    pub(super) share: f64,
    /// The step that was tried last, and the share at its end.
    pub(super) tried: Option<(f64, Strode)>,
    /// Inertial part of the slopes, in the mean over the frame.
    pub(super) slopes: Vec<PoseSlope>,
}

/// The beginning of a frame.
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
    pub(super) forces: Option<Forces>,
    /// The modes for the elements that were released last.
    pub(super) system: Option<System>,
    /// The frame that it goes through in steps.
    pub(super) course: Option<Course>,
    /// Poses to which the last step brought elements that nothing holds.
    pub moved: Vec<(usize, ControlPose)>,
    /// Whether each element was held in the last step.
    pub(super) held: Vec<bool>,
    /// Whether its vibration is kept.
    pub is_heard: bool,
    /// The modes in each step of the last frame, in those of `system`; empty unless they are kept.
    pub(super) vibration: Vec<VibrationStep>,
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
            course: None,
            moved: Vec::new(),
            held: Vec::new(),
            is_heard: false,
            vibration: Vec::new(),
        })
    }

    /// Goes on from a motion. The error says why it cannot.
    pub fn set_motion(&mut self, motion: Motion) -> Result<(), String> {
        let (modes, elements) = (self.tables.modes(), self.tables.fields() / FIELDS);
        let Motion { poses, speeds, places, rates, slopes, pressed, .. } = &motion;
        let lists = [poses.len() * FIELDS, slopes.len() * FIELDS, speeds.len()];
        let is_begun = motion.time_s.is_some();
        let of_modes = [places.len(), rates.len(), pressed.len().max(modes)];
        if is_begun && (lists != [elements * FIELDS; 3] || of_modes != [modes; 3]) {
            let found = format!("{} control elements and {} modes", poses.len(), places.len());
            return Err(format!(
                "its motion is that of another body, with {found}; this one has {elements} and {modes}"
            ));
        }
        (self.motion, self.system, self.course) = (motion, None, None);
        self.moved.clear();
        self.vibration.clear();
        Ok(())
    }

    /// Moves the body on to the poses of this frame. A time that does not go on moves nothing and excites nothing.
    pub fn step(&mut self, now: &Now<'_>) {
        let Some(dt_s) = self.time_to(now.time_s, now.poses, now.held) else { return };
        let slopes = now.deformer.slopes();
        let system = self.system_of(now.poses, slopes.is_some());
        let mut forces = self.forces.take();
        let after = match &mut forces {
            Some(forces) if system.whole.is_none() && system.released.contains(&true) => {
                self.swung(forces, &system, now, dt_s)
            }
            _ => {
                // Without the inertia of elements that were held until now.
                let acting = slopes.map(|slopes| difference(slopes, &self.motion.slopes)).unwrap_or_default();
                let strode = self.strode(
                    &system,
                    &Stride {
                        last: &self.motion,
                        poses: now.poses,
                        held: now.held,
                        turn: now.turn(),
                        acting: &acting,
                        is_weight_alone: now.deformer.bears_weight_alone(),
                        pressed: &Pressed::default(),
                        dt_s,
                    },
                );
                if self.is_heard {
                    self.vibration.push(strode.vibration);
                }
                strode.motion
            }
        };
        (self.system, self.forces) = (Some(system), forces);
        self.take(Motion { frame_s: dt_s, ..after }, now.time_s, now.poses);
    }

    /// The system in which elements move that are not held and stand where the last step left them, if there are forces on them.
    pub(super) fn system_of(&mut self, poses: &[ControlPose], has_forces: bool) -> System {
        let is_released = |e: usize| !self.held[e] && has_forces && poses[e] == self.motion.poses[e];
        let released: Vec<bool> = (0..poses.len()).map(is_released).collect();
        match self.system.take() {
            Some(system) if system.released == released => system,
            _ => System::new(&self.tables, released, self.is_linear, self.damping),
        }
    }

    /// The motion after a step of a body of which nothing swings in a model that turns.
    pub(super) fn strode(&self, system: &System, stride: &Stride<'_>) -> Strode {
        match &system.whole {
            Some(whole) => self.flown(system, whole, stride),
            None => self.advanced(system, stride),
        }
    }

    /// Goes on from the motion at the end of a frame.
    pub(super) fn take(&mut self, after: Motion, time_s: f64, poses: &[ControlPose]) {
        if after.is_finite() {
            self.motion = Motion { time_s: Some(time_s), ..after };
        } else {
            // Poses that no number can follow: it stands where it is, without a memory of them.
            self.vibration.clear();
            self.begin(time_s, poses);
        }
        let released = self.system.iter().flat_map(|system| system.released.iter().enumerate());
        let moved = released.filter(|(_, released)| **released).map(|(e, _)| (e, self.motion.poses[e]));
        self.moved = moved.collect();
    }

    /// Time from the last step to this frame, s; `None` where it does not go on, and nothing moves by itself.
    pub(super) fn time_to(&mut self, time_s: f64, poses: &[ControlPose], held: &[bool]) -> Option<f64> {
        self.moved.clear();
        self.vibration.clear();
        self.held.clear();
        self.held.extend(held);
        let Some(last_s) = self.motion.time_s else {
            self.begin(time_s, poses);
            return None;
        };
        let dt_s = time_s - last_s;
        if dt_s > 0.0 && dt_s.is_finite() {
            return Some(dt_s);
        }
        // The script began anew, or the clock stands: what was put elsewhere meanwhile rests there.
        self.motion.time_s = Some(if time_s.is_finite() { time_s } else { last_s });
        self.motion.poses.iter_mut().zip(poses).for_each(|(last, pose)| {
            if pose.is_finite() {
                *last = *pose;
            }
        });
        None
    }

    /// Rests at these poses.
    fn begin(&mut self, time_s: f64, poses: &[ControlPose]) {
        let (elements, modes) = (poses.len(), self.tables.modes());
        let place = |(e, pose): (usize, &ControlPose)| match self.motion.poses.get(e) {
            Some(last) if !pose.is_finite() => *last,
            _ => *pose,
        };
        self.motion = Motion {
            time_s: Some(time_s).filter(|time| time.is_finite()),
            poses: poses.iter().enumerate().map(place).collect(),
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
        to.coefficients[columns].iter_mut().zip(self.amplitudes(motion)).for_each(|(c, q)| *c += q);
        to.energy += self.energy();
        for e in (0..motion.slopes.len()).filter(|e| self.held[*e]) {
            to.slopes[e].translation += motion.slopes[e].translation;
            to.slopes[e].matrix += motion.slopes[e].matrix;
            to.curvatures[e] += self.curvature(e, turn);
        }
    }

    /// q, less what pressing forces move the modes by at rest: their columns contain that.
    pub(super) fn amplitudes(&self, motion: &Motion) -> Vec<f64> {
        let mut amplitudes = motion.places.clone();
        let pressed = motion.pressed.iter().zip(&self.tables.squares);
        amplitudes.iter_mut().zip(pressed).for_each(|(q, (force, square))| *q -= force / square);
        amplitudes
    }

    /// Elastic energy of the modes, J.
    fn energy(&self) -> f64 {
        let amplitudes = self.amplitudes(&self.motion);
        amplitudes.iter().zip(&self.tables.squares).map(|(q, square)| 0.5 * square * q * q).sum()
    }

    /// The stiffness with which modes resist a motion of a held element, in the mean over a frame as long as the last: q takes up
    /// all of a sudden motion at first, and swings back. Modes of more than half a period in a frame resist nothing in the mean.
    fn curvature(&self, e: usize, turn: &UnitQuaternion<f64>) -> PoseCurvature {
        let (mut sum, fields) = (PoseCurvature::zeros(), self.tables.fields());
        let out = turn.to_rotation_matrix();
        for (k, square) in self.tables.squares.iter().enumerate() {
            let angle = square.sqrt() * self.motion.frame_s;
            if angle >= PI || self.motion.frame_s == 0.0 {
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
    pub fn poses(&self) -> &[ControlPose] {
        &self.poses
    }

    /// ċ, then q̇.
    #[cfg(test)]
    pub fn all_speeds(&self) -> Vec<f64> {
        self.speeds.iter().chain(&self.rates).copied().collect()
    }

    pub(super) fn is_finite(&self) -> bool {
        let slopes = self.slopes.iter().flat_map(|slope| slope.numbers());
        let numbers = self.speeds.iter().chain(&self.places).chain(&self.rates).chain(&self.pressed).copied();
        self.poses.iter().all(ControlPose::is_finite) && numbers.chain(slopes).all(f64::is_finite)
    }
}
