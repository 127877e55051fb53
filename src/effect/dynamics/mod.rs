//! The effect `dynamics`: what is moved quickly or released springs back and rings.
//!
//! In: offline a body with the densities of its materials, online the poses of its control elements over time. Out: modes of
//! vibration beside the columns ([`section`]), their amplitudes in every frame, the inertial force on what a hand holds, and the
//! poses of elements that no hand holds, where the scene releases them ([`moving`]). Each mode is stepped exactly
//! ([`oscillator`]), together with the released elements ([`coupled`]): in one step a frame ([`held_step`]) or, by the model's own
//! [`forces`], in several ([`swing`]); a body that nothing holds flies ([`free_step`]). An effect that presses the body takes it through
//! the frame in steps of its own ([`course`]).

#[cfg(test)]
mod beam_tests;
#[cfg(test)]
mod carried_tests;
mod coupled;
mod course;
mod forces;
mod free_body;
mod free_step;
#[cfg(test)]
mod free_tests;
mod held_step;
mod moving;
mod oscillator;
#[cfg(test)]
mod pendulum_tests;
mod running;
mod section;
mod settings;
mod swing;
#[cfg(test)]
mod swing_tests;
mod system;
mod tables;
#[cfg(test)]
mod tests;

use super::entry::EffectEntry;
use crate::green::STIFFNESS;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "inertia: what is moved quickly or released springs back and rings, by modes of vibration",
    requirements: &[STIFFNESS],
    needs_energy: true,
    needs_inside: true,
    vibrates: true,
    settings: Some(settings::Settings::read),
    suits: Some(section::suits),
    solve: Some(section::solve),
    precompute: Some(section::precompute),
    check_section: Some(|file, body| tables::Tables::read(file, body).map(drop)),
    attach: Some(running::attach),
    ..EffectEntry::NOTHING
};
