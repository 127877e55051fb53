//! Settings of effects: `[body.NAME.effect.EFFECT]` of a scene, or the effect's defaults.

use super::entry::Settings;
use crate::config;
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// The settings of an effect whose settings are of this type ([`EffectEntry::settings`](super::EffectEntry::settings)).
pub fn read<T>(table: Option<&toml::Table>) -> Result<Settings, String>
where
    T: DeserializeOwned + Default + Send + Sync + 'static,
{
    let settings: T = table.map_or_else(|| Ok(T::default()), config::from_table)?;
    Ok(Arc::new(settings))
}
