//! Contacts: spots of surfaces that touch tools or one another, their forces, and the compliance between them.
//!
//! A force at spot j, along the room's axes, moves spot i by R C R^T of each body on which both lie, with the sign of either side, and by 1/k
//! of a tool's spring that both press.

use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::world::tool::Tool;
use nalgebra::{DMatrix, Isometry3, Matrix3, Translation3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

type V3 = Vector3<f64>;

/// A contact of a spot of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Index among the touched bodies.
    pub body: usize,
    pub spot: SurfaceSpot,
    pub against: Against,
    /// Force on the body along the axes of its columns, N.
    #[serde(with = "crate::field::numbers")]
    pub force: V3,
    /// Force where the step began; zero for a contact that is new or was let go.
    #[serde(skip)]
    pub before: V3,
    /// Way that it has slipped in the step, m, and the work of friction on it, J.
    #[serde(skip)]
    pub slip: f64,
    #[serde(skip)]
    pub rubbed: f64,
}

/// Partner of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Against {
    /// A tool, by its index.
    Tool(usize),
    /// A spot of a body, which may be the same one.
    Surface { body: usize, spot: SurfaceSpot },
}

impl Contact {
    /// A contact without a force.
    pub fn new(body: usize, spot: SurfaceSpot, against: Against) -> Contact {
        let (force, before) = (V3::zeros(), V3::zeros());
        Contact { body, spot, against, force, before, slip: 0.0, rubbed: 0.0 }
    }

    /// Whether it presses a body that moves by inertia.
    pub fn lives(&self, bodies: &[TouchedBody]) -> bool {
        self.sides().any(|(body, ..)| bodies[body].inertial.is_some())
    }

    /// The tool that it touches.
    pub fn tool(&self) -> Option<usize> {
        match self.against {
            Against::Tool(tool) => Some(tool),
            Against::Surface { .. } => None,
        }
    }

    /// Touched body, and the spot there, where it is no tool.
    pub fn other(&self) -> Option<(usize, SurfaceSpot)> {
        match self.against {
            Against::Tool(_) => None,
            Against::Surface { body, spot } => Some((body, spot)),
        }
    }

    /// The spots that it presses, each with its body and the sign of the force there.
    pub fn sides(&self) -> impl Iterator<Item = (usize, SurfaceSpot, f64)> + use<> {
        let other = self.other().map(|(body, spot)| (body, spot, -1.0));
        std::iter::once((self.body, self.spot, 1.0)).chain(other)
    }

    /// Nodes of a body that have a share in it.
    pub fn nodes_of(&self, body: usize) -> impl Iterator<Item = u32> + use<> {
        let own = self.sides().filter(move |(side, ..)| *side == body);
        own.flat_map(|(_, spot, _)| spot.corners()).map(|(node, _)| node)
    }

    /// Part with which the force at the end of a step acts in the mean over it, beside that at its beginning. Normal forces on surfaces that
    /// were apart give a body no energy if it is a half or more; with a half they take none, but forces that jump from step to step do
    /// not fade.
    pub const PART_OF_END: f64 = 0.6;

    /// Contact with its force in the mean over the step.
    pub fn in_the_mean(&self) -> Contact {
        let force = self.force * Contact::PART_OF_END + self.before * (1.0 - Contact::PART_OF_END);
        Contact { force, ..*self }
    }

    /// Force along the room's axes on the first body, N.
    pub fn force_in_room(&self, bodies: &[TouchedBody]) -> V3 {
        bodies[self.body].turn() * self.force
    }
}

/// Forces of the contacts at spots of a body, along the axes of its columns, N.
pub fn at_spots(bodies: &[TouchedBody], contacts: &[Contact], body: usize) -> Vec<(SurfaceSpot, V3)> {
    let of = |contact: &Contact| {
        let force = match contact.body == body {
            true => contact.force,
            false => bodies[body].turn().inverse() * contact.force_in_room(bodies),
        };
        contact
            .sides()
            .filter(move |(side, ..)| *side == body)
            .map(move |(_, spot, sign)| (spot, force * sign))
    };
    contacts.iter().flat_map(of).collect()
}

