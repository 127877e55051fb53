//! Noise of what rubs or is cut.
//!
//! In: mean square and middle frequency f of the noise at the end of each frame. Out: samples. White noise goes through
//!
//! ```text
//! H(s) = s/(s² + k s + 1)      s = iω/2πf, k = 1
//! ```
//!
//! a band that is as wide as its middle frequency, by the trapezoidal rule with g = tan(πf/rate), whose frequency may change with every sample
//! (V. Zavalishin, The Art of VA Filter Design, 2012, chapter 4). Of the mean square of white noise it leaves g/(k (1 + kg + g²)), by the
//! integral of |H|² over all frequencies up to half of the rate.

use super::glide::{Glide, Level};
use crate::base::random::Random;
use std::f64::consts::PI;

/// Width of the band against its middle frequency.
const WIDTH: f64 = 1.0;
/// Middle frequencies at least and at most, Hz, and at most as a part of the rate.
const MIDDLE_HZ: [f64; 2] = [50.0, 8000.0];
const MOST_OF_RATE: f64 = 0.4;
/// Mean square at most, Pa²: that of the pressure of the air itself.
const MOST: f64 = 1e10;
/// Mean square of [`Random::draw`].
const DRAWN: f64 = 1.0 / 12.0;

/// Goal of a noise at the end of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseAim {
    /// Mean square of the pressure at 1 m, Pa².
    pub square: f64,
    pub hertz: f64,
}

/// A noise. Its mean square moves evenly within a frame, so that its energy is that of the frames.
#[derive(Debug)]
pub struct Noise {
    rate_hz: f64,
    random: Random,
    square: Level,
    g: Glide,
    /// State of the filter.
    kept: [f64; 2],
}

impl Noise {
    /// A silent noise, another one for each seed.
    pub fn new(rate_hz: f64, seed: u64) -> Noise {
        let (random, square, g) = (Random::new(seed), Level::new(rate_hz), Glide::default());
        Noise { rate_hz, random, square, g, kept: [0.0; 2] }
    }

    /// Reaches what a frame asks for within so many samples. What is no number is silent.
    pub fn go(&mut self, aim: &NoiseAim, samples: usize) {
        let is_known = aim.square.is_finite() && aim.hertz.is_finite();
        let hertz = if is_known { aim.hertz.clamp(MIDDLE_HZ[0], MIDDLE_HZ[1]) } else { MIDDLE_HZ[0] };
        let g = (PI * (hertz / self.rate_hz).min(MOST_OF_RATE)).tan();
        match self.square.is_silent() || !is_known {
            true => self.g.put(g),
            false => self.g.go(g, samples),
        }
        self.square.go(if is_known { aim.square.clamp(0.0, MOST) } else { 0.0 }, samples);
    }

