//! The effect `contact`: tools press, push and rub bodies.
//!
//! In: tools of the scene, on styli or in the room; bodies with the compliance of their surface. Out: forces at single points of each
//! surface, which act like loads, and on the tool. The shape without contact is [`free`](touched_body) by columns alone; the gaps at
//! nodes and triangles near a tool ([`detection`]), the compliance between them and Coulomb's friction make a complementarity problem
//! ([`crate::solve::cone`]), solved in steps so short that no tool passes through a body ([`system`]). A force device feels them between
//! two frames too ([`felt`]).

mod detection;
mod felt;
mod running;
mod settings;
mod shape;
mod shown;
mod system;
#[cfg(test)]
mod tests;
mod tool;
mod touched_body;

use super::entry::EffectEntry;
use crate::green::STIFFNESS;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "tools touch the body: it yields to them, with friction, and the hand feels them",
    requirements: &[STIFFNESS],
    needs_energy: true,
    presses_points: true,
    settings: Some(settings::Settings::read),
    suits: Some(settings::suits),
    attach: Some(running::attach),
    ..EffectEntry::NOTHING
};
