//! Functions that make the samples for which an audio device asks.

/// Writes the samples of the next frames, which are 0 before, interleaved for all channels of a
/// [`Listening`](super::Listening). It runs in the audio thread: no allocation, no lock, no file.
pub type Fill = Box<dyn FnMut(&mut [f32]) + Send>;
