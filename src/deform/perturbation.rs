//! Method 2b: the equilibrium as a power series in the relative motion of two control elements, to the third order.
//!
//! In: the mean frame m, the coefficients c and the differences x of the screws ξ_e ([`Posed`]); the series q(x) and its
//! radius of convergence. Out: x = m (X + Σ c_k u_k + Φ q - ō). The boundary is exact, Φ q is what the body adds to it. With
//! r = √(xᵀ G x), the part of the radius at which x lies, and a smooth step b from 0 at r = 0.7 to 1 at r = 1,
//!
//! ```text
//! q = (1 - b) q(x)     V = (1 - b) V(y, q(x)) + b V_rotation
//! ```
//!
//! so that the model passes into `rotation` before its series stops meaning anything. V(y, q) is the exact energy of the
//! displacements; forces are the derivative of V, that of q(x) and b included.

use super::cubic_form::CubicForm;
use super::frames::{FrameSlope, PoseSlope};
use super::helicoidal::Helicoidal;
use super::model::{BodyState, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response};
use super::pose::ControlPose;
use super::reduced::{Posed, Quartic, quartic_table};
use crate::green::{AFFINE, CUBIC, FIELDS, Lift, PERTURBATION, RADIUS, REDUCED, SERIES, STIFFNESS};
use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

pub(super) const ENTRY: ModelEntry = ModelEntry {
    name: "perturbation",
    summary: "method 2b: a power series of third order in the relative motion, within its radius of convergence",
    requirements: &[AFFINE, REDUCED, PERTURBATION],
    frame: Frame::MeanMotion,
    energy: Some(&[STIFFNESS, CUBIC]),
    turn_limits_deg: [30.0, 60.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Perturbation::new(input)?))),
};

/// Up to this part of the radius of convergence the series stands alone.
const ALONE: f64 = 0.7;

pub struct Perturbation {
    posed: Posed,
    lift: Lift,
    quartic: Quartic,
    series: DMatrix<f64>,
    radius: SMatrix<f64, 6, 6>,
    rotation: Option<Helicoidal>,
    fields: usize,
    /// x of the last poses.
    x: SVector<f64, 6>,
    /// z = (1, y of undeformed elements, q, the other y), ∂V/∂z; q(x) and its derivatives, a column for each x.
    z: Vec<f64>,
    slopes: Vec<f64>,
    bends: DMatrix<f64>,
    by_frames: Vec<FrameSlope>,
    /// Of the last poses that had a mean frame.
    energy: f64,
    by_poses: Vec<PoseSlope>,
}

impl Perturbation {
    fn new(input: &ModelInput<'_>) -> Result<Perturbation, String> {
        let (coefficients, fields) = quartic_table(input)?;
        let lift = Lift::of(input.controls.len());
        let variables = 1 + lift.len() + fields;
        let table = |name: &str| {
            (input.table)(name).ok_or_else(|| {
                format!("the table {name} is missing; run `greenstage precompute` on the scene")
            })
        };
        let (series, radius) = (table(SERIES)?, table(RADIUS)?);
        if series.shape() != (fields, 77) || radius.shape() != (6, 6) || input.controls.len() != 2 {
            return Err(format!(
                "the table {SERIES} has {} × {} numbers, {fields} fields of two control elements need {fields} × 77",
                series.nrows(),
                series.ncols()
            ));
        }
        let origins: Vec<Vector3<f64>> = input.controls.iter().map(|control| control.origin).collect();
        let cubic = (input.table)(CUBIC.name);
        let cubic = cubic.and_then(|table| CubicForm::new(FIELDS * origins.len(), table.as_slice().to_vec()));
        let rotation = match ((input.table)(STIFFNESS.name), cubic) {
            (Some(stiffness), Some(cubic)) => Some(Helicoidal::new(&origins, stiffness, Some(cubic))?),
            _ => None,
        };
        let nothing = Vector3::zeros();
        let quartic = Quartic::new(variables, coefficients);
        Ok(Perturbation {
            posed: Posed::new(input.controls),
            quartic: quartic.ok_or("the energy's table does not suit the control elements")?,
            lift,
            bends: DMatrix::zeros(fields, 7),
            series,
            radius: radius.fixed_view::<6, 6>(0, 0).into_owned(),
            rotation,
            fields,
            x: SVector::zeros(),
            z: vec![0.0; variables],
            slopes: vec![0.0; variables],
            by_frames: vec![FrameSlope { force: nothing, torque: nothing, stretch: Matrix3::zeros() }; 2],
            energy: 0.0,
            by_poses: vec![PoseSlope::default(); 2],
        })
    }

