//! Formats numbers with their units, short enough for an axis or a cell: "20 µs", "2·10⁻³", "0.31 %".

/// The unit of an axis or a cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unit {
    /// A relative error, shown in percent where that is readable.
    #[default]
    Ratio,
    /// A number of things.
    Count,
    Seconds,
    Bytes,
    Metres,
    Degrees,
}

impl Unit {
    pub fn text(self, value: f64) -> String {
        match self {
            Unit::Ratio if (0.99e-6..1e3).contains(&value) => format!("{} %", digits(100.0 * value, 3)),
            Unit::Ratio => power(value),
            Unit::Count => format!("{value}"),
            Unit::Seconds => prefixed(value, "s"),
            Unit::Bytes => prefixed(value, "B"),
            Unit::Metres => prefixed(value, "m"),
            Unit::Degrees => format!("{}°", digits(value, 3)),
        }
    }
}

/// Writes at most `count` significant digits, without zeros at the end.
pub fn digits(value: f64, count: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0);
    }
    let exponent =
        format!("{value:.*e}", count - 1).split_once('e').map_or(0, |(_, e)| e.parse().unwrap_or(0));
    let decimals = usize::try_from(count as i32 - 1 - exponent).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// 10⁻³, 2·10⁻³; 1 and 5 as they are.
pub fn power(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return digits(value, 3);
    }
    let text = format!("{value:.2e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let mantissa =
        if mantissa.contains('.') { mantissa.trim_end_matches('0').trim_end_matches('.') } else { mantissa };
    match (mantissa, exponent) {
        (_, "0") => mantissa.to_owned(),
        ("1", _) => format!("10{}", superscript(exponent)),
        _ => format!("{mantissa}·10{}", superscript(exponent)),
    }
}

fn superscript(number: &str) -> String {
    const RAISED: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let raise = |c: char| c.to_digit(10).map_or('⁻', |digit| RAISED[digit as usize]);
    number.chars().map(raise).collect()
}

fn prefixed(value: f64, unit: &str) -> String {
    const PREFIXES: [(f64, &str); 7] =
        [(1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ")];
    let large_only = matches!(unit, "B");
    let small_only = matches!(unit, "s" | "m");
    // 999.9996 is 1000, which belongs to the next prefix.
    let (scale, prefix) = PREFIXES
        .into_iter()
        .filter(|(scale, _)| !(large_only && *scale < 1.0 || small_only && *scale > 1.0))
        .find(|(scale, _)| value.abs() >= 0.9995 * scale)
        .unwrap_or(if large_only || value == 0.0 { (1.0, "") } else { (1e-9, "n") });
    let scaled = value / scale;
    let number =
        if (1e-2..1e5).contains(&scaled) || scaled == 0.0 { digits(scaled, 3) } else { power(scaled) };
    format!("{number} {prefix}{unit}")
}

pub fn seconds(s: f64) -> String {
    Unit::Seconds.text(s)
}

pub fn bytes(count: f64) -> String {
    Unit::Bytes.text(count)
}

/// Metres, of two digits.
pub fn metres(m: f64) -> String {
    Unit::Metres.text(format!("{m:.1e}").parse().unwrap_or(m))
}

/// A relative error: in percent while that is readable.
pub fn relative(error: f64) -> String {
    if (1e-4..1e3).contains(&error) { format!("{} %", digits(100.0 * error, 2)) } else { brief(error) }
}

/// "2.0", "31", "0.45": how many times as much.
pub fn times(ratio: f64) -> String {
    match ratio {
        r if (1.0..9.95).contains(&r) => format!("{r:.1}"),
        r if (1e-2..1e5).contains(&r) => digits(r, 2),
        r => brief(r),
    }
}

/// [`power`] of two digits.
fn brief(value: f64) -> String {
    power(format!("{value:.1e}").parse().unwrap_or(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_engineers_write_them() {
        let texts = [1.0, 5.0, 0.1, 1e-3, 2e-3, 1.25e-10, 0.0, 20.0].map(power);
        assert_eq!(texts, ["1", "5", "10⁻¹", "10⁻³", "2·10⁻³", "1.25·10⁻¹⁰", "0", "2·10¹"]);
        let seconds = [1e-3, 2e-5, 0.9996, 100.0, 1e4, 3e-10, 0.0].map(|s| Unit::Seconds.text(s));
        assert_eq!(seconds, ["1 ms", "20 µs", "1 s", "100 s", "10000 s", "0.3 ns", "0 s"]);
        let bytes = [1.0, 1e3, 2.5e6, 0.5].map(|b| Unit::Bytes.text(b));
        assert_eq!(bytes, ["1 B", "1 kB", "2.5 MB", "0.5 B"]);
        assert_eq!([0.0123, 1.4, 3.14e-5, 0.0].map(relative), ["1.2 %", "140 %", "3.1·10⁻⁵", "0"]);
        assert_eq!([2.0, 31.4, 123.4, 9.96].map(times), ["2.0", "31", "123", "10"]);
        assert_eq!(
            [10.0, 0.5, 1e-4, 1e-5].map(|e| Unit::Ratio.text(e)),
            ["1000 %", "50 %", "0.01 %", "0.001 %"]
        );
        assert_eq!(Unit::Degrees.text(22.5), "22.5°");
    }
}
