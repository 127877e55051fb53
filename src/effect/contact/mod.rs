//! The effect `contact`: tools press, push and rub bodies, and bodies each other and themselves.
//!
//! In: tools of the scene, on styli or in the room; bodies with the compliance of their surface. Out: forces at single points of each
//! surface, which act like loads, and on the tool. The shape without contact is [`free`](touched_body) by columns alone; the gaps at
//! nodes and triangles near a tool ([`detection`]) or another surface ([`meeting`], [`crossing`]), the compliance between them ([`compliance`]) and
//! Coulomb's friction make a complementarity problem ([`crate::solve::cone`]), solved in steps so short that nothing passes through a
//! body ([`way`], [`system`], [`round`]). A body with inertia is moved by these forces meanwhile ([`inertial`], [`response`]). A force
//! device feels those of its tool between two frames too ([`felt`]).

mod acting;
mod attach;
mod backing;
mod candidates;
mod compliance;
mod crossing;
#[cfg(test)]
mod crowd_tests;
mod detection;
mod felt;
mod inertial;
#[cfg(test)]
mod inertial_tests;
mod meeting;
#[cfg(test)]
mod meeting_tests;
mod motion;
mod response;
mod rest;
mod round;
mod rubbed;
mod running;
mod settings;
mod shown;
mod slides;
mod system;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod theory_tests;
mod touch;
mod touched_body;
mod way;

use super::entry::EffectEntry;
use crate::green::STIFFNESS;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "tools and bodies touch the body: it yields to them, with friction, and the hand feels them",
    requirements: &[STIFFNESS],
    needs_energy: true,
    presses_points: true,
    friction: Some(settings::Settings::friction_of),
    dissipates: Some(|body| settings::Settings::of(body).friction > 0.0),
    settings: Some(settings::Settings::read),
    suits: Some(settings::suits),
    attach: Some(attach::attach),
    ..EffectEntry::NOTHING
};
