//! Method 2b as a basis: the mean frame of the control elements carries the body, which bends into fields of its own
//! equilibria so that its strain energy is least.
//!
//! In: the coefficients of the affine fields of the poses seen from the mean frame m ([`Posed`]), and the tables of the
//! family `reduced`. Out: x = m (X + Σ c_k u_k + Φ q - ō) with ∂V/∂q = 0 for V(y, q), y = Lᵀ c, the exact energy of St.
//! Venant–Kirchhoff's law in these fields; an upper bound of that of the mesh, exact to the fifth order for two elements. With the
//! tables of `reduced_neo_hookean` V is that of the neo-Hookean law, its volume kept in the mean by few [`pressures`].
//! Forces are the derivative of V by the poses, that of m included; q has no part in it. Loads and forces at points are forces on
//! (y, q) and m ([`FrameForces`]), and what they do at rest is among the fields Φ.
//!
//! With m from [`MeanFrame`] and L from [`Lift`], a pose enters V
//! through c, and through m, which moves with all of them; both parts of the derivative are taken.

mod cubics;
mod curvature;
mod equilibrium;
mod pressures;
mod quartic;
mod secants;
mod strain_energy;

use super::rotation::mean_rotation;
use crate::deform::loads::FrameForces;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlFrame, ControlPose, FrameSlope, PoseSlope, axial};
use crate::deform::pose::se3::{MeanFrame, halves, inverse_left_jacobian, inverse_right_jacobian};
use crate::fem::QuarticShape;
use crate::field::numbers::Numbers;
use crate::green::{
    AFFINE, FIELDS, Lift, PRESSED_POINTS, QUARTIC, REDUCED, REDUCED_NEO_HOOKEAN, VOLUME_FORMS,
};
pub use curvature::Curvature;
use equilibrium::ReducedBody;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6,
};
use pressures::Pressures;
pub use quartic::Quartic;
use strain_energy::{QuarticEnergy, StrainEnergy};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "reduced",
    summary: "method 2b as a basis: fields of the body's own equilibria; forces within 3 % to 90° of bend and twist with two control elements",
    requirements: &[AFFINE, REDUCED],
    frame: Frame::MeanMotion,
    energy: Some(&[]),
    // Two elements at 90° turn the pieces at their ends by 45° against the mean frame.
    turn_limits_deg: [40.0, 75.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Reduced::new(input)?))),
    loads: Bearing::Forces(&[]),
    fits: None,
};

pub const NEO_HOOKEAN_ENTRY: ModelEntry = ModelEntry {
    name: "reduced_neo_hookean",
    summary: "reduced, under the neo-Hookean law: compact bodies too have an equilibrium at 90° of bend and twist",
    requirements: &[AFFINE, REDUCED_NEO_HOOKEAN],
    ..ENTRY
};

pub struct Reduced {
    posed: Posed,
    body: ReducedBody,
    loads: Option<FrameForces>,
    /// Poses that were settled last; none where they had no equilibrium.
    poses: Vec<ControlPose>,
    /// Energy and slopes of the last poses that had an equilibrium.
    energy: f64,
    slopes: Vec<PoseSlope>,
}

/// The table of the energy, and how many fields Φ it has; the error says what is wrong with it.
pub fn quartic_table(input: &ModelInput<'_>) -> Result<(Vec<f64>, usize), String> {
    let table = (input.table)(QUARTIC)
        .ok_or_else(|| format!("the table {QUARTIC} is missing; run `greenstage precompute` on the scene"))?;
    let lifted = Lift::new(input.controls.len()).len();
    let is_of = |fields: &usize| QuarticShape { variables: 1 + lifted + fields }.len() == table.len();
    let fields = (0..256)
        .find(is_of)
        .ok_or_else(|| format!("the table {QUARTIC} has {} numbers, which suits no fields", table.len()))?;
    Ok((table.as_slice().to_vec(), fields))
}

/// The energy of the neo-Hookean law, and how many fields Φ it has beside `lifted` y; the error says what is wrong with the tables.
fn energy_of_forms(
    input: &ModelInput<'_>,
    forms: &DMatrix<f64>,
    lifted: usize,
) -> Result<(Box<dyn StrainEnergy>, usize), String> {
    let unfit = || format!("the tables {VOLUME_FORMS} and {PRESSED_POINTS} do not suit the body");
    let points = (input.table)(PRESSED_POINTS).ok_or_else(unfit)?;
    let variables = 1 + points.nrows() / 9;
    let fields = variables.checked_sub(1 + lifted).ok_or_else(unfit)?;
    let energy = Pressures::new(variables, forms, &points).ok_or_else(unfit)?;
    Ok((Box::new(energy), fields))
}

