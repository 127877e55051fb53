//! A row of an overlay column: coloured words, bars or a gauge, in a font of one width.

use egui::Color32;

pub(super) const GOOD: Color32 = Color32::from_rgb(116, 196, 118);
pub(super) const FAIR: Color32 = Color32::from_rgb(240, 180, 60);
pub(super) const BAD: Color32 = Color32::from_rgb(240, 86, 70);
/// Letters in a row of a column.
pub(super) const LETTERS: usize = 40;

/// A piece of a row in its colour.
pub(super) type Words = Vec<(String, Color32)>;

pub(super) enum Row {
    Words(Words),
    /// Steps of the last frames, stacked.
    Bars,
    /// Share of a whole, where good and fair end, and in which the pointer is.
    Gauge {
        share: f64,
        good: f64,
        fair: f64,
        ink: Color32,
    },
    Gap,
}

impl Row {
    /// Height in lines.
    pub(super) fn lines(&self) -> f32 {
        match self {
            Row::Words(_) => 1.0,
            Row::Bars => 4.0,
            Row::Gauge { .. } => 0.8,
            Row::Gap => 0.5,
        }
    }
}

pub(super) fn words(text: impl Into<String>, ink: Color32) -> Row {
    Row::Words(vec![(text.into(), ink)])
}

/// A number in so many letters; if it does not fit, as a power of ten. A zero has no minus sign.
pub(super) fn fixed(value: f64, letters: usize, digits: usize) -> String {
    let text = format!("{value:>letters$.digits$}");
    let is_zero = text.chars().all(|c| matches!(c, ' ' | '-' | '0' | '.'));
    match text {
        _ if is_zero => format!("{:>letters$.digits$}", 0.0),
        text if text.chars().count() <= letters => text,
        _ => format!("{value:>letters$.0e}"),
    }
}

/// The first `letters` letters, with a sign where some are missing.
pub(super) fn clipped(text: &str, letters: usize) -> String {
    if text.chars().count() <= letters {
        return text.to_owned();
    }
    text.chars().take(letters.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn long_names_are_cut_visibly() {
        assert_eq!(
            (clipped("tube", 4), clipped("tubes", 4), clipped("é", 1)),
            ("tube".into(), "tub…".into(), "é".into())
        );
    }
}
