//! W of the contacts of a step: how each yields to a force at another.
//!
//! In: contacts with their bases, and the bodies and springs on which they lie. Out: for contacts i and j, each along its basis B,
//!
//! ```text
//! W_ij = Σ ± B_iᵀ R C R^T B_j + B_iᵀ B_j / k + what inertia adds
//! ```
//!
//! over the bodies on which both lie, with C between the nodes of their spots and R the turn of the body's columns, and k of the spring of a
//! tool that both press.

use super::inertial::Living;
use super::round::{Round, leads};
use super::touch::Contact;
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::solve::cone::Compliance;
use crate::world::tool::Tool;
use nalgebra::Matrix3;

/// Part of its own compliance by which a spot yields more that is not independent of the others.
const SKIN: f64 = 1e-3;

/// W of these contacts, each in its own basis, m/N, with their skins, and the compliance of each skin.
pub fn compliance<'a>(
    now: &'a Round<'_>,
    contacts: &'a [Contact],
    (turns, bases): (&'a [Matrix3<f64>], &'a [Matrix3<f64>]),
) -> (Compliance<'a>, Vec<f64>) {
    let living = Living::new(now.bodies, turns, contacts, bases);
    let at_rest = AtRest::new(now.bodies, now.step.tools, turns, (contacts, bases));
    let block = move |i: usize, j: usize| at_rest.block(i, j) + living.block(i, j);
    let mut diagonal: Vec<_> = (0..contacts.len()).map(|i| block(i, i)).collect();
    let with_skin = |(contact, block): (&Contact, &mut Matrix3<f64>)| {
        let skin = skin(now.bodies, contact, block);
        *block += Matrix3::from_diagonal_element(skin);
        skin
    };
    let skins = contacts.iter().zip(&mut diagonal).map(with_skin).collect();
    (Compliance::new(diagonal, block), skins)
}

/// Compliance of a contact beside that of its bodies, m/N. Contacts between nodes, and those of both surfaces at once, depend on one
/// another: a thin skin makes their forces unique.
fn skin(bodies: &[TouchedBody], contact: &Contact, own: &Matrix3<f64>) -> f64 {
    let yields = |(body, spot, _): (usize, SurfaceSpot, f64)| bodies[body].has_columns(&spot);
    let is_node = contact.spot.corners().count() == 1 && contact.sides().all(yields);
    let is_one_way = |(other, _)| other != contact.body && leads(bodies, [contact.body, other]);
    let is_alone = is_node && contact.other().is_none_or(is_one_way);
    if is_alone { 0.0 } else { SKIN * own.trace() / 3.0 }
}

/// The part of W without inertia.
struct AtRest<'a> {
    bodies: &'a [TouchedBody],
    bases: &'a [Matrix3<f64>],
    /// Spots that the contacts press, and of each contact the first one; last, their number.
    sides: Vec<Side>,
    firsts: Vec<usize>,
    /// Tool of each contact, and how it yields on its spring, m/N.
    springs: Vec<Option<(usize, f64)>>,
}

/// A spot that a contact presses.
struct Side {
    body: usize,
    /// Places of its nodes among the columns of the body, with their shares.
    corners: [(usize, f64); 3],
    count: usize,
    /// ± Rᵀ B.
    along: Matrix3<f64>,
}

impl<'a> AtRest<'a> {
    fn new(
        bodies: &'a [TouchedBody],
        tools: &[Tool],
        turns: &[Matrix3<f64>],
        (contacts, bases): (&[Contact], &'a [Matrix3<f64>]),
    ) -> AtRest<'a> {
        let (mut sides, mut firsts) = (Vec::with_capacity(2 * contacts.len()), vec![0]);
        for (contact, basis) in contacts.iter().zip(bases) {
            for (body, spot, sign) in contact.sides() {
                let along = turns[body].tr_mul(basis) * sign;
                let mut side = Side { body, corners: [(0, 0.0); 3], count: 0, along };
                for corner in bodies[body].slots(&spot) {
                    side.corners[side.count] = corner;
                    side.count += 1;
                }
                sides.push(side);
            }
            firsts.push(sides.len());
        }
        let spring = |contact: &Contact| {
            let tool = contact.tool()?;
            Some((tool, 1.0 / tools[tool].stiffness?))
        };
        AtRest { bodies, bases, sides, firsts, springs: contacts.iter().map(spring).collect() }
    }

    fn sides(&self, i: usize) -> &[Side] {
        &self.sides[self.firsts[i]..self.firsts[i + 1]]
    }

    fn block(&self, i: usize, j: usize) -> Matrix3<f64> {
        let mut block = Matrix3::zeros();
        for one in self.sides(i) {
            for other in self.sides(j) {
                if one.body == other.body {
                    block += one.along.tr_mul(&self.between(one, other)) * other.along;
                }
            }
        }
        match (self.springs[i], self.springs[j]) {
            (Some((one, yields)), Some((other, _))) if one == other => {
                block + self.bases[i].tr_mul(&self.bases[j]) * yields
            }
            _ => block,
        }
    }

    /// Compliance between two spots of a body along the axes of its columns.
    fn between(&self, one: &Side, other: &Side) -> Matrix3<f64> {
        let body = &self.bodies[one.body];
        let scale = body.room_from_body.scaling();
        let mut between = Matrix3::zeros();
        for (at, v) in &one.corners[..one.count] {
            for (from, w) in &other.corners[..other.count] {
                between += body.block(*at, *from) * (v * w * scale);
            }
        }
        between
    }
}
