//! Opt-in effects: what a scene does not list costs nothing, neither precomputation, file, memory, pipeline nor
//! time in the frame.
//!
//! Each effect is one entry of [`EFFECTS`]; a body names those it wants, and only what they need is precomputed.

pub mod haptics;

use crate::green::{FIELDS, Needs};

/// One entry of the list of effects.
pub struct EffectEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// What must be precomputed for it.
    pub needs: Needs,
}

impl EffectEntry {
    /// Bytes that it adds to a body of so many control elements, in the file and in memory: S has (12 E)² numbers.
    pub fn bytes(&self, control_elements: usize) -> usize {
        let unknowns = FIELDS * control_elements;
        if self.needs.stiffness { 8 * unknowns * unknowns } else { 0 }
    }
}

/// All effects; a new one is one file and one line here.
pub const EFFECTS: &[EffectEntry] = &[haptics::ENTRY];

/// The effect called `name`, or what there is instead.
pub fn find_effect(name: &str) -> Result<&'static EffectEntry, String> {
    EFFECTS
        .iter()
        .find(|entry| entry.name == name)
        .ok_or_else(|| crate::config::unknown_name("effect", name, EFFECTS.iter().map(|entry| entry.name)))
}
