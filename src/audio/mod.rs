//! Sound in the room: how the sound of a place reaches the viewer's ears, from loudspeakers or headphones.
//!
//! In: a [`Stage`](crate::stage::Stage), the tracked head, and for each source a place in the room with the pressure that it would
//! have at a distance of 1 m. Out: samples for the channels of an audio device or of a file.
//! Loudspeakers: V. Pulkki, "Virtual sound source positioning using vector base amplitude panning", J. Audio Eng. Soc. 45(6),
//! 1997. Headphones: C. P. Brown and R. O. Duda, "A structural model for binaural sound synthesis", IEEE Trans. Speech Audio
//! Process. 6(5), 1998.
//!
//! The way of a block: once per frame [`Listening::paths`] says how a source reaches each channel; in the audio thread
//! [`Mixer::add`] adds the sources, and [`Mixer::finish`] makes samples of pressures.
mod ears;
mod hull;
mod limiter;
mod line;
mod listening;
mod mixer;
mod panning;
mod paths;

pub use ears::{HEAD_RADIUS_M, SPEED_OF_SOUND};
pub use listening::Listening;
pub use mixer::Mixer;
pub use paths::{MOST_CHANNELS, Path, Paths};
