//! A running maximum that rises at once and decays slowly.

/// Time constant of the decay, s: several hundred readings of a slow device, so that a rare peak is not forgotten before
/// the next one comes.
pub const MEMORY_S: f64 = 5.0;

/// Takes numbers with the times at which they came, and holds their recent maximum. It begins with the first number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    pub value: f64,
    at_s: f64,
}

impl Default for Peak {
    fn default() -> Peak {
        Peak { value: 0.0, at_s: f64::NEG_INFINITY }
    }
}

impl Peak {
    /// Takes a number at a time in s; NaN is ignored.
    pub fn take(&mut self, value: f64, now_s: f64) {
        if !value.is_finite() {
            return;
        }
        let part = ((now_s - self.at_s) / MEMORY_S).clamp(0.0, 1.0);
        self.value = value.max(self.value + (value - self.value) * part);
        self.at_s = now_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_rises_at_once_and_falls_slowly() {
        let mut peak = Peak::default();
        peak.take(1.0, 7.0);
        assert_eq!(peak.value, 1.0);
        peak.take(5.0, 7.001);
        peak.take(f64::NAN, 7.002);
        assert_eq!(peak.value, 5.0);
        for i in 1..=5000 {
            peak.take(1.0, 7.001 + 1e-3 * f64::from(i));
        }
        assert!((peak.value - (1.0 + 4.0 / std::f64::consts::E)).abs() < 1e-3, "{peak:?}");
        peak.take(0.5, 1000.0);
        assert_eq!(peak.value, 0.5, "after a long silence it begins anew");
    }
}
