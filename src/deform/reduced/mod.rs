//! Method 2b as a basis: the mean frame of the control elements carries the body, which bends into fields of second and
//! third order so that its strain energy is least.
//!
//! In: the coefficients of the affine fields of the poses seen from the mean frame m ([`MeanFrame`]), and the tables of the
//! family `reduced`. Out: x = m (X + Σ c_k u_k + Φ q - ō) with ∂V/∂q = 0 for V(y, q), y = Lᵀ c, the exact energy of St.
//! Venant–Kirchhoff's law in these fields; an upper bound of that of the mesh, exact to the fifth order for two elements.
//! Forces are the derivative of V by the poses, that of m included; q has no part in it.

mod equilibrium;
mod quartic;

use super::frames::{ControlFrame, FrameSlope, PoseSlope, axial};
use super::mean_frame::MeanFrame;
use super::model::{BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response};
use super::pose::ControlPose;
use crate::fem::QuarticShape;
use crate::green::{AFFINE, FIELDS, Lift, QUARTIC, REDUCED};
use equilibrium::ReducedBody;
use nalgebra::{DVector, Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3, Vector6};

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "reduced",
    summary: "method 2b as a basis: fields of second and third order in equilibrium; forces right to 90° and beyond",
    requirements: &[AFFINE, REDUCED],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    turn_limits_deg: [90.0, 150.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Reduced::new(input)?))),
};

pub struct Reduced {
    controls: Vec<ControlRest>,
    /// ō.
    centre: Vector3<f64>,
    lift: Lift,
    body: ReducedBody,
    mean: MeanFrame,
    frames: Vec<ControlFrame>,
    /// The rotation of every element in the last evaluation.
    turns: Option<Vec<UnitQuaternion<f64>>>,
    /// c, and ∂V/∂c.
    coefficients: DVector<f64>,
    forces: DVector<f64>,
    /// y, and ∂V/∂y.
    coordinates: DVector<f64>,
    coordinate_forces: DVector<f64>,
    /// Of the last poses that had an equilibrium.
    energy: f64,
    slopes: Vec<PoseSlope>,
}

impl Reduced {
    pub fn new(input: &ModelInput<'_>) -> Result<Reduced, String> {
        let elements = input.controls.len();
        let lift = Lift::of(elements);
        let table = (input.table)(QUARTIC).ok_or_else(|| {
            format!("the table {QUARTIC} is missing; run `greenstage precompute` on the scene")
        })?;
        let unfit = || format!("the table {QUARTIC} has {} numbers, which suits no fields", table.len());
        let others = lift.len() - lift.rigid;
        let is_of = |fields: &usize| QuarticShape { variables: 1 + lift.len() + fields }.len() == table.len();
        let fields = (0..256).find(is_of).ok_or_else(unfit)?;
        let body = ReducedBody::new(lift.rigid, others, fields, table.as_slice().to_vec());
        let sum: Vector3<f64> = input.controls.iter().map(|control| control.origin).sum();
        let (c, y) = (DVector::zeros(FIELDS * elements), DVector::zeros(lift.len()));
        Ok(Reduced {
            controls: input.controls.to_vec(),
            centre: sum / elements.max(1) as f64,
            body: body.ok_or_else(unfit)?,
            lift,
            mean: MeanFrame::new(elements),
            frames: Vec::with_capacity(elements),
            turns: None,
            forces: c.clone(),
            coefficients: c,
            coordinate_forces: y.clone(),
            coordinates: y,
            energy: 0.0,
            slopes: vec![PoseSlope::default(); elements],
        })
    }