    /// Adds the next samples.
    pub fn add(&mut self, samples: &mut [f32]) {
        for sample in samples {
            if self.square.is_silent() {
                return;
            }
            let (square, g) = (self.square.step(), self.g.step());
            let [a, b] = self.kept;
            let band = (a + g * (self.random.draw() - b)) / (1.0 + g * (g + WIDTH));
            let low = b + g * band;
            self.kept = [2.0 * band - a, 2.0 * low - b];
            let left = DRAWN * g / (WIDTH * (1.0 + g * (g + WIDTH)));
            *sample += ((square / left).sqrt() * band) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 48_000.0;

    fn played(aims: &[NoiseAim], seed: u64) -> Vec<f32> {
        let mut noise = Noise::new(RATE_HZ, seed);
        let mut all = Vec::new();
        for aim in aims {
            noise.go(aim, 800);
            let mut samples = [0.0; 800];
            samples.chunks_mut(130).for_each(|piece| noise.add(piece));
            all.extend(samples);
        }
        all
    }

    fn mean_square(samples: &[f32]) -> f64 {
        samples.iter().map(|p| f64::from(*p).powi(2)).sum::<f64>() / samples.len() as f64
    }

    /// Whatever the band, the mean square is that which is asked for; a random number of 20 s tells it within about 1/√(20 s · f).
    #[test]
    fn a_noise_is_as_loud_as_asked_in_every_band() {
        for hertz in [50.0, 200.0, 1000.0, 8000.0] {
            let square = mean_square(&played(&[NoiseAim { square: 4e-4, hertz }; 1201], 1)[800..]);
            println!("{hertz} Hz: {:e}", square / 4e-4 - 1.0);
            assert!((square / 4e-4 - 1.0).abs() < 2.5 / (20.0 * hertz).sqrt(), "{hertz} Hz: {square}");
        }
    }

    /// Mean square moves evenly: frames of different powers have the energy of all of them, which a mean over amplitudes would not.
    #[test]
    fn a_noise_that_swells_and_fades_has_the_energy_of_its_frames() {
        let of = |n: usize| [0.0, 1e-3, 0.0, 0.0, 4e-3, 2e-3][n % 6];
        let aims: Vec<_> = (0..1200).map(|n| NoiseAim { square: of(n), hertz: 2000.0 }).collect();
        let square = mean_square(&played(&aims, 3));
        let asked = (0..6).map(of).sum::<f64>() / 6.0;
        println!("swelling {:e}", square / asked - 1.0);
        assert!((square / asked - 1.0).abs() < 0.02, "{square} {asked}");
    }

    /// A tone goes through by its own amplification: at the middle 1, at half and twice of it 1/√(1 + 1.5²).
    #[test]
    fn the_band_is_as_wide_as_its_middle_frequency() {
        let samples = played(&[NoiseAim { square: 1.0, hertz: 1000.0 }; 2400], 5);
        let density = |hertz: f64| {
            let parts = samples.chunks(4800).map(|part| {
                let turned = part.iter().enumerate().map(|(n, p)| {
                    let (sine, cosine) = (2.0 * PI * hertz * n as f64 / RATE_HZ).sin_cos();
                    [f64::from(*p) * cosine, f64::from(*p) * sine]
                });
                let [re, im] = turned.fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
                re * re + im * im
            });
            parts.sum::<f64>()
        };
        // Means over neighbouring frequencies, 10 Hz apart.
        let near = |hertz: f64| (-9..10).map(|k| density(hertz + 10.0 * f64::from(k))).sum::<f64>();
        let middle = near(1000.0);
        for (hertz, expected) in
            [(500.0, 1.0 / 3.25), (2000.0, 1.0 / 3.25), (4000.0, 1.0 / (1.0 + 3.75_f64.powi(2)))]
        {
            let found = near(hertz) / middle;
            println!("{hertz} Hz: {found} of {expected}");
            assert!((found / expected - 1.0).abs() < 0.1, "{hertz} Hz: {found} {expected}");
        }
    }

    #[test]
    fn what_is_no_number_is_silent_and_seeds_differ() {
        for aim in [
            NoiseAim { square: f64::NAN, hertz: 100.0 },
            NoiseAim { square: 1.0, hertz: f64::NAN },
            NoiseAim { square: f64::INFINITY, hertz: 100.0 },
            NoiseAim { square: -1.0, hertz: 100.0 },
        ] {
            assert!(played(&[aim; 3], 1).iter().all(|sample| *sample == 0.0), "{aim:?}");
        }
        let loudest = played(&[NoiseAim { square: 1e300, hertz: 1e300 }; 3], 1);
        assert!(loudest.iter().all(|sample| sample.is_finite()));
        let [one, again, other] =
            [1, 1, 2].map(|seed| played(&[NoiseAim { square: 1.0, hertz: 500.0 }; 60], seed));
        assert_eq!(one, again);
        let both: f64 = one.iter().zip(&other).map(|(a, b)| f64::from(a * b)).sum::<f64>() / one.len() as f64;
        println!("of one another {both:e}");
        assert!(both.abs() < 0.07, "{both}");
    }
}
