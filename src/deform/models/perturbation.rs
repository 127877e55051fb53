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
//!
//! Loads add what they do at rest, in the frame that turns: with their forces g on q and W = Σ f·(x - X) ([`FrameForces`]), and
//! those of warmth p,
//!
//! ```text
//! r = g + p     q = (1 - b) q(x) + r     V = (1 - b) V(y, q(x) + r) + b (V_rotation + ½ r·r - p·(y, r)) - W
//! ```
//!
//! r is exact to first order in loads at rest; it misses products of load and motion, and of loads. V is the least to its first
//! order, so that it misses squares of these.

use super::helicoidal::{CubicForm, Helicoidal};
use super::reduced::{ByMean, Curvature, Posed, Quartic, quartic_table};
use crate::deform::loads::FrameForces;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{
    Bearing, BodyState, DeformationModel, Frame, Kind, ModelEntry, ModelInput, Response,
};
use crate::deform::pose::frame::{ControlPose, FrameSlope, PoseSlope};
use crate::green::{AFFINE, CUBIC, FIELDS, Lift, PERTURBATION, RADIUS, REDUCED, SERIES, STIFFNESS};
use nalgebra::{DMatrix, Matrix3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6};

pub const ENTRY: ModelEntry = ModelEntry {
    name: "perturbation",
    summary: "method 2b: a power series of third order in the relative motion, within its radius of convergence",
    requirements: &[AFFINE, REDUCED, PERTURBATION],
    frame: Frame::MeanMotion,
    energy: Some(&[STIFFNESS, CUBIC]),
    // Beyond the radius of convergence it is `rotation`.
    turn_limits_deg: [15.0, 45.0],
    kind: Kind::Online(|input: &ModelInput<'_>| Ok(Box::new(Perturbation::new(input)?))),
    loads: Bearing::Forces(&[]),
    fits: None,
};

/// Part of the radius of convergence up to which the series stands alone.
const ALONE: f64 = 0.7;

pub struct Perturbation {
    posed: Posed,
    lift: Lift,
    quartic: Quartic,
    series: DMatrix<f64>,
    radius: SMatrix<f64, 6, 6>,
    rotation: Option<Helicoidal>,
    fields: usize,
    /// x of the last poses, and the share of `rotation` in what was shown last.
    x: SVector<f64, 6>,
    share: f64,
    /// z = (1, y of undeformed elements, q, the other y), ∂V/∂z; q(x) and its derivatives, a column for each x.
    z: Vec<f64>,
    slopes: Vec<f64>,
    bends: DMatrix<f64>,
    /// z and ∂V/∂z of the last response and V there, and ∂²V/∂z² of a response before: with them slopes beside are found.
    last: (Vec<f64>, Vec<f64>, f64),
    curvature: Curvature,
    by_frames: Vec<FrameSlope>,
    loads: Option<FrameForces>,
    /// r, and ∂V by it.
    answers: Vec<f64>,
    by_answers: Vec<f64>,
    /// Energy and slopes of the last poses that had a mean frame.
    energy: f64,
    by_poses: Vec<PoseSlope>,
}

impl Perturbation {
    fn new(input: &ModelInput<'_>) -> Result<Perturbation, String> {
        let (coefficients, fields) = quartic_table(input)?;
        let lift = Lift::new(input.controls.len());
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
        let quartic = Quartic::new(variables, &coefficients);
        let loads = FrameForces::from_input(input, fields)?;
        let answers = vec![0.0; if loads.is_some() { fields } else { 0 }];
        Ok(Perturbation {
            loads,
            by_answers: answers.clone(),
            answers,
            posed: Posed::new(input.controls),
            quartic: quartic.ok_or("the energy's table does not suit the control elements")?,
            lift,
            bends: DMatrix::zeros(fields, 7),
            series,
            radius: radius.fixed_view::<6, 6>(0, 0).into_owned(),
            rotation,
            fields,
            x: SVector::zeros(),
            share: 0.0,
            z: vec![0.0; variables],
            slopes: vec![0.0; variables],
            last: (vec![0.0; variables], vec![0.0; variables], 0.0),
            curvature: Curvature::new(variables),
            by_frames: vec![FrameSlope { force: nothing, torque: nothing, stretch: Matrix3::zeros() }; 2],
            energy: 0.0,
            by_poses: vec![PoseSlope::default(); 2],
        })
    }

    /// Finds m, c, x and q(x); b and its derivative by xᵀ G x.
    fn settle(&mut self, poses: &[ControlPose]) -> Option<(f64, f64)> {
        if let Some(loads) = &mut self.loads {
            loads.read();
        }
        self.posed.take(poses)?;
        self.find_answers(poses);
        self.x = (self.posed.screw(1) - self.posed.screw(0)) * std::f64::consts::FRAC_1_SQRT_2;
        self.bend();
        let square = self.x.dot(&(self.radius * self.x));
        let part = square.max(0.0).sqrt();
        let share = ((part - ALONE) / (1.0 - ALONE)).clamp(0.0, 1.0);
        let (step, slope) = (share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share));
        Some((step, slope / (1.0 - ALONE) / (2.0 * part.max(ALONE))))
    }

    /// r.
    fn find_answers(&mut self, poses: &[ControlPose]) {
        let Some(loads) = self.loads.as_mut().filter(|loads| !loads.is_none) else {
            return self.answers.fill(0.0);
        };
        loads.find(self.posed.mean(), &self.posed.mean_turn(poses));
        let start = 1 + self.lift.rigid;
        for (i, answer) in self.answers.iter_mut().enumerate() {
            *answer = loads.burden.forces[start + i] + loads.push_of_warmth(start + i);
        }
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

    /// Loads have second derivatives of their own, which are not made beside the equilibrium.
    fn is_loaded(&self) -> bool {
        self.loads.as_ref().is_some_and(|loads| !loads.is_none)
    }

    /// V(z) and its slopes.
    fn evaluate(&mut self) -> f64 {
        let energy = self.quartic.slopes(&self.z, self.z.len(), &mut self.slopes);
        let (z, slopes, last) = &mut self.last;
        z.copy_from_slice(&self.z);
        slopes.copy_from_slice(&self.slopes);
        *last = energy;
        energy
    }

    /// Evaluates V(z) near the z of the last evaluation: slopes to first order of the way from there.
    fn evaluate_beside(&mut self) -> f64 {
        let (last_z, last_slopes, last) = &self.last;
        let n = last_z.len();
        for (way, last) in self.z.iter_mut().zip(last_z) {
            *way -= last;
        }
        let mut energy = *last;
        for (at, slope) in self.slopes.iter_mut().enumerate() {
            let row = &self.curvature.second[at * n..][..n];
            *slope = last_slopes[at] + row.iter().zip(&self.z).map(|(second, way)| second * way).sum::<f64>();
            energy += 0.5 * (*slope + last_slopes[at]) * self.z[at];
        }
        energy
    }

    /// V and its slopes at the poses that were settled with the share b of `rotation`, where V(z) is evaluated so.
    fn answer(
        &mut self,
        poses: &[ControlPose],
        (share, slope): (f64, f64),
        evaluate: fn(&mut Perturbation) -> f64,
    ) -> Option<f64> {
        self.rotation.as_ref()?;
        self.z[0] = 1.0;
        let (rigid, fields) = (self.lift.rigid, self.fields);
        let place = |k: usize| if k < rigid { 1 + k } else { 1 + fields + k };
        for (k, y) in self.posed.coordinates().iter().enumerate() {
            self.z[place(k)] = *y;
        }
        let q = 1 + self.lift.rigid;
        self.z[q..q + self.fields].copy_from_slice(self.bends.column(0).as_slice());
        let is_loaded = self.is_loaded();
        if is_loaded {
            self.z[q..].iter_mut().zip(&self.answers).for_each(|(z, answer)| *z += answer);
        }
        let mut energy = evaluate(self);
        let mut loads = self.loads.as_mut().filter(|_| is_loaded);
        if let Some(loads) = &mut loads {
            (energy, _) = loads.burden.add(energy, &self.z, &mut self.slopes);
        }
        let mut by_x = SVector::<f64, 6>::zeros();
        for i in 0..6 {
            let own = self.bends.column(1 + i);
            by_x[i] = own.iter().zip(&self.slopes[q..]).map(|(bend, slope)| bend * slope).sum();
        }
        by_x *= 1.0 - share;
        let mut of_rotation = None;
        if share > 0.0 {
            let mut other = self.rotation.as_mut()?.respond(self.posed.frames(), &mut self.by_frames)?;
            if let Some(loads) = &loads {
                let by_motion = |k: usize| self.z[k] * (loads.burden.forces[k] + loads.push_of_warmth(k));
                other -= (1..q).chain(q + fields..self.z.len()).map(by_motion).sum::<f64>();
                other -= 0.5 * self.answers.iter().map(|answer| answer * answer).sum::<f64>();
            }
            by_x += self.radius * self.x * (2.0 * slope * (other - energy));
            energy = (1.0 - share) * energy + share * other;
            of_rotation = Some(());
        }
        let half: Vector6<f64> = by_x * std::f64::consts::FRAC_1_SQRT_2;
        let mut by_mean = None;
        if let Some(loads) = &loads {
            let m = self.posed.mean();
            let common = self.posed.common();
            energy += loads.beside(m, &common);
            let bends = self.bends.column(0);
            for (z, (bend, answer)) in self.z[q..].iter_mut().zip(bends.iter().zip(&self.answers)) {
                *z = (1.0 - share) * bend + answer;
            }
            for (by, slope) in self.by_answers.iter_mut().zip(&self.slopes[q..]) {
                *by = (1.0 - share) * slope;
            }
            by_mean = Some(ByMean {
                motion: loads.by_turn(m, &self.by_answers) - loads.by_frame(m, &common, &self.z),
                common: -loads.by_common(m),
            });
        }
        let slopes = &self.slopes;
        let by_y = |k: usize| {
            let k = place(k);
            let by_loads = |loads: &&mut FrameForces| loads.burden.forces[k] + loads.push_of_warmth(k);
            (1.0 - share) * slopes[k] - share * loads.as_ref().map_or(0.0, by_loads)
        };
        self.posed.pull_back(poses, &by_y, (Some(&[-half, half]), by_mean), &mut self.by_poses)?;
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
        self.share = found.map_or(self.share, |(share, _)| share);
        let mut q = self.bends.column(0) * (1.0 - self.share);
        q.iter_mut().zip(&self.answers).for_each(|(q, answer)| *q += answer);
        BodyState {
            parts: vec![self.posed.body_from_surface()],
            coefficients: self.posed.coefficients().iter().chain(q.iter()).copied().collect(),
            rotation_undefined: found.is_none(),
            field_version: 0,
        }
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.rotation.as_ref()?;
        let found = self.settle(poses).and_then(|share| self.answer(poses, share, Self::evaluate));
        self.energy = found.unwrap_or(self.energy);
        slopes.copy_from_slice(&self.by_poses);
        Some(Response { energy: self.energy, is_defined: found.is_some() })
    }

    fn prepare_beside(&mut self, anew: bool) -> bool {
        if self.is_loaded() {
            return true;
        }
        if anew {
            self.curvature.forget();
        }
        self.curvature.prepare(&self.quartic, &self.last.0)
    }

    fn respond_beside(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.rotation.as_ref()?;
        if self.is_loaded() || !self.curvature.is_made() {
            return None;
        }
        slopes.copy_from_slice(&self.by_poses);
        let found = self.settle(poses).and_then(|share| self.answer(poses, share, Self::evaluate_beside));
        slopes.swap_with_slice(&mut self.by_poses);
        found.map(|energy| Response { energy, is_defined: true })
    }

    fn memory(&self) -> ModelMemory {
        let slopes = self.by_poses.clone();
        let mut memory = ModelMemory { slopes, energy: self.energy, ..ModelMemory::default() };
        self.posed.keep(&mut memory);
        memory.unknowns.push(self.share);
        memory.unknowns.extend(self.bends.column(0).iter().chain(&self.answers));
        memory
    }

    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        memory.suits(2, self.posed.kept() + 1 + self.fields + self.answers.len())?;
        let mut unknowns = Unknowns(&memory.unknowns);
        self.posed.take_back(memory, &mut unknowns);
        self.share = unknowns.take();
        unknowns.fill(self.bends.column_mut(0).as_mut_slice());
        unknowns.fill(&mut self.answers);
        self.energy = memory.energy;
        self.by_poses.clone_from(&memory.slopes);
        self.by_poses.resize(2, PoseSlope::default());
        Ok(())
    }

    fn forget(&mut self) {
        self.posed.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.posed.set_turn(e, turn);
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::assert_slopes;
    use super::super::reduced::tests::{RIGHT, bar, poses};
    use crate::base::progress::Silent;
    use crate::deform::{ControlPoses, DeformationModel, PoseSlope, find_model, model_of};
    use crate::green::{self, AFFINE, CUBIC, PERTURBATION, RADIUS, Requirements, STIFFNESS, Solution};
    use nalgebra::Isometry3;

    fn solution() -> Solution {
        let requirements = Requirements::new(&[AFFINE, PERTURBATION, STIFFNESS, CUBIC]);
        green::solve(&bar(RIGHT), "bar", &requirements, &Silent).unwrap()
    }

    fn model(name: &str, solution: &Solution) -> Box<dyn DeformationModel> {
        model_of(find_model(name).unwrap(), solution).unwrap().0
    }

    fn energy(model: &mut dyn DeformationModel, poses: &ControlPoses) -> f64 {
        let response = model.respond(poses, &mut [PoseSlope::default(); 2]).unwrap();
        assert!(response.is_defined);
        response.energy
    }

    fn bent(degrees: f64) -> ControlPoses {
        poses([0.0; 3], [0.0, 0.3 * degrees.to_radians(), degrees.to_radians()], &Isometry3::identity())
    }

    /// The series exceeds the least energy in the same fields by an amount that falls with at least the sixth power of the
    /// motion; a bend by 30° is good to a thousandth of the energy.
    #[test]
    fn it_is_the_series_of_the_equilibrium() {
        let solution = solution();
        let (mut series, mut least) = (model("perturbation", &solution), model("reduced", &solution));
        let miss = [7.5, 15.0, 30.0].map(|degrees| {
            let poses = bent(degrees);
            let least = energy(least.as_mut(), &poses);
            let miss = energy(series.as_mut(), &poses) - least;
            assert!(miss >= -1e-9 * least && miss < 1e-3 * least, "{degrees}: {miss} of {least}");
            miss
        });
        assert!(miss[1] > 45.0 * miss[0] && miss[2] > 45.0 * miss[1], "{miss:?}");
    }

    /// The radius is that of a slender body: less for a bend than for a twist, and `rotation` takes over at its end.
    #[test]
    fn it_passes_into_rotation_at_its_radius() {
        let solution = solution();
        let form = &solution.tables[RADIUS];
        // x of a turn by a radian is 1/√2.
        let radius = |axis: usize| (2.0 / form[(3 + axis, 3 + axis)]).sqrt().to_degrees();
        let (twist, bend) = (radius(0), radius(2));
        assert!((20.0..120.0).contains(&bend) && twist > 1.3 * bend, "twist {twist}°, bend {bend}°");
        let (mut series, mut rotation) = (model("perturbation", &solution), model("rotation", &solution));
        let beyond = bent(1.01 * bend);
        let (found, expected) = (energy(series.as_mut(), &beyond), energy(rotation.as_mut(), &beyond));
        assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
        let mut before = energy(series.as_mut(), &bent(0.6 * bend));
        for step in 0..=250 {
            let now = energy(series.as_mut(), &bent((0.6 + 0.002 * f64::from(step)) * bend));
            assert!((now - before).abs() < 0.02 * before.max(now), "{step}: {before} {now}");
            before = now;
        }
    }

    #[test]
    fn slopes_are_derivatives_of_the_energy() {
        let solution = solution();
        let bend = (2.0 / solution.tables[RADIUS][(5, 5)]).sqrt().to_degrees();
        let mut model = model("perturbation", &solution);
        for part in [0.4, 0.8, 0.95, 1.2] {
            let poses = bent(part * bend);
            let mut slopes = [PoseSlope::default(); 2];
            model.respond(&poses, &mut slopes).unwrap();
            let size = slopes.iter().map(|slope| slope.matrix.norm()).fold(0.0, f64::max);
            assert_slopes(model.as_mut(), &poses, 1e-5, 1e-6 * size);
        }
    }
}
