//! Numbers with units, as the panel shows and reads them.

/// A unit's size and name, the largest first.
type Units = &'static [(f64, &'static str)];

pub const PASCAL: Units = &[(1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa"), (1.0, "Pa")];
pub const METRE: Units = &[(1.0, "m"), (1e-2, "cm"), (1e-3, "mm"), (1e-6, "µm")];

/// "2.10 MPa": three digits or more.
pub fn shown(value: f64, units: Units) -> String {
    let fitting = units.iter().find(|(size, _)| value.abs() >= *size).or(units.last());
    let (size, unit) = fitting.copied().unwrap_or((1.0, ""));
    let number = value / size;
    let decimals = match number.abs() {
        large if large >= 100.0 => 0,
        middle if middle >= 10.0 => 1,
        _ => 2,
    };
    format!("{number:.decimals$} {unit}")
}

/// Parses a quantity as a person types it, in letters of any case; a number alone is in the unit of size 1.
pub fn read(text: &str, units: Units) -> Option<f64> {
    let text = text.trim().to_lowercase().replace(',', ".");
    let of_unit = |(size, unit): &(f64, &str)| {
        Some(text.strip_suffix(&unit.to_lowercase())?.trim().parse::<f64>().ok()? * size)
    };
    text.parse().ok().or_else(|| units.iter().find_map(of_unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_they_are_shown() {
        for (value, text) in [(2.1e11, "210 GPa"), (1e6, "1.00 MPa"), (5.5e3, "5.50 kPa"), (0.5, "0.50 Pa")] {
            assert_eq!(shown(value, PASCAL), text);
            assert_eq!(read(text, PASCAL), Some(value));
        }
        assert_eq!(shown(0.0042, METRE), "4.20 mm");
        assert_eq!((read("4mm", METRE), read("3 CM", METRE)), (Some(0.004), Some(0.03)));
        assert_eq!(
            (read("2e6", PASCAL), read("2,5 mpa", PASCAL), read("soft", PASCAL)),
            (Some(2e6), Some(2.5e6), None)
        );
    }
}
