//! Rows of the overlay's left column: hands, and force devices.

use super::readings::{HandDoes, HandReading, Readings};
use super::row::{BAD, FAIR, GOOD, LETTERS, Row, clipped, words};
use crate::base::fixed::{FORCE, TIME, fixed};
use crate::display::lettering::{INK, QUIET};
use crate::effect::haptics::HapticReading;

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

/// Rows for a force device: its state and force, the timing of its loop, and whether the force was softened.
pub fn haptic_rows(haptic: &HapticReading) -> Vec<Row> {
    let HapticReading { state, timing, .. } = haptic;
    let (word, ink) = match () {
        () if state.room_from_handle.is_none() => ("no device", BAD),
        () if state.gain >= 1.0 => ("felt", GOOD),
        () if state.gain > 0.0 => ("fading in", FAIR),
        () if haptic.holds => ("no force", BAD),
        () => ("nothing held", QUIET),
    };
    let force_n = state.push.force.norm();
    let scale = FORCE.scale(force_n.max(haptic.max_force_n));
    let limited = if state.limited { "  at its limit" } else { "" };
    let (passive, passive_ink) =
        if state.observer.energy < 0.0 { ("brakes", FAIR) } else { ("passive", GOOD) };
    let mut rows = vec![
        Row::Words(vec![(format!("haptic {:<14}", clipped(&haptic.name, 14)), INK), (word.into(), ink)]),
        Row::Words(vec![
            ("force ".into(), QUIET),
            (scale.number(force_n), INK),
            (format!(" of {} {}", scale.part(haptic.max_force_n).trim_start(), scale.plain_name()), QUIET),
            (limited.into(), FAIR),
        ]),
        Row::Words(vec![
            ("rate ".into(), QUIET),
            (fixed(timing.rate_hz, 8, 0), INK),
            (" Hz  late ".into(), QUIET),
            (timing.late.to_string(), INK),
            ("  out ".into(), QUIET),
            (timing.missed.to_string(), INK),
        ]),
        Row::Words(vec![
            ("work p50 ".into(), QUIET),
            (TIME.quantity(timing.work_p50_s), INK),
            (" p99 ".into(), QUIET),
            (TIME.quantity(timing.work_p99_s), INK),
        ]),
        Row::Words(vec![
            (format!("{passive:<8}"), passive_ink),
            ("braked ".into(), QUIET),
            (fixed(1e3 * state.observer.braked, 9, 3), INK),
            (" mJ in all".into(), QUIET),
        ]),
    ];
    if state.gain > 0.0 && state.age_s > state.spacing_s {
        rows.push(words(
            format!(
                "late by {} ms: bears {} N/m",
                fixed(1e3 * state.age_s, 7, 1),
                fixed(state.bearable, 8, 0)
            ),
            FAIR,
        ));
    }
    if state.gain > 0.0 && state.stiffer > 1.0 {
        rows.push(words(format!("softened: {} times too stiff for it", fixed(state.stiffer, 7, 1)), FAIR));
    }
    rows
}
