//! Quantities as an engineer reads them: three digits, and a prefix of the SI.

const PREFIXES: [(f64, &str); 8] =
    [(1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n")];

/// The prefix for values up to `largest`, and what it stands for.
pub fn prefix(largest: f64) -> (f64, &'static str) {
    // 999.6 is 1000, which belongs to the next prefix.
    let fits = |(scale, _): &(f64, &str)| largest.abs() >= 0.9995 * scale;
    match largest.abs() {
        size if size == 0.0 || !size.is_finite() => (1.0, ""),
        _ => PREFIXES.into_iter().find(fits).unwrap_or((1e-9, "n")),
    }
}

/// Three digits, without zeros at the end of a decimal fraction.
pub fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{}", value + 0.0);
    }
    if !(1e-3..1e6).contains(&value.abs()) {
        return format!("{value:.2e}");
    }
    let exponent = value.abs().log10().floor() as i32;
    let decimals = usize::try_from(2 - exponent).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// `412 MPa`, `12.5 mm`; a ratio, which has no unit, in percent: `1.24 %`.
pub fn quantity(value: f64, unit: &str) -> String {
    if unit.is_empty() {
        return format!("{} %", digits(100.0 * value));
    }
    let (scale, prefix) = prefix(value);
    format!("{} {prefix}{unit}", digits(value / scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_read_as_engineers_write_them() {
        let pascals =
            [0.0, 1.0, 412.4e6, 999.6e6, 2.1e11, 4e3, -7.25e6, 3e16].map(|value| quantity(value, "Pa"));
        assert_eq!(
            pascals,
            ["0 Pa", "1 Pa", "412 MPa", "1 GPa", "210 GPa", "4 kPa", "-7.25 MPa", "30000 TPa"]
        );
        let ratios = [0.0, 0.3, 0.012345, 1e-7, 25.0].map(|value| quantity(value, ""));
        assert_eq!(ratios, ["0 %", "30 %", "1.23 %", "1.00e-5 %", "2500 %"]);
        let metres = [0.0125, 2e-6, 1.0, 1e-13].map(|value| quantity(value, "m"));
        assert_eq!(metres, ["12.5 mm", "2 µm", "1 m", "1.00e-4 nm"]);
        assert_eq!(quantity(f64::NAN, "Pa"), "NaN Pa");
    }

    proptest::proptest! {
        #[test]
        fn three_digits_are_kept(value in -1e15..1e15_f64) {
            let text = quantity(value, "Pa");
            let (number, unit) = text.split_once(' ').unwrap();
            let scale = PREFIXES.into_iter().find(|(_, prefix)| unit == format!("{prefix}Pa")).unwrap().0;
            let read: f64 = number.parse().unwrap();
            proptest::prop_assert!((scale * read - value).abs() <= 5.1e-3 * value.abs(), "{text}");
        }
    }
}
