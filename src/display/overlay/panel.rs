//! Paints the overlay: rows in a font of one width on dark translucent plates. The rows on the left show frame times,
//! device, trackers, force devices and hands.

use super::body_rows::body_rows;
use super::readings::{COLOURS, FRAMES, HandDoes, HandReading, History, Readings, STEPS, SensorReading};
use super::row::{GAP, Rank, Ranked, Row, Words, fitting, height, words};
use super::seats::{SeatRequests, Seats};
use crate::base::fixed::{LETTERS, clipped, fixed};
use crate::display::caption::{BAD, DARK, FAIR, GOOD, INK, QUIET, RULE};
use crate::display::plates::ink;
use crate::track::Signal;
use egui::{FontId, Mesh, Painter, Pos2, Rect, Shape, pos2, vec2};

/// Rows of warnings.
const WARNINGS: usize = 4;
/// Height of the letters, pixels: below the first they cannot be read.
const LETTER: [f32; 2] = [11.0, 22.0];
/// Share of the width that two plates beside each other may take.
const BESIDE: f32 = 0.84;

/// The overlay on its way onto a picture.
pub struct Panel<'a> {
    pub painter: &'a Painter,
    /// The picture.
    pub rect: Rect,
    pub readings: &'a Readings,
    pub history: &'a History,
    /// Pixels over which no plate stands: held elements.
    pub clear: &'a [Rect],
    /// Pixels that panel and messages take.
    pub taken: &'a [Rect],
}

