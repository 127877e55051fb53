//! A tone whose frequency and level glide.
//!
//! In: both at the end of each frame. Out: samples, whose phase goes on whatever a frame asks for.

use super::glide::{Glide, Level};
use std::f64::consts::TAU;

/// Frequency at most, as a part of the rate.
const MOST_OF_RATE: f64 = 0.45;

/// Goal of a tone at the end of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SineAim {
    /// Amplitude at 1 m, Pa.
    pub pressure: f64,
    pub hertz: f64,
}

/// A tone.
#[derive(Debug)]
pub struct Sine {
    rate_hz: f64,
    pressure: Level,
    hertz: Glide,
    /// Phase, in turns.
    turned: f64,
}

impl Sine {
    /// A silent tone.
    pub fn new(rate_hz: f64) -> Sine {
        Sine { rate_hz, pressure: Level::new(rate_hz), hertz: Glide::default(), turned: 0.0 }
    }

    /// Reaches what a frame asks for within so many samples.
    pub fn go(&mut self, aim: &SineAim, samples: usize) {
        let hertz = aim.hertz.min(MOST_OF_RATE * self.rate_hz);
        match self.pressure.is_silent() {
            true => self.hertz.put(hertz),
            false => self.hertz.go(hertz, samples),
        }
        self.pressure.go(aim.pressure, samples);
    }

    /// Adds the next samples.
    pub fn add(&mut self, samples: &mut [f32]) {
        for sample in samples {
            if self.pressure.is_silent() {
                return;
            }
            let (pressure, hertz) = (self.pressure.step(), self.hertz.step());
            self.turned = (self.turned + hertz / self.rate_hz).fract();
            *sample += (pressure * (TAU * self.turned).sin()) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 48_000.0;

    /// A tone that glides by an octave and back within frames: its phase is the integral of its frequency, so that no sample is farther from
    /// the last one than the steepest slope allows, at the borders of frames too.
    #[test]
    fn a_gliding_tone_goes_on_in_phase() {
        let mut sine = Sine::new(RATE_HZ);
        let mut all = Vec::new();
        for frame in 0..60 {
            let hertz = if frame % 2 == 0 { 400.0 } else { 800.0 };
            sine.go(&SineAim { pressure: 1.0, hertz }, 800);
            let mut samples = [0.0; 800];
            samples.chunks_mut(130).for_each(|piece| sine.add(piece));
            all.extend(samples);
        }
        let steepest = all[800..].windows(2).map(|two| f64::from(two[1] - two[0]).abs()).fold(0.0, f64::max);
        let allowed = TAU * 800.0 / RATE_HZ;
        println!("steepest {steepest} of {allowed}");
        assert!(steepest < allowed * 1.001);
        // 600 Hz in the mean, each turn with one crossing upwards.
        let turns = all[800..].windows(2).filter(|two| two[0] < 0.0 && two[1] >= 0.0).count();
        assert!((turns as f64 - 600.0 * 59.0 / 60.0).abs() < 2.0, "{turns}");
    }

    #[test]
    fn a_tone_ends_where_no_frame_continues_it() {
        let mut sine = Sine::new(RATE_HZ);
        sine.go(&SineAim { pressure: 1.0, hertz: 440.0 }, 800);
        let mut samples = vec![0.0; 800 + 2400];
        sine.add(&mut samples);
        assert!(samples[800..1600].iter().any(|sample| sample.abs() > 0.6));
        let mut after = [0.0; 800];
        sine.add(&mut after);
        assert_eq!(after, [0.0; 800]);
    }
}
