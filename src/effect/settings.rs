//! Settings of effects: `[body.NAME.effect.EFFECT]` of a scene, or the effect's defaults.

use crate::config;
use crate::scene::Body;
use serde::de::DeserializeOwned;

/// The settings of an effect of a body. The error names a key that does not exist, or a value that it cannot have.
pub fn settings<T: DeserializeOwned + Default>(body: &Body, effect: &str) -> Result<T, String> {
    body.effect.get(effect).map_or_else(|| Ok(T::default()), config::from_table)
}
