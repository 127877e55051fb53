//! The audible modes of a body, and what a frame does to them.
//!
//! In: the vibration of a frame ([`Vibration`]), its modes' pressure ([`Radiator`]). Out: a [`Phrase`] for the voice that plays it.
//!
//! Within a step a mode's amplitude is x = α + β t + γ t² + Re z, where the polynomial follows the load as if there were no inertia and z turns
//! and fades as e^(st), s = -δ + iω. A step begins with a jump of z; between jumps a mode rings by itself, so that a voice plays on even where
//! the next frame comes late. The pressure follows the speed, which no jump of z and β breaks off.

use super::radiation::Radiator;
use super::voice::Ringing;
use crate::world::vibration::{ModeStep, Vibration, VibrationModes};
use nalgebra::Complex;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Frequencies that people hear, Hz.
const AUDIBLE: [f64; 2] = [16.0, 20_000.0];

/// A mode that is heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Its index among the modes of the vibration.
    mode: usize,
    /// λ and δ.
    square: f64,
    decay: f64,
    /// s, 1/s.
    pub rate: Complex<f64>,
    /// Pressure at 1 m over the amplitude's speed, Pa m over its unit.
    pub pressure: f64,
}

/// The audible modes of a body while the same elements are held.
#[derive(Debug)]
pub struct Tones {
    pub all: Vec<Tone>,
    of: Arc<VibrationModes>,
}

impl Tones {
    pub fn new(of: &Arc<VibrationModes>, radiator: &Radiator) -> Tones {
        let tone = |mode: usize| {
            let (square, decay) = (of.squares[mode], of.decays[mode]);
            let omega = (square - decay * decay).max(0.0).sqrt();
            let is_heard = AUDIBLE[0] <= omega / TAU && omega / TAU <= AUDIBLE[1];
            is_heard.then(|| Tone {
                mode,
                square,
                decay,
                rate: Complex::new(-decay, omega),
                pressure: radiator.pressure(&of.shapes[mode], omega),
            })
        };
        Tones { all: (0..of.squares.len()).filter_map(tone).collect(), of: of.clone() }
    }

    pub fn are_of(&self, modes: &Arc<VibrationModes>) -> bool {
        Arc::ptr_eq(&self.of, modes)
    }
}

impl Tone {
    /// α, β and γ of a step, and z where it begins.
    fn begun(&self, step: &ModeStep) -> ([f64; 3], Complex<f64>) {
        let ModeStep { state: [x, v], load: [a, b, c] } = *step;
        let gamma = c / self.square;
        let beta = (b - 4.0 * self.decay * gamma) / self.square;
        let alpha = (a - 2.0 * self.decay * beta - 2.0 * gamma) / self.square;
        let (w, rate) = (x - alpha, v - beta);
        ([alpha, beta, gamma], Complex::new(w, -(rate + self.decay * w) / self.rate.im))
    }
}

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