impl Reduced {
    pub fn new(input: &ModelInput<'_>) -> Result<Reduced, String> {
        let elements = input.controls.len();
        let lift = Lift::new(elements);
        let (energy, fields): (Box<dyn StrainEnergy>, usize) = match (input.table)(VOLUME_FORMS) {
            Some(forms) => energy_of_forms(input, &forms, lift.len())?,
            None => {
                let (coefficients, fields) = quartic_table(input)?;
                let energy = QuarticEnergy::new(1 + lift.len() + fields, &coefficients)
                    .ok_or_else(|| format!("the table {QUARTIC} does not suit the body"))?;
                (Box::new(energy), fields)
            }
        };
        Ok(Reduced {
            loads: FrameForces::from_input(input, fields)?,
            posed: Posed::new(input.controls),
            body: ReducedBody::new([lift.rigid, fields, lift.len() - lift.rigid], energy),
            poses: Vec::with_capacity(elements),
            energy: 0.0,
            slopes: vec![PoseSlope::default(); elements],
        })
    }

    /// Loads have second derivatives of their own, which are not made beside the equilibrium.
    fn is_loaded(&self) -> bool {
        self.loads.as_ref().is_some_and(|loads| !loads.is_none)
    }

    /// Finds m, c and q of the poses; `None` where there are none.
    fn settle(&mut self, poses: &[ControlPose]) -> Option<()> {
        let has_changed = self.loads.as_mut().is_some_and(FrameForces::read);
        if self.poses == poses && !has_changed {
            return Some(());
        }
        self.poses.clear();
        self.posed.take(poses)?;
        let y = self.posed.coordinates();
        self.energy = match self.loads.as_mut().filter(|loads| !loads.is_none) {
            None => self.body.settle(y, None)?,
            Some(loads) => {
                let m = self.posed.mean();
                loads.find(m, &self.posed.mean_turn(poses));
                self.body.settle(y, Some(&mut loads.burden))? + loads.beside(m, &self.posed.common())
            }
        };
        self.poses.extend_from_slice(poses);
        Some(())
    }
}

impl DeformationModel for Reduced {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let is_found = self.settle(poses).is_some();
        let coefficients = self.posed.coefficients().iter().chain(self.body.q()).copied().collect();
        BodyState {
            parts: vec![self.posed.body_from_surface()],
            coefficients,
            rotation_undefined: !is_found,
            field_version: 0,
        }
    }

    /// Energy and forces at `poses`; where there is no mean frame or no equilibrium, the last ones go on.
    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        let found = self.settle(poses);
        let (body, posed) = (&self.body, &mut self.posed);
        let loads = self.loads.as_ref().filter(|loads| !loads.is_none);
        let by_mean = loads.map(|loads| {
            let m = posed.mean();
            ByMean { motion: -loads.by_frame(m, &posed.common(), body.z()), common: -loads.by_common(m) }
        });
        let own = &mut self.slopes;
        let found = found.and_then(|()| posed.pull_back(poses, &|k| body.slope(k), (None, by_mean), own));
        slopes.copy_from_slice(&self.slopes);
        Some(Response { energy: self.energy, is_defined: found.is_some() })
    }

    fn prepare_beside(&mut self, anew: bool) -> bool {
        self.poses.is_empty() || self.is_loaded() || self.body.prepare_beside(anew)
    }

    fn respond_beside(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        if self.poses.is_empty() || self.is_loaded() {
            return None;
        }
        let (body, posed) = (&mut self.body, &mut self.posed);
        let found = posed.take(poses).and_then(|()| body.settle_beside(posed.coordinates()));
        let found = found.and_then(|added| {
            posed.pull_back(poses, &|k| body.slope_beside(k), (None, None), slopes)?;
            Some(Response { energy: self.energy + added, is_defined: true })
        });
        // Where that fails, the poses are settled anew.
        if posed.take(&self.poses).is_none() {
            self.poses.clear();
        }
        found
    }

    fn is_inverted(&self) -> bool {
        self.body.is_inverted()
    }

    fn was_long(&self) -> bool {
        self.body.was_long()
    }

    fn memory(&self) -> ModelMemory {
        let (poses, slopes) = (self.poses.clone(), self.slopes.clone());
        let mut memory = ModelMemory { poses, slopes, energy: self.energy, ..ModelMemory::default() };
        self.posed.keep(&mut memory);
        self.body.keep(&mut memory.unknowns);
        memory.loads = self.loads.as_ref().map(|loads| loads.applied().clone());
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        memory.suits(self.posed.elements(), self.posed.kept() + self.body.kept())?;
        let mut unknowns = Unknowns(&memory.unknowns);
        self.posed.take_back(memory, &mut unknowns);
        self.body.take_back(&mut unknowns);
        self.poses.clone_from(&memory.poses);
        self.energy = memory.energy;
        self.slopes.clone_from(&memory.slopes);
        self.slopes.resize(self.posed.elements(), PoseSlope::default());
        if let (Some(loads), Some(applied)) = (&mut self.loads, &memory.loads) {
            loads.set_applied(applied);
            loads.find(self.posed.mean(), &self.posed.mean_turn(&memory.poses));
        }
        Ok(())
    }

    fn forget(&mut self) {
        self.poses.clear();
        self.posed.forget();
        self.body.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.poses.clear();
        self.posed.set_turn(e, turn);
    }
}

