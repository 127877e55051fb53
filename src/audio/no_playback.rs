//! The audio device of a program that was built without one: nothing starts.

use super::error::AudioError;
use super::fill::Fill;
use super::listening::Listening;

/// An audio device that plays; there is none.
#[derive(Debug)]
pub enum Playback {}

impl Playback {
    /// # Errors
    /// [`AudioError::NotBuilt`], always.
    pub fn start(_: &Listening, _: impl FnOnce(f64) -> Fill) -> Result<Playback, AudioError> {
        Err(AudioError::NotBuilt)
    }

    pub fn device(&self) -> &str {
        match *self {}
    }

    pub fn rate_hz(&self) -> f64 {
        match *self {}
    }

    pub fn buffer_s(&self) -> Option<f64> {
        match *self {}
    }

    pub fn gaps(&self) -> u64 {
        match *self {}
    }

    pub fn failure(&self) -> Option<&str> {
        match *self {}
    }
}
