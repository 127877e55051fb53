//! The effect `sound`: bodies are heard as they vibrate, are rubbed and cut, and strained.
//!
//! In: the vibration of each body in a frame ([`Vibration`](crate::world::vibration::Vibration)), the work of friction and cutting
//! ([`Dissipation`](crate::world::dissipation::Dissipation)), its largest strain; its surface, the head, the stage. Out: the
//! sound of the frame for all loudspeakers or both ears, into a file, or out of the audio device in a live session. A mode's pressure follows
//! from its motion of the surface ([`Radiator`]); what a frame does to the audible modes ([`Listener`]) is played sample by sample, from where
//! the body is ([`Player`], [`crate::audio`]). A small part of the work is heard as noise ([`NoiseAim`]) from where it is done, the strain as a
//! tone ([`SineAim`]).

mod glide;
#[cfg(test)]
mod heard;
mod listener;
mod live;
mod noise;
mod phrase;
mod pitch;
mod player;
mod radiation;
mod ringing;
#[cfg(test)]
mod rubbed_tests;
mod running;
mod settings;
mod sine;
mod source;
#[cfg(test)]
mod tests;
mod tones;
mod voice;

pub use listener::Listener;
pub use noise::NoiseAim;
pub use phrase::Phrase;
pub use player::{Frames, Player, SoundFrame};
pub use radiation::Radiator;
pub use sine::SineAim;

use super::entry::EffectEntry;

pub(crate) const ENTRY: EffectEntry = EffectEntry {
    name: settings::NAME,
    summary: "the body is heard as it vibrates, is rubbed, cut or strained: loudspeakers, headphones, or a WAV file (--sound)",
    is_heard: true,
    settings: Some(settings::Settings::read),
    suits: Some(settings::suits),
    attach: Some(running::attach),
    start: Some(live::start),
    ..EffectEntry::NOTHING
};
