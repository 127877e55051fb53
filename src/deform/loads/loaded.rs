//! A model with loads: its own state, with the loads' coefficients and the displacements of point forces added.

use super::applied::{AppliedLoads, SharedLoads};
use super::points::{Point, PointForces};
use super::work::{Exerted, LoadWork};
use crate::base::parts::PartWeights;
use crate::deform::frames::PoseSlope;
use crate::deform::memory::ModelMemory;
use crate::deform::model::{
    BodyState, ControlRest, DeformationModel, ModelEntry, PointResult, Response, StateAge,
};
use crate::deform::pose::{ControlPose, ControlPoses};
use crate::green::{FIELDS, GreenFile, LOAD_COMPLIANCE, MOMENTS, REACTION, TORQUES};
use nalgebra::{DMatrix, DVector, Isometry3, UnitQuaternion, Vector3};
use std::sync::Arc;
use std::time::Duration;

type V3 = Vector3<f64>;

/// The reason why a body of such a model cannot have a compliance of its surface, and what to choose; `None` where it can.
pub fn refusal(model: &ModelEntry, has_compliance: bool) -> Option<String> {
    let name = model.name;
    (has_compliance && model.takes_points()).then(|| {
        format!(
            "\"{name}\" has no surface_compliance: that adds up what single forces do at rest, and sums are answers of a linear body \
             alone (the principle of superposition); the stiffness of \"{name}\" changes as the body bends. Leave it out \
             (`greenstage deform` has forces at points without), or write model = \"rotation\""
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
