//! Loads on a body: coefficients of further columns, forces at single points, and what all of them do to control elements.
//!
//! In: the state that a model makes of the poses, and the [`AppliedLoads`]. Out: the same state with the loads' coefficients
//! behind the model's own, the displacements that point forces cause, and the potential energy
//!
//! ```text
//! V = ½ cᵀ S c - fᵀ U c - ½ fᵀ A⁻¹ f - (work in the body's rigid motion)
//! ```
//!
//! (f: all nodal forces in the frame of the columns, U: the affine fields over all nodes). Its derivative by the poses is that
//! of the model's energy less the forces' virtual work, f · δ(R (X + u_c + u_f) + t) with u_f held: by reciprocity that by c is
//! -Uᵀ f. Loads that turn with the body have no potential; theirs is the virtual work alone. A point that is held gets the
//! force that brings it to its place, by the compliance of all held points together.

use super::frames::{PoseSlope, axial};
use super::model::{
    BodyState, ControlRest, DeformationModel, Frame, Kind, ModelEntry, PointResult, Response, StateAge,
};
use super::pose::ControlPose;
use crate::base::notice::notice;
use crate::base::parts::PartWeights;
use crate::green::{
    AFFINE, FIELDS, GreenFile, LOAD_COMPLIANCE, LoadMeta, MOMENTS, REACTION, TORQUES, Turning, Yield,
};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

type V3 = Vector3<f64>;

/// Whether a model can carry loads: its whole displacement is the sum of the affine columns in one frame.
pub fn carries_loads(model: &ModelEntry) -> bool {
    let is_affine = matches!(model.requirements, [family] if family.name == AFFINE.name);
    is_affine && matches!(model.kind, Kind::Online(_)) && model.frame != Frame::Solved
}

/// Why a body of such a model has no loads, and what to choose.
pub fn refusal(model: &ModelEntry) -> String {
    let name = model.name;
    if let Kind::Background(_) = model.kind {
        return format!(
            "\"{name}\" has loads (gravity, centrifugal, thermal, load) in `greenstage deform` alone, where it is solved anew: in a \
             session write model = \"rotation\" or model = \"linear\", and list \"ghost_equilibrium\" to see how far it is off"
        );
    }
    format!(
        "\"{name}\" cannot carry loads (gravity, centrifugal, thermal, load and surface_compliance), whose columns are those of \
         small strain: write model = \"rotation\" or model = \"linear\", or leave the loads out"
    )
}

/// All loads of a body as they are now, in the body's frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AppliedLoads {
    /// One for each column of the family `loads`; what is left out is 0.
    pub coefficients: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub points: Vec<PointLoad>,
}

