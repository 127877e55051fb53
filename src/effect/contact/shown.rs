//! What is seen of tools: their shapes, and the force on the hand as an arrow with its newtons.

use super::running::Contacts;
use super::system::force_on_tool;
use super::tool::Tool;
use crate::base::plates::{Anchor, Plate};
use crate::base::quantity::quantity;
use crate::interact::force_arrow;
use crate::render::{Arrow, Drawable, Formed};
use crate::world::{Frame, World};
use nalgebra::{Point3, Vector3};

/// Radius of an arrow's shaft and length of the longest arrow, against the workspace's radius.
const SHAFT: f64 = 0.012;
const LONGEST: f64 = 0.6;
/// Part of a body's radius by which the pressed place yields where the arrow is longest.
const FULL_AT: f64 = 0.1;
/// Linear.
const COLOR: [f32; 3] = [0.25, 0.85, 0.75];

/// Adds the tools to a frame.
pub fn show(contacts: &Contacts, world: &World, frame: &mut Frame) {
    let radius_m = world.assets.stage.workspace.radius_m;
    for (t, (tool, placed)) in contacts.tools.iter().zip(&contacts.motion.tools).enumerate() {
        let Some(pose) = placed.surface() else { continue };
        hide_pen(tool, world, frame);
        let room_from_shape = pose.to_homogeneous().cast();
        frame.drawables.push(Drawable::Formed(Formed {
            shape: tool.drawn.clone(),
            room_from_shape,
            color: tool.color,
        }));
        let own = || contacts.motion.contacts.iter().filter(|contact| contact.tool == t);
        let force = force_on_tool(t, &contacts.bodies, &contacts.motion.contacts);
        let Some(place) = middle(contacts, t) else { continue };
        let soft = own().map(|contact| {
            let body = &contacts.bodies[contact.body];
            let size = world.bodies[body.b].assets.ball.1 * body.room_from_body.scaling();
            FULL_AT * size / (body.between(&contact.spot(), &contact.spot()).trace() / 3.0)
        });
        let full_n = soft.fold(0.0, f64::max);
        if let Some(arrow) = force_arrow(&place, &force, full_n, LONGEST * radius_m) {
            frame.drawables.push(Drawable::Arrow(Arrow {
                from: arrow.from.cast(),
                along: arrow.along.cast(),
                radius_m: (SHAFT * radius_m) as f32,
                color: COLOR,
                through: true,
            }));
        }
        let words = format!("{}: {}, error unknown", tool.name, quantity(force.norm(), "N"));
        frame.drawables.push(Drawable::Plate(Plate::new(Anchor::Place(place.into()), words)));
    }
}

/// Mean of the places at which a tool touches, weighted with the forces there.
fn middle(contacts: &Contacts, tool: usize) -> Option<Point3<f64>> {
    let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
    for contact in contacts.motion.contacts.iter().filter(|contact| contact.tool == tool) {
        let force = contact.force.norm();
        for (node, w) in contact.spot().corners() {
            sum += contacts.place(contact.body, node) * (w * force);
        }
        weight += force;
    }
    (weight > 0.0).then(|| Point3::from(sum / weight))
}

/// Takes away the pen and the ray of the stylus that carries a tool: the hand holds that instead. One that is pressed keeps its ray.
fn hide_pen(tool: &Tool, world: &World, frame: &mut Frame) {
    let carrier = tool.carrier(world).map(|stylus| stylus.room_from_stylus.cast::<f64>().to_homogeneous());
    let Some(pen) = carrier.map(|pose| pose.cast::<f32>()) else { return };
    let is_pen = |drawable: &Drawable| {
        drawable.stylus().is_some_and(|shape| !shape.pressed && (shape.room_from_stylus - pen).norm() < 1e-5)
    };
    frame.drawables.retain(|drawable| !is_pen(drawable));
}
