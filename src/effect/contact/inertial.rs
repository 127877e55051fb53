//! Touched bodies that move by their inertia.
//!
//! In: what gives a body its inertia, and the forces of contacts. Out: the body at the end of a step under these forces, and how it
//! yields to them until then, beside the columns of its nodes.

use super::touch::{Contact, at_nodes};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::deform::Deformer;
use crate::world::inertia::{Gone, Inertia, StepForces};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// The inertia of each touched body; `None` of one that has none, or for which time stands.
pub type Inertias<'a> = Vec<Option<&'a mut dyn Inertia>>;

/// Response of a body in a step.
#[derive(Default)]
pub struct Inertial {
    /// r of nodes.
    rows: BTreeMap<u32, Vec<V3>>,
    /// w.
    weights: Vec<f64>,
    /// Axes of the columns where the step begins, body_from_columns.
    turn: UnitQuaternion<f64>,
    /// Forces at the end of the step under which it has come to where it is, along the axes of the columns.
    forces: Vec<(u32, V3)>,
    /// Σ_j w_k r_jkᵀ f_j of these forces, once their rows are there.
    moved: Vec<f64>,
}

impl Inertial {
    /// Displacement of one node by a force at another until the end of the step, beyond that of the columns, m/N.
    pub fn block(&self, at: u32, from: u32) -> Matrix3<f64> {
        let Some((at, from)) = self.rows.get(&at).zip(self.rows.get(&from)) else { return Matrix3::zeros() };
        let each = at.iter().zip(from).zip(&self.weights);
        each.fold(Matrix3::zeros(), |sum, ((at, from), w)| sum + at * (from * *w).transpose())
    }

    /// Makes sure that the rows of these nodes are there, and of those at which forces act.
    pub fn fetch(&mut self, inertia: &dyn Inertia, deformer: &Deformer, nodes: impl Iterator<Item = u32>) {
        let pressed = self.forces.iter().map(|(node, _)| *node);
        for node in nodes.chain(pressed) {
            self.rows.entry(node).or_insert_with(|| inertia.rows(deformer, node));
        }
        self.moved.clear();
        self.moved.resize(self.weights.len(), 0.0);
        for (node, force) in &self.forces {
            let of_node = self.moved.iter_mut().zip(&self.rows[node]).zip(&self.weights);
            of_node.for_each(|((sum, row), w)| *sum += w * row.dot(force));
        }
    }

    /// Displacement of a node by the present forces, m.
    fn displacement(&self, node: u32) -> V3 {
        let rows = self.rows.get(&node).map_or(&[][..], Vec::as_slice);
        rows.iter().zip(&self.moved).map(|(row, moved)| row * *moved).sum()
    }
}

/// Begins a step of all bodies with inertia that ends at this share of the frame.
pub fn begin(bodies: &mut [TouchedBody], inertias: &Inertias<'_>, share: f64) {
    for (body, inertia) in bodies.iter_mut().zip(inertias) {
        if let (Some(inertial), Some(inertia)) = (&mut body.inertial, inertia) {
            inertial.turn = body.free.state.body_from_surface().rotation;
            inertial.weights = inertia.weights(share, Contact::PART_OF_END);
        }
    }
}

/// Moves all bodies with inertia to this share of the frame under the forces of the contacts, which stay as they are in the room.
pub fn go(bodies: &mut [TouchedBody], inertias: &mut Inertias<'_>, share: f64, contacts: &mut [Contact]) {
    for (number, inertia) in inertias.iter_mut().enumerate() {
        let Some(inertia) = inertia else { continue };
        let Some(turn) = bodies[number].inertial.as_ref().map(|inertial| inertial.turn) else { continue };
        let turned = bodies[number].turn();
        let now = bodies[number].free.state.body_from_surface().rotation;
        let mean: Vec<Contact> = contacts.iter().map(Contact::in_the_mean).collect();
        let along = |contacts: &[Contact]| -> Vec<(u32, V3)> {
            at_nodes(bodies, contacts, number).into_iter().map(|(node, force)| (node, now * force)).collect()
        };
        let (mean, mut end) = (along(&mean), along(contacts));
        let forces = StepForces { mean: &mean, end: &end };
        let gone = inertia.go(share, &turn, &bodies[number].free, forces);
        bodies[number].follow(&**inertia, &gone);
        let back = bodies[number].turn().inverse() * turned;
        let own = contacts.iter_mut().filter(|contact| contact.body == number);
        own.for_each(|contact| {
            contact.force = back * contact.force;
            contact.before = back * contact.before;
        });
        let in_columns = bodies[number].free.state.body_from_surface().rotation.inverse();
        end.iter_mut().for_each(|(_, force)| *force = in_columns * *force);
        if let Some(inertial) = &mut bodies[number].inertial {
            inertial.forces = end;
        }
    }
}

/// Ends the step.
pub fn keep(inertias: &mut Inertias<'_>) {
    inertias.iter_mut().flatten().for_each(|inertia| inertia.keep());
}

impl TouchedBody {
    /// Displacement in the room of a spot that the present forces bring about by inertia, m.
    pub fn moved_by_inertia(&self, spot: &SurfaceSpot) -> V3 {
        let Some(inertial) = &self.inertial else { return V3::zeros() };
        let sum: V3 = spot.corners().map(|(node, w)| inertial.displacement(node) * w).sum();
        self.turn() * sum * self.room_from_body.scaling()
    }

    /// Takes what its inertia has come to. True if that has moved it.
    pub fn follow(&mut self, inertia: &dyn Inertia, gone: &Gone) -> bool {
        let mut contribution = self.others.clone();
        if let Some(own) = contribution.coefficients.get_mut(inertia.columns()) {
            own.iter_mut().zip(&gone.amplitudes).for_each(|(own, amplitude)| *own = *amplitude);
        }
        self.free.contribute(&contribution);
        self.free.take(&gone.poses)
    }

    /// Axes of the columns, body_from_columns, of a body with inertia.
    pub fn turn_of_inertia(&self) -> Option<UnitQuaternion<f64>> {
        self.inertial.as_ref().map(|_| self.free.state.body_from_surface().rotation)
    }

    /// Begins a frame with inertia, or without.
    pub fn set_inertia(&mut self, inertia: Option<&dyn Inertia>) {
        self.inertial = inertia.map(|_| Inertial::default());
        if inertia.is_none() && !std::mem::take(&mut self.has_lived) {
            return;
        }
        self.has_lived = inertia.is_some();
        for e in 0..self.free.controls.len() {
            let moves = inertia.is_some_and(|inertia| inertia.moves(e));
            for node in self.free.control_nodes(e) {
                self.takes[*node as usize] = moves;
            }
        }
    }
}
