//! The frame of a body that another effect presses: in steps, each tried again until the forces fit.
//!
//! In: the beginning of a frame, and for each step the forces at nodes. Out: the motion at the end of the frame, as [`Moving::step`]
//! leaves it without such forces.
//!
//! A force f at a node i acts on the coordinates by Nᵢᵀf with Nᵢ = (u⁽ᵏ⁾, φ) there, and on what the m modes leave out at once: the columns
//! of the compliance A⁻¹ less Φ ω⁻² Φᵀ.

use super::moving::{Course, Motion, Moving, Pressed, Stride, Strode};
use super::swing::between;
use super::system::System;
use crate::deform::{ControlPose, Deformer, PoseSlope};
use crate::green::FIELDS;
use crate::world::vibration::VibrationModes;
use nalgebra::{DMatrix, DVector, DVectorView, UnitQuaternion, Vector3};

impl Moving {
    /// Begins a frame; its length, s, or `None` where time does not go on.
    pub fn set_out(
        &mut self,
        time_s: f64,
        (poses, held): (Vec<ControlPose>, &[bool]),
        body: &Deformer,
    ) -> Option<f64> {
        let dt_s = self.time_to(time_s, &poses, held)?;
        let acting = body.slopes();
        let system = self.system_of(&poses, acting.is_some());
        self.system = Some(system);
        self.course = Some(Course {
            time_s,
            dt_s,
            start: self.motion.poses.clone(),
            acting: acting.unwrap_or_default().to_vec(),
            is_weight_alone: body.bears_weight_alone(),
            share: 0.0,
            tried: None,
            slopes: vec![PoseSlope::default(); poses.len()],
            poses,
        });
        Some(dt_s)
    }

    /// Whether an element moves by inertia in this frame.
    pub fn releases(&self, control: usize) -> bool {
        self.system.as_ref().is_some_and(|system| system.released.get(control) == Some(&true))
    }

    /// N of a node, 3 × coordinates; the columns of the modes begin at `first_mode`.
    pub fn shapes_at(&self, deformer: &Deformer, first_mode: usize, node: u32) -> DMatrix<f64> {
        let (columns, fields) = (deformer.columns_of(node), self.tables.fields());
        let column = |k: usize| columns.get(if k < fields { k } else { first_mode + k - fields });
        DMatrix::from_fn(3, self.tables.mass.nrows(), |axis, k| column(k).map_or(0.0, |column| column[axis]))
    }

    /// Motion of a node in each mode of what nothing prescribes, then in each φ.
    pub fn rows(&self, shapes: &DMatrix<f64>) -> Vec<Vector3<f64>> {
        let Some(system) = &self.system else { return Vec::new() };
        let of_modes = shapes * &system.all_from_own * system.coupled.shapes();
        let held = shapes.columns(self.tables.fields(), self.tables.modes());
        let vector = |column: DVectorView<'_, f64>| Vector3::new(column[0], column[1], column[2]);
        of_modes.column_iter().map(vector).chain(held.column_iter().map(vector)).collect()
    }

    /// The modes of all that nothing prescribes, at every node of the surface.
    pub fn vibration_modes(&self, system: &System, deformer: &Deformer, first_mode: usize) -> VibrationModes {
        let modes = &system.coupled.modes;
        let all_from_modes = &system.all_from_own * system.coupled.shapes();
        let mut shapes = vec![Vec::with_capacity(deformer.node_count()); modes.len()];
        for node in 0..deformer.node_count() as u32 {
            let of_node = self.shapes_at(deformer, first_mode, node) * &all_from_modes;
            for (shape, column) in shapes.iter_mut().zip(of_node.column_iter()) {
                shape.push(Vector3::from_fn(|axis, _| column[axis] as f32));
            }
        }
        VibrationModes {
            squares: modes.iter().map(|mode| mode.square).collect(),
            decays: modes.iter().map(|mode| mode.decay).collect(),
            shapes,
        }
    }

