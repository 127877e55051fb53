//! Settings of `dynamics`: `[body.NAME.effect.dynamics]`.

use super::coupled::Damping;
use crate::config;
use crate::effect::entry::{ResolvedBody, Settings as AnySettings};
use crate::scene::Body;
use serde::Deserialize;
use std::f64::consts::TAU;
use std::sync::Arc;

/// The effect's name in scenes.
pub const NAME: &str = "dynamics";

/// Most modes that a body may have.
const MOST: usize = 200;
/// Damping ratio of a body that asks for none: between that of a steel part in its joints and that of rubber.
const RATIO: f64 = 0.01;

#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Modes at most.
    pub modes: usize,
    /// Largest frequency of a mode, Hz; without it the lowest `modes` are taken whatever their frequency.
    pub up_to: Option<f64>,
    /// Damping ratio ζ of every mode.
    damping: Option<f64>,
    /// α and β of Rayleigh's damping α M + β K, 1/s and s.
    rayleigh: Option<[f64; 2]>,
    /// Control elements that swing while no hand holds them.
    pub free: Vec<String>,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings { modes: 12, up_to: None, damping: None, rayleigh: None, free: Vec::new() }
    }
}

impl Settings {
    /// The settings of a scene's table. The error names a value that cannot be.
    pub fn read(table: Option<&toml::Table>) -> Result<AnySettings, String> {
        let settings: Settings = table.map_or_else(|| Ok(Settings::default()), config::from_table)?;
        settings.check()?;
        Ok(Arc::new(settings))
    }

    /// The settings of a body that lists the effect.
    pub fn of(body: &ResolvedBody) -> Settings {
        body.settings::<Settings>(NAME).cloned().unwrap_or_default()
    }

    fn check(&self) -> Result<(), String> {
        let is_size = |value: f64| value.is_finite() && value >= 0.0;
        if self.modes > MOST {
            return Err(format!("modes = {} is above {MOST}: the highest are heard, not seen", self.modes));
        }
        if let Some(hertz) = self.up_to.filter(|hertz| !(is_size(*hertz) && *hertz > 0.0)) {
            return Err(format!("up_to = {hertz} is no frequency: a positive number, Hz"));
        }
        if let Some(ratio) = self.damping.filter(|ratio| !is_size(*ratio)) {
            return Err(format!(
                "damping = {ratio} is no ratio: 0 rings on forever, 1 does not swing at all"
            ));
        }
        if let Some([alpha, beta]) = self.rayleigh {
            if !(is_size(alpha) && is_size(beta)) {
                return Err(format!(
                    "rayleigh = [{alpha}, {beta}]: both numbers must be 0 or more, 1/s and s"
                ));
            }
            if let Some(ratio) = self.damping {
                return Err(format!("write damping = {ratio} or rayleigh = [{alpha}, {beta}], not both"));
            }
        }
        Ok(())
    }

    pub fn damping(&self) -> Damping {
        self.rayleigh.map_or(Damping::Ratio(self.damping.unwrap_or(RATIO)), Damping::Rayleigh)
    }

    /// Whether a mode of this ω², (rad/s)², is asked for.
    pub fn takes(&self, square: f64) -> bool {
        self.up_to.is_none_or(|hertz| square <= (TAU * hertz).powi(2))
    }

    /// Whether each control element of the body swings while nothing holds it. The error names one that there is not.
    pub fn free_of(&self, body: &Body) -> Result<Vec<bool>, String> {
        if let Some(unknown) = self.free.iter().find(|name| !body.control.contains_key(name.as_str())) {
            let known = body.control.keys().map(String::as_str);
            return Err(config::unknown_name("control element", unknown, known));
        }
        Ok(body.control.keys().map(|name| self.free.contains(name)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Settings, String> {
        let table: toml::Table = text.parse().unwrap();
        Settings::read(Some(&table)).map(|settings| settings.downcast_ref::<Settings>().unwrap().clone())
    }

    #[test]
    fn settings_are_numbers_that_can_be() {
        let settings = read("modes = 3\nup_to = 50.0\nrayleigh = [0.1, 1e-4]").unwrap();
        assert_eq!((settings.modes, settings.damping()), (3, Damping::Rayleigh([0.1, 1e-4])));
        assert!(settings.takes((TAU * 49.0).powi(2)) && !settings.takes((TAU * 51.0).powi(2)));
        assert_eq!(read("").unwrap().damping(), Damping::Ratio(0.01));
        for (text, told) in [
            ("modes = 500", "above 200"),
            ("up_to = 0.0", "no frequency"),
            ("up_to = nan", "no frequency"),
            ("damping = -0.1", "no ratio"),
            ("rayleigh = [1.0, inf]", "0 or more"),
            ("damping = 0.1\nrayleigh = [1.0, 0.0]", "not both"),
            ("dampign = 0.1", "dampign"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
    }
}
