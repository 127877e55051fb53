//! Quantities for people: three significant digits and an SI prefix.

/// Prefixes by their power of a thousand, from nano to giga.
const PREFIXES: [&str; 7] = ["n", "µ", "m", "", "k", "M", "G"];

/// `12.3 mm`, `1.20 kN`, `-0.340 µm`; a ratio, which has no unit, in percent: `1.24 %`.
pub fn quantity(value: f64, unit: &str) -> String {
    if unit.is_empty() {
        return format!("{} %", digits(100.0 * value));
    }
    let power = power_of(value);
    format!("{} {}{unit}", digits(value / 1000f64.powi(power)), prefix(power))
}

/// The power of a thousand in which a quantity of this size is written: `12.3 mm` is in 1000⁻¹.
pub fn power_of(value: f64) -> i32 {
    if !(value.is_finite() && value != 0.0) {
        return 0;
    }
    // What rounds up to 1000 is told with the next prefix.
    let power = ((value.abs() * 1.0005).log10() / 3.0).floor() as i32;
    power.clamp(-3, 3)
}

/// The prefix of a power of a thousand from -3 to 3.
pub fn prefix(power: i32) -> &'static str {
    PREFIXES[(power.clamp(-3, 3) + 3) as usize]
}

/// The divisor for numbers up to `largest`, and the prefix that stands for it.
pub fn scale_of(largest: f64) -> (f64, &'static str) {
    let power = power_of(largest);
    (1000f64.powi(power), prefix(power))
}

/// Three digits, without zeros at the end of a decimal fraction: for numbers along an axis.
pub fn short(value: f64) -> String {
    let text = digits(value);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Three significant digits of a number below 1000, never more than four.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if size < 0.0005 => "0.000".into(),
        size if size < 9.995 => format!("{value:.2}"),
        size if size < 99.95 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_have_three_digits_and_a_prefix() {
        for (value, unit, text) in [
            (0.0123456, "m", "12.3 mm"),
            (0.9999, "m", "1.00 m"),
            (0.99949, "m", "999 mm"),
            (-1234.0, "N", "-1.23 kN"),
            (0.0, "N", "0 N"),
            (5.0, "N·m", "5.00 N·m"),
            (2.5e-12, "m", "0.00 nm"),
            (7.1e13, "Pa", "71000 GPa"),
            (-3.2e-5, "m", "-32.0 µm"),
        ] {
            assert_eq!(quantity(value, unit), text);
        }
        assert_eq!(quantity(f64::NAN, "m"), "NaN m");
        assert_eq!(
            [quantity(0.0124, ""), quantity(0.0, ""), quantity(25.0, "")],
            ["1.24 %", "0 %", "2500 %"]
        );
        assert_eq!([short(250.0), short(0.5), short(1.0), short(12.34)], ["250", "0.5", "1", "12.3"]);
        assert_eq!(scale_of(250e6), (1e6, "M"));
    }
}
