//! Settings of `cut`, `[body.NAME.effect.cut]`, and conditions under which a body can be cut.

use crate::config;
use crate::deform::{LINEAR, ModelEntry, ROTATION};
use crate::effect::entry::{EffectEntry, ResolvedBody, Settings as AnySettings};
use crate::fem::TET4;
use crate::scene::{Body, LoadSource, Scene, SceneError};
use serde::Deserialize;
use std::sync::Arc;

/// The effect's name in scenes.
pub const NAME: &str = "cut";

#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Work that a new area of cut takes, J/m²; without it cutting takes no force.
    pub toughness: f64,
}

impl Settings {
    /// The settings of a scene's table. The error names a value that cannot be.
    pub fn read(table: Option<&toml::Table>) -> Result<AnySettings, String> {
        let settings: Settings = table.map_or_else(|| Ok(Settings::default()), config::from_table)?;
        let toughness = settings.toughness;
        if !(toughness.is_finite() && toughness >= 0.0) {
            return Err(format!(
                "toughness = {toughness} is no work for an area: write J/m², as 100.0 for soft tissue, or 0 for none"
            ));
        }
        Ok(Arc::new(settings))
    }

    /// The settings of a body that lists the effect.
    pub fn of(body: &ResolvedBody) -> Settings {
        body.settings::<Settings>(NAME).cloned().unwrap_or_default()
    }
}

/// Models that are sums of columns in one frame, which those of the cut body replace.
const CUT: [&ModelEntry; 2] = [&LINEAR, &ROTATION];

/// Refuses a body that nothing can cut, or of which other numbers would go on to be those of the whole body.
pub fn suits(scene: &Scene, name: &str, body: &Body, resolved: &ResolvedBody) -> Result<(), SceneError> {
    let wrong = |key: &str, message: String| Err(scene.invalid(&format!("body.{name}.{key}"), message));
    if !scene.tool.values().any(|tool| tool.shape.is_blade()) {
        let message = "nothing cuts the body: add a blade, as [tool.scalpel] with shape = { blade = { length = 0.05, width = 0.01 } } \
                       and stylus = 1";
        return wrong("effects", message.to_owned());
    }
    if body.element_name() != TET4.name {
        let message = format!(
            "\"{NAME}\" divides linear tetrahedra, not \"{}\": write element = \"{}\"",
            body.element_name(),
            TET4.name
        );
        return wrong("element", message);
    }
    if !CUT.contains(&resolved.model) {
        let message = format!(
            "\"{NAME}\" replaces the columns of a body, and \"{}\" does not sum them in one frame: write model = \"{}\"",
            resolved.model.name,
            CUT.map(|model| model.name).join("\" or \"")
        );
        return wrong("model", message);
    }
    let key =
        |name: &str| if body.load.contains_key(name) { format!("load.{name}") } else { name.to_owned() };
    if let Some(load) = body.loads().iter().find(|load| load.source != LoadSource::Gravity) {
        let message =
            format!("of a cut body \"{NAME}\" knows what gravity does, and no other load: leave it out");
        return wrong(&key(load.name), message);
    }
    let measured = [
        ("accuracy", body.accuracy.is_some()),
        ("budget", body.budget.is_some()),
        ("plan", body.plan.is_some()),
    ];
    if let Some((key, _)) = measured.into_iter().find(|(_, is_there)| *is_there) {
        let message = format!(
            "what was measured of the whole body would be shown of the cut one: leave it out beside \"{NAME}\""
        );
        return wrong(key, message);
    }
    let others = || resolved.effects.iter().map(|listed| listed.entry).filter(|entry| entry.name != NAME);
    // What it shows, or keeps, of the whole body would not be true of the cut one.
    let is_of_whole = |entry: &&EffectEntry| {
        let keeps = entry.precompute.is_some() || entry.vibrates || entry.needs_inside;
        let shows = entry.shows_stress || entry.measures_errors;
        keeps || shows
    };
    if let Some(other) = others().find(is_of_whole) {
        let message = format!(
            "\"{}\" keeps numbers of the body as it was before a cut, and would go on to show them: list it in another body",
            other.name
        );
        return wrong("effects", message);
    }
    if let Some(other) = others().find(|entry| entry.needs_energy && *resolved.model != LINEAR) {
        let message = format!(
            "\"{}\" needs the energy of the cut body, which \"{}\" does not have: write model = \"{}\", or list it in another body",
            other.name, resolved.model.name, LINEAR.name
        );
        return wrong("effects", message);
    }
    Ok(())
}
