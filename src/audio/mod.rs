//! Sound in the room: how the sound of a place reaches the viewer's ears, from loudspeakers or headphones.
//!
//! In: a [`Stage`](crate::stage::Stage), the tracked head, and for each source a place in the room with the pressure that it would
//! have at a distance of 1 m. Out: samples for the channels of an audio device ([`Playback`]) or of a WAV file ([`WavFile`]).
//! Loudspeakers: V. Pulkki, "Virtual sound source positioning using vector base amplitude panning", J. Audio Eng. Soc. 45(6),
//! 1997. Headphones: C. P. Brown and R. O. Duda, "A structural model for binaural sound synthesis", IEEE Trans. Speech Audio
//! Process. 6(5), 1998.
//!
//! The way of a block: once per frame [`Listening::paths`] says how a source reaches each channel; in the audio thread
//! [`Mixer::add`] adds the sources, and [`Mixer::finish`] makes samples of pressures.
mod bursts;
mod ears;
mod error;
mod fill;
mod hull;
mod limiter;
mod line;
mod listening;
mod mixer;
#[cfg(not(feature = "audio"))]
mod no_playback;
mod panning;
mod paths;
#[cfg(feature = "audio")]
mod playback;
mod wav;

pub use bursts::Bursts;
pub use ears::{HEAD_RADIUS_M, SPEED_OF_SOUND};
pub use error::AudioError;
pub use fill::Fill;
pub use listening::{Listening, REFERENCE_PA};
pub use mixer::Mixer;
#[cfg(not(feature = "audio"))]
pub use no_playback::Playback;
pub use paths::{MOST_CHANNELS, Path, Paths};
#[cfg(feature = "audio")]
pub use playback::Playback;
pub use wav::{WAV, WavFile};
