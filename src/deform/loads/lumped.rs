//! Loads on a body whose shape is no sum of columns: their forces, shared among the places that its equilibrium knows.
//!
//! In: the forces at nodes ([`LoadForces`]), a model's own sharing of a force at a place X among its slots, what is applied, and the
//! poses. Out: for each slot s the sum Σ f φ_s(X) along the body's axes, so that the forces' work on x = Σ_s φ_s(X) a_s is
//! Σ_s a_s · (Σ f φ_s); behind the slots of the model those of the control elements, f and f ⊗ (X - o_e) of the nodes that each
//! holds. Loads that follow the body turn with the mean turn of its control elements ([`mean_rotation`]).
//!
//! The load on a frame of a section or an interface ([`Borne`]), with N = Σ f and M = Σ f ⊗ a of forces at arms a from the frame,
//! along the body's axes, has the potential -(N·x + M : R) of the frame (x, R), with derivatives by a motion exp (v, ω) along the
//! frame's own axes, of x + R (v + ½ ω × v) and R (1 + ω̂ + ½ ω̂²).
//!
//! On a body that is solved anew ([`NodalLoads`]) they are forces over all nodes, N, along the body's axes, that keep their
//! directions while a pose is solved, and warmth that lengthens what is free; pressure is that on the area at rest.

use super::applied::{AppliedLoads, StaticForces};
use super::in_frame::Acting;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{ColumnsAt, ControlRest, ModelInput};
use crate::deform::models::rotation::mean_rotation;
use crate::deform::pose::frame::{ControlPose, PoseSlope, axial};
use crate::deform::pose::se3::{blocks, joined};
use crate::fem::NodeFields;
use crate::green::{self, GreenError, LoadForces, LoadMeta, Turning};
use crate::mesh::TetMesh;
use crate::scene::Scene;
use nalgebra::{DMatrix, Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3, Vector6};

type V3 = Vector3<f64>;

/// The share φ_s(X) of each slot in a force at X.
pub type Shares = Box<dyn Fn(&V3) -> Vec<(usize, f64)> + Send>;

pub struct Lumped {
    acting: Acting,
    surface: ColumnsAt,
    shares: Shares,
    controls: Vec<ControlRest>,
    /// Slots of the model, before those of control elements and Σ f ⊗ X.
    own: usize,
    table: DMatrix<f64>,
    fixed: Vec<V3>,
    follows: Vec<V3>,
    all: Vec<V3>,
    /// Rotation by which loads that follow the body are turned.
    mean: Rotation3<f64>,
}

impl Lumped {
    /// `None` where nothing may act on the body.
    pub fn new(input: &ModelInput<'_>, own: usize, shares: Shares) -> Result<Option<Lumped>, String> {
        let Some(loads) = input.loads else { return Ok(None) };
        let acting = Acting::new(&loads);
        let forces = LoadForces::read(input.table, input.controls.len(), acting.columns())?;
        let slots = own + SLOTS * input.controls.len() + 3;
        let mut table = DMatrix::zeros(3 * slots, acting.columns());
        for (node, (place, held)) in forces.places.iter().zip(&forces.held).enumerate() {
            let mut at = match held {
                None => shares(place),
                Some(e) => Borne::shares(own + SLOTS * e, 1.0, &(place - input.controls[*e].origin)).to_vec(),
            };
            at.extend((0..3).map(|axis| (slots - 3 + axis, place[axis])));
            for (slot, share) in at {
                for column in 0..acting.columns() {
                    for axis in 0..3 {
                        table[(3 * slot + axis, column)] += share * forces.forces[(3 * node + axis, column)];
                    }
                }
            }
        }
        Ok(Some(Lumped {
            acting,
            surface: loads.surface.clone(),
            shares,
            controls: input.controls.to_vec(),
            own,
            table,
            fixed: vec![V3::zeros(); slots],
            follows: vec![V3::zeros(); slots],
            all: vec![V3::zeros(); slots],
            mean: Rotation3::identity(),
        }))
    }

    /// Reads what is applied; whether it has changed.
    pub fn read(&mut self) -> bool {
        let has_changed = self.acting.read();
        if has_changed {
            self.gather();
        }
        has_changed
    }

    /// Count of the numbers that [`Lumped::keep`] adds.
    pub const KEPT: usize = 9;

    /// Adds what is applied, and how it is turned.
    pub fn keep(&self, memory: &mut ModelMemory) {
        memory.loads = Some(self.acting.applied.clone());
        memory.put(self.mean.matrix());
    }

