//! Contact in the picture: the shapes of tools, and forces on hands and between bodies as arrows with their newtons.

use super::candidates::Places;
use super::touch::{Contact, force_on_tool};
use super::touched_body::TouchedBody;
use crate::render::{Drawable, Formed};
use crate::world::force_mark::{mark_force, unknown};
use crate::world::tool::Tool;
use crate::world::{Frame, World};
use nalgebra::{Isometry3, Point3, Vector3};

/// Part of a body's radius by which the pressed place yields where the arrow is longest.
const FULL_AT: f64 = 0.1;

/// Tools and contacts of a frame.
pub struct Shown<'a> {
    pub bodies: &'a [TouchedBody],
    pub tools: &'a [Tool],
    /// Bodies that touch each other, or themselves.
    pub pairs: &'a [[usize; 2]],
    /// Poses of the tools' surfaces.
    pub places: &'a [Option<Isometry3<f64>>],
    pub contacts: &'a [Contact],
}

impl<'a> Shown<'a> {
    /// Adds tools and forces to a frame.
    pub fn show(&self, world: &World, frame: &mut Frame) {
        for (t, (tool, pose)) in self.tools.iter().zip(self.places).enumerate() {
            let Some(pose) = pose else { continue };
            tool.place.hide_pen(world, frame);
            let (shape, color) = (tool.drawn.clone(), tool.color);
            let room_from_shape = pose.to_homogeneous().cast();
            frame.drawables.push(Drawable::Formed(Formed { shape, room_from_shape, color }));
            let own: Vec<&Contact> =
                self.contacts.iter().filter(|contact| contact.tool() == Some(t)).collect();
            let force = force_on_tool(t, self.bodies, self.contacts);
            self.show_force(&tool.name, (&own, force), world, frame);
        }
        for [one, two] in self.pairs {
            let is_own = |contact: &&Contact| {
                contact.other().is_some_and(|(other, _)| {
                    [contact.body, other] == [*one, *two] || [other, contact.body] == [*one, *two]
                })
            };
            let own: Vec<&Contact> = self.contacts.iter().filter(is_own).collect();
            let force = match one == two {
                true => self.within_itself(&own),
                false => own.iter().map(|contact| self.force_on(contact, *two)).sum(),
            };
            let [name, other] = [*one, *two].map(|body| &self.bodies[body].free.body);
            let words = if one == two { format!("{name} on itself") } else { format!("{name} on {other}") };
            self.show_force(&words, (&own, force), world, frame);
        }
    }

    /// Force of a contact of two bodies on one of them.
    fn force_on(&self, contact: &Contact, body: usize) -> Vector3<f64> {
        contact.force_in_room(self.bodies) * if contact.body == body { 1.0 } else { -1.0 }
    }

    /// Force with which a body presses itself: the nodes of both walls bear a share of it, one in the other's direction.
    fn within_itself(&self, contacts: &[&Contact]) -> Vector3<f64> {
        let forces = || contacts.iter().map(|contact| contact.force_in_room(self.bodies));
        let strongest = forces().max_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default();
        forces().map(|force| if force.dot(&strongest) < 0.0 { -force } else { force }).sum()
    }

    /// An arrow and a plate where these contacts press.
    fn show_force(
        &self,
        name: &str,
        (contacts, force): (&[&Contact], Vector3<f64>),
        world: &World,
        frame: &mut Frame,
    ) {
        let Some(place) = self.middle(contacts) else { return };
        let (full_n, words) = (self.full_n(contacts, world), unknown(name, force.norm()));
        mark_force((&place, &force), full_n, words, (world.assets.stage.workspace.radius_m, frame));
    }

    /// The force of the longest arrow: that at which the stiffest spot that yields does so by a part of its body's radius.
    fn full_n(&self, contacts: &[&Contact], world: &World) -> f64 {
        let of = |contact: &&Contact| {
            let body = &self.bodies[contact.body];
            let size = world.bodies[body.b].assets.ball.1 * body.room_from_body.scaling();
            FULL_AT * size / (body.between(&contact.spot, &contact.spot).trace() / 3.0)
        };
        contacts.iter().map(of).filter(|force| force.is_finite()).fold(0.0, f64::max)
    }

    /// Mean of the places of contacts, weighted with their forces.
    fn middle(&self, contacts: &[&Contact]) -> Option<Point3<f64>> {
        let of = |number: usize| {
            let nodes = contacts.iter().flat_map(|contact| contact.nodes_of(number)).collect();
            Places::pressed(self.bodies, self.contacts, number, nodes)
        };
        let places: Vec<_> = (0..self.bodies.len()).map(of).collect();
        let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
        for contact in contacts {
            let force = contact.force.norm();
            sum += places[contact.body].of(&contact.spot) * force;
            weight += force;
        }
        (weight > 0.0).then(|| Point3::from(sum / weight))
    }
}
