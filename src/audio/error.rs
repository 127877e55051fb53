//! Why sound cannot be played or written, and what to do.

use crate::base::failure::Failure;
use crate::base::output::OutputError;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum AudioError {
    #[error(
        "this program was built without the feature `audio` and plays no sound: build it with `cargo build --release`, or \
         write the sound to a WAV file"
    )]
    NotBuilt,
    #[error(
        "no audio device was found: connect one and see that this user may use it (group `audio`), or write the sound to \
         a WAV file"
    )]
    NoDevice,
    #[error("there is no audio device \"{name}\"{}; there are: {known}", did_you_mean(nearest))]
    Unknown { name: String, nearest: Option<String>, known: String },
    #[error(
        "audio device \"{device}\" has {found} channels, and the stage needs {wanted}: name another by `device` in [sound] \
         of the stage file, or give it fewer [[loudspeaker]] tables"
    )]
    Channels { device: String, found: usize, wanted: usize },
    #[error("audio device \"{device}\": {message}")]
    Device { device: String, message: String },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{}: cannot be written: {message}", path.display())]
    Wav { path: PathBuf, message: String },
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean \"{name}\"?"))
}

impl From<AudioError> for Failure {
    fn from(error: AudioError) -> Failure {
        match error {
            AudioError::Output(error) => error.into(),
            AudioError::Unknown { .. } | AudioError::Channels { .. } => Failure::request(error),
            _ => Failure::work(error),
        }
    }
}
