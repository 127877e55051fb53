//! The effect `cut`: a blade opens the body where it passes through.
//!
//! In: blades of the scene, on styli or in the room, and the mesh of each body that lists the effect. Out: its surface with the cut in it,
//! and its columns, which are those of the cut body. A blade's edge cuts the edges of the mesh that it passes ([`blade`]); tetrahedra fall
//! into pieces with copies of the nodes beyond the cut ([`crate::mesh::split`]); how these move apart is found at once by the factor of a
//! base, the whole body at first ([`opened`], [`solves`]). When the copies become too many, the body as it is cut gets a factor of its own
//! in the background and is the next base ([`mod@base`]). The body goes on with the new columns as with any others, under gravity and with
//! contacts, which ask for its compliance ([`yielding`]).

mod base;
mod blade;
#[cfg(test)]
mod blade_tests;
mod body;
mod carried;
mod couplings;
mod descent;
mod fallen;
mod frames;
mod landing;
mod loose;
mod matter;
mod opened;
mod opening;
#[cfg(test)]
mod operated;
#[cfg(test)]
mod piece_tests;
mod point_fields;
mod recall;
#[cfg(test)]
mod renewal_tests;
mod resistance;
mod running;
mod settings;
mod shown;
mod solves;
mod system;
#[cfg(test)]
mod tests;
mod weight;
mod yielding;

use super::entry::EffectEntry;
use crate::green::{STIFFNESS, VOLUME};

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "blades cut the body open where they pass through it, and it yields as a cut body does",
    requirements: &[STIFFNESS, VOLUME],
    needs_inside: true,
    is_cut: true,
    dissipates: Some(|body| settings::Settings::of(body).toughness > 0.0),
    settings: Some(settings::Settings::read),
    suits: Some(settings::suits),
    attach: Some(running::attach),
    ..EffectEntry::NOTHING
};
