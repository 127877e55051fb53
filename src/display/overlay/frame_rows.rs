//! The rows on the left: frame times, device, trackers, force devices, hands.

use super::readings::{Readings, SensorReading};
use super::row::{BAD, FAIR, GAP, GOOD, Rank, Ranked, Row, words};
use super::rows::hand_rows;
use super::times::{COLOURS, History, STEPS};
use crate::base::fixed::{LETTERS, clipped, fixed};
use crate::display::lettering::{INK, QUIET};
use crate::display::plates::ink;
use crate::track::Signal;

pub(super) fn frame_rows(readings: &Readings, history: &History) -> Vec<Ranked> {
    let mean_s = history.mean(|frame| frame.whole_s);
    let rate = if mean_s > 0.0 { 1.0 / mean_s } else { 0.0 };
    let mut rows = vec![
        Row::Words(vec![
            (format!("{:<17}", clipped(&readings.stage, 17)), INK),
            (format!(" {}", fixed(rate, 7, 1)), INK),
            (" frames/s".into(), QUIET),
        ])
        .ranked(Rank::First),
        Row::Words(vec![
            ("mean ".into(), QUIET),
            (fixed(mean_s * 1e3, 8, 2), INK),
            (" ms   worst ".into(), QUIET),
            (fixed(history.worst_s() * 1e3, 8, 2), INK),
            (" ms".into(), QUIET),
        ])
        .ranked(Rank::Second),
        Row::Bars.ranked(Rank::Third),
    ];
    let step = |k: usize| {
        let mean_ms = 1e3 * history.mean(|frame| frame.steps[k]);
        [("■ ".to_owned(), COLOURS[k]), (format!("{:<9}", STEPS[k]), QUIET), (fixed(mean_ms, 6, 2), INK)]
    };
    for k in (0..STEPS.len()).step_by(2) {
        let gap = [("   ".to_owned(), INK)];
        let row = Row::Words(step(k).into_iter().chain(gap).chain(step(k + 1)).collect());
        rows.push(row.ranked(Rank::Third));
    }
    rows.push(GAP);
    rows.push(words(clipped(&readings.device, LETTERS), QUIET).ranked(Rank::Detail));
    rows.push(words(clipped(&readings.deformation, LETTERS), QUIET).ranked(Rank::Detail));
    rows.push(GAP);
    if readings.sensors.is_empty() {
        rows.push(words(clipped(&readings.source, LETTERS), QUIET).ranked(Rank::Detail));
    } else {
        let header = format!("{:<14}{:>9}{:>9}", "sensor", "rate", "age");
        rows.push(words(header, QUIET).ranked(Rank::Third));
        rows.extend(readings.sensors.iter().map(|sensor| sensor_row(sensor).ranked(Rank::Second)));
    }
    for device in &readings.devices {
        rows.push(GAP);
        rows.extend(device.iter().enumerate().map(|(k, words)| {
            let row = Row::Words(words.iter().map(|(text, tone)| (text.clone(), ink(*tone))).collect());
            row.ranked(if k < 2 { Rank::Second } else { Rank::Third })
        }));
    }
    rows.push(GAP);
    rows.extend(hand_rows(readings).into_iter().map(|row| row.ranked(Rank::Second)));
    rows.push(GAP);
    rows.push(words("F1 closes   F2 room   F3 test pattern", QUIET).ranked(Rank::Detail));
    rows
}

fn sensor_row(sensor: &SensorReading) -> Row {
    let name = format!("{:<14}", clipped(&sensor.name, 13));
    if !sensor.heard {
        return Row::Words(vec![(name, INK), ("never heard".into(), BAD)]);
    }
    let (state, ink) = match sensor.signal {
        Signal::Live => ("live", GOOD),
        Signal::Held { .. } => ("held", FAIR),
        Signal::Lost { .. } => ("lost", BAD),
    };
    let age = match sensor.age_s {
        s if s < 10.0 => format!("{} ms", fixed(1e3 * s, 6, 0)),
        s => format!("{} s ", fixed(s, 6, 0)),
    };
    Row::Words(vec![
        (name, INK),
        (format!("{} Hz{age}  ", fixed(sensor.rate_hz, 6, 1)), INK),
        (state.into(), ink),
    ])
}
