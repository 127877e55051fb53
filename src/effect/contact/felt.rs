//! Contacts as a force device feels them: those of its tool, about the pose of a frame.
//!
//! In: the contacts of a frame, and the nodes near each tool. Out: a [`TouchPotential`] for each tool on a stylus with a force device:
//! its contacts, and ahead of them the spots that it can reach before the next frame, so that the force begins where they touch.

use super::backing::Backed;
use super::candidates::{Nodes, Places};
use super::detection::{distance, find};
use super::touch::{Against, Contact, fetch, nodes_of};
use super::touched_body::{SurfaceSpot, TouchedBody};
use crate::deform::{TouchPoint, TouchPotential, contact_axes};
use crate::stage::Stage;
use crate::world::World;
use crate::world::tool::Tool;
use nalgebra::Isometry3;
use std::sync::Arc;

/// Frames over which a tool is followed ahead, and the part of its thickness that it may move at least.
const AHEAD: f64 = 2.0;
const LEAST: f64 = 0.02;
/// Spots ahead at most: each needs its column.
const MOST_AHEAD: usize = 4;

/// A tool in a frame.
pub struct Touching<'a> {
    pub t: usize,
    /// Pose in the hand, and that of the surface, which yields to its spring.
    pub hand: Isometry3<f64>,
    pub surface: Isometry3<f64>,
    /// Contacts of all tools.
    pub contacts: &'a [Contact],
    /// Places of the nodes near tools.
    pub near: &'a [Places],
}

/// Tools that are felt.
pub struct Felt {
    tools: Vec<usize>,
    /// Nodes of each body near a tool, and by how far each tool has moved in this frame, m.
    near: Vec<Arc<Nodes>>,
    travels: Vec<f64>,
}

impl Felt {
    /// The tools whose stylus a force device of the stage moves, and that touch a body that is felt.
    pub fn new(bodies: &[TouchedBody], tools: &[Tool], stage: &Stage) -> Felt {
        let touches = |t: usize| bodies.iter().any(|body| body.is_felt && body.tools[t]);
        let is_felt = |t: &usize| tools[*t].place.has_device(stage) && touches(*t);
        Felt {
            tools: (0..tools.len()).filter(is_felt).collect(),
            near: Vec::new(),
            travels: vec![0.0; tools.len()],
        }
    }

    pub fn tools(&self) -> &[usize] {
        &self.tools
    }

    pub fn near(&self) -> &[Arc<Nodes>] {
        &self.near
    }

    /// Begins a frame: nothing has moved.
    pub fn rests(&mut self) {
        self.travels.fill(0.0);
    }

    /// Forgets the nodes near tools.
    pub fn forget(&mut self) {
        self.near.clear();
    }

    /// Takes the nodes near tools after a motion, and by how far each tool has moved, m.
    pub fn moved(&mut self, near: Vec<Arc<Nodes>>, travels: Vec<f64>) {
        if !self.tools.is_empty() {
            (self.near, self.travels) = (near, travels);
        }
    }

    /// The touch of a tool with all bodies that are felt, and the one of them that it presses most; `None` while its stylus is not seen,
    /// or starts at the eye, as the mouse's does: its tool does not go where the handle goes. The error says why a column cannot be
    /// read.
    pub fn touch(
        &self,
        touching: &Touching<'_>,
        (bodies, tools): (&mut [TouchedBody], &[Tool]),
        world: &World,
    ) -> Result<Option<(usize, TouchPotential)>, String> {
        let Touching { t, hand, surface, contacts: all, .. } = *touching;
        let Some((stylus, room_from_stylus)) = tools[t].place.in_hand(world) else { return Ok(None) };
        // What moves by inertia alone has no compliance by which it would be felt between frames.
        let is_own = |contact: &&Contact| {
            let body = &bodies[contact.body];
            contact.tool() == Some(t) && body.is_felt && body.has_columns(&contact.spot)
        };
        let mut contacts: Vec<Contact> = all.iter().filter(is_own).copied().collect();
        contacts.extend(self.ahead(touching, bodies, &tools[t]));
        fetch(bodies, &contacts)?;
        let strength = |contact: &&Contact| contact.force.norm();
        let strongest = contacts.iter().max_by(|a, b| strength(a).total_cmp(&strength(b)));
        let first = bodies.iter().position(|body| body.is_felt && body.tools[t]);
        let Some(body) = strongest.map(|contact| contact.body).or(first) else { return Ok(None) };
        let places: Vec<_> = (0..bodies.len())
            .map(|b| Places::pressed(bodies, all, b, nodes_of(&contacts, b).collect()))
            .collect();
        let points: Vec<TouchPoint> = contacts
            .iter()
            .map(|contact| {
                let body = &bodies[contact.body];
                let x = places[contact.body].of(&contact.spot);
                let (gap, normal) = distance(&tools[t].shape, &surface, &x);
                TouchPoint {
                    arm: x - surface.translation.vector,
                    axes: contact_axes(&normal),
                    friction: body.friction,
                    force: contact.force_in_room(bodies),
                    gap,
                    limit: f64::INFINITY,
                }
            })
            .collect();
        let backed = Backed::new(bodies, tools, &contacts, all);
        let compliance = |i: usize, j: usize| backed.between(i, j);
        Ok(Some((body, TouchPotential::new((stylus, room_from_stylus, hand), &points, &compliance))))
    }

    /// Spots without a contact that the tool can reach before the next frame, the nearest ones.
    fn ahead(&self, touching: &Touching<'_>, bodies: &[TouchedBody], tool: &Tool) -> Vec<Contact> {
        let Touching { t, surface, contacts, near, .. } = *touching;
        let mut spots = Vec::new();
        let felt = bodies
            .iter()
            .zip(near)
            .enumerate()
            .filter(|(_, (body, places))| body.is_felt && body.tools[t] && !places.is_empty());
        for (number, (body, places)) in felt {
            let reach = AHEAD * self.travels[t] + LEAST * tool.shape.thickness().min(body.longest());
            let outline = body.summed_places(&body.free);
            for spot in find(&tool.shape, &surface, body, (places.nodes(), places), &outline, reach).spots {
                let is_known = |contact: &Contact| {
                    (contact.body, contact.tool(), contact.spot.nodes) == (number, Some(t), spot.nodes)
                };
                if body.has_columns(&spot) && !contacts.iter().any(is_known) {
                    spots.push((distance(&tool.shape, &surface, &places.of(&spot)).0, number, spot));
                }
            }
        }
        spots.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
        let contact = |(_, body, spot): (f64, usize, SurfaceSpot)| Contact::new(body, spot, Against::Tool(t));
        spots.into_iter().take(MOST_AHEAD).map(contact).collect()
    }
}