/// ∂V by a motion of m in its own axes, and by c̄, where V depends on them beside y.
#[derive(Default)]
pub struct ByMean {
    pub motion: Vector6<f64>,
    pub common: Vector3<f64>,
}

pub struct Posed {
    controls: Vec<ControlRest>,
    /// ō.
    centre: Vector3<f64>,
    lift: Lift,
    mean: MeanFrame,
    frames: Vec<ControlFrame>,
    /// The rotation of every element in the last poses.
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
        let lift = Lift::new(elements);
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
            self.frames.push(ControlFrame::new(&control.origin, pose, self.turns.get(e))?);
        }
        // Hands turn on where there is no mean.
        self.turns.clear();
        self.turns.extend(self.frames.iter().map(|frame| frame.turn));
        self.mean.find(&self.frames)?;
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

    /// The mean turn of the control elements at the poses that were taken.
    pub fn mean_turn(&self, poses: &[ControlPose]) -> Rotation3<f64> {
        let mean = mean_rotation(&self.controls, poses, &self.turns);
        mean.unwrap_or_else(|| self.mean().rotation.to_rotation_matrix())
    }

    /// c̄, the mean translation of the elements in c, which y leaves out.
    pub fn common(&self) -> Vector3<f64> {
        let own = |e: usize| Vector3::from_column_slice(&self.coefficients.as_slice()[FIELDS * e..][..3]);
        (0..self.elements()).map(own).sum::<Vector3<f64>>() / self.elements().max(1) as f64
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

    /// ∂V by the poses that were taken, from that by each y and, where V depends on them too, by each ξ_e, and by m and c̄ with all
    /// of these held.
    pub fn pull_back(
        &mut self,
        poses: &[ControlPose],
        by_coordinate: &dyn Fn(usize) -> f64,
        (by_screw, by_mean): (Option<&[Vector6<f64>]>, Option<ByMean>),
        slopes: &mut [PoseSlope],
    ) -> Option<()> {
        for (k, slope) in self.by_coordinates.iter_mut().enumerate() {
            *slope = by_coordinate(k);
        }
        self.forces.gemv(1.0, &self.lift.columns, &self.by_coordinates, 0.0);
        let by_mean = by_mean.unwrap_or_default();
        let part = by_mean.common / self.elements().max(1) as f64;
        for own in self.forces.as_mut_slice().chunks_exact_mut(FIELDS) {
            own.iter_mut().zip(part.iter()).for_each(|(own, part)| *own += part);
        }
        let rotation = self.mean.body_from_mean.rotation.to_rotation_matrix();
        let mean_from_body = self.mean.body_from_mean.inverse();
        // ∂V by a motion of m, in its own axes.
        let mut common = by_mean.motion;
        let forces = &self.forces;
        let held = |e: usize| {
            let own = &forces.as_slice()[FIELDS * e..FIELDS * (e + 1)];
            PoseSlope::of_numbers(own)
        };
        for (e, pose) in poses.iter().enumerate().take(self.frames.len()) {
            let PoseSlope { translation: force, matrix: moment } = held(e);
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
            let own = held(e);
            *slope = PoseSlope { translation: rotation * own.translation, matrix: rotation * own.matrix };
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

#[cfg(test)]
pub mod tests;
