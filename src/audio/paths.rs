//! The ways of one source to all channels, as plain data that a frame hands to the audio thread.

use crate::stage::MOST_LOUDSPEAKERS;

/// The largest number of channels.
pub const MOST_CHANNELS: usize = MOST_LOUDSPEAKERS;
/// A longer delay is cut, s.
pub const MOST_DELAY_S: f64 = 0.1;

/// The way of a source to one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Path {
    /// Pascals of the channel, where it is calibrated, per pascal of the source at 1 m.
    pub gain: f32,
    pub delay_s: f32,
    /// The gain of the head's shadow at high frequencies, by which the gain at low ones is multiplied: 1 without a head, 2 towards
    /// the source, and down to 0.1 behind the head.
    pub shadow: f32,
}

impl Path {
    pub const SILENT: Path = Path { gain: 0.0, delay_s: 0.0, shadow: 1.0 };

    pub(super) fn towards(&self, other: &Path, share: f32) -> Path {
        let between = |from: f32, to: f32| from + (to - from) * share;
        Path {
            gain: between(self.gain, other.gain),
            delay_s: between(self.delay_s, other.delay_s),
            shadow: between(self.shadow, other.shadow),
        }
    }
}

/// The ways of a source to all channels; those beyond the device's are silent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paths(pub [Path; MOST_CHANNELS]);

impl Paths {
    pub const SILENT: Paths = Paths([Path::SILENT; MOST_CHANNELS]);

    /// The ways after this share of the way to others.
    pub fn towards(&self, other: &Paths, share: f32) -> Paths {
        Paths(std::array::from_fn(|channel| self.0[channel].towards(&other.0[channel], share)))
    }
}
