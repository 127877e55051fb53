//! One entry of the list of effects, and the scene in which bodies list them.

use crate::base::failure::Failure;
use crate::base::output;
use crate::deform::ModelEntry;
use crate::green::{FAMILIES, Family, GreenError, GreenFile, Precomputed, Requirements, Tensor};
use crate::scene::Scene;
use crate::solve::Progress;
use crate::world::{RunningEffect, World};
use indexmap::IndexMap;
use std::any::Any;
use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

/// A scene with every name of a model or an effect turned into its entry, and the settings of effects parsed. It is read as
/// the scene; a scene that has changed is resolved anew.
#[derive(Clone, Debug)]
pub struct Resolved {
    pub(super) scene: Scene,
    /// By name, in the order of the scene.
    pub bodies: IndexMap<String, ResolvedBody>,
}

impl Deref for Resolved {
    type Target = Scene;

    fn deref(&self) -> &Scene {
        &self.scene
    }
}

/// What a body of a scene names.
#[derive(Clone, Debug)]
pub struct ResolvedBody {
    pub model: &'static ModelEntry,
    pub effects: Vec<ListedEffect>,
}

/// An effect that a body lists.
#[derive(Clone, Debug)]
pub struct ListedEffect {
    pub entry: &'static EffectEntry,
    /// `None` of an effect without settings.
    pub settings: Option<Settings>,
}

/// Settings of an effect, of a type that the effect alone knows.
pub type Settings = Arc<dyn Any + Send + Sync>;

/// Parses `[body.NAME.effect.EFFECT]` of a scene; without a table come the effect's defaults. The error names a key that does
/// not exist, or a value that it cannot have.
pub type ReadSettings = fn(Option<&toml::Table>) -> Result<Settings, String>;

/// Makes the tensors of an effect's own section for a solved body of a scene, each with its name.
pub type Precompute =
    fn(&Resolved, &mut Precomputed, &dyn Progress) -> Result<Vec<(String, Tensor)>, GreenError>;

/// A scene in which some bodies list an effect.
pub struct Listed<'a> {
    pub scene: &'a Resolved,
    pub file: &'a GreenFile,
    /// The bodies that list it: number in the scene and in the world, and name.
    pub bodies: Vec<(usize, &'a str)>,
}

/// The error of a body's section that cannot be used.
pub type CheckSection = fn(&GreenFile, &str) -> Result<(), GreenError>;

/// The tensors of a body's section, each with its name.
pub type SectionAfterChange = fn(&Resolved, &str) -> Vec<(String, Tensor)>;

pub type Attach = fn(&Listed<'_>, &mut World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

pub type Start = fn(&Listed<'_>, &World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

/// One entry of the list of effects.
#[derive(Clone, Copy)]
pub struct EffectEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    /// Whether it asks for the strain energy of the body's model ([`crate::deform::ModelEntry::energy`]).
    pub needs_energy: bool,
    /// Whether it needs the body's inside, which boundary elements do not have.
    pub needs_inside: bool,
    /// Whether it shows stresses, and where a material's limit is passed.
    pub shows_stress: bool,
    /// Whether it measures the errors of force and shape to expect of a body.
    pub measures_errors: bool,
    /// The table of what it has recorded, which `--curve` writes ([`RunningEffect::table`]).
    pub table: Option<&'static output::Kind>,
    /// `None` of an effect without settings ([`read`](super::settings::read)).
    pub settings: Option<ReadSettings>,
    /// Of an effect that has tensors of its own: the section `EFFECT/TENSOR` of the .green file, which
    /// [`crate::green::GreenFile::section`] reads.
    pub precompute: Option<Precompute>,
    /// Errors where the section of a body, by its name, does not hold what `precompute` makes.
    pub check_section: Option<CheckSection>,
    /// The section of a body, by its name, of which something was released or changed since; `None` where it stays as it is.
    pub section_after_change: Option<SectionAfterChange>,
    /// Joins a new world: in windows, in pictures and where a session is checked.
    pub attach: Option<Attach>,
    /// Starts what a live session alone has: devices, and nothing where the stage has none.
    pub start: Option<Start>,
}

impl EffectEntry {
    /// An effect that does nothing and needs nothing: what an entry leaves out.
    pub const NOTHING: EffectEntry = EffectEntry {
        name: "",
        summary: "",
        requirements: &[],
        needs_energy: false,
        needs_inside: false,
        shows_stress: false,
        measures_errors: false,
        table: None,
        settings: None,
        precompute: None,
        check_section: None,
        section_after_change: None,
        attach: None,
        start: None,
    };

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

impl fmt::Debug for EffectEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for EffectEntry {
    fn eq(&self, other: &EffectEntry) -> bool {
        self.name == other.name
    }
}

impl Eq for EffectEntry {}
