//! Tones as a voice plays them, made ready outside of the audio thread.

use super::tones::{Tone, Tones};
use nalgebra::Complex;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Tones as they ring.
#[derive(Clone, Debug, Default)]
pub struct Ringing {
    pub tones: Option<Arc<Tones>>,
    /// z of each tone, by what it turns in a sample, and the pressure of a z of 1.
    pub z: Vec<Complex<f64>>,
    pub turns: Vec<Complex<f64>>,
    pub pressures: Vec<Complex<f64>>,
}

impl Ringing {
    /// Tones at rest. Those above half of `rate_hz` cannot be played, and are silent.
    pub fn new(tones: &Arc<Tones>, rate_hz: f64) -> Ringing {
        let can_be_played = |rate: Complex<f64>| rate.im < 0.5 * TAU * rate_hz;
        let pressure = |tone: &Tone| match can_be_played(tone.rate) {
            true => tone.rate * tone.pressure,
            false => Complex::ZERO,
        };
        Ringing {
            z: vec![Complex::ZERO; tones.all.len()],
            turns: tones.all.iter().map(|tone| (tone.rate / rate_hz).exp()).collect(),
            pressures: tones.all.iter().map(pressure).collect(),
            tones: Some(tones.clone()),
        }
    }
}
