//! Values that move evenly from sample to sample, and levels that end where no frame continues them.

/// Samples in which a value moves at least, so that it does not click.
const SHORTEST: usize = 32;
/// Time in which a level falls to zero that no frame continues, s: longer than frames are late.
const STOP_S: f64 = 0.05;

/// A value on its way to another one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Glide {
    now: f64,
    to: f64,
    left: usize,
}

impl Glide {
    pub fn put(&mut self, at: f64) {
        *self = Glide { now: at, to: at, left: 0 };
    }

    /// Reaches a value within so many samples.
    pub fn go(&mut self, to: f64, samples: usize) {
        (self.to, self.left) = (to, samples.max(SHORTEST));
    }

    /// The value at the next sample.
    pub fn step(&mut self) -> f64 {
        if self.left > 0 {
            self.now += (self.to - self.now) / self.left as f64;
            self.left -= 1;
        }
        self.now
    }
}

/// A level that falls to zero where no frame continues it.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    glide: Glide,
    /// Samples of its fall.
    stop: usize,
}

impl Level {
    pub fn new(rate_hz: f64) -> Level {
        Level { glide: Glide::default(), stop: (STOP_S * rate_hz).ceil() as usize }
    }

    /// Reaches a level within so many samples.
    pub fn go(&mut self, to: f64, samples: usize) {
        self.glide.go(to, samples);
    }

    pub fn is_silent(&self) -> bool {
        self.glide.left == 0 && self.glide.to == 0.0
    }

    /// The level at the next sample.
    pub fn step(&mut self) -> f64 {
        if self.glide.left == 0 && self.glide.to != 0.0 {
            self.glide.go(0.0, self.stop);
        }
        self.glide.step().max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_arrives_with_the_frame_and_ends_where_none_follows() {
        let mut level = Level::new(48_000.0);
        assert!(level.is_silent());
        level.go(1.0, 100);
        let risen: Vec<f64> = (0..100).map(|_| level.step()).collect();
        assert!((risen[0] - 0.01).abs() < 1e-15 && (risen[99] - 1.0).abs() < 1e-15);
        level.go(0.5, 100);
        (0..100).for_each(|_| {
            level.step();
        });
        assert!((level.step() - 0.5 * (1.0 - 1.0 / 2400.0)).abs() < 1e-12);
        (1..2400).for_each(|_| {
            level.step();
        });
        assert!(level.is_silent() && level.step() == 0.0);
    }
}