/// A force at one point of the surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PointLoad {
    /// The point is the mean of these nodes of the surface with these weights.
    pub nodes: [u32; 3],
    pub weights: [f64; 3],
    pub pull: Pull,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Pull {
    /// N, along the body's axes.
    Force(#[serde(with = "crate::field::numbers")] V3),
    /// Towards a place, m about the body's centre, by a spring, N/m; without one the point is there.
    Towards {
        #[serde(with = "crate::field::numbers")]
        place: V3,
        spring: Option<f64>,
    },
}

/// Loads that a body's models share: set by frames, read by force loops.
pub type SharedLoads = Arc<Mutex<AppliedLoads>>;

/// A part of the largest compliance that is added to that of each held point, so that two hands may hold the same one.
const RIDGE: f64 = 1e-9;

/// A model with loads.
pub struct Loaded {
    model: Box<dyn DeformationModel>,
    file: Arc<GreenFile>,
    body: String,
    shared: SharedLoads,
    applied: AppliedLoads,
    metas: Vec<LoadMeta>,
    origins: Vec<V3>,
    turns: bool,
    /// Columns of the file before those of loads.
    before: usize,
    reaction: DMatrix<f64>,
    compliance: DMatrix<f64>,
    moments: DMatrix<f64>,
    torques: DMatrix<f64>,
    /// Of nodes that take forces: where their columns stand, and those of nodes that are touched.
    places: BTreeMap<u32, usize>,
    touched: BTreeMap<u32, Yield>,
    field: Option<Vec<[f32; 3]>>,
    field_of: Vec<(u32, V3)>,
    results: Vec<PointResult>,
}

/// One point in the frame of the columns.
struct Point {
    nodes: [u32; 3],
    weights: [f64; 3],
    /// Its place at rest, and with the displacements of all columns.
    rest: V3,
    now: V3,
    /// The affine columns' and the loads' displacements there: 3 × 12 E and 3 × K.
    affine: DMatrix<f64>,
    loads: DMatrix<f64>,
}

/// All forces of one state, in the frame of the columns.
struct Exerted {
    rotation: Rotation3<f64>,
    shift: V3,
    c: DVector<f64>,
    lambda: DVector<f64>,
    points: Vec<Point>,
    forces: Vec<V3>,
}

impl Loaded {
    /// `model` with the loads that the file has of the body. The error says why a table cannot be used.
    pub fn new(
        file: &Arc<GreenFile>,
        body: &str,
        model: Box<dyn DeformationModel>,
        entry_turns: bool,
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
        let nodes = meta.surface_nodes;
        let columns = |group: &crate::base::columns::ColumnGroup<'_>| group.columns(nodes).unwrap_or(0);
        let all: usize = file.groups(body).iter().map(columns).sum();
        let places = file.compliance(body).map(|compliance| compliance.places());
        Ok(Loaded {
            model,
            shared: shared.clone(),
            applied: AppliedLoads::default(),
            metas: meta.loads.clone(),
            origins: controls.iter().map(|control| control.origin).collect(),
            turns: entry_turns,
            before: all - count,
            reaction: table(REACTION, fields)?,
            compliance: table(LOAD_COMPLIANCE, count)?,
            moments: table(MOMENTS, 12)?,
            torques: table(TORQUES, 3 * (fields + count))?,
            field: places.is_some().then(|| vec![[0.0; 3]; nodes]),
            places: places.unwrap_or_default(),
            touched: BTreeMap::new(),
            field_of: Vec::new(),
            results: Vec::new(),
            body: body.to_owned(),
            file: file.clone(),
        })
    }

    /// What is applied now; that of the last time where a frame is just setting it.
    fn read(&mut self) {
        if let Ok(shared) = self.shared.try_lock() {
            self.applied.clone_from(&shared);
        }
    }

    /// The coefficients of the loads' columns in a frame that is turned by `rotation`.
    fn lambda(&self, rotation: &Rotation3<f64>) -> DVector<f64> {
        let mut all = DVector::zeros(self.reaction.ncols());
        let mut at = 0;
        for meta in &self.metas {
            let own = |i: usize| self.applied.coefficients.get(at + i).copied().unwrap_or(0.0);
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

    /// All forces of a state of the model.
    fn exerted(&mut self, state: &BodyState) -> Exerted {
        let motion = state.body_from_surface();
        let rotation = motion.rotation.to_rotation_matrix();
        let shift = motion.translation.vector;
        let fields = FIELDS * self.origins.len();
        let c = DVector::from_fn(fields, |k, _| state.coefficients.get(k).copied().unwrap_or(0.0));
        let lambda = self.lambda(&rotation);
        let applied = std::mem::take(&mut self.applied.points);
        self.touch(&applied);
        let points: Vec<Point> = applied.iter().map(|point| self.point(point, &c, &lambda)).collect();
        let forces = self.forces(&applied, &points, &rotation, &shift);
        self.applied.points = applied;
        Exerted { rotation, shift, c, lambda, points, forces }
    }

    /// Reads the columns of nodes that are touched now, and drops those of others.
    fn touch(&mut self, points: &[PointLoad]) {
        let now: Vec<u32> = points.iter().flat_map(corners).map(|(node, _)| node).collect();
        self.touched.retain(|node, _| now.contains(node));
        let Some(compliance) = self.file.compliance(&self.body) else { return };
        for node in now.into_iter().filter(|node| !self.touched.contains_key(node)).collect::<BTreeSet<_>>() {
            let Some(place) = self.places.get(&node) else { continue };
            match compliance.column(*place) {
                Ok(column) => drop(self.touched.insert(node, column)),
                Err(error) => {
                    notice!("{error}; node {node} of the surface takes no force");
                    self.places.remove(&node);
                }
            }
        }
    }

    fn point(&self, point: &PointLoad, c: &DVector<f64>, lambda: &DVector<f64>) -> Point {
        let (file, body) = (&self.file, &self.body);
        let (rest, nodes) = (file.rest(body), file.rest(body).len());
        let groups = file.groups(body);
        let place: V3 =
            corners(point).map(|(node, w)| Vector3::from(rest[node as usize]).cast::<f64>() * w).sum();
        // The affine groups stand first, those of loads behind all that models have.
        let width = |group: &crate::base::columns::ColumnGroup<'_>| group.columns(nodes).unwrap_or(0);
        let starts =
            groups.iter().scan(0, |start, group| Some(std::mem::replace(start, *start + width(group))));
        let (mut affine, mut loads) = (DMatrix::zeros(3, c.len()), DMatrix::zeros(3, lambda.len()));
        for (group, start) in groups.iter().zip(starts.collect::<Vec<_>>()) {
            let target = match start {
                start if start < c.len() => Some((&mut affine, start)),
                start if start >= self.before => Some((&mut loads, start - self.before)),
                _ => None,
            };
            let Some((matrix, first)) = target else { continue };
            for k in 0..width(group) {
                for (node, w) in corners(point) {
                    for axis in 0..3 {
                        let value = group.value(nodes, k, 3 * node as usize + axis);
                        matrix[(axis, first + k)] += w * f64::from(value);
                    }
                }
            }
        }
        let moved = &affine * c + &loads * lambda;
        Point {
            nodes: point.nodes,
            weights: point.weights,
            rest: place,
            now: place + V3::new(moved[0], moved[1], moved[2]),
            affine,
            loads,
        }
    }

    /// C_ab: what a force at point `b` does at point `a`.
    fn between(&self, a: &Point, b: &Point) -> Matrix3<f64> {
        let mut all = Matrix3::zeros();
        for (from, w) in b.nodes.iter().zip(b.weights).filter(|(_, w)| *w != 0.0) {
            let Some(column) = self.touched.get(from) else { continue };
            for (to, v) in a.nodes.iter().zip(a.weights).filter(|(_, v)| *v != 0.0) {
                let block = &column[*to as usize];
                all += Matrix3::from_fn(|axis, force| f64::from(block[axis][force])) * (v * w);
            }
        }
        all
    }

    /// The force at each point: as it is given, or what brings the point to its place.
    fn forces(
        &self,
        applied: &[PointLoad],
        points: &[Point],
        rotation: &Rotation3<f64>,
        shift: &V3,
    ) -> Vec<V3> {
        let inverse = rotation.inverse();
        let mut forces = vec![V3::zeros(); points.len()];
        let mut held = Vec::new();
        for (i, point) in applied.iter().enumerate() {
            match point.pull {
                Pull::Force(force) => forces[i] = inverse * force,
                Pull::Towards { place, spring } => held.push((i, inverse * (place - shift), spring)),
            }
        }
        if held.is_empty() {
            return forces;
        }
        let size = 3 * held.len();
        let (mut matrix, mut missing) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for (row, (i, place, spring)) in held.iter().enumerate() {
            let given = (0..points.len()).filter(|j| held.iter().all(|(held, ..)| held != j));
            let by_forces: V3 = given.map(|j| self.between(&points[*i], &points[j]) * forces[j]).sum();
            missing.rows_mut(3 * row, 3).copy_from(&(place - points[*i].now - by_forces));
            for (column, (j, ..)) in held.iter().enumerate() {
                let block = self.between(&points[*i], &points[*j]);
                matrix.view_mut((3 * row, 3 * column), (3, 3)).copy_from(&block);
            }
            let softness = spring.map_or(0.0, |spring| 1.0 / spring);
            (0..3).for_each(|axis| matrix[(3 * row + axis, 3 * row + axis)] += softness);
        }
        let ridge = RIDGE * matrix.diagonal().amax();
        (0..size).for_each(|i| matrix[(i, i)] += ridge);
        if let Some(found) = matrix.lu().solve(&missing).filter(|found| found.iter().all(|f| f.is_finite())) {
            for (row, (i, ..)) in held.iter().enumerate() {
                forces[*i] = V3::new(found[3 * row], found[3 * row + 1], found[3 * row + 2]);
            }
        }
        forces
    }

    /// Where every point ends up, in the frame of the columns.
    fn ends(&self, exerted: &Exerted) -> Vec<V3> {
        let of = |a: &Point| {
            let pulled: V3 =
                exerted.points.iter().zip(&exerted.forces).map(|(b, f)| self.between(a, b) * f).sum();
            a.now + pulled
        };
        exerted.points.iter().map(of).collect()
    }

    /// Brings the displacements that point forces cause up to date.
    fn spread(&mut self, exerted: &Exerted) {
        let Some(field) = &mut self.field else { return };
        let mut at_nodes: BTreeMap<u32, V3> = BTreeMap::new();
        for (point, force) in exerted.points.iter().zip(&exerted.forces) {
            for (node, w) in point.nodes.iter().zip(point.weights).filter(|(_, w)| *w != 0.0) {
                *at_nodes.entry(*node).or_default() += force * w;
            }
        }
        let at_nodes: Vec<(u32, V3)> = at_nodes.into_iter().collect();
        if at_nodes == self.field_of {
            return;
        }
        field.fill([0.0; 3]);
        for (node, force) in &at_nodes {
            let (Some(column), f) = (self.touched.get(node), force.cast::<f32>()) else { continue };
            for (u, block) in field.iter_mut().zip(column) {
                for (u, row) in u.iter_mut().zip(block) {
                    *u += row[0] * f.x + row[1] * f.y + row[2] * f.z;
                }
            }
        }
        self.field_of = at_nodes;
    }

    /// The loads' part of the energy, and the forces' virtual work, which is taken from the slopes.
    fn act(&self, exerted: &Exerted, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> f64 {
        let Exerted { rotation, shift, c, lambda, points, forces } = exerted;
        let ends = self.ends(exerted);
        // The loads' resultant and moment about the centre, those that turn inside the body left out; work by c.
        let (mut net, mut moments) = (V3::zeros(), Matrix3::zeros());
        let (mut torque, mut at) = (V3::zeros(), 0);
        for meta in &self.metas {
            for k in at..at + meta.columns {
                if meta.turning == Turning::Inner {
                    continue;
                }
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
        for (((point, force), end), pull) in points.iter().zip(forces).zip(&ends).zip(&self.applied.points) {
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
            let (force, moment) = (V3::new(h[0], h[1], h[2]), Matrix3::from_row_slice(&h.as_slice()[3..]));
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

/// Nodes of a point that have a share in it, with that share.
fn corners(point: &PointLoad) -> impl Iterator<Item = (u32, f64)> + use<> {
    point.nodes.into_iter().zip(point.weights).filter(|(_, w)| *w != 0.0)
}

impl DeformationModel for Loaded {
    fn state(&mut self, poses: &[ControlPose]) -> BodyState {
        self.read();
        let mut state = self.model.state(poses);
        let exerted = self.exerted(&state);
        self.spread(&exerted);
        let motion = Isometry3::from_parts(
            exerted.shift.into(),
            UnitQuaternion::from_rotation_matrix(&exerted.rotation),
        );
        let ends = self.ends(&exerted);
        let result = |(end, force): (&V3, &V3)| PointResult {
            place: motion.rotation * end + motion.translation.vector,
            force: motion.rotation * force,
        };
        self.results = ends.iter().zip(&exerted.forces).map(result).collect();
        state.coefficients.resize(self.before, 0.0);
        state.coefficients.extend(exerted.lambda.iter());
        state
    }

    fn respond(&mut self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> Option<Response> {
        self.read();
        let response = self.model.respond(poses, slopes)?;
        let state = self.model.state(poses);
        let exerted = self.exerted(&state);
        let energy = self.act(&exerted, poses, slopes);
        let is_defined = response.is_defined && !state.rotation_undefined;
        Some(Response { energy: response.energy + energy, is_defined })
    }

    fn field(&self) -> Option<&[[f32; 3]]> {
        self.field.as_deref()
    }

    fn point_results(&self) -> &[PointResult] {
        &self.results
    }

    fn has_news(&mut self) -> bool {
        self.model.has_news()
    }

    fn age(&self) -> Option<StateAge> {
        self.model.age()
    }

    fn wait_for_background(&mut self) {
        self.model.wait_for_background();
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

/// Sets what is applied; false where it is as it was.
pub fn set(shared: &SharedLoads, loads: &AppliedLoads) -> bool {
    let mut applied = shared.lock().unwrap_or_else(PoisonError::into_inner);
    let differs = *applied != *loads;
    if differs {
        applied.clone_from(loads);
    }
    differs
}
