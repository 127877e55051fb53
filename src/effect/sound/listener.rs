//! Modes of a body as a voice plays them.
//!
//! In: the vibration of one frame after the other. Out: for each a [`Phrase`], with the jumps of z where its steps begin, as [`Tone`] has
//! them.

use super::phrase::{Beat, Phrase};
use super::radiation::Radiator;
use super::ringing::Ringing;
#[cfg(doc)]
use super::tones::Tone;
use super::tones::Tones;
use crate::world::vibration::Vibration;
use nalgebra::Complex;
use std::sync::Arc;

/// Frames of one body turned into phrases.
pub struct Listener {
    rate_hz: f64,
    tones: Option<Arc<Tones>>,
    /// Each tone where the last frame ended; `None` where it begins anew.
    last: Vec<Option<Ended>>,
    /// All tones that were heard yet.
    known: Vec<Arc<Tones>>,
}

/// z and β at the end of a step.
#[derive(Clone, Copy)]
struct Ended {
    z: Complex<f64>,
    beta: f64,
}

impl Listener {
    /// A listener for voices that play this many samples in a second.
    pub fn new(rate_hz: f64) -> Listener {
        Listener { rate_hz, tones: None, last: Vec::new(), known: Vec::new() }
    }

    /// The phrase of a frame. A motion that is no number is silent, and the next frame begins anew.
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
            self.last = vec![None; tones.all.len()];
            self.tones = Some(tones.clone());
        }
        let (mut beats, mut at_s) = (Vec::new(), 0.0);
        for step in &vibration.steps {
            let mut beat = Beat { at_s, ..Beat::default() };
            for (tone, last) in tones.all.iter().zip(&mut self.last) {
                let mode = &step.modes[tone.mode];
                let (z, [beta, gamma]) = tone.begun(mode);
                let before = last.unwrap_or(Ended { z: Complex::ZERO, beta });
                beat.jumps.push(z - before.z - tone.kicked(mode.kick - (beta - before.beta)));
                let turned = z * (tone.rate * step.dt_s).exp();
                *last = Some(Ended { z: turned, beta: beta + 2.0 * gamma * step.dt_s });
            }
            if !beat.jumps.iter().all(|jump| jump.re.is_finite() && jump.im.is_finite()) {
                self.break_off();
                return Phrase::default();
            }
            at_s += step.dt_s;
            beats.push(beat);
        }
        let fresh = (!is_same).then(|| Ringing::new(&tones, self.rate_hz));
        Phrase { fresh, beats, ..Phrase::default() }
    }

    /// Forgets what was heard last: the next frame does not go on from it.
    pub fn break_off(&mut self) {
        self.tones = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::vibration::{ModeStep, VibrationModes, VibrationStep};
    use nalgebra::Vector3;

    const OMEGA: f64 = 2800.0;

    fn body() -> (Arc<VibrationModes>, Radiator) {
        let radiator = Radiator::new(&[[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], &[[0, 1, 2]]);
        let (squares, shapes) = (vec![OMEGA * OMEGA], vec![vec![Vector3::z(); 3]]);
        (Arc::new(VibrationModes { squares, decays: vec![0.0], shapes }), radiator)
    }

    fn frame(modes: &Arc<VibrationModes>, mode: ModeStep) -> Vibration {
        let step = VibrationStep { dt_s: 1.0 / 60.0, modes: vec![mode] };
        Vibration { modes: modes.clone(), steps: vec![step] }
    }

    /// A hand that goes to and fro evenly from frame to frame: its speed and the slope of the load jump, which no one hears.
    #[test]
    fn a_hand_that_moves_a_body_makes_no_sound() {
        let (modes, radiator) = body();
        let mut listener = Listener::new(48_000.0);
        let speed = |frame: i32| 0.6 * (0.1 * f64::from(frame)).cos();
        let (mut state, mut last_slope) = ([0.0, 0.0], 0.0);
        for number in 0..100 {
            let kick = speed(number) - speed(number - 1);
            let slope = 40.0 * speed(number);
            let begun = [state[0], state[1] + kick];
            let phrase = listener
                .phrase(&frame(&modes, ModeStep { state: begun, kick, load: [0.0, slope, 0.0] }), &radiator);
            let most = phrase.beats[0].jumps[0].norm();
            // The first frame takes up a motion that has begun.
            assert!(number == 0 || most < 1e-12 * OMEGA, "frame {number}: {most}");
            // x = b t/λ + …, whose beginning the next frame moves to 0.
            let (square, t) = (OMEGA * OMEGA, 1.0_f64 / 60.0);
            let (w, rate) = (begun[0], begun[1] - slope / square);
            let (sine, cosine) = (OMEGA * t).sin_cos();
            state = [w * cosine + rate / OMEGA * sine, rate * cosine - w * OMEGA * sine + slope / square];
            last_slope = slope;
        }
        assert!(state[1].abs() > 1e-3 && last_slope != 0.0, "the mode itself rings");
    }

    /// A frame of no numbers is silent, and the one after it is heard again.
    #[test]
    fn what_is_no_number_is_not_played() {
        let (modes, radiator) = body();
        let mut listener = Listener::new(48_000.0);
        let struck = ModeStep { state: [0.0, 1.0], ..ModeStep::default() };
        assert_eq!(listener.phrase(&frame(&modes, struck), &radiator).beats.len(), 1);
        let wrong = ModeStep { state: [f64::NAN, 1.0], ..ModeStep::default() };
        assert!(listener.phrase(&frame(&modes, wrong), &radiator).beats.is_empty());
        let phrase = listener.phrase(&frame(&modes, struck), &radiator);
        assert!(phrase.fresh.is_some() && (phrase.beats[0].jumps[0].norm() * OMEGA - 1.0).abs() < 1e-12);
    }
}
