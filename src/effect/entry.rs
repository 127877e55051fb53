//! What an effect says of itself.

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
