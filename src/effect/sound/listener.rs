//! Frames of a body as a voice plays them.
//!
//! In: the vibration of one frame after the other. Out: for each a [`Phrase`], with the jumps of z where its steps begin, as [`Tone`] has
//! them.

use super::radiation::Radiator;
use super::ringing::Ringing;
#[cfg(doc)]
use super::tones::Tone;
use super::tones::Tones;
use crate::world::vibration::Vibration;
use nalgebra::Complex;
use std::sync::Arc;

/// A frame of one body, to be played.
#[derive(Debug, Default)]
pub struct Phrase {
    /// Tones at rest that take the place of those before, where they are others.
    pub fresh: Option<Ringing>,
    pub beats: Vec<Beat>,
}

/// The beginning of a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Beat {
    /// Time since the frame began, s.
    pub at_s: f64,
    /// Jump of z of each tone.
    pub jumps: Vec<Complex<f64>>,
    /// Pressure at 1 m of the motion that follows the load, Pa, and its slope, Pa/s.
    pub slow: [f64; 2],
}

/// Frames of one body turned into phrases.
pub struct Listener {
    rate_hz: f64,
    tones: Option<Arc<Tones>>,
    /// z of each tone where the last frame ended.
    last: Vec<Complex<f64>>,
    /// All tones that were heard yet.
    known: Vec<Arc<Tones>>,
}

impl Listener {
    /// A listener for voices that play this many samples in a second.
    pub fn new(rate_hz: f64) -> Listener {
        Listener { rate_hz, tones: None, last: Vec::new(), known: Vec::new() }
    }

    /// The phrase of a frame.
    pub fn phrase(&mut self, vibration: &Vibration, radiator: &Radiator) -> Phrase {
        let is_same = self.tones.as_ref().is_some_and(|tones| tones.are_of(&vibration.modes));
        let tones = match self.known.iter().find(|tones| tones.are_of(&vibration.modes)) {
            Some(tones) => tones.clone(),
            None => {
                let tones = Arc::new(Tones::new(&vibration.modes, radiator));
                self.known.push(tones.clone());
                tones
            }
        };
        if !is_same {
            self.last = vec![Complex::ZERO; tones.all.len()];
            self.tones = Some(tones.clone());
        }
        let (mut beats, mut at_s) = (Vec::new(), 0.0);
        for step in &vibration.steps {
            let mut beat = Beat { at_s, ..Beat::default() };
            for (tone, last) in tones.all.iter().zip(&mut self.last) {
                let ([_, beta, gamma], z) = tone.begun(&step.modes[tone.mode]);
                beat.jumps.push(z - *last);
                beat.slow[0] += tone.pressure * beta;
                beat.slow[1] += tone.pressure * 2.0 * gamma;
                *last = z * (tone.rate * step.dt_s).exp();
            }
            at_s += step.dt_s;
            beats.push(beat);
        }
        Phrase { fresh: (!is_same).then(|| Ringing::new(&tones, self.rate_hz)), beats }
    }

    /// Forgets what was heard last: the next frame does not go on from it.
    pub fn break_off(&mut self) {
        self.tones = None;
    }
}
