//! Touched bodies that move by their inertia.
//!
//! In: what gives a body its inertia, and the forces of contacts. Out: the body at the end of a step under these forces, and how it
//! yields to them until then, beside the columns of its nodes.

use super::touch::{Contact, at_nodes};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::deform::Deformer;
use crate::world::inertia::{Gone, Inertia};
use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// The inertia of each touched body; `None` of one that has none, or for which time stands.
pub type Inertias<'a> = Vec<Option<&'a mut dyn Inertia>>;

/// Response of a body in a step.
#[derive(Default)]
pub struct Inertial {
    /// r of nodes.
    rows: BTreeMap<u32, DMatrix<f64>>,
    /// w.
    weights: Vec<f64>,
    /// Axes of the columns where the step begins, body_from_columns.
    turn: UnitQuaternion<f64>,
    /// Forces under which it has come to where it is, along the axes of the columns.
    forces: Vec<(u32, V3)>,
}

impl Inertial {
    /// Displacement of one node by a force at another until the end of the step, beyond that of the columns, m/N.
    pub fn block(&self, at: u32, from: u32) -> Matrix3<f64> {
        let Some((at, from)) = self.rows.get(&at).zip(self.rows.get(&from)) else { return Matrix3::zeros() };
        let mut sum = Matrix3::zeros();
        for ((at, from), w) in at.column_iter().zip(from.column_iter()).zip(&self.weights) {
            sum += at * from.transpose() * *w;
        }
        sum
    }

    /// Makes sure that the rows of these nodes are there.
    pub fn fetch(&mut self, inertia: &dyn Inertia, deformer: &Deformer, nodes: impl Iterator<Item = u32>) {
        for node in nodes {
            self.rows.entry(node).or_insert_with(|| inertia.rows(deformer, node));
        }
    }
}

/// Begins a step of all bodies with inertia that ends at this share of the frame.
pub fn begin(bodies: &mut [TouchedBody], inertias: &Inertias<'_>, share: f64) {
    for (body, inertia) in bodies.iter_mut().zip(inertias) {
        if let (Some(inertial), Some(inertia)) = (&mut body.inertial, inertia) {
            inertial.turn = body.free.state.body_from_surface().rotation;
            inertial.weights = inertia.weights(share);
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
        let mut forces = at_nodes(bodies, contacts, number);
        forces.iter_mut().for_each(|(_, force)| *force = now * *force);
        let gone = inertia.go(share, &turn, &bodies[number].free, &forces);
        bodies[number].follow(&**inertia, &gone);
        let back = bodies[number].turn().inverse() * turned;
        let own = contacts.iter_mut().filter(|contact| contact.body == number);
        own.for_each(|contact| contact.force = back * contact.force);
        let in_columns = bodies[number].free.state.body_from_surface().rotation.inverse();
        forces.iter_mut().for_each(|(_, force)| *force = in_columns * *force);
        if let Some(inertial) = &mut bodies[number].inertial {
            inertial.forces = forces;
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
        let by =
            |node: u32| inertial.forces.iter().map(move |(from, force)| inertial.block(node, *from) * force);
        let sum: V3 = spot.corners().map(|(node, w)| by(node).sum::<V3>() * w).sum();
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

    /// Begins a frame with inertia, or without.
    pub fn set_inertia(&mut self, inertia: Option<&dyn Inertia>) {
        self.inertial = inertia.map(|_| Inertial::default());
        for e in 0..self.free.controls.len() {
            let moves = inertia.is_some_and(|inertia| inertia.moves(e));
            for node in self.free.control_nodes(e) {
                self.takes[*node as usize] = moves;
            }
        }
    }
}
