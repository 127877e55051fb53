//! Settings of `sound`: `[body.NAME.effect.sound]`.

use crate::config;
use crate::effect::entry::{ResolvedBody, Settings as AnySettings};
use serde::Deserialize;
use std::sync::Arc;

/// The effect's name in scenes.
pub const NAME: &str = "sound";

/// Most dB by which a body may be made louder or softer.
const MOST_DB: f64 = 120.0;

#[derive(Clone, Debug, Default, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Gain over the sound pressure that the body would really have, dB.
    gain_db: f64,
}

impl Settings {
    /// The settings of a scene's table. The error names a value that cannot be.
    pub fn read(table: Option<&toml::Table>) -> Result<AnySettings, String> {
        let settings: Settings = table.map_or_else(|| Ok(Settings::default()), config::from_table)?;
        let gain_db = settings.gain_db;
        if gain_db.is_nan() || gain_db.abs() > MOST_DB {
            return Err(format!(
                "gain_db = {gain_db} is not within -{MOST_DB} and {MOST_DB} dB; 0 is the true level"
            ));
        }
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_is_a_number_of_decibels() {
        let read = |text: &str| Settings::read(Some(&text.parse().unwrap()));
        let gain = |text: &str| read(text).unwrap().downcast_ref::<Settings>().unwrap().gain();
        assert_eq!((gain(""), gain("gain_db = 20")), (1.0, 10.0));
        for (text, told) in
            [("gain_db = nan", "not within"), ("gain_db = 500.0", "not within"), ("gain = 1", "gain")]
        {
            let error = read(text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
    }
}