/// Forces of the contacts at single nodes of a body.
pub fn at_nodes(bodies: &[TouchedBody], contacts: &[Contact], body: usize) -> Vec<(u32, V3)> {
    let mut all: BTreeMap<u32, V3> = BTreeMap::new();
    let pressing = |(_, force): &(SurfaceSpot, V3)| *force != V3::zeros();
    for (spot, force) in at_spots(bodies, contacts, body).into_iter().filter(pressing) {
        spot.corners().for_each(|(node, w)| *all.entry(node).or_default() += force * w);
    }
    all.into_iter().collect()
}

/// Force of the bodies on a tool, in the room, N.
pub fn force_on_tool(tool: usize, bodies: &[TouchedBody], contacts: &[Contact]) -> V3 {
    let own = contacts.iter().filter(|contact| contact.tool() == Some(tool));
    -own.map(|contact| contact.force_in_room(bodies)).sum::<V3>()
}

/// A tool where its spring holds it.
pub fn shifted(pose: &Isometry3<f64>, by: &V3) -> Isometry3<f64> {
    Translation3::from(*by) * pose
}

/// Makes sure that the columns of all contacts are there. The error says why one cannot be read.
pub fn fetch(bodies: &mut [TouchedBody], contacts: &[Contact]) -> Result<(), String> {
    for (number, body) in bodies.iter_mut().enumerate() {
        body.fetch(nodes_of(contacts, number))?;
    }
    Ok(())
}

/// Nodes of a body that have a share in contacts.
pub fn nodes_of(contacts: &[Contact], body: usize) -> impl Iterator<Item = u32> + use<'_> {
    contacts.iter().flat_map(move |contact| contact.nodes_of(body))
}

/// Displacement of one contact by a force at another, along the room's axes, m/N: that of its spot against what it touches.
pub fn compliance_between(
    bodies: &[TouchedBody],
    tools: &[Tool],
    turns: &[Matrix3<f64>],
    (a, b): (&Contact, &Contact),
) -> Matrix3<f64> {
    let mut block = Matrix3::zeros();
    for (body, at, sign) in a.sides() {
        for (_, from, other_sign) in b.sides().filter(|(other, ..)| *other == body) {
            let turn = &turns[body];
            block += turn * bodies[body].between(&at, &from) * turn.transpose() * (sign * other_sign);
        }
    }
    let spring = a.tool().filter(|_| a.tool() == b.tool()).and_then(|tool| tools[tool].stiffness);
    if let Some(k) = spring {
        block += Matrix3::from_diagonal_element(1.0 / k);
    }
    block
}

/// W of these contacts, each in its own basis, 3n × 3n, m/N.
pub fn compliance(
    bodies: &[TouchedBody],
    tools: &[Tool],
    contacts: &[Contact],
    bases: &[Matrix3<f64>],
) -> DMatrix<f64> {
    let (turns, size) = (turns(bodies), 3 * contacts.len());
    let mut w = DMatrix::zeros(size, size);
    for (i, a) in contacts.iter().enumerate() {
        for (j, b) in contacts.iter().enumerate().take(i + 1) {
            let block = bases[i].tr_mul(&compliance_between(bodies, tools, &turns, (a, b))) * bases[j];
            w.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
            w.fixed_view_mut::<3, 3>(3 * j, 3 * i).copy_from(&block.transpose());
        }
    }
    w
}

/// Turns of the bodies from the axes of their columns to those of the room.
pub fn turns(bodies: &[TouchedBody]) -> Vec<Matrix3<f64>> {
    bodies.iter().map(|body| body.turn().into_inner()).collect()
}

/// Coefficient of friction of a contact; that of two bodies is the geometric mean of theirs.
pub fn friction(bodies: &[TouchedBody], contact: &Contact) -> f64 {
    let own = bodies[contact.body].friction;
    contact.other().map_or(own, |(other, _)| (own * bodies[other].friction).sqrt())
}
