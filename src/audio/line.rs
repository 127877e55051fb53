//! A delay line of one source, read between its samples.
//!
//! In: samples. Out: the sound of any moment in the last tenth of a second, by the cubic through four samples (Lagrange).

use super::paths::MOST_DELAY_S;

#[derive(Clone, Debug)]
pub struct DelayLine {
    /// A ring whose length is a power of two.
    samples: Vec<f32>,
    /// Place of the next sample.
    at: usize,
}

impl DelayLine {
    pub fn new(rate_hz: f64) -> DelayLine {
        let length = (MOST_DELAY_S * rate_hz.clamp(1.0, 1e6)).ceil() as usize + 4;
        DelayLine { samples: vec![0.0; length.next_power_of_two()], at: 0 }
    }

    pub fn push(&mut self, sample: f32) {
        let length = self.samples.len();
        self.samples[self.at] = sample;
        self.at = (self.at + 1) & (length - 1);
    }

    /// The sound `delay` + 1 samples before the last one: a cubic needs a sample after the moment, too.
    pub fn read(&self, delay: f32) -> f32 {
        let mask = self.samples.len() - 1;
        let delay = delay.clamp(0.0, (mask - 3) as f32);
        let whole = delay as usize;
        let x = delay - whole as f32;
        let ago = |k: usize| self.samples[self.at.wrapping_sub(1 + whole + k) & mask];
        let [after, from, to, before] = [ago(0), ago(1), ago(2), ago(3)];
        let [u, v, w] = [x + 1.0, x - 1.0, x - 2.0];
        -x * v * w / 6.0 * after + u * v * w / 2.0 * from - u * x * w / 2.0 * to + u * x * v / 6.0 * before
    }

    pub fn clear(&mut self) {
        self.samples.fill(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cubic through four samples is exact for cubics, at every delay.
    #[test]
    fn a_cubic_is_read_between_its_samples() {
        let cubic = |t: f64| 1.0 - 0.3 * t + 0.02 * t * t - 0.001 * t.powi(3);
        let mut line = DelayLine::new(1000.0);
        (0..200).for_each(|k| line.push(cubic(f64::from(k) - 190.0) as f32));
        for delay in [0.0f32, 0.25, 1.0, 2.5, 7.999] {
            let expected = cubic(9.0 - 1.0 - f64::from(delay));
            assert!((f64::from(line.read(delay)) - expected).abs() < 2e-6, "{delay}: {}", line.read(delay));
        }
    }

    #[test]
    fn a_delay_beyond_the_line_is_cut() {
        let mut line = DelayLine::new(1000.0);
        (0..1000).for_each(|_| line.push(1.0));
        assert!(
            [1e9, f32::INFINITY, -1.0].map(|delay| line.read(delay)).iter().all(|x| (x - 1.0).abs() < 1e-6)
        );
    }
}
