//! Touched bodies that move by their inertia.
//!
//! In: what gives a body its inertia, and the forces of contacts. Out: the body at the end of a step under these forces, and how it
//! yields to them until then, beside the columns of its nodes.

use super::response::Response;
use super::touch::{Contact, at_nodes, nodes_of};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::deform::ControlPose;
use crate::world::inertia::{Gone, Inertia, StepForces};
use nalgebra::{DMatrix, Matrix3, UnitQuaternion, Vector3};

type V3 = Vector3<f64>;

/// The inertia of each touched body; `None` of one that has none, or for which time stands.
pub type Inertias<'a> = Vec<Option<&'a mut dyn Inertia>>;

/// Begins a step of all bodies with inertia that ends at this share of the frame.
pub fn begin(bodies: &mut [TouchedBody], inertias: &Inertias<'_>, share: f64) {
    for (body, inertia) in bodies.iter_mut().zip(inertias) {
        if let (Some(inertial), Some(inertia)) = (&mut body.inertial, inertia) {
            inertial.turn = body.free.state.body_from_surface().rotation;
            inertial.weights = inertia.weights(share, Contact::PART_OF_END);
        }
    }
}

/// Makes sure that what moves the nodes of all contacts by inertia is there.
pub fn fetch(bodies: &mut [TouchedBody], inertias: &Inertias<'_>, contacts: &[Contact]) {
    for (number, (body, inertia)) in bodies.iter_mut().zip(inertias).enumerate() {
        if let (Some(inertial), Some(inertia)) = (&mut body.inertial, inertia) {
            inertial.fetch(&**inertia, &body.free, nodes_of(contacts, number));
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

/// Poses of the control elements of bodies with inertia at the end of the last step; none of another one.
pub fn poses(inertias: &Inertias<'_>) -> Vec<Vec<ControlPose>> {
    let of = |inertia: &Option<&mut dyn Inertia>| inertia.as_ref().map(|inertia| inertia.now().poses);
    inertias.iter().map(of).map(Option::unwrap_or_default).collect()
}

/// Ends the step.
pub fn keep(inertias: &mut Inertias<'_>) {
    inertias.iter_mut().flatten().for_each(|inertia| inertia.keep());
}

/// The part of W that follows from the inertia of the bodies: Σ_k w_k r_ik r_jkᵀ ([`Inertia`]).
pub struct Living {
    /// r of each contact along its basis, coordinates × 3n, and these times their weights, of each body with inertia.
    bodies: Vec<[DMatrix<f64>; 2]>,
}

impl Living {
    pub fn new(
        bodies: &[TouchedBody],
        turns: &[Matrix3<f64>],
        contacts: &[Contact],
        bases: &[Matrix3<f64>],
    ) -> Living {
        let mut all = Vec::new();
        for (number, (body, turn)) in bodies.iter().zip(turns).enumerate() {
            let Some(inertial) = &body.inertial else { continue };
            let mut rows = DMatrix::zeros(inertial.weights.len(), 3 * contacts.len());
            for (i, (contact, basis)) in contacts.iter().zip(bases).enumerate() {
                for (_, spot, sign) in contact.sides().filter(|(side, ..)| *side == number) {
                    let along = basis.tr_mul(turn) * sign;
                    for (k, row) in inertial.rows_of(spot.corners()).into_iter().enumerate() {
                        let mut own = rows.fixed_view_mut::<1, 3>(k, 3 * i);
                        own += (along * row).transpose();
                    }
                }
            }
            let scale = body.room_from_body.scaling();
            let mut weighted = rows.clone();
            for mut column in weighted.column_iter_mut() {
                column.iter_mut().zip(&inertial.weights).for_each(|(row, w)| *row *= *w * scale);
            }
            all.push([rows, weighted]);
        }
        Living { bodies: all }
    }

    /// Displacement of a contact by a force at another, m/N.
    pub fn block(&self, i: usize, j: usize) -> Matrix3<f64> {
        let of = |[rows, weighted]: &[DMatrix<f64>; 2]| {
            let [one, other] = [weighted.fixed_columns::<3>(3 * i), rows.fixed_columns::<3>(3 * j)];
            Matrix3::from_fn(|r, k| one.column(r).dot(&other.column(k)))
        };
        self.bodies.iter().map(of).sum()
    }
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
        self.inertial = inertia.map(|_| Response::default());
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
