//! The effect `sound`: bodies are heard as they vibrate.
//!
//! In: the vibration of each body in a frame ([`Vibration`](crate::world::vibration::Vibration)), its surface, the head, the stage. Out: the
//! sound of the frame for all loudspeakers or both ears, into a file, or out of the audio device in a live session. A mode's pressure follows
//! from its motion of the surface ([`Radiator`]); what a frame does to the audible modes ([`Listener`]) is played sample by sample, from where
//! the body is ([`Player`], [`crate::audio`]).

mod listener;
mod live;
mod player;
mod radiation;
mod ringing;
mod running;
mod settings;
#[cfg(test)]
mod tests;
mod tones;
mod voice;

pub use listener::{Listener, Phrase};
pub use player::{Frames, Player, SoundFrame};
pub use radiation::Radiator;

use super::entry::EffectEntry;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "the body is heard as it vibrates, from where it is: loudspeakers, headphones, or a WAV file (--sound)",
    is_heard: true,
    settings: Some(settings::Settings::read),
    attach: Some(running::attach),
    start: Some(live::start),
    ..EffectEntry::NOTHING
};
