//! One entry of the list of sources (the keys in a stage's `[tracker.NAME]` table, how they are checked, and how the source
//! is opened), and the errors of opening a tracker, with what to do about them.

use super::device::Source;
use super::listen::Listen;
use crate::base::failure::Failure;
use crate::config;
use crate::stage::StageError;
use serde::de::DeserializeOwned;
use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Sensors with any number.
pub const ANY: Option<RangeInclusive<i32>> = Some(i32::MIN..=i32::MAX);

pub struct SourceEntry {
    /// The key that makes a table one of this kind.
    pub key: &'static str,
    /// Keys that go with it.
    pub more_keys: &'static [&'static str],
    /// Numbers that its sensors can have; `None` where it has none.
    pub sensors: Option<RangeInclusive<i32>>,
    pub has_buttons: bool,
    /// Checks the keys of the tracker of this name; an error says what is wrong and what to do.
    pub read: fn(tracker: &str, keys: &toml::Table) -> Result<SourceSettings, String>,
}

/// A checked table, from which its source can be opened.
pub struct SourceSettings {
    /// The port or device that no second tracker can use at the same time.
    pub exclusive_use: Option<ExclusiveUse>,
    /// Starts the source of the tracker of this name.
    pub open: OpenSource,
}

pub type OpenSource = Box<dyn FnOnce(&str) -> Result<Box<dyn Source>, OpenError>>;

/// A port or a device that one source occupies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExclusiveUse {
    Listens(SocketAddr),
    Opens(PathBuf),
}

impl ExclusiveUse {
    /// Whether both cannot be had at once; 0.0.0.0 is every address of this machine, and port 0 any free one.
    pub fn clashes_with(&self, other: &ExclusiveUse) -> bool {
        match (self, other) {
            (ExclusiveUse::Listens(a), ExclusiveUse::Listens(b)) => {
                let is_same = a.ip() == b.ip() || a.ip().is_unspecified() || b.ip().is_unspecified();
                a.port() != 0 && a.port() == b.port() && is_same
            }
            (ExclusiveUse::Opens(a), ExclusiveUse::Opens(b)) => a == b,
            _ => false,
        }
    }
}

impl std::fmt::Display for ExclusiveUse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ExclusiveUse::Listens(at) => write!(f, "port {}", at.port()),
            ExclusiveUse::Opens(device) => device.display().fmt(f),
        }
    }
}

/// The keys of a tracker's table as a struct with `deny_unknown_fields`.
pub fn keys<T: DeserializeOwned>(tracker: &str, keys: &toml::Table) -> Result<T, String> {
    config::from_table(keys).map_err(|message| format!("tracker `{tracker}`: {message}"))
}

/// The path of a device, which must not be empty.
pub fn device(tracker: &str, key: &str, path: PathBuf, example: &str) -> Result<PathBuf, String> {
    if path == Path::new("") {
        return Err(format!("`{key}` of tracker `{tracker}` is empty: give the device's path, as {example}"));
    }
    Ok(path)
}

/// The reason why a source could not be opened at all. A device that is merely absent is waited for.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error(
        "tracker `{tracker}`: cannot listen on {at}: {source}; does another program listen there, and is it an address \
         of this machine?"
    )]
    Listen { tracker: String, at: std::net::SocketAddr, source: std::io::Error },
    #[error(
        "tracker `{tracker}`: cannot join the multicast group {place}: {source}. Give `interface`, this \
         machine's address there"
    )]
    Join { tracker: String, place: Listen, source: std::io::Error },
    #[error("tracker `{tracker}`: cannot start its thread: {source}")]
    Thread { tracker: String, source: std::io::Error },
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error("tracker `{tracker}`: {why}")]
    Unsupported { tracker: String, why: String },
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Failure {
        Failure::work(error)
    }
}