    /// Finds m, c and q of the poses; `None` where there are none.
    fn settle(&mut self, poses: &[ControlPose]) -> Option<()> {
        self.frames.clear();
        for (e, (control, pose)) in self.controls.iter().zip(poses).enumerate() {
            let before = self.turns.as_ref().map(|turns| &turns[e]);
            self.frames.push(ControlFrame::of(&control.origin, pose, before)?);
        }
        self.mean.find(&self.frames)?;
        let turns = self.turns.get_or_insert_with(Vec::new);
        turns.clear();
        turns.extend(self.frames.iter().map(|frame| frame.turn));
        let mean_from_body = self.mean.body_from_mean.inverse();
        for (e, (control, pose)) in self.controls.iter().zip(poses).enumerate() {
            let place = mean_from_body * nalgebra::Point3::from(control.origin + pose.translation);
            let seen = ControlPose {
                translation: place.coords - (control.origin - self.centre),
                matrix: mean_from_body.rotation.to_rotation_matrix() * pose.matrix,
            };
            self.coefficients.rows_mut(FIELDS * e, FIELDS).copy_from_slice(&seen.coefficients());
        }
        self.coordinates.gemv_tr(1.0, &self.lift.columns, &self.coefficients, 0.0);
        self.energy = self.body.settle(self.coordinates.as_slice())?;
        Some(())
    }

    /// ∂V by the poses from that by y.
    fn pull_back(&mut self, poses: &[ControlPose]) -> Option<()> {
        for (k, slope) in self.coordinate_forces.iter_mut().enumerate() {
            *slope = self.body.slope(k);
        }
        self.forces.gemv(1.0, &self.lift.columns, &self.coordinate_forces, 0.0);
        let rotation = self.mean.body_from_mean.rotation.to_rotation_matrix();
        let mean_from_body = self.mean.body_from_mean.inverse();
        // ∂V by a motion of m, in its own axes.
        let mut common = Vector6::zeros();
        for (e, (slope, pose)) in self.slopes.iter_mut().zip(poses).enumerate() {
            let own = &self.forces.as_slice()[FIELDS * e..FIELDS * (e + 1)];
            let (force, moment) =
                (Vector3::new(own[0], own[1], own[2]), Matrix3::from_row_slice(&own[3..FIELDS]));
            let seen = rotation.matrix().transpose() * pose.matrix;
            let place = mean_from_body * nalgebra::Point3::from(self.frames[e].place);
            let torque = place.coords.cross(&force) + axial(&(moment * seen.transpose()));
            common -= Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
            *slope = PoseSlope { translation: rotation * force, matrix: rotation * moment };
        }
        let share = self.mean.share(&common)?;
        for (e, (slope, frame)) in self.slopes.iter_mut().zip(&self.frames).enumerate() {
            let (force, torque) = self.mean.own_share(e, &share);
            let of_mean = frame.pull_back(&FrameSlope {
                force: frame.turn * force,
                torque: frame.turn * torque,
                stretch: Matrix3::zeros(),
            });
            slope.translation += of_mean.translation;
            slope.matrix += of_mean.matrix;
        }
        Some(())
    }
}

impl DeformationModel for Reduced {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let is_found = self.settle(poses).is_some();
        let mean = &self.mean.body_from_mean;
        // The surface stands about the body's centre, m about ō.
        let shift = mean.translation.vector - mean.rotation * self.centre;
        let body_from_surface = Isometry3::from_parts(Translation3::from(shift), mean.rotation);
        let coefficients = self.coefficients.iter().chain(self.body.q()).copied().collect();
        BodyState { parts: vec![body_from_surface], coefficients, rotation_undefined: !is_found }
    }

    /// Where there is no mean frame or no equilibrium, the last one's energy and forces go on.
    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let found = self.settle(poses).and_then(|()| self.pull_back(poses));
        slopes.copy_from_slice(&self.slopes);
        Some(Response { energy: self.energy, is_defined: found.is_some() })
    }

    fn forget(&mut self) {
        self.turns = None;
        self.body.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        if let Some(place) = self.turns.as_mut().and_then(|turns| turns.get_mut(e)) {
            *place = turn;
        }
    }
}

#[cfg(test)]
mod tests;
