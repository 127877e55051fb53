//! Keeps the output within digital full scale.
//!
//! In: frames of samples. Out: the same below -1 dB re full scale; a louder frame is turned down at once, all channels alike so that
//! places stay, and the gain comes back within some tenths of a second.

/// The loudest sample that is let through, -1 dB re full scale.
pub const CEILING: f32 = 0.891_250_9;
/// Time constant with which the gain comes back, s.
const RELEASE_S: f64 = 0.1;

#[derive(Clone, Debug)]
pub struct Limiter {
    gain: f64,
    /// Share of the way back to 1 per frame.
    release: f64,
    /// Frames that were turned down so far.
    pub limited: u64,
}

impl Limiter {
    pub fn new(rate_hz: f64) -> Limiter {
        let release = 1.0 - (-1.0 / (RELEASE_S * rate_hz.max(1.0))).exp();
        Limiter { gain: 1.0, release, limited: 0 }
    }

    pub fn frame(&mut self, frame: &mut [f32]) {
        for sample in frame.iter_mut().filter(|sample| !sample.is_finite()) {
            *sample = 0.0;
        }
        let peak = frame.iter().fold(0.0f32, |peak, sample| peak.max(sample.abs()));
        self.gain += (1.0 - self.gain) * self.release;
        if f64::from(peak) * self.gain > f64::from(CEILING) {
            self.gain = f64::from(CEILING) / f64::from(peak);
            self.limited += 1;
        }
        // The last ten-thousandth of the way back.
        if self.gain > 0.9999 {
            self.gain = 1.0;
        } else {
            frame.iter_mut().for_each(|sample| *sample *= self.gain as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_below_the_ceiling_passes_unchanged() {
        let mut limiter = Limiter::new(48_000.0);
        for k in 0..1000 {
            let mut frame = [0.89 * (k as f32 * 0.1).sin(), 0.3];
            let before = frame;
            limiter.frame(&mut frame);
            assert_eq!(frame, before);
        }
        assert_eq!(limiter.limited, 0);
    }

    /// A sine of twice full scale comes out at the ceiling, and 1 s later a soft one has its level again.
    #[test]
    fn a_loud_tone_is_turned_down_and_the_gain_comes_back() {
        let mut limiter = Limiter::new(48_000.0);
        let tone = |k: usize| (k as f32 * std::f32::consts::TAU * 1000.0 / 48_000.0).sin();
        let loud = |k: usize| {
            let mut frame = [2.0 * tone(k)];
            limiter.frame(&mut frame);
            frame[0]
        };
        let loud: Vec<f32> = (0..4800).map(loud).collect();
        let power = loud[480..].iter().map(|x| f64::from(x * x)).sum::<f64>() / 4320.0;
        assert!((power.sqrt() / (f64::from(CEILING) / 2f64.sqrt()) - 1.0).abs() < 0.01, "{power}");
        assert!(limiter.limited > 100);
        (0..48_000).for_each(|_| limiter.frame(&mut [0.0]));
        let mut frame = [0.5];
        limiter.frame(&mut frame);
        assert_eq!(frame, [0.5]);
    }

    proptest! {
        #[test]
        fn no_sample_is_beyond_full_scale(samples in proptest::collection::vec(proptest::num::f32::ANY, 2..200)) {
            let mut limiter = Limiter::new(48_000.0);
            let mut samples = samples;
            samples.chunks_mut(2).for_each(|frame| limiter.frame(frame));
            prop_assert!(samples.iter().all(|sample| sample.abs() <= 1.0), "{samples:?}");
        }
    }
}
