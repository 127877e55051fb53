//! The legend of colours in a picture.

/// The legend of a field, in SI units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Legend {
    /// `von Mises stress`.
    pub title: String,
    /// A unit, such as `Pa`; empty for a ratio, which is shown in percent.
    pub unit: String,
    /// The value at the end of the colours; they begin at 0.
    pub to: f64,
    /// The origin of the end: `the limit`, `as the scene has it`, `grows with the session`.
    pub range: String,
    /// Limits of this field.
    pub limits: Vec<f64>,
    /// Whether anything has a limit, of whatever field: a separate colour marks what is beyond it.
    pub has_limit: bool,
    /// Further lines, the most important first.
    pub lines: Vec<LegendLine>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct LegendLine {
    pub text: String,
    /// Whether a limit is passed.
    pub warns: bool,
}

/// Numbers along a legend that ends at `to`: 3 to 6 round values, 0 first.
pub fn ticks(to: f64) -> Vec<f64> {
    if !(to > 0.0 && to.is_finite()) {
        return vec![0.0];
    }
    let step = above(to / 5.0, &[1.0, 2.0, 5.0, 10.0]);
    (0..=5).map(|k| f64::from(k) * step).filter(|tick| *tick <= to * (1.0 + 1e-9)).collect()
}

/// The next round value, at most a third larger.
pub fn round_up(value: f64) -> f64 {
    above(value, &[1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
}

/// The next of these steps times a power of ten, the last of which is 10; 0 if the value is not positive.
fn above(value: f64, steps: &[f64]) -> f64 {
    if !(value > 0.0 && value.is_finite()) {
        return 0.0;
    }
    let power = 10_f64.powf(value.log10().floor());
    let step = steps.iter().find(|step| **step * power >= value * (1.0 - 1e-9));
    step.unwrap_or(&10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        assert_eq!(ticks(250e6), [0.0, 50e6, 100e6, 150e6, 200e6, 250e6]);
        assert_eq!(ticks(1.0), [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]);
        assert_eq!(ticks(3.1), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(ticks(f64::NAN), [0.0]);
    }

    proptest::proptest! {
        #[test]
        fn every_range_has_ticks(to in 1e-200..1e200_f64) {
            let ticks = ticks(to);
            proptest::prop_assert!((3..=6).contains(&ticks.len()), "{ticks:?}");
            proptest::prop_assert!(ticks.windows(2).all(|pair| pair[1] > pair[0]));
            let top = round_up(to);
            proptest::prop_assert!(top >= to * (1.0 - 1e-9) && top <= 1.34 * to);
        }
    }
}
