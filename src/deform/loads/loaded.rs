//! A model with loads: its own state, with the loads' coefficients and the displacements of point forces added; and the energy and
//! virtual work of loads and forces at points, for the control elements.
//!
//! In: all forces of one state, in the frame of the columns. Out: their part of the potential energy, and its slopes by the poses
//! of the control elements.

use super::applied::{AppliedLoads, Point, PointForces, PointLoad, Pull, SharedLoads};
use crate::base::parts::PartWeights;
use crate::deform::memory::ModelMemory;
use crate::deform::model::{
    BodyState, ControlRest, DeformationModel, ModelEntry, PointResult, Response, StateAge,
};
use crate::deform::pose::frame::{ControlPose, ControlPoses, PoseSlope, axial};
use crate::green::{FIELDS, GreenFile, LOAD_COMPLIANCE, LoadMeta, MOMENTS, REACTION, TORQUES, Turning};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use std::sync::Arc;
use std::time::Duration;

type V3 = Vector3<f64>;

/// The reason why a body of such a model cannot have a compliance of its surface, and what to choose; `None` where it can.
pub fn refusal(model: &ModelEntry, has_compliance: bool) -> Option<String> {
    let name = model.name;
    (has_compliance && model.takes_points()).then(|| {
        format!(
            "\"{name}\" cannot use surface_compliance: its stiffness changes as the body bends, and forces at \
             rest do not add up. Leave it out, or write model = \"rotation\""
        )
    })
}

/// A model with loads.
pub struct Loaded {
    model: Box<dyn DeformationModel>,
    shared: SharedLoads,
    applied: AppliedLoads,
    work: LoadWork,
    points: PointForces,
    results: Vec<PointResult>,
    /// Poses of the last state.
    poses: ControlPoses,
}

impl Loaded {
    /// `model` with the loads that the file has of the body; its columns' frame turns with the control elements or stays. The error says why a table cannot be used.
    pub fn new(
        file: &Arc<GreenFile>,
        body: &str,
        model: Box<dyn DeformationModel>,
        turns: bool,
        controls: &[ControlRest],
        shared: &SharedLoads,
    ) -> Result<Loaded, String> {
        let meta = file.meta.bodies.get(body).ok_or("the body is not in the file")?;
        let (fields, count) = (FIELDS * controls.len(), meta.load_columns());
        let table = |name: &str, rows: usize| match file.table(body, name) {
            Some(table) if table.shape() == (rows, count) => Ok(table),
            None if count == 0 => Ok(DMatrix::zeros(rows, 0)),
            _ => Err(format!("table {name} of the loads cannot be used")),
        };
        Ok(Loaded {
            model,
            shared: shared.clone(),
            applied: AppliedLoads::default(),
            work: LoadWork {
                metas: meta.loads.clone(),
                origins: controls.iter().map(|control| control.origin).collect(),
                turns,
                reaction: table(REACTION, fields)?,
                compliance: table(LOAD_COMPLIANCE, count)?,
                moments: table(MOMENTS, 12)?,
                torques: table(TORQUES, 3 * (fields + count))?,
            },
            points: PointForces::new(file, body, count),
            results: Vec::new(),
            poses: vec![ControlPose::REST; controls.len()],
        })
    }

    /// Reads the loads that are applied now; keeps the last ones while a frame is just setting them.
    fn read(&mut self) {
        if let Ok(shared) = self.shared.try_lock() {
            self.applied.clone_from(&shared);
        }
    }

    /// All forces of a state of the model.
    fn exerted(&mut self, state: &BodyState) -> Exerted {
        let motion = state.body_from_surface();
        let rotation = motion.rotation.to_rotation_matrix();
        let shift = motion.translation.vector;
        let fields = FIELDS * self.work.origins.len();
        let c = DVector::from_fn(fields, |k, _| state.coefficients.get(k).copied().unwrap_or(0.0));
        let lambda = self.work.lambda(&self.applied.coefficients, &rotation);
        let applied = &self.applied.points;
        self.points.touch(applied);
        let points: Vec<Point> = applied.iter().map(|point| self.points.point(point, &c, &lambda)).collect();
        let forces = self.points.forces(applied, &points, &rotation, &shift);
        Exerted { rotation, shift, c, lambda, points, forces }
    }
}