    /// The weights of [`Moving::rows`] in a step up to this share of the frame, if a force at its end acts with `part` of it in the mean.
    pub fn weights(&self, share: f64, part: f64) -> Vec<f64> {
        let (Some(system), Some(course)) = (&self.system, &self.course) else { return Vec::new() };
        let at_rest = self.tables.squares.iter().map(|square| -1.0 / square);
        let dt_s = (share - course.share) * course.dt_s;
        system.coupled.yields(dt_s).map(|by| by * part).chain(at_rest).collect()
    }

    /// Tries a step up to this share under pressing forces, in axes R that are turned by `turn` where it begins.
    pub fn tried(&mut self, share: f64, turn: &UnitQuaternion<f64>, pressed: &Pressed) -> &Motion {
        if let (Some(system), Some(mut course)) = (self.system.take(), self.course.take()) {
            let last = &self.motion;
            let goal = |e: usize| match (system.released[e], self.held[e] && course.poses[e].is_finite()) {
                (true, _) => last.poses[e],
                (false, true) => between(&course.start[e], &course.poses[e], share),
                (false, false) => course.poses[e],
            };
            let poses: Vec<ControlPose> = (0..course.poses.len()).map(goal).collect();
            let acting = self.acting(&course);
            let dt_s = (share - course.share) * course.dt_s;
            let (held, turn, is_weight_alone) = (&self.held, *turn, course.is_weight_alone);
            let stride =
                Stride { last, poses: &poses, held, turn, acting: &acting, is_weight_alone, pressed, dt_s };
            course.tried = Some((share, self.strode(&system, &stride)));
            (self.system, self.course) = (Some(system), Some(course));
        }
        let tried = self.course.as_ref().and_then(|course| course.tried.as_ref());
        tried.map_or(&self.motion, |(_, strode)| &strode.motion)
    }

    /// ∂V/∂P at the last poses, with V of the frame's beginning: in `linear` what the way from there adds by S.
    fn acting(&self, course: &Course) -> Vec<PoseSlope> {
        if !self.is_linear || course.share == 0.0 {
            return course.acting.clone();
        }
        let numbers = |poses: &[ControlPose]| -> DVector<f64> {
            DVector::from_iterator(FIELDS * poses.len(), poses.iter().flat_map(|pose| pose.coefficients()))
        };
        let way = numbers(&self.motion.poses) - numbers(&course.start);
        let fields = self.tables.fields();
        let more = self.tables.stiffness.view((0, 0), (fields, fields)) * way;
        let mut acting = course.acting.clone();
        for (slope, more) in acting.iter_mut().zip(more.as_slice().chunks_exact(FIELDS)) {
            let more = PoseSlope::of_numbers(more);
            slope.translation += more.translation;
            slope.matrix += more.matrix;
        }
        acting
    }

    /// Goes on from the step that was tried last.
    pub fn keep(&mut self) {
        let Some(course) = &mut self.course else { return };
        let Some((share, Strode { motion, vibration })) = course.tried.take() else { return };
        if self.is_heard {
            self.vibration.push(vibration);
        }
        for (mean, own) in course.slopes.iter_mut().zip(&motion.slopes) {
            mean.translation += own.translation * (share - course.share);
            mean.matrix += own.matrix * (share - course.share);
        }
        (course.share, self.motion) = (share, motion);
    }

    /// Ends the frame, if one was begun.
    pub fn arrive(&mut self) {
        let Some(Course { time_s, dt_s, start, poses, slopes, .. }) = self.course.take() else { return };
        let motion = Motion { frame_s: dt_s, slopes, ..std::mem::take(&mut self.motion) };
        self.motion.poses = start;
        self.take(motion, time_s, &poses);
    }

    /// Forces on all coordinates, in axes that are turned by `turn`, of forces at nodes with these N; nothing without.
    pub fn pressing<'a>(
        &self,
        turn: &UnitQuaternion<f64>,
        forces: impl Iterator<Item = (&'a DMatrix<f64>, Vector3<f64>)>,
    ) -> Vec<f64> {
        let mut sum = DVector::zeros(0);
        for (shapes, force) in forces {
            sum.resize_vertically_mut(self.tables.mass.nrows(), 0.0);
            let force = turn.inverse() * force;
            sum += shapes.tr_mul(&DVectorView::from_slice(force.as_slice(), 3));
        }
        sum.as_slice().to_vec()
    }
}
