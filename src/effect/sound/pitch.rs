//! A tone that tells how far a body is strained: `[body.NAME.effect.sound.pitch]`.
//!
//! In: the largest value of a quantity on its surface, x of the value at the end of the scale. Out: a frequency and a level,
//!
//! ```text
//! f = from_hz (to_hz/from_hz)^x      p = x p_level      x within 0 and 1
//! ```

use super::sine::SineAim;
use super::tones::AUDIBLE;
use crate::audio::REFERENCE_PA;
use crate::scene::Quantity;
use serde::Deserialize;
use std::f64::consts::SQRT_2;

/// Level at most, dB.
const MOST_DB: f64 = 120.0;

#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Pitch {
    /// The quantity that is heard, and its value at the end of the scale.
    of: Quantity,
    full: f64,
    from_hz: f64,
    to_hz: f64,
    /// Sound pressure level at 1 m at the end of the scale, dB.
    level_db: f64,
}

impl Default for Pitch {
    fn default() -> Pitch {
        Pitch { of: Quantity::Strain, full: 0.0, from_hz: 110.0, to_hz: 880.0, level_db: 60.0 }
    }
}

impl Pitch {
    /// The error names a value that cannot be.
    pub fn check(&self) -> Result<(), String> {
        let Pitch { of, full, from_hz, to_hz, level_db } = *self;
        if !(full > 0.0 && full.is_finite()) {
            let (title, unit) = (of.title(), of.unit());
            let unit =
                if unit.is_empty() { "as a ratio, such as 0.3".to_owned() } else { format!("in {unit}") };
            return Err(format!(
                "pitch.full = {full}: write the {title} at which the tone is at to_hz, {unit}"
            ));
        }
        let is_audible = |hertz: f64| (AUDIBLE[0]..=AUDIBLE[1]).contains(&hertz);
        if !(is_audible(from_hz) && is_audible(to_hz) && from_hz < to_hz) {
            return Err(format!(
                "pitch.from_hz = {from_hz} and pitch.to_hz = {to_hz}: write two frequencies within {} and {} Hz, the lower one first",
                AUDIBLE[0], AUDIBLE[1]
            ));
        }
        if !(0.0..=MOST_DB).contains(&level_db) {
            return Err(format!("pitch.level_db = {level_db} is not within 0 and {MOST_DB} dB"));
        }
        Ok(())
    }

    /// The tone of a body with these largest values, in the order of [`Quantity::ALL`]. What is no number is silent.
    pub fn aim(&self, largest: &[f64; 3]) -> SineAim {
        let part = largest[self.of as usize] / self.full;
        let part = if part.is_finite() { part.clamp(0.0, 1.0) } else { 0.0 };
        let full = SQRT_2 * REFERENCE_PA * 10.0_f64.powf(self.level_db / 20.0);
        SineAim { pressure: part * full, hertz: self.from_hz * (self.to_hz / self.from_hz).powf(part) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_has_equal_steps_for_equal_strains() {
        let pitch = Pitch { full: 0.3, ..Pitch::default() };
        let hertz = |strain: f64| pitch.aim(&[1e9, strain, 1e9]).hertz;
        for (strain, expected) in [(0.0, 110.0), (0.1, 220.0), (0.2, 440.0), (0.3, 880.0), (5.0, 880.0)] {
            assert!((hertz(strain) / expected - 1.0).abs() < 1e-12, "{strain}: {}", hertz(strain));
        }
        let pressure = |strain: f64| pitch.aim(&[0.0, strain, 0.0]).pressure;
        // 60 dB are 20 mPa in the root mean square.
        assert!(
            (pressure(0.3) - 0.02 * SQRT_2).abs() < 1e-15 && (pressure(0.15) - 0.01 * SQRT_2).abs() < 1e-15
        );
        assert_eq!([pressure(0.0), pressure(f64::NAN), pressure(-1.0)], [0.0; 3]);
    }
}
