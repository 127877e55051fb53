//! Loads on a body whose shape is no sum of columns: their forces, shared among the places that its equilibrium knows.
//!
//! In: the forces at nodes ([`LoadForces`]), a model's own sharing of a force at a place X among its slots, what is applied, and the
//! poses. Out: for each slot s the sum Σ f φ_s(X) along the body's axes, so that the forces' work on x = Σ_s φ_s(X) a_s is
//! Σ_s a_s · (Σ f φ_s); behind the slots of the model those of the control elements, f and f ⊗ (X - o_e) of the nodes that each
//! holds. Loads that follow the body turn with the mean turn of its control elements ([`mean_rotation`]).

use super::acting::Acting;
use super::applied::AppliedLoads;
use super::borne::{Borne, SLOTS};
use crate::deform::frames::PoseSlope;
use crate::deform::memory::{ModelMemory, Unknowns};
use crate::deform::model::{ColumnsAt, ControlRest, ModelInput};
use crate::deform::pose::ControlPose;
use crate::deform::rotation::mean_rotation;
use crate::green::{LoadForces, Turning};
use nalgebra::{DMatrix, Matrix3, Rotation3, UnitQuaternion, Vector3};

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
        let forces = LoadForces::of(input.table, input.controls.len(), acting.columns())?;
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
