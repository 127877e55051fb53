//! One entry of the list of effects, and the scene in which bodies list them.

use crate::base::failure::Failure;
use crate::base::output;
use crate::deform::ModelEntry;
use crate::green::{
    Assembled, FAMILIES, Family, GreenError, GreenFile, Precomputed, Requirements, Solution, Tensor,
};
use crate::scene::{Body, Scene, SceneError};
use crate::solve::Progress;
use crate::world::{RunningEffect, World};
use indexmap::IndexMap;
use std::any::Any;
use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

/// A scene with every name of a model or an effect turned into its entry, and the settings of effects parsed. Dereferences to the
/// scene. If the scene changes, make a new one.
#[derive(Clone, Debug)]
pub struct Resolved {
    pub(super) scene: Scene,
    /// Bodies by name, in the order of the scene.
    pub bodies: IndexMap<String, ResolvedBody>,
}

impl Deref for Resolved {
    type Target = Scene;

    fn deref(&self) -> &Scene {
        &self.scene
    }
}

/// The entries that a body of a scene names.
#[derive(Clone, Debug)]
pub struct ResolvedBody {
    pub model: &'static ModelEntry,
    pub effects: Vec<ListedEffect>,
}

/// An effect that a body lists.
#[derive(Clone, Debug)]
pub struct ListedEffect {
    pub entry: &'static EffectEntry,
    /// `None` if the effect has no settings.
    pub settings: Option<Settings>,
}

/// Settings of an effect; only the effect knows the type.
pub type Settings = Arc<dyn Any + Send + Sync>;

/// Parses `[body.NAME.effect.EFFECT]` of a scene; `None` gives the defaults. The error names a key that does not exist, or a
/// value that it cannot have.
pub type ReadSettings = fn(Option<&toml::Table>) -> Result<Settings, String>;

/// Refuses a body that cannot have the effect, before anything is solved; the error names what it lacks.
pub type Suits = fn(&Scene, &str, &Body, &ResolvedBody) -> Result<(), SceneError>;

/// Solves for what an effect needs of a body while its system is assembled and factorised, and leaves it in
/// [`Solution::tables`], where `precompute` finds it.
pub type SolveFurther = fn(&Resolved, &Assembled<'_>, &mut Solution, &dyn Progress) -> Result<(), GreenError>;

/// Makes the tensors of an effect's own section for a solved body of a scene, each with its name.
pub type Precompute =
    fn(&Resolved, &mut Precomputed, &dyn Progress) -> Result<Vec<(String, Tensor)>, GreenError>;

/// The arguments of `Attach` and `Start`: the scene, its file, and the bodies that list the effect.
pub struct EffectInput<'a> {
    pub scene: &'a Resolved,
    pub file: &'a GreenFile,
    /// The bodies that list it, by index and name.
    pub bodies: Vec<(usize, &'a str)>,
}

/// Coefficient of friction with which the tool of this name touches the body; `None` where it does not.
pub type Friction = fn(&ResolvedBody, &str) -> Option<f64>;

/// Checks the effect's section of the body of this name.
pub type CheckSection = fn(&GreenFile, &str) -> Result<(), GreenError>;

/// Makes the section again after something in the body of this name was released or changed.
pub type SectionAfterChange = fn(&Resolved, &str) -> Vec<(String, Tensor)>;

/// Makes the effect's part of a new world; `None` if it has none there.
pub type Attach = fn(&EffectInput<'_>, &mut World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

/// Makes the part of the effect that only a live session has, such as devices and threads; `None` if it has none here.
pub type Start = fn(&EffectInput<'_>, &World) -> Result<Option<Box<dyn RunningEffect>>, Failure>;

/// One entry of the list of effects.
#[derive(Clone, Copy)]
pub struct EffectEntry {
    pub name: &'static str,
    pub summary: &'static str,
    /// Column families that must be precomputed for it.
    pub requirements: &'static [Family],
    /// Whether it asks for the strain energy of the body's model ([`crate::deform::ModelEntry::energy`]).
    pub needs_energy: bool,
    /// Whether it needs the inside of the body; boundary elements have none.
    pub needs_inside: bool,
    /// Whether it presses single points of the surface: a body whose scene gives it no `surface_compliance` has it by the factor.
    pub presses_points: bool,
    /// Friction of tools on a body that lists it; `None` where it lets nothing touch the body.
    pub friction: Option<Friction>,
    /// Whether blades cut the body.
    pub is_cut: bool,
    /// Whether work is done on a body that lists it by what rubs or cuts, as [`Dissipation`](crate::world::dissipation::Dissipation); `None`
    /// where none ever is.
    pub dissipates: Option<fn(&ResolvedBody) -> bool>,
    /// Whether hands with a force device feel the body.
    pub is_felt: bool,
    /// Whether the body vibrates by it, and whether it makes the body heard.
    pub vibrates: bool,
    pub is_heard: bool,
    /// Whether it shows stresses, and where a material's limit is passed.
    pub shows_stress: bool,
    /// Whether it measures how large the errors of force and shape may be.
    pub measures_errors: bool,
    /// The kind of the table that it records ([`RunningEffect::table`]); `--curve` writes the first that an effect has.
    pub table: Option<&'static output::Kind>,
    /// `None` if it has no settings ([`read`](super::settings::read)).
    pub settings: Option<ReadSettings>,
    /// Refuses bodies that cannot have it; `None` where every body can.
    pub suits: Option<Suits>,
    /// Solves with the body's factor what `precompute` writes; `None` if that needs no factor.
    pub solve: Option<SolveFurther>,
    /// Makes the effect's own tensors, stored as `EFFECT/TENSOR` and read by [`crate::green::GreenFile::section`].
    pub precompute: Option<Precompute>,
    /// Fails if the section is not what `precompute` makes.
    pub check_section: Option<CheckSection>,
    /// Replaces the section when the body was changed; `None` if the old one still holds.
    pub section_after_change: Option<SectionAfterChange>,
    /// Makes the effect's part of a new world. Called for windows, pictures and checks.
    pub attach: Option<Attach>,
    /// Starts devices and threads, in a live session only; `None` where the stage has none.
    pub start: Option<Start>,
}

impl EffectEntry {
    /// Defaults for an entry: `..EffectEntry::NOTHING`.
    pub const NOTHING: EffectEntry = EffectEntry {
        name: "",
        summary: "",
        requirements: &[],
        needs_energy: false,
        needs_inside: false,
        presses_points: false,
        friction: None,
        is_cut: false,
        dissipates: None,
        is_felt: false,
        vibrates: false,
        is_heard: false,
        shows_stress: false,
        measures_errors: false,
        table: None,
        settings: None,
        suits: None,
        solve: None,
        precompute: None,
        check_section: None,
        section_after_change: None,
        attach: None,
        start: None,
    };

    /// The families and the section that must be precomputed for it.
    pub fn requirements(&self) -> Requirements {
        let families = Requirements::new(self.requirements);
        if self.precompute.is_some() { families.with_section(self.name) } else { families }
    }

    /// Bytes that it adds to a body of this model with `control_elements`, in the file and in memory, beside columns and its own
    /// section.
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
