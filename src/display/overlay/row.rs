//! A row of an overlay column: coloured words, bars or a gauge, in a font of one width; and how much it matters.

use egui::Color32;

/// A piece of a row in its colour.
pub(super) type Words = Vec<(String, Color32)>;

pub(super) enum Row {
    Words(Words),
    /// A heading and what stands below it, shown whole or not at all.
    Table(Vec<Words>),
    /// Steps of the last frames, stacked.
    Bars,
    /// Share of a whole, where good and fair end, and in which the pointer is.
    Gauge {
        share: f64,
        marks: Vec<f64>,
        ink: Color32,
    },
    Gap,
}

/// Importance of a row: if there is no room for all, rows of the last rank go first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Rank {
    /// The reason to open the overlay.
    First,
    Second,
    Third,
    /// Details for the search of a fault.
    Detail,
    Space,
}

pub(super) type Ranked = (Rank, Row);

impl Row {
    /// Height in lines.
    pub(super) fn lines(&self) -> f32 {
        match self {
            Row::Words(_) => 1.0,
            Row::Table(rows) => rows.len() as f32,
            Row::Bars => 4.0,
            Row::Gauge { .. } => 0.8,
            Row::Gap => 0.5,
        }
    }

    pub(super) fn ranked(self, rank: Rank) -> Ranked {
        (rank, self)
    }
}

pub(super) const GAP: Ranked = (Rank::Space, Row::Gap);

pub(super) fn words(text: impl Into<String>, ink: Color32) -> Row {
    Row::Words(vec![(text.into(), ink)])
}

pub(super) fn height(rows: &[Ranked]) -> f32 {
    rows.iter().map(|(_, row)| row.lines()).sum()
}

/// The rows that fit into `lines` lines, without the least of them: of one rank the last go first. A last row counts those that
/// are left out. Nothing where not even one of them and that row fit.
pub(super) fn fitting(mut rows: Vec<Ranked>, lines: f32, quiet: Color32) -> Vec<Ranked> {
    if height(&rows) <= lines {
        return rows;
    }
    let mut left_out = 0;
    while height(&rows) + 1.0 > lines {
        let Some(least) = rows.iter().map(|(rank, _)| *rank).max() else { return rows };
        let Some(last) = rows.iter().rposition(|(rank, _)| *rank == least) else { return rows };
        left_out += match rows.remove(last) {
            (Rank::Space, _) => 0,
            (_, Row::Table(rows)) => rows.len(),
            _ => 1,
        };
    }
    if !rows.is_empty() && left_out > 0 {
        rows.push(words(format!("… {left_out} more rows"), quiet).ranked(Rank::First));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::caption::GOOD;

    #[test]
    fn the_least_rows_are_left_out_first_and_counted() {
        let rows = || {
            let row = |text: &str, rank| words(text, GOOD).ranked(rank);
            vec![
                row("a", Rank::First),
                GAP,
                row("b", Rank::Detail),
                row("c", Rank::Second),
                row("d", Rank::Detail),
            ]
        };
        let left = |lines: f32| -> Vec<String> {
            let text = |(_, row): Ranked| match row {
                Row::Words(words) => words.into_iter().map(|(text, _)| text).collect(),
                Row::Table(rows) => format!("{} rows", rows.len()),
                _ => "-".to_owned(),
            };
            fitting(rows(), lines, GOOD).into_iter().map(text).collect()
        };
        assert_eq!(left(4.5), ["a", "-", "b", "c", "d"]);
        assert_eq!(left(4.4), ["a", "b", "c", "… 1 more rows"]);
        assert_eq!(left(3.0), ["a", "c", "… 2 more rows"]);
        assert_eq!(left(2.0), ["a", "… 3 more rows"]);
        assert_eq!(left(1.5), [""; 0], "nothing, rather than a count alone");
        // A table's heading never stands without what it heads.
        let line = || vec![("line".to_owned(), GOOD)];
        let table = || Row::Table(vec![line(), line(), line()]).ranked(Rank::Detail);
        let lines = |most: f32| {
            let rows = vec![words("a", GOOD).ranked(Rank::First), table(), table()];
            fitting(rows, most, GOOD).iter().map(|(_, row)| row.lines()).collect::<Vec<_>>()
        };
        assert_eq!((lines(7.0), lines(6.9)), (vec![1.0, 3.0, 3.0], vec![1.0, 3.0, 1.0]));
        assert_eq!(lines(4.9), [1.0, 1.0]);
    }
}
