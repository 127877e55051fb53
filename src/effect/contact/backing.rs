//! Compliance between contacts while others hold: a body that lies on another one yields less to a tool.
//!
//! In: contacts between surfaces with their forces. Out: W_ij - W_ip W_pp⁻¹ W_pj for two contacts i and j of a tool, with p the directions in
//! which surfaces hold each other: that of the force without friction, and all with it, as if they stuck.

use super::touch::{Contact, compliance, compliance_between, friction, turns};
use super::touched_body::TouchedBody;
use crate::world::tool::Tool;
use nalgebra::{DMatrix, Matrix3, Vector3};

type V3 = Vector3<f64>;

/// Part of the mean compliance by which directions that depend on one another yield more.
const SKIN: f64 = 1e-3;
/// Contacts between surfaces that count, the strongest ones.
const MOST: usize = 60;

/// The compliance between contacts of tools, others of the same bodies given.
pub struct Backed<'a> {
    bodies: &'a [TouchedBody],
    tools: &'a [Tool],
    contacts: &'a [Contact],
    turns: Vec<Matrix3<f64>>,
    /// L⁻¹ W_pi of each contact, 3 columns, with L the factor of W_pp.
    taken: Vec<DMatrix<f64>>,
}

impl<'a> Backed<'a> {
    /// `contacts` are those between which it is asked for, `all` those of the frame.
    pub fn new(
        bodies: &'a [TouchedBody],
        tools: &'a [Tool],
        contacts: &'a [Contact],
        all: &[Contact],
    ) -> Backed<'a> {
        let turns = turns(bodies);
        let holding = strongest(all);
        let directions: Vec<Matrix3<f64>> =
            holding.iter().map(|contact| directions(bodies, contact)).collect();
        let count = 3 * holding.len();
        let mut w = compliance(bodies, tools, &holding, &directions);
        let skin = SKIN * w.trace() / count.max(1) as f64;
        (0..count).for_each(|i| w[(i, i)] += skin);
        // The skin makes W_pp positive definite.
        let factor = w.cholesky().map(|factor| factor.unpack());
        let taken = |contact: &Contact| {
            let mut rows = DMatrix::zeros(count, 3);
            for (i, a) in holding.iter().enumerate() {
                let moved = directions[i].tr_mul(&compliance_between(bodies, tools, &turns, (a, contact)));
                rows.fixed_view_mut::<3, 3>(3 * i, 0).copy_from(&moved);
            }
            factor
                .as_ref()
                .and_then(|factor| factor.solve_lower_triangular(&rows))
                .unwrap_or_else(|| rows * 0.0)
        };
        let taken = contacts.iter().map(taken).collect();
        Backed { bodies, tools, contacts, turns, taken }
    }

    /// Compliance between two of the contacts, along the room's axes, m/N.
    pub fn between(&self, i: usize, j: usize) -> Matrix3<f64> {
        let pair = (&self.contacts[i], &self.contacts[j]);
        let taken = self.taken[i].tr_mul(&self.taken[j]);
        compliance_between(self.bodies, self.tools, &self.turns, pair) - taken.fixed_view::<3, 3>(0, 0)
    }
}

/// The contacts between surfaces that press most.
fn strongest(all: &[Contact]) -> Vec<Contact> {
    let holds = |contact: &&Contact| contact.other().is_some() && contact.force != V3::zeros();
    let mut holding: Vec<Contact> = all.iter().filter(holds).copied().collect();
    holding.sort_by(|a, b| b.force.norm().total_cmp(&a.force.norm()));
    holding.truncate(MOST);
    holding
}

/// Unit vectors in columns, in the room, along which a contact with a force holds; zero where it does not.
fn directions(bodies: &[TouchedBody], contact: &Contact) -> Matrix3<f64> {
    if friction(bodies, contact) > 0.0 {
        return Matrix3::identity();
    }
    let mut along = Matrix3::zeros();
    along.set_column(0, &contact.force_in_room(bodies).normalize());
    along
}
