//! Pseudorandom numbers that are the same in every run.

/// A linear congruential generator (D. Knuth, The Art of Computer Programming, volume 2, section 3.3.4).
#[derive(Debug)]
pub struct Random(u64);

impl Default for Random {
    fn default() -> Random {
        Random(1)
    }
}

impl Random {
    /// Numbers that are others for each seed.
    pub fn new(seed: u64) -> Random {
        // Neighbours begin far from each other (S. Vigna's SplitMix64).
        let mixed = (seed ^ (seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        Random(mixed ^ (mixed >> 27))
    }

    /// The next number, between -0.5 and 0.5.
    pub fn draw(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64 - 0.5
    }
}