    /// Finds m, c, x and q(x); b and its derivative by xᵀ G x.
    fn settle(&mut self, poses: &[ControlPose]) -> Option<(f64, f64)> {
        self.posed.take(poses)?;
        self.x = (self.posed.screw(1) - self.posed.screw(0)) * std::f64::consts::FRAC_1_SQRT_2;
        self.bend();
        let square = self.x.dot(&(self.radius * self.x));
        let part = square.sqrt();
        let share = ((part - ALONE) / (1.0 - ALONE)).clamp(0.0, 1.0);
        let (step, slope) = (share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share));
        Some((step, slope / (1.0 - ALONE) / (2.0 * part.max(ALONE))))
    }

    /// Column 0 of `bends`: q(x); the others: ∂q/∂x.
    fn bend(&mut self) {
        self.bends.fill(0.0);
        let x = &self.x;
        let mut at = 0;
        let mut term = |value: f64, slopes: &[(usize, f64)]| {
            let own = self.series.column(at);
            self.bends.column_mut(0).axpy(value, &own, 1.0);
            for (i, slope) in slopes {
                self.bends.column_mut(1 + i).axpy(*slope, &own, 1.0);
            }
            at += 1;
        };
        for i in 0..6 {
            for j in i..6 {
                term(x[i] * x[j], &[(i, x[j]), (j, x[i])]);
            }
        }
        for i in 0..6 {
            for j in i..6 {
                for k in j..6 {
                    term(x[i] * x[j] * x[k], &[(i, x[j] * x[k]), (j, x[i] * x[k]), (k, x[i] * x[j])]);
                }
            }
        }
    }

    /// V and its slopes at the poses that were settled with the share b of `rotation`.
    fn answer(&mut self, poses: &[ControlPose], (share, slope): (f64, f64)) -> Option<f64> {
        let rotation = self.rotation.as_mut()?;
        self.z[0] = 1.0;
        let (rigid, fields) = (self.lift.rigid, self.fields);
        let place = |k: usize| if k < rigid { 1 + k } else { 1 + fields + k };
        for (k, y) in self.posed.coordinates().iter().enumerate() {
            self.z[place(k)] = *y;
        }
        let q = 1 + self.lift.rigid;
        self.z[q..q + self.fields].copy_from_slice(self.bends.column(0).as_slice());
        let mut energy = self.quartic.slopes(&self.z, self.z.len(), &mut self.slopes);
        let mut by_x = SVector::<f64, 6>::zeros();
        for i in 0..6 {
            let own = self.bends.column(1 + i);
            by_x[i] = own.iter().zip(&self.slopes[q..]).map(|(bend, slope)| bend * slope).sum();
        }
        by_x *= 1.0 - share;
        let mut of_rotation = None;
        if share > 0.0 {
            let other = rotation.respond(self.posed.frames(), &mut self.by_frames)?;
            by_x += self.radius * self.x * (2.0 * slope * (other - energy));
            energy = (1.0 - share) * energy + share * other;
            of_rotation = Some(());
        }
        let half: Vector6<f64> = by_x * std::f64::consts::FRAC_1_SQRT_2;
        let slopes = &self.slopes;
        let by_y = |k: usize| (1.0 - share) * slopes[place(k)];
        self.posed.pull_back(poses, &by_y, Some(&[-half, half]), &mut self.by_poses)?;
        if of_rotation.is_some() {
            for ((slope, frame), own) in
                self.by_poses.iter_mut().zip(self.posed.frames()).zip(&self.by_frames)
            {
                let own = frame.pull_back(own);
                slope.translation += own.translation * share;
                slope.matrix += own.matrix * share;
            }
        }
        Some(energy)
    }
}

impl DeformationModel for Perturbation {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        let found = self.settle(poses);
        let share = found.map_or(0.0, |(share, _)| share);
        let q = self.bends.column(0) * (1.0 - share);
        BodyState {
            parts: vec![self.posed.body_from_surface()],
            coefficients: self.posed.coefficients().iter().chain(q.iter()).copied().collect(),
            rotation_undefined: found.is_none(),
        }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.rotation.as_ref()?;
        let found = self.settle(poses).and_then(|share| self.answer(poses, share));
        self.energy = found.unwrap_or(self.energy);
        slopes.copy_from_slice(&self.by_poses);
        Some(Response { energy: self.energy, is_defined: found.is_some() })
    }

    fn forget(&mut self) {
        self.posed.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.posed.set_turn(e, turn);
    }
}
