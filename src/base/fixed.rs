//! Numbers in a fixed width with fixed digits, so that nothing jumps or collides while they change.
//!
//! In: any number, also infinite or none. Out: text of exactly the asked number of letters; a quantity begins with a blank and
//! has its prefix and unit in a column of their own: `  12.34 mN `.

/// A kind of quantity: its unit, and the powers of a thousand for which it has prefixes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    pub name: &'static str,
    pub powers: [i32; 2],
}

pub const FORCE: Unit = Unit { name: "N", powers: [-2, 2] };
pub const TORQUE: Unit = Unit { name: "N·m", powers: [-2, 2] };
pub const LENGTH: Unit = Unit { name: "m", powers: [-1, 0] };
pub const ENERGY: Unit = Unit { name: "J", powers: [-2, 2] };
pub const TIME: Unit = Unit { name: "s", powers: [-2, 0] };

/// Letters in a row of the overlay.
pub const LETTERS: usize = 40;

/// Letters of the number of a quantity.
pub const NUMBER: usize = 8;

/// Two digits after the point, up to this before the next prefix; one digit of a part of it stays below 1000 too.
const MOST: f64 = 999.95;

/// A unit with a prefix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    unit: Unit,
    power: i32,
}

impl Unit {
    /// The prefix for a number of this size: µ for millionths to M for millions, as far as the unit takes them. A number that
    /// would be zero with all of them has none.
    pub fn scale(self, size: f64) -> Scale {
        let [least, most] = self.powers;
        let fits = |power: &i32| size.abs() < MOST * 1000f64.powi(*power);
        let is_zero = size.abs() < 0.005 * 1000f64.powi(least) || !size.is_finite();
        let power = if is_zero { 0 } else { (least..=most).find(fits).unwrap_or(0) };
        Scale { unit: self, power }
    }

    /// A number with its prefix and unit: 8 letters, of which the first is a blank, a blank, and the unit in one letter more than
    /// it has.
    pub fn quantity(self, value: f64) -> String {
        let scale = self.scale(value);
        format!("{} {}", scale.number(value), scale.name())
    }
}

impl Scale {
    /// The number in this unit: 8 letters, two of them after the point, the first a blank.
    pub fn number(self, value: f64) -> String {
        format!(" {}", fixed(self.value(value), NUMBER - 1, 2))
    }

    /// A part of a number in its unit: 7 letters, one of them after the point, the first a blank.
    pub fn part(self, value: f64) -> String {
        format!(" {}", fixed(self.value(value), 6, 1))
    }

    pub fn value(self, value: f64) -> f64 {
        value / 1000f64.powi(self.power)
    }

    /// Prefix and unit in one letter more than the unit has.
    pub fn name(self) -> String {
        let letters = self.unit.name.chars().count() + 1;
        format!("{:<letters$}", self.plain_name())
    }

    /// Prefix and unit.
    pub fn plain_name(self) -> String {
        let prefix = match self.power {
            -2 => "µ",
            -1 => "m",
            1 => "k",
            2 => "M",
            _ => "",
        };
        format!("{prefix}{}", self.unit.name)
    }
}

/// Writes a number in `letters` letters, at least 6; where it does not fit, as a power of ten. A zero has no minus sign.
pub fn fixed(value: f64, letters: usize, digits: usize) -> String {
    let text = format!("{value:>letters$.digits$}");
    let is_zero = text.chars().all(|c| matches!(c, ' ' | '-' | '0' | '.'));
    match text {
        _ if is_zero => format!("{:>letters$.digits$}", 0.0),
        text if text.chars().count() <= letters => text,
        _ => format!("{value:>letters$.0e}"),
    }
}

/// The first `letters` letters, with a sign where some are missing.
pub fn clipped(text: &str, letters: usize) -> String {
    if text.chars().count() <= letters {
        return text.to_owned();
    }
    text.chars().take(letters.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn long_names_are_cut_visibly() {
        assert_eq!(
            (clipped("tube", 4), clipped("tubes", 4), clipped("é", 1)),
            ("tube".into(), "tub…".into(), "é".into())
        );
    }

    #[test]
    fn numbers_stay_in_their_columns() {
        for (value, text) in [
            (0.0, "  0.000"),
            (-0.0001, "  0.000"),
            (-1.5, " -1.500"),
            (123.4567, "123.457"),
            (-123456.0, "   -1e5"),
            (f64::NAN, "    NaN"),
            (f64::INFINITY, "    inf"),
        ] {
            assert_eq!(fixed(value, 7, 3), text);
        }
    }

    #[test]
    fn prefixes_go_from_micro_to_mega() {
        for (unit, value, text) in [
            (FORCE, 0.0, "    0.00 N "),
            (FORCE, 1e-12, "    0.00 N "),
            (FORCE, 2.5e-5, "   25.00 µN"),
            (FORCE, -0.0125, "  -12.50 mN"),
            (FORCE, 999.94, "  999.94 N "),
            (FORCE, 999.996, "    1.00 kN"),
            (FORCE, -6221.05, "   -6.22 kN"),
            (FORCE, 12.9e6, "   12.90 MN"),
            (FORCE, -1.5e12, "    -2e12 N ".trim_start_matches(' ')),
            (LENGTH, 0.0254, "   25.40 mm"),
            (LENGTH, 195.0, "  195.00 m "),
            (LENGTH, 1234.5, " 1234.50 m "),
            (TORQUE, 0.25, "  250.00 mN·m"),
            (ENERGY, 12.9e6, "   12.90 MJ"),
            (TIME, 43e-6, "   43.00 µs"),
            (FORCE, f64::NAN, "     NaN N "),
            (FORCE, f64::NEG_INFINITY, "    -inf N "),
        ] {
            assert_eq!(unit.quantity(value).trim_start(), text.trim_start(), "{value}");
            assert_eq!(
                unit.quantity(value).chars().count(),
                NUMBER + 2 + unit.name.chars().count(),
                "{value}"
            );
        }
    }

    proptest! {
        /// Every number that there is has the same width, a blank before it, the point at the same place, and its value.
        #[test]
        fn every_number_keeps_to_its_columns(bits in any::<u64>(), plain in -1e7..1e7f64, k in 0_usize..5) {
            let unit = [FORCE, TORQUE, LENGTH, ENERGY, TIME][k];
            for value in [f64::from_bits(bits), plain, plain * 1e-9] {
                let text = unit.quantity(value);
                let letters: Vec<char> = text.chars().collect();
                prop_assert_eq!(letters.len(), NUMBER + 2 + unit.name.chars().count());
                prop_assert!(letters[0] == ' ' && letters[NUMBER] == ' ', "{}", text);
                let scale = unit.scale(value);
                let number = scale.number(value);
                if value.is_finite() && number.contains('.') {
                    prop_assert_eq!(letters[NUMBER - 3], '.');
                    let read: f64 = number.trim().parse().unwrap();
                    prop_assert!((read - scale.value(value)).abs() <= 0.00501, "{} {}", text, value);
                }
                // A part of a whole of this size keeps its blank, so that three of them never run together.
                for part in [value, -value, 0.3 * value] {
                    let text = scale.part(part);
                    prop_assert!(text.chars().count() == 7 && text.starts_with(' '), "{:?}", text);
                }
                for (letters, digits) in [(6, 0), (6, 1), (7, 3), (9, 2)] {
                    prop_assert_eq!(fixed(value, letters, digits).chars().count(), letters);
                }
            }
        }
    }
}