    /// Goes on from what was applied, where the memory has it.
    pub fn take_back(&mut self, applied: Option<&AppliedLoads>, unknowns: &mut Unknowns<'_>) {
        let mean = Rotation3::from_matrix_unchecked(unknowns.take());
        if let Some(applied) = applied {
            self.acting.applied.clone_from(applied);
            self.mean = mean;
            self.gather();
        }
    }

    pub fn is_none(&self) -> bool {
        self.acting.is_none()
    }

    /// Thermal strain: the relative elongation of the body where it is free.
    pub fn strain(&self) -> f64 {
        self.acting.strain()
    }

    fn gather(&mut self) {
        self.fixed.fill(V3::zeros());
        self.follows.fill(V3::zeros());
        self.acting.add(&self.table, Turning::Fixed, &mut self.fixed);
        self.acting.add(&self.table, Turning::Follows, &mut self.follows);
        let behind = self.fixed.len() - 3;
        for (point, force) in self.acting.points() {
            let corners = point.nodes.iter().zip(point.weights).filter(|(_, w)| *w != 0.0);
            let place: V3 = corners.map(|(node, w)| (self.surface)(*node).0 * w).sum();
            for (slot, share) in (self.shares)(&place) {
                self.fixed[slot] += force * share;
            }
            (0..3).for_each(|axis| self.fixed[behind + axis] += force * place[axis]);
        }
        self.turn();
    }

    /// Turns what follows the body with the control elements in poses to which they have turned so.
    pub fn follow(&mut self, poses: &[ControlPose], turns: &[UnitQuaternion<f64>]) {
        if let Some(mean) = mean_rotation(&self.controls, poses, turns) {
            self.mean = mean;
            self.turn();
        }
    }

    fn turn(&mut self) {
        for ((all, fixed), follows) in self.all.iter_mut().zip(&self.fixed).zip(&self.follows) {
            *all = fixed + self.mean * follows;
        }
    }

    /// The model's own slots.
    pub fn slots(&self) -> &[V3] {
        &self.all[..self.own]
    }

    /// Takes the work on what control elements hold from the slopes; the potential of that, and of where all forces rest.
    pub fn hold(&self, poses: &[ControlPose], slopes: &mut [PoseSlope]) -> f64 {
        let mut potential = Matrix3::from_columns(&self.all[self.all.len() - 3..]).trace();
        let held = self.controls.iter().zip(poses).zip(slopes).enumerate();
        for (e, ((control, pose), slope)) in held {
            let Borne { force, moments } = Borne::of_slots(&self.all[self.own + SLOTS * e..]);
            potential -= force.dot(&(control.origin + pose.translation)) + moments.dot(&pose.matrix);
            slope.translation -= force;
            slope.matrix -= moments;
        }
        potential
    }
}

/// Slots of a frame in a list of shares: N, then the three columns of M.
pub const SLOTS: usize = 4;

/// N and M.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Borne {
    pub force: V3,
    pub moments: Matrix3<f64>,
}

impl Borne {
    /// Reads the [`SLOTS`] of a frame.
    pub fn of_slots(slots: &[V3]) -> Borne {
        Borne { force: slots[0], moments: Matrix3::from_columns(&slots[1..SLOTS]) }
    }

    /// The share of a force in the slots of a frame from `first` on; `arm` is already multiplied by the share.
    pub fn shares(first: usize, share: f64, arm: &V3) -> [(usize, f64); SLOTS] {
        [(first, share), (first + 1, arm.x), (first + 2, arm.y), (first + 3, arm.z)]
    }

    /// J.
    pub fn potential(&self, place: &V3, turn: &UnitQuaternion<f64>) -> f64 {
        -self.force.dot(place) - self.moments.dot(turn.to_rotation_matrix().matrix())
    }

    /// This load along the frame's own axes.
    pub fn along(&self, turn: &UnitQuaternion<f64>) -> Borne {
        let inverse = turn.inverse().to_rotation_matrix();
        Borne { force: inverse * self.force, moments: inverse.matrix() * self.moments }
    }

    /// Minus the slope of the potential by (v, ω), of a load along the frame's own axes: force and torque.
    pub fn wrench(&self) -> Vector6<f64> {
        joined(&self.force, &axial(&self.moments))
    }

