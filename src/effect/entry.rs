//! One entry of the list of effects: name, required column families, own tensors.

use crate::base::failure::Failure;
use crate::deform::ModelEntry;
use crate::green::{FAMILIES, Family, GreenError, GreenFile, Precomputed, Requirements, Tensor};
use crate::scene::{Body, Scene};
use crate::solve::Progress;
use crate::world::{RunningEffect, World};

/// Makes the tensors of an effect's own section for a solved body of a scene, each with its name.
pub type Precompute =
    fn(&Scene, &mut Precomputed, &dyn Progress) -> Result<Vec<(String, Tensor)>, GreenError>;

/// A scene in which some bodies list an effect.
pub struct Listed<'a> {
    pub scene: &'a Scene,
    pub file: &'a GreenFile,
    /// The bodies that list it: number in the scene and in the world, and name.
    pub bodies: Vec<(usize, &'a str)>,
}

/// What is wrong with the settings of an effect in a body.
pub type CheckSettings = fn(&Body) -> Result<(), String>;

pub type Attach = fn(&Listed<'_>, &mut World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

pub type Start = fn(&Listed<'_>, &World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

/// One entry of the list of effects.
pub struct EffectEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    /// Whether it asks for the strain energy of the body's model ([`crate::deform::ModelEntry::energy`]).
    pub needs_energy: bool,
    /// Whether it needs the body's inside, which boundary elements do not have.
    pub needs_inside: bool,
    /// Whether its settings in a body can be used; `None` of an effect without ([`settings`](super::settings())).
    pub check_settings: Option<CheckSettings>,
    /// Of an effect that has tensors of its own: the section `EFFECT/TENSOR` of the .green file, which
    /// [`crate::green::GreenFile::section`] reads.
    pub precompute: Option<Precompute>,
    /// Joins a new world: in windows, in pictures and where a session is checked.
    pub attach: Option<Attach>,
    /// Starts what a live session alone has: devices, and nothing where the stage has none.
    pub start: Option<Start>,
}

impl EffectEntry {
    /// Its families, and its own section where it has one.
    pub fn requirements(&self) -> Requirements {
        let families = Requirements::of(self.requirements);
        if self.precompute.is_some() { families.with_section(self.name) } else { families }
    }

    /// Bytes that it adds to a body of this model and so many control elements, in the file and in memory, beside columns and
    /// its own section.
    pub fn bytes(&self, model: &ModelEntry, control_elements: usize) -> usize {
        let energy = model.energy.filter(|_| self.needs_energy).unwrap_or_default();
        let is_of = |families: &[Family], family: &Family| families.iter().any(|own| own.name == family.name);
        let is_required = |family: &Family| {
            (is_of(self.requirements, family) || is_of(energy, family)) && !is_of(model.requirements, family)
        };
        let entries = FAMILIES.iter().filter(|entry| is_required(&entry.family));
        entries.map(|entry| (entry.fixed_bytes)(control_elements)).sum()
    }
}