impl Panel<'_> {
    /// Returns the rectangles of its plates.
    pub fn paint(&self, seats: &mut Seats) -> Vec<Rect> {
        let size = self.letter_height();
        let line = (1.3 * size).round();
        let letter = self.letter_width(size);
        let width = letter * (LETTERS as f32 + 2.0);
        let (margin, pad) = (size.round(), (0.5 * size).round());
        let inside = self.rect.shrink(margin);
        let strip = self.strip(inside, line, letter, pad, margin);
        let warnings = self.warnings(((strip.width() / letter) as usize).saturating_sub(2));
        let bottom = if warnings.is_empty() { inside.max.y } else { strip.min.y - margin };
        let frames = frame_rows(self.readings, self.history);
        let bodies: Vec<Ranked> = self.readings.bodies.iter().flat_map(body_rows).collect();
        let plate = |rows: &[Ranked]| if rows.is_empty() { 0.0 } else { height(rows) * line + 2.0 * pad };
        let wanted = SeatRequests {
            inside: Rect::from_min_max(inside.min, pos2(inside.max.x, bottom)),
            width: width.min(inside.width()),
            heights: [plate(&frames), plate(&bodies)],
            margin,
            least: 2.0 * line + 2.0 * pad,
            is_wide: 2.0 * width + margin <= BESIDE * self.rect.width(),
        };
        let clear: Vec<Rect> = self.clear.iter().chain(self.taken).copied().collect();
        let (taken, mut painted) = (seats.take(&wanted, &clear, self.readings.time_s), Vec::new());
        for (seat, rows) in taken.iter().zip([frames, bodies]) {
            if let Some(seat) = seat {
                let lines = (seat.rect.height() - 2.0 * pad) / line;
                painted.extend(self.column(seat.rect.min, wanted.width, &fitting(rows, lines, QUIET)));
            }
        }
        if !clear.iter().any(|held| held.intersects(strip)) {
            painted.extend(self.column(strip.min, strip.width(), &warnings));
        }
        painted
    }

    /// The rectangle of the warnings: at the bottom, beside a panel and above messages.
    fn strip(&self, inside: Rect, line: f32, letter: f32, pad: f32, margin: f32) -> Rect {
        let mut strip = inside;
        for panel in self.taken.iter().filter(|taken| taken.height() > 0.5 * inside.height()) {
            if panel.center().x > inside.center().x {
                strip.max.x = strip.max.x.min(panel.min.x - margin);
            } else {
                strip.min.x = strip.min.x.max(panel.max.x + margin);
            }
        }
        let rows = height(&self.warnings(((strip.width() / letter) as usize).saturating_sub(2)));
        strip.min.y = strip.max.y - rows * line - 2.0 * pad;
        let mut over: Vec<&Rect> = self.taken.iter().collect();
        over.sort_by(|a, b| b.max.y.total_cmp(&a.max.y));
        for message in over {
            if message.intersects(strip) && message.min.y - margin - strip.height() > inside.center().y {
                strip = strip.translate(vec2(0.0, message.min.y - margin - strip.max.y));
            }
        }
        strip
    }

    /// Two plates beside each other, if the letters can be read so.
    fn letter_height(&self) -> f32 {
        let by_height = self.rect.height() / 62.0;
        let by_width = 0.75 * self.rect.width() / (2.0 * (LETTERS as f32 + 2.0) * 0.61);
        by_height.min(by_width).clamp(LETTER[0], LETTER[1])
    }

    fn letter_width(&self, size: f32) -> f32 {
        let ten = self.painter.layout_no_wrap("0000000000".into(), FontId::monospace(size), INK);
        ten.size().x / 10.0
    }

    /// Rows on a plate.
    fn column(&self, corner: Pos2, width: f32, rows: &[Ranked]) -> Option<Rect> {
        if rows.is_empty() {
            return None;
        }
        let size = self.letter_height();
        let line = (1.3 * size).round();
        let pad = (0.5 * size).round();
        let plate = Rect::from_min_size(corner, vec2(width, height(rows) * line + 2.0 * pad));
        self.painter.rect_filled(plate, 0.3 * size, DARK.gamma_multiply(0.86));
        let inside = plate.shrink2(vec2(self.letter_width(size), pad));
        let mut top = inside.min.y;
        for (_, row) in rows {
            let rect = Rect::from_min_size(pos2(inside.min.x, top), vec2(inside.width(), row.lines() * line));
            self.row(row, rect, size);
            top += row.lines() * line;
        }
        Some(plate)
    }

    fn words(&self, pieces: &Words, place: Pos2, size: f32) {
        let mut job = egui::text::LayoutJob::default();
        for (text, ink) in pieces {
            job.append(text, 0.0, egui::TextFormat::simple(FontId::monospace(size), *ink));
        }
        self.painter.galley(place.round(), self.painter.layout_job(job), INK);
    }

    fn row(&self, row: &Row, rect: Rect, size: f32) {
        match row {
            Row::Words(pieces) => self.words(pieces, rect.min, size),
            Row::Table(rows) => {
                let line = rect.height() / rows.len().max(1) as f32;
                for (k, pieces) in rows.iter().enumerate() {
                    self.words(pieces, rect.min + vec2(0.0, k as f32 * line), size);
                }
            }
            Row::Bars => self.bars(rect.shrink2(vec2(0.0, 2.0))),
            Row::Gauge { share, marks, ink } => {
                let bar = rect.shrink2(vec2(0.0, 0.25 * rect.height()));
                let to = |share: f64| (bar.min.x + bar.width() * share.clamp(0.0, 1.0) as f32).round();
                let part =
                    |from: f32, to: f32| Rect::from_min_max(pos2(from, bar.min.y), pos2(to, bar.max.y));
                self.painter.rect_filled(bar, 0.0, RULE);
                self.painter.rect_filled(part(bar.min.x, to(*share)), 0.0, *ink);
                for mark in marks {
                    let at = to(*mark);
                    self.painter.rect_filled(part(at - 1.0, at + 1.0).expand2(vec2(0.0, 2.0)), 0.0, INK);
                }
            }
            Row::Gap => {
                let middle = rect.center().y.round();
                let rule = Rect::from_min_max(pos2(rect.min.x, middle), pos2(rect.max.x, middle + 1.0));
                self.painter.rect_filled(rule, 0.0, RULE);
            }
        }
    }

    /// One bar a frame, newest right; the whole height is the worst frame.
    fn bars(&self, rect: Rect) {
        let worst_s = self.history.worst_s();
        if worst_s <= 0.0 {
            return;
        }
        let step = rect.width() / FRAMES as f32;
        let mut mesh = Mesh::default();
        for (k, frame) in self.history.frames.iter().rev().enumerate() {
            let right = rect.max.x - step * k as f32;
            let rest_s = (frame.whole_s - frame.steps.iter().sum::<f64>()).max(0.0);
            let mut bottom = rect.max.y;
            for (part_s, colour) in frame.steps.iter().chain([&rest_s]).zip(COLOURS) {
                let top = bottom - rect.height() * (part_s / worst_s) as f32;
                let bar = Rect::from_min_max(pos2(right - step, top.max(rect.min.y)), pos2(right, bottom));
                mesh.add_colored_rect(bar, colour);
                bottom = top;
            }
        }
        self.painter.add(Shape::mesh(mesh));
    }

    /// The newest warnings, oldest first, each cut to one row.
    fn warnings(&self, letters: usize) -> Vec<Ranked> {
        let all = &self.readings.warnings;
        let newest = &all[all.len().saturating_sub(WARNINGS)..];
        let row = |(time_s, text): &(f64, String)| {
            let text = clipped(text, letters.saturating_sub(11));
            Row::Words(vec![(format!("{time_s:>8.1} s "), QUIET), (text, FAIR)]).ranked(Rank::First)
        };
        newest.iter().map(row).collect()
    }
}

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
