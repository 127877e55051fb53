//! What an effect says of itself.

use crate::green::{FAMILIES, Family, GreenError, Requirements, Solution, Tensor};

/// Makes the tensors of an effect's own section from the solution of a body, each with its name.
pub type Precompute = fn(&Solution) -> Result<Vec<(String, Tensor)>, GreenError>;

pub struct EffectEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    /// Of an effect that has tensors of its own: the section `EFFECT/TENSOR` of the .green file, which
    /// [`crate::green::GreenFile::section`] reads.
    pub precompute: Option<Precompute>,
}

impl EffectEntry {
    /// Its families, and its own section where it has one.
    pub fn requirements(&self) -> Requirements {
        let families = Requirements::of(self.requirements);
        if self.precompute.is_some() { families.with_section(self.name) } else { families }
    }

    /// Bytes that it adds to a body of so many control elements, in the file and in memory, beside columns and its own
    /// section.
    pub fn bytes(&self, control_elements: usize) -> usize {
        let needs = |family: &Family| self.requirements.iter().any(|own| own.name == family.name);
        let entries = FAMILIES.iter().filter(|entry| needs(&entry.family));
        entries.map(|entry| (entry.fixed_bytes)(control_elements)).sum()
    }
}
