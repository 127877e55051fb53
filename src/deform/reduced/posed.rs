//! A body's control elements in poses, for energies V(y, …) that the mean frame m sees: poses in, m and y out, and the slopes of
//! V on their way back to the poses.
//!
//! c are the coefficients of the affine fields of the poses seen from m ([`MeanFrame`]), y = Lᵀ c ([`Lift`]). A pose enters V
//! through c, and through m, which moves with all of them; both parts of the derivative are taken.

use super::super::frames::{ControlFrame, FrameSlope, PoseSlope, axial};
use super::super::mean_frame::MeanFrame;
use super::super::memory::{ModelMemory, Unknowns};
use super::super::model::ControlRest;
use super::super::pose::ControlPose;
use super::super::se3::{halves, inverse_left_jacobian, inverse_right_jacobian};
use crate::field::numbers::Numbers;
use crate::green::{FIELDS, Lift};
use nalgebra::{DVector, Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

pub struct Posed {
    controls: Vec<ControlRest>,
    /// ō.
    centre: Vector3<f64>,
    lift: Lift,
    mean: MeanFrame,
    frames: Vec<ControlFrame>,
    /// The rotation of every element in the last poses that had a mean frame.
    turns: Vec<UnitQuaternion<f64>>,
    /// c, and ∂V/∂c.
    coefficients: DVector<f64>,
    forces: DVector<f64>,
    coordinates: DVector<f64>,
    by_coordinates: DVector<f64>,
}

impl Posed {
    pub fn new(controls: &[ControlRest]) -> Posed {
        let elements = controls.len();
        let lift = Lift::of(elements);
        let sum: Vector3<f64> = controls.iter().map(|control| control.origin).sum();
        let (c, y) = (DVector::zeros(FIELDS * elements), DVector::zeros(lift.len()));
        Posed {
            controls: controls.to_vec(),
            centre: sum / elements.max(1) as f64,
            lift,
            mean: MeanFrame::new(elements),
            frames: Vec::with_capacity(elements),
            turns: vec![UnitQuaternion::identity(); elements],
            forces: c.clone(),
            coefficients: c,
            by_coordinates: y.clone(),
            coordinates: y,
        }
    }

    /// Finds m, c and y of the poses; `None` where there are none, and those of before are kept.
    pub fn take(&mut self, poses: &[ControlPose]) -> Option<()> {
        self.frames.clear();
        for (e, (control, pose)) in self.controls.iter().zip(poses).enumerate() {
            self.frames.push(ControlFrame::of(&control.origin, pose, self.turns.get(e))?);
        }
        self.mean.find(&self.frames)?;
        self.turns.clear();
        self.turns.extend(self.frames.iter().map(|frame| frame.turn));
        let mean_from_body = self.mean.body_from_mean.inverse();
        let rotation = mean_from_body.rotation.to_rotation_matrix();
        for (e, (control, pose)) in self.controls.iter().zip(poses).enumerate() {
            let place = mean_from_body * Point3::from(control.origin + pose.translation);
            let seen = ControlPose {
                translation: place.coords - (control.origin - self.centre),
                matrix: rotation * pose.matrix,
            };
            self.coefficients.rows_mut(FIELDS * e, FIELDS).copy_from_slice(&seen.coefficients());
        }
        self.coordinates.gemv_tr(1.0, &self.lift.columns, &self.coefficients, 0.0);
        Some(())
    }

    pub fn elements(&self) -> usize {
        self.controls.len()
    }

    pub fn coordinates(&self) -> &[f64] {
        self.coordinates.as_slice()
    }

    /// ξ_e = log(m⁻¹ g_e) without that at rest.
    pub fn screw(&self, e: usize) -> Vector6<f64> {
        let arm = self.controls[e].origin - self.centre;
        self.mean.screws[e] - Vector6::new(arm.x, arm.y, arm.z, 0.0, 0.0, 0.0)
    }

    /// c.
    pub fn coefficients(&self) -> &[f64] {
        self.coefficients.as_slice()
    }

    /// The surface stands about the body's centre, m about ō.
    pub fn body_from_surface(&self) -> Isometry3<f64> {
        let mean = &self.mean.body_from_mean;
        let shift = mean.translation.vector - mean.rotation * self.centre;
        Isometry3::from_parts(Translation3::from(shift), mean.rotation)
    }

    pub fn frames(&self) -> &[ControlFrame] {
        &self.frames
    }

    /// m, whose origin rests at ō.
    pub fn mean(&self) -> &Isometry3<f64> {
        &self.mean.body_from_mean
    }

    /// ∂V by the poses that were taken, from that by each y and, where V depends on them too, by each ξ_e, and by a motion of m in its
    /// own axes with all of these held.
    pub fn pull_back(
        &mut self,
        poses: &[ControlPose],
        by_coordinate: &dyn Fn(usize) -> f64,
        (by_screw, by_mean): (Option<&[Vector6<f64>]>, Option<Vector6<f64>>),
        slopes: &mut [PoseSlope],
    ) -> Option<()> {
        for (k, slope) in self.by_coordinates.iter_mut().enumerate() {
            *slope = by_coordinate(k);
        }
        self.forces.gemv(1.0, &self.lift.columns, &self.by_coordinates, 0.0);
        let rotation = self.mean.body_from_mean.rotation.to_rotation_matrix();
        let mean_from_body = self.mean.body_from_mean.inverse();
        // ∂V by a motion of m, in its own axes.
        let mut common = by_mean.unwrap_or_default();
        let forces = &self.forces;
        let held = |e: usize| {
            let own = &forces.as_slice()[FIELDS * e..FIELDS * (e + 1)];
            (Vector3::new(own[0], own[1], own[2]), Matrix3::from_row_slice(&own[3..FIELDS]))
        };
        for (e, pose) in poses.iter().enumerate().take(self.frames.len()) {
            let (force, moment) = held(e);
            let seen = rotation.matrix().transpose() * pose.matrix;
            let place = mean_from_body * Point3::from(self.frames[e].place);
            let torque = place.coords.cross(&force) + axial(&(moment * seen.transpose()));
            common -= Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
        }
        for (screw, slope) in self.mean.screws.iter().zip(by_screw.unwrap_or_default()) {
            common -= inverse_left_jacobian(screw).transpose() * slope;
        }
        let share = self.mean.share(&common)?;
        for (e, (slope, frame)) in slopes.iter_mut().zip(&self.frames).enumerate() {
            let (own_force, own_moment) = held(e);
            *slope = PoseSlope { translation: rotation * own_force, matrix: rotation * own_moment };
            let (mut force, mut torque) = self.mean.own_share(e, &share);
            if let Some(own) = by_screw.and_then(|slopes| slopes.get(e)) {
                let own = inverse_right_jacobian(&self.mean.screws[e]).transpose() * own;
                let (own_force, own_torque) = halves(&own);
                (force, torque) = (force + own_force, torque + own_torque);
            }
            let of_frame = frame.pull_back(&FrameSlope {
                force: frame.turn * force,
                torque: frame.turn * torque,
                stretch: Matrix3::zeros(),
            });
            slope.translation += of_frame.translation;
            slope.matrix += of_frame.matrix;
        }
        Some(())
    }

    /// Count of the unknowns that [`Posed::keep`] adds.
    pub fn kept(&self) -> usize {
        Isometry3::<f64>::COUNT + self.coefficients.len()
    }

    /// Adds turns, m and c.
    pub fn keep(&self, memory: &mut ModelMemory) {
        memory.turns.clone_from(&self.turns);
        memory.put(&self.mean.body_from_mean);
        memory.unknowns.extend(self.coefficients.iter());
    }

    /// Takes back what [`Posed::keep`] added.
    pub fn take_back(&mut self, memory: &ModelMemory, unknowns: &mut Unknowns<'_>) {
        self.turns = memory.turns_of(self.controls.len());
        // The same poses, continuing their own turns, have the same frames and screws.
        if !memory.poses.is_empty() {
            self.take(&memory.poses);
        }
        self.mean.body_from_mean = unknowns.take();
        unknowns.fill(self.coefficients.as_mut_slice());
    }

    pub fn forget(&mut self) {
        self.turns.fill(UnitQuaternion::identity());
    }

    pub fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.get_mut(e) {
            *place = turn;
        }
    }
}