impl DeformationModel for Loaded {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.read();
        self.poses.copy_from_slice(poses);
        let mut state = self.model.state(poses);
        let exerted = self.exerted(&state);
        self.points.spread(&exerted.points, &exerted.forces);
        let motion = Isometry3::from_parts(
            exerted.shift.into(),
            UnitQuaternion::from_rotation_matrix(&exerted.rotation),
        );
        let ends = self.points.ends(&exerted.points, &exerted.forces);
        let result = |(end, force): (&V3, &V3)| PointResult {
            place: motion.rotation * end + motion.translation.vector,
            force: motion.rotation * force,
        };
        self.results = ends.iter().zip(&exerted.forces).map(result).collect();
        state.coefficients.resize(self.points.before(), 0.0);
        state.coefficients.extend(exerted.lambda.iter());
        state
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.read();
        let response = self.model.respond(poses, slopes)?;
        let state = self.model.state(poses);
        let exerted = self.exerted(&state);
        let ends = self.points.ends(&exerted.points, &exerted.forces);
        let energy = self.work.act(&exerted, (&self.applied.points, &ends), poses, slopes);
        let is_defined = response.is_defined && !state.rotation_undefined;
        Some(Response { energy: response.energy + energy, is_defined })
    }

    fn memory(&self) -> ModelMemory {
        ModelMemory { poses: self.poses.clone(), ..self.model.memory() }
    }

    /// Restores the model's memory, with the loads that are applied now.
    fn set_memory(&mut self, memory: &ModelMemory) -> Result<(), String> {
        self.model.set_memory(memory)?;
        let poses = &memory.poses;
        if poses.len() == self.poses.len() {
            self.state(poses);
            // The same poses again leave what the model keeps of them, but for what it keeps where they have no frame.
            self.model.set_memory(memory)?;
        }
        Ok(())
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        self.points.field()
    }

    fn point_results(&self) -> &[PointResult] {
        &self.results
    }

    fn has_news(&mut self) -> bool {
        self.points.has_news() || self.model.has_news()
    }

    fn age(&self) -> Option<StateAge> {
        self.model.age()
    }

    fn is_inverted(&self) -> bool {
        self.model.is_inverted()
    }

    fn be_patient(&mut self, patience: Duration) {
        self.points.be_patient(patience);
        self.model.be_patient(patience);
    }

    fn part_weights(&self, rest: &[[f32; 3]]) -> Option<PartWeights> {
        self.model.part_weights(rest)
    }

    fn feel(&mut self) {
        self.model.feel();
    }

    fn forget(&mut self) {
        self.model.forget();
    }

    fn set_turn(&mut self, e: usize, turn: UnitQuaternion<f64>) {
        self.model.set_turn(e, turn);
    }
}

/// All forces of one state, in the frame of the columns.
pub struct Exerted {
    pub rotation: Rotation3<f64>,
    pub shift: V3,
    pub c: DVector<f64>,
    pub lambda: DVector<f64>,
    pub points: Vec<Point>,
    pub forces: Vec<V3>,
}

/// The tables of a body's loads.
pub struct LoadWork {
    pub metas: Vec<LoadMeta>,
    pub origins: Vec<V3>,
    /// Whether the columns' frame turns with the control elements.
    pub turns: bool,
    pub reaction: DMatrix<f64>,
    pub compliance: DMatrix<f64>,
    pub moments: DMatrix<f64>,
    pub torques: DMatrix<f64>,
}

impl LoadWork {
    /// The coefficients of the loads' columns in a frame that is turned by `rotation`.
    pub fn lambda(&self, coefficients: &[f64], rotation: &Rotation3<f64>) -> DVector<f64> {
        let mut all = DVector::zeros(self.reaction.ncols());
        let mut at = 0;
        for meta in &self.metas {
            let own = |i: usize| coefficients.get(at + i).copied().unwrap_or(0.0);
            match (meta.turning, meta.columns) {
                (Turning::Fixed, 3) => {
                    let turned = rotation.inverse() * V3::new(own(0), own(1), own(2));
                    all.rows_mut(at, 3).copy_from(&turned);
                }
                _ => (0..meta.columns).for_each(|i| all[at + i] = own(i)),
            }
            at += meta.columns;
        }
        all
    }

