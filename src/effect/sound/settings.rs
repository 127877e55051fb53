//! Settings of `sound`: `[body.NAME.effect.sound]`.

use super::pitch::Pitch;
use crate::config;
use crate::effect::entry::{EffectEntry, ResolvedBody, Settings as AnySettings};
use crate::scene::{Body, Scene, SceneError};
use serde::Deserialize;
use std::sync::Arc;

/// The effect's name in scenes.
pub const NAME: &str = "sound";

/// Most dB by which a body may be made louder or softer.
const MOST_DB: f64 = 120.0;
/// Roughness at least and at most, m.
const ROUGHNESS: [f64; 2] = [1e-6, 0.1];

#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Gain over the sound pressure that the body would really have, dB.
    gain_db: f64,
    /// Part of the power of friction and cutting that is heard.
    pub efficiency: f64,
    /// Distance between the bumps of what rubs and is cut, m: as many as pass in a second are the middle frequency of the noise, Hz.
    pub roughness: f64,
    pub pitch: Option<Pitch>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { gain_db: 0.0, efficiency: 1e-6, roughness: 1e-4, pitch: None }
    }
}

impl Settings {
    /// The settings of a scene's table. The error names a value that cannot be.
    pub fn read(table: Option<&toml::Table>) -> Result<AnySettings, String> {
        let settings: Settings = table.map_or_else(|| Ok(Settings::default()), config::from_table)?;
        let Settings { gain_db, efficiency, roughness, pitch } = &settings;
        if gain_db.is_nan() || gain_db.abs() > MOST_DB {
            return Err(format!(
                "gain_db = {gain_db} is not within -{MOST_DB} and {MOST_DB} dB; 0 is the true level"
            ));
        }
        if !(0.0..=1.0).contains(efficiency) {
            return Err(format!(
                "efficiency = {efficiency} is no part of the power of friction and cutting: 0 for silence, such as 1e-6, or 1 for all of it"
            ));
        }
        if !(ROUGHNESS[0]..=ROUGHNESS[1]).contains(roughness) {
            return Err(format!(
                "roughness = {roughness} is no distance between bumps: write one within {} and {} m, such as 1e-4",
                ROUGHNESS[0], ROUGHNESS[1]
            ));
        }
        pitch.iter().try_for_each(Pitch::check)?;
        Ok(Arc::new(settings))
    }

    /// The settings of a body that lists the effect.
    pub fn of(body: &ResolvedBody) -> Settings {
        body.settings::<Settings>(NAME).cloned().unwrap_or_default()
    }

    /// Factor of the pressure.
    pub fn gain(&self) -> f64 {
        10.0_f64.powf(self.gain_db / 20.0)
    }

    /// Whether work is done on the body, and heard.
    pub fn hears_work(&self, body: &ResolvedBody) -> bool {
        self.efficiency > 0.0 && body.entries().any(|effect| effect.dissipates.is_some_and(|does| does(body)))
    }
}

/// Refuses a body of which there is nothing to hear.
pub fn suits(scene: &Scene, name: &str, _: &Body, resolved: &ResolvedBody) -> Result<(), SceneError> {
    let wrong = |key: &str, message: String| Err(scene.invalid(&format!("body.{name}.{key}"), message));
    let settings = Settings::of(resolved);
    let has = |is_meant: fn(&EffectEntry) -> bool| resolved.entries().any(is_meant);
    if settings.pitch.is_some() && !has(|effect| effect.shows_stress) {
        let message = format!(
            "the tone follows what \"stress\" measures: list \"stress\" beside \"{NAME}\", or leave pitch out"
        );
        return wrong(&format!("effect.{NAME}.pitch"), message);
    }
    if has(|effect| effect.vibrates) || settings.pitch.is_some() || settings.hears_work(resolved) {
        return Ok(());
    }
    let message = format!(
        "there is nothing to hear of the body. For its modes, write effects = [\"dynamics\", \"{NAME}\"]; for noise, list \"contact\" \
         with friction or \"cut\" with a toughness, and leave efficiency above 0; for a tone that follows its strain, list \
         \"stress\" and write effect.{NAME} = {{ pitch = {{ full = 0.3 }} }}"
    );
    wrong("effects", message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_cannot_be_are_told() {
        let read = |text: &str| Settings::read(Some(&text.parse().unwrap()));
        let gain = |text: &str| read(text).unwrap().downcast_ref::<Settings>().unwrap().gain();
        assert_eq!((gain(""), gain("gain_db = 20")), (1.0, 10.0));
        for (text, told) in [
            ("gain_db = nan", "gain_db = NaN is not within"),
            ("gain_db = 500.0", "gain_db = 500 is not within"),
            ("gain = 1", "did you mean `gain_db`"),
            ("efficiency = -1.0", "efficiency = -1 is no part"),
            ("efficiency = nan", "such as 1e-6"),
            ("roughness = 0.0", "roughness = 0 is no distance"),
            ("pitch = {}", "pitch.full = 0: write the largest principal strain"),
            ("pitch = { of = \"von_mises\", full = -1.0 }", "in Pa"),
            ("pitch = { full = 0.3, from_hz = 880.0, to_hz = 110.0 }", "the lower one first"),
            ("pitch = { full = 0.3, from_hz = 1.0 }", "pitch.from_hz = 1 and pitch.to_hz = 880"),
            ("pitch = { full = 0.3, level_db = 500.0 }", "pitch.level_db = 500 is not within"),
            ("pitch = { full = 0.3, to = 1.0 }", "unknown field"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
    }
}
