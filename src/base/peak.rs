//! The greatest of late: rises at once with what it is told, and falls slowly towards it.

/// Time constant with which it falls, s: several hundred readings of a slow device, so that what comes seldom is
/// not forgotten before it comes again.
pub const MEMORY_S: f64 = 5.0;

/// Numbers with the time at which they came, in; the greatest of late, out. Begins with the first number.
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
    /// Takes a number at a time in s; what is no number is passed over.
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
