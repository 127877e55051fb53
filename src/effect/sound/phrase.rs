//! Phrases: the content of a frame for one voice.

use super::noise::NoiseAim;
use super::ringing::Ringing;
use super::sine::SineAim;
use nalgebra::Complex;

/// A frame of one source, to be played.
#[derive(Debug, Default)]
pub struct Phrase {
    /// Tones at rest that take the place of those before, where they are others.
    pub fresh: Option<Ringing>,
    pub beats: Vec<Beat>,
    /// Noise and tone at the end of the frame; where a frame asks for none, they end.
    pub noise: Option<NoiseAim>,
    pub tone: Option<SineAim>,
}

/// The beginning of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beat {
    /// Time since the frame began, s.
    pub at_s: f64,
    /// Jump of z of each tone.
    pub jumps: Vec<Complex<f64>>,
}
