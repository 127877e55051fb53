//! Rows of the overlay's left column: hands.

use super::readings::{HandDoes, HandReading, Readings};
use super::row::{BAD, GOOD, Row};
use crate::base::fixed::{LETTERS, clipped};
use crate::display::lettering::{INK, QUIET};

/// Rows for the mode of motion, for each hand, and for what can be undone.
pub fn hand_rows(readings: &Readings) -> Vec<Row> {
    let [undo, redo] = readings.undo;
    let mut rows = vec![
        Row::Words(vec![("mode ".into(), QUIET), (clipped(&readings.mode, LETTERS - 5), INK)]),
        Row::Words(vec![
            ("undo ".into(), QUIET),
            (format!("{undo:<4}"), INK),
            ("  redo ".into(), QUIET),
            (redo.to_string(), INK),
        ]),
    ];
    rows.extend(readings.hands.iter().map(hand_row));
    rows
}

fn hand_row(hand: &HandReading) -> Row {
    let (what, target, ink) = match &hand.does {
        HandDoes::Holds(target) => ("holds ", target.as_str(), GOOD),
        HandDoes::PointsAt(target) => ("at ", target.as_str(), INK),
        HandDoes::Nothing => ("free", "", INK),
        HandDoes::Lost => ("lost", "", INK),
    };
    let name = format!("{:<12} ", clipped(&hand.name, 12));
    let target = clipped(target, LETTERS - 13 - what.len());
    let what_ink = if hand.does == HandDoes::Lost { BAD } else { QUIET };
    Row::Words(vec![(name, INK), (what.to_owned(), what_ink), (target, ink)])
}
