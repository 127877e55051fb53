//! The audible modes of a body, and what a frame does to them.
//!
//! In: modes of a body, and each of them in a step ([`ModeStep`]); their pressure ([`Radiator`]). Out: what rings in a step.
//!
//! Within a step a mode's amplitude is x = α + β t + γ t² + Re z, where the polynomial follows the load as if there were no inertia and z turns
//! and fades as e^(st), s = -δ + iω. A step begins with a jump of z; between jumps a mode rings by itself, so that a voice plays on even where
//! the next frame comes late. What is heard is Re sz, the speed without β + 2γt.
//!
//! Hands move evenly within a frame, so that their speed jumps from frame to frame. In truth it does not, and what these jumps add to z and β
//! would rattle 60 times a second: they are left out.

use super::radiation::Radiator;
use crate::world::vibration::{ModeStep, VibrationModes};
use nalgebra::Complex;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Frequencies that people hear, Hz.
pub const AUDIBLE: [f64; 2] = [16.0, 20_000.0];

/// A mode that is heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Index among the modes of the vibration.
    pub mode: usize,
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
    /// z where a step begins, and β and γ.
    pub fn begun(&self, step: &ModeStep) -> (Complex<f64>, [f64; 2]) {
        let ModeStep { state: [x, v], load: [a, b, c], .. } = *step;
        let gamma = c / self.square;
        let beta = (b - 4.0 * self.decay * gamma) / self.square;
        let alpha = (a - 2.0 * self.decay * beta - 2.0 * gamma) / self.square;
        let (w, rate) = (x - alpha, v - beta);
        (Complex::new(w, -(rate + self.decay * w) / self.rate.im), [beta, gamma])
    }

    /// Jump of z by a jump of the speed.
    pub fn kicked(&self, by: f64) -> Complex<f64> {
        Complex::new(0.0, -by / self.rate.im)
    }
}
