//! The step of a body that nothing holds.
//!
//! In: a motion and the forces on the body. Out: the motion at the end of the frame: as a whole by [`RigidInertia::flown`], about that motion
//! by its modes.

use super::coupled::{Phase, StepLoads};
use super::free_body::FreeBody;
use super::moving::{Motion, Moving, Stride, Strode};
use super::system::System;
use super::tables::squared;
use crate::deform::{ControlPose, PoseSlope};
#[cfg(doc)]
use crate::world::flight::RigidInertia;
use crate::world::vibration::VibrationStep;
use nalgebra::{DVector, DVectorView, Rotation3, Vector3};

impl Moving {
    /// The whole step at once.
    pub(super) fn flown(&self, system: &System, whole: &FreeBody, stride: &Stride<'_>) -> Strode {
        let Stride { last, dt_s, .. } = *stride;
        let turn = stride.turn.to_rotation_matrix();
        let (out, into) = (turn.matrix(), turn.matrix().transpose());
        let Phase { place, speed } = self.phase(system, last, &into);
        let (twist, speed) = whole.split(&speed);
        let ([force, mut torque], load) = whole.split_force(&self.stride_load(system, stride, &into));
        if stride.is_weight_alone {
            // The weight acts where the centre of mass is. The model has it there where the weight would bring it if the body were held.
            let ([_, of_sag], _) = whole.split_force(&self.load(system, stride.acting, &last.poses, &into));
            torque -= of_sag;
        }
        let centrifugal = &system.centrifugal * DVectorView::from_slice(&squared(&twist.spin), 9);
        let (_, outward) = whole.split_force(&system.all_from_own.tr_mul(&centrifugal));
        let loads = StepLoads { load: load - &outward, ..StepLoads::none(outward.len()) };
        let modes = system.coupled.begun(&Phase { place, speed }, &loads, dt_s);
        let to = system.coupled.ended(&modes, dt_s);
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
        let motion = Motion {
            time_s: last.time_s.map(|time_s| time_s + dt_s),
            step_s: dt_s,
            frame_s: last.frame_s,
            slopes: vec![PoseSlope::default(); poses.len()],
            poses,
            speeds,
            places: to.place.as_slice()[count..].to_vec(),
            rates: to.speed.as_slice()[count..].to_vec(),
            turn: Some(stride.turn),
            pressed: self.pressed_modes(stride),
            stopped: 0,
        };
        Strode { motion, vibration: VibrationStep { dt_s, modes } }
    }
}
