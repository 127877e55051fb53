//! How a command fails: whose fault it is, and the chain of reasons.

use crate::config::ConfigError;
use crate::green::GreenError;
use crate::scene::SceneError;
use std::fmt;

/// An error and the exit status it ends with.
pub enum Failure {
    /// The request or its files are wrong: status 2.
    Request(anyhow::Error),
    /// The work failed: status 1.
    Work(anyhow::Error),
}

impl Failure {
    pub fn request(error: impl Into<anyhow::Error>) -> Failure {
        Failure::Request(error.into())
    }

    pub fn work(error: impl Into<anyhow::Error>) -> Failure {
        Failure::Work(error.into())
    }

    /// A wrong request in words.
    pub fn wrong(message: impl fmt::Display) -> Failure {
        Failure::Request(anyhow::anyhow!("{message}"))
    }

    pub fn status(&self) -> u8 {
        match self {
            Failure::Request(_) => 2,
            Failure::Work(_) => 1,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Request(error) | Failure::Work(error) => error.fmt(f),
        }
    }
}

impl fmt::Debug for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self:#}")
    }
}

impl From<ConfigError> for Failure {
    fn from(error: ConfigError) -> Failure {
        Failure::request(error)
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        Failure::request(error)
    }
}

impl From<GreenError> for Failure {
    fn from(error: GreenError) -> Failure {
        if error.is_request() { Failure::request(error) } else { Failure::work(error) }
    }
}
