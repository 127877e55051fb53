//! Opt-in effects: what a scene does not list costs nothing, neither precomputation, file, memory, pipeline nor
//! time in the frame.
//!
//! Each effect is one entry of [`EFFECTS`]; a body names those it wants, and only what they need is precomputed.

mod entry;
pub mod haptics;

pub use entry::EffectEntry;

/// All effects; a new one is one file and one line here.
pub const EFFECTS: &[EffectEntry] = &[haptics::ENTRY];

/// The effect called `name`, or what there is instead.
pub fn find_effect(name: &str) -> Result<&'static EffectEntry, String> {
    EFFECTS
        .iter()
        .find(|entry| entry.name == name)
        .ok_or_else(|| crate::config::unknown_name("effect", name, EFFECTS.iter().map(|entry| entry.name)))
}