    /// The loads' part of the energy, and the forces' virtual work, which is taken from the slopes.
    pub fn act(
        &self,
        exerted: &Exerted,
        (pulls, ends): (&[PointLoad], &[V3]),
        poses: &[ControlPose],
        slopes: &mut [PoseSlope],
    ) -> f64 {
        let Exerted { rotation, shift, c, lambda, points, forces } = exerted;
        // The loads' resultant and moment about the centre; work by c.
        let (mut net, mut moments) = (V3::zeros(), Matrix3::zeros());
        let (mut torque, mut at) = (V3::zeros(), 0);
        for meta in &self.metas {
            for k in at..at + meta.columns {
                let own = self.moments.column(k);
                net += own.fixed_rows::<3>(0) * lambda[k];
                moments += Matrix3::from_row_slice(own.rows(3, 9).into_owned().as_slice()) * lambda[k];
                let by = self.torques.column(k);
                for (column, factor) in c.iter().chain(lambda.iter()).enumerate() {
                    torque += by.fixed_rows::<3>(3 * column) * (factor * lambda[k]);
                }
            }
            if meta.turning == Turning::Fixed && meta.columns == 3 {
                // Σ u × f of what point forces move, by reciprocity.
                let moved = |i: usize| -> f64 {
                    let by = points.iter().zip(forces);
                    by.map(|(point, force)| point.loads.fixed_view::<3, 1>(0, at + i).dot(force)).sum()
                };
                torque += V3::new(moved(0), moved(1), moved(2)).cross(&lambda.fixed_rows::<3>(at));
            }
            at += meta.columns;
        }
        torque += axial(&moments);
        let mut work = &self.reaction * lambda;
        let rigid =
            moments.trace() + (rotation * net).dot(shift) - rotation.matrix().dot(&moments.transpose());
        let compliant = &self.compliance * lambda;
        let mut energy = -work.dot(c) - 0.5 * lambda.dot(&compliant) - rigid;
        for (((point, force), end), pull) in points.iter().zip(forces).zip(ends).zip(pulls) {
            net += force;
            torque += end.cross(force);
            work += point.affine.tr_mul(force);
            // In the body; what points and other loads do with each other cancels against the loads' work.
            energy += 0.5 * force.dot(&(end - point.now));
            match pull.pull {
                Pull::Force(in_body) => {
                    energy -= in_body.dot(&(rotation * end + shift - point.rest));
                }
                Pull::Towards { spring, .. } => {
                    energy += spring.map_or(0.0, |spring| 0.5 * force.norm_squared() / spring);
                }
            }
        }
        self.take_work(exerted, poses, (net, torque, &work), slopes);
        energy
    }

    /// Takes the virtual work R F·δt + τ·w + h·δc, with δR = R \[w\], from the slopes by the poses.
    fn take_work(
        &self,
        exerted: &Exerted,
        poses: &[ControlPose],
        (net, torque, work): (V3, V3, &DVector<f64>),
        slopes: &mut [PoseSlope],
    ) {
        let Exerted { rotation, c, .. } = exerted;
        let matrix = rotation.matrix();
        let (mut rest, mut about) = (net, torque);
        for (e, slope) in slopes.iter_mut().enumerate() {
            let h = work.rows(FIELDS * e, FIELDS);
            let PoseSlope { translation: force, matrix: moment } = PoseSlope::of_numbers(h.as_slice());
            slope.translation -= matrix * force;
            slope.matrix -= matrix * moment;
            let own = c.rows(FIELDS * e, FIELDS);
            let place = self.origins[e] + V3::new(own[0], own[1], own[2]);
            let seen = Matrix3::from_row_slice(&own.as_slice()[3..]) + Matrix3::identity();
            rest -= force;
            about -= place.cross(&force) + axial(&(moment * seen.transpose()));
        }
        if !self.turns {
            return;
        }
        // t̄ = Σ (o + T - R̄ o)/E and R̄ = polar(A) of [`super::rotation`].
        let count = self.origins.len().max(1) as f64;
        let middle = self.origins.iter().sum::<V3>() / count;
        about -= middle.cross(&rest);
        let moved: Vec<V3> =
            self.origins.iter().zip(poses).map(|(origin, pose)| origin + pose.translation).collect();
        let moved_middle = moved.iter().sum::<V3>() / count;
        let square = self.origins.iter().map(|origin| (origin - middle).norm_squared()).sum::<f64>() / count;
        let mut a = poses.iter().map(|pose| pose.matrix).sum::<Matrix3<f64>>() / count;
        if square > 0.0 {
            for (origin, moved) in self.origins.iter().zip(&moved) {
                a += (moved - moved_middle) * (origin - middle).transpose() / (square * count);
            }
        }
        let stretch = matrix.transpose() * a;
        let stretch = (stretch + stretch.transpose()) * 0.5;
        let Some(inverse) = (Matrix3::from_diagonal_element(stretch.trace()) - stretch).try_inverse() else {
            return;
        };
        let spin = matrix * (inverse * about).cross_matrix() / count;
        for (slope, origin) in slopes.iter_mut().zip(&self.origins) {
            slope.translation -= matrix * rest / count;
            slope.matrix -= spin;
            if square > 0.0 {
                slope.translation -= spin * (origin - middle) / square;
            }
        }
    }
}
