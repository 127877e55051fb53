//! The coordinates of a body that nothing holds, split into its motion as a whole and what deforms it.
//!
//! In: the mass matrix M of the coordinates z = (shift and turn of each element, q), and where the elements rest. Out: with the rates r
//! of z in the six rigid motions about the centre of mass, w = (rᵀMr)⁻¹ rᵀM ż and ż - r w; of forces rᵀf and f - M r (rᵀMr)⁻¹ rᵀf,
//! which deforms the body and moves its centre no more.

use super::coupled::{Phase, StepLoads};
use super::flying::{Inertia, Twist};
use super::held_step::difference;
use super::moving::{Motion, Moving, Now};
use super::system::System;
use super::tables::{Tables, squared};
use crate::deform::{ControlPose, PoseSlope};
use nalgebra::{DMatrix, DVector, DVectorView, Rotation3, Vector3};

#[derive(Clone, Debug, PartialEq)]
pub struct FreeBody {
    pub inertia: Inertia,
    /// r.
    rigid: DMatrix<f64>,
    /// (rᵀMr)⁻¹ rᵀM.
    twist: DMatrix<f64>,
}

impl FreeBody {
    /// `mass` is M of z; `None` of a body without mass.
    pub fn new(tables: &Tables, mass: &DMatrix<f64>) -> Option<FreeBody> {
        let inertia = Inertia::of_whole(&tables.whole)?;
        let mut rigid = DMatrix::zeros(mass.nrows(), 6);
        for (e, origin) in tables.origins.iter().enumerate() {
            let arm = origin - inertia.centre;
            for axis in 0..3 {
                let unit = Vector3::ith(axis, 1.0);
                rigid[(6 * e + axis, axis)] = 1.0;
                rigid[(6 * e + 3 + axis, 3 + axis)] = 1.0;
                rigid.view_mut((6 * e, 3 + axis), (3, 1)).copy_from(&unit.cross(&arm));
            }
        }
        let by_mass = rigid.tr_mul(mass);
        let inverse = (&by_mass * &rigid).try_inverse()?;
        Some(FreeBody { inertia, twist: inverse * by_mass, rigid })
    }

    /// The velocity as a whole, and the rest of ż.
    pub fn split(&self, rates: &DVector<f64>) -> (Twist, DVector<f64>) {
        let whole = &self.twist * rates;
        let rest = rates - &self.rigid * &whole;
        (Twist { velocity: whole.fixed_rows::<3>(0).into(), spin: whole.fixed_rows::<3>(3).into() }, rest)
    }

    /// Force and torque about the centre of mass, and the rest of f.
    pub fn split_force(&self, force: &DVector<f64>) -> ([Vector3<f64>; 2], DVector<f64>) {
        let whole = self.rigid.tr_mul(force);
        let rest = force - self.twist.tr_mul(&whole);
        ([whole.fixed_rows::<3>(0).into(), whole.fixed_rows::<3>(3).into()], rest)
    }
}

impl Moving {
    /// The step of a body that nothing holds: as a whole by [`Inertia::flown`], about that motion by its
    /// modes.
    pub(super) fn flown(&self, system: &System, whole: &FreeBody, now: &Now<'_>, dt_s: f64) -> Motion {
        let last = &self.motion;
        let turn = now.turn().to_rotation_matrix();
        let (out, into) = (turn.matrix(), turn.matrix().transpose());
        let Phase { place, speed } = self.phase(system, last, &into);
        let (twist, speed) = whole.split(&speed);
        let slopes = now.deformer.slopes().map(|slopes| difference(slopes, &last.slopes)).unwrap_or_default();
        let ([force, torque], load) = whole.split_force(&self.load(system, &slopes, &last.poses, &into));
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
            turn: Some(now.turn()),
        }
    }
}