    /// Minus the second derivative of the potential by (v, ω), of a load along the frame's own axes.
    pub fn curvature(&self) -> Matrix6<f64> {
        let symmetric = (self.moments + self.moments.transpose()) * 0.5;
        let turning = symmetric - Matrix3::from_diagonal_element(self.moments.trace());
        let mixed = self.force.cross_matrix() * 0.5;
        blocks(&Matrix3::zeros(), &mixed, &mixed.transpose(), &turning)
    }
}

/// The columns of a body's loads over all nodes of its mesh.
#[derive(Clone)]
pub struct NodalLoads(Vec<Column>);

#[derive(Clone)]
struct Column {
    turning: Turning,
    /// Empty of warmth.
    force: Vec<V3>,
}

impl NodalLoads {
    pub fn new(scene: &Scene, name: &str, mesh: &TetMesh) -> Result<NodalLoads, GreenError> {
        let mut columns = Vec::new();
        for load in scene.body[name].loads() {
            let turning = LoadMeta::new(&load).turning;
            match turning {
                Turning::Inner => columns.push(Column { turning, force: Vec::new() }),
                Turning::Fixed | Turning::Follows => {
                    let forces = green::nodal_forces(scene, name, mesh, &load)?;
                    columns.extend(forces.into_iter().map(|force| Column { turning, force }));
                }
            }
        }
        Ok(NodalLoads(columns))
    }

    /// Loads from the table of a file: the forces of each column over all nodes, x, y and z of one after another.
    pub fn of_table(metas: &[LoadMeta], forces: &DMatrix<f64>) -> NodalLoads {
        let turnings = metas.iter().flat_map(|meta| std::iter::repeat_n(meta.turning, meta.columns));
        let column = |(turning, forces): (Turning, &[f64])| Column {
            turning,
            force: forces.chunks_exact(3).map(V3::from_column_slice).collect(),
        };
        let rows = forces.nrows().max(1);
        NodalLoads(turnings.zip(forces.as_slice().chunks_exact(rows)).map(column).collect())
    }

    /// Factor by which warmth lengthens the body where it is free.
    pub fn stretch(&self, of: &StaticForces) -> f64 {
        let all = self.0.iter().zip(&of.coefficients);
        1.0 + all.filter(|(column, _)| column.turning == Turning::Inner).map(|(_, c)| c).sum::<f64>()
    }

    /// All forces in poses to which control elements have turned so.
    pub fn forces(
        &self,
        of: &StaticForces,
        nodes: usize,
        controls: &[ControlRest],
        poses: &[ControlPose],
        turns: &[UnitQuaternion<f64>],
    ) -> NodeFields {
        let follows = |column: &Column| column.turning == Turning::Follows;
        let mean = self.0.iter().any(follows).then(|| mean_rotation(controls, poses, turns)).flatten();
        let mean = mean.unwrap_or_else(Rotation3::identity);
        let mut all = NodeFields::zeros(nodes, 1);
        let mut add = |node: usize, force: V3| {
            all.data[3 * node..][..3].iter_mut().zip(force.iter()).for_each(|(all, own)| *all += own);
        };
        for (column, c) in self.0.iter().zip(&of.coefficients).filter(|(_, c)| **c != 0.0) {
            for (node, force) in column.force.iter().enumerate() {
                add(node, if follows(column) { mean * force * *c } else { force * *c });
            }
        }
        for (node, force) in &of.at_nodes {
            add(*node as usize, *force);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::random::Random;

    /// The derivatives against differences of the potential along a motion of the frame.
    #[test]
    fn derivatives_are_those_of_the_potential() {
        let mut random = Random::default();
        let mut vector = || V3::from_fn(|_, _| random.draw());
        let load = Borne { force: vector(), moments: Matrix3::from_columns(&[vector(), vector(), vector()]) };
        let (place, turn) = (vector(), UnitQuaternion::from_scaled_axis(vector()));
        let (v, w) = (vector(), vector());
        let at = |t: f64| {
            let (v, w) = (v * t, w * t);
            load.potential(
                &(place + turn * (v + w.cross(&v) * 0.5)),
                &(turn * UnitQuaternion::from_scaled_axis(w)),
            )
        };
        let own = load.along(&turn);
        let motion = joined(&v, &w);
        let (slope, second) = (-own.wrench().dot(&motion), -motion.dot(&(own.curvature() * motion)));
        let h = 1e-4;
        let (high, low, here) = (at(h), at(-h), at(0.0));
        assert!(((high - low) / (2.0 * h) - slope).abs() < 1e-7, "{slope}");
        assert!(((high - 2.0 * here + low) / (h * h) - second).abs() < 1e-6, "{second}");
    }
}
