//! Paints the overlay: rows in a font of one width on dark translucent plates.

use super::readings::{BodyReading, ControlReading, ErrorReading, Readings, SensorReading};
use super::row::{BAD, FAIR, GOOD, LETTERS, Row, clipped, fixed, words};
use super::rows::{hand_rows, haptic_rows};
use super::times::{FRAMES, History, STEPS};
use crate::deform::{ErrorsAt, MeshErrors, StateAge, percent};
use crate::display::lettering::{DARK, INK, QUIET};
use crate::track::Signal;
use egui::{Color32, FontId, Mesh, Painter, Pos2, Rect, Shape, pos2, vec2};
use std::f64::consts::PI;

const RULE: Color32 = Color32::from_rgb(54, 62, 74);
/// Colours of [`STEPS`], and of the time that no step accounts for.
const COLOURS: [Color32; 9] = [
    Color32::from_rgb(198, 120, 221),
    Color32::from_rgb(97, 175, 239),
    Color32::from_rgb(86, 182, 130),
    Color32::from_rgb(152, 195, 121),
    Color32::from_rgb(229, 192, 123),
    Color32::from_rgb(224, 142, 84),
    Color32::from_rgb(132, 146, 166),
    Color32::from_rgb(92, 106, 128),
    Color32::from_rgb(60, 68, 82),
];
/// Rows of warnings.
const WARNINGS: usize = 4;

/// The overlay on its way onto a picture.
pub struct Panel<'a> {
    pub painter: &'a Painter,
    /// The picture.
    pub rect: Rect,
    pub readings: &'a Readings,
    pub history: &'a History,
}

impl Panel<'_> {
    pub fn paint(&self) {
        let size = self.letter_height();
        let line = (1.3 * size).round();
        let letter = self.letter_width(size);
        let width = letter * (LETTERS as f32 + 2.0);
        let margin = size.round();
        let inside = self.rect.shrink(margin);
        let warnings = self.warnings(((inside.width() / letter) as usize).saturating_sub(2));
        let strip = warnings.len() as f32 * line + if warnings.is_empty() { 0.0 } else { 2.0 * margin };
        let most = inside.height() - strip;
        let height = self.column(inside.min, width, most, self.frame_rows());
        let bodies = self.readings.bodies.iter().flat_map(body_rows).collect::<Vec<_>>();
        if !bodies.is_empty() {
            // Below each other where the picture is too narrow for both.
            let (corner, most) = match 2.0 * width + margin > inside.width() {
                true => (inside.min + vec2(0.0, height + margin), most - height - margin),
                false => (pos2(inside.max.x - width, inside.min.y), most),
            };
            self.column(corner, width, most, bodies);
        }
        if !warnings.is_empty() {
            let top = inside.max.y - strip + margin;
            self.column(pos2(inside.min.x, top), inside.width(), strip, warnings);
        }
    }

    /// Two columns take up at most three quarters of the width; letters are 8 to 22 pixels high.
    fn letter_height(&self) -> f32 {
        let by_height = self.rect.height() / 62.0;
        let by_width = 0.75 * self.rect.width() / (2.0 * (LETTERS as f32 + 2.0) * 0.61);
        by_height.min(by_width).clamp(8.0, 22.0)
    }

    fn letter_width(&self, size: f32) -> f32 {
        let ten = self.painter.layout_no_wrap("0000000000".into(), FontId::monospace(size), INK);
        ten.size().x / 10.0
    }

    /// Rows on a plate, whose height it returns; rows that do not fit into `most` pixels are counted.
    fn column(&self, corner: Pos2, width: f32, most: f32, mut rows: Vec<Row>) -> f32 {
        let size = self.letter_height();
        let line = (1.3 * size).round();
        let pad = (0.5 * size).round();
        let height = |rows: &[Row]| rows.iter().map(Row::lines).sum::<f32>() * line + 2.0 * pad;
        if height(&rows) > most {
            let all = rows.len();
            while !rows.is_empty() && height(&rows) + line > most {
                rows.pop();
            }
            rows.push(words(format!("… {} more rows", all - rows.len()), QUIET));
        }
        let plate = Rect::from_min_size(corner, vec2(width, height(&rows)));
        self.painter.rect_filled(plate, 0.3 * size, DARK.gamma_multiply(0.86));
        let inside = plate.shrink2(vec2(self.letter_width(size), pad));
        let mut top = inside.min.y;
        for row in &rows {
            let rect = Rect::from_min_size(pos2(inside.min.x, top), vec2(inside.width(), row.lines() * line));
            self.row(row, rect, size);
            top += row.lines() * line;
        }
        plate.height()
    }

    fn row(&self, row: &Row, rect: Rect, size: f32) {
        match row {
            Row::Words(pieces) => {
                let mut job = egui::text::LayoutJob::default();
                for (text, ink) in pieces {
                    job.append(text, 0.0, egui::TextFormat::simple(FontId::monospace(size), *ink));
                }
                let galley = self.painter.layout_job(job);
                self.painter.galley(rect.min.round(), galley, INK);
            }
            Row::Bars => self.bars(rect.shrink2(vec2(0.0, 2.0))),
            Row::Gauge { share, good, fair, ink } => {
                let bar = rect.shrink2(vec2(0.0, 0.25 * rect.height()));
                let to = |share: f64| (bar.min.x + bar.width() * share.clamp(0.0, 1.0) as f32).round();
                let part =
                    |from: f32, to: f32| Rect::from_min_max(pos2(from, bar.min.y), pos2(to, bar.max.y));
                self.painter.rect_filled(bar, 0.0, RULE);
                self.painter.rect_filled(part(bar.min.x, to(*share)), 0.0, *ink);
                for mark in [good, fair] {
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

    fn frame_rows(&self) -> Vec<Row> {
        let Self { history, readings, .. } = self;
        let mean_s = history.mean(|frame| frame.whole_s);
        let rate = if mean_s > 0.0 { 1.0 / mean_s } else { 0.0 };
        let mut rows = vec![
            Row::Words(vec![
                (format!("{:<17}", clipped(&readings.stage, 17)), INK),
                (format!("{rate:>8.1}"), INK),
                (" frames/s".into(), QUIET),
            ]),
            Row::Words(vec![
                ("mean".into(), QUIET),
                (format!("{:>9.2}", mean_s * 1e3), INK),
                (" ms   worst".into(), QUIET),
                (format!("{:>9.2}", history.worst_s() * 1e3), INK),
                (" ms".into(), QUIET),
            ]),
            Row::Bars,
        ];
        let step = |k: usize| {
            let mean_ms = 1e3 * history.mean(|frame| frame.steps[k]);
            [
                ("■ ".to_owned(), COLOURS[k]),
                (format!("{:<9}", STEPS[k]), QUIET),
                (format!("{mean_ms:>6.2}"), INK),
            ]
        };
        for k in (0..STEPS.len()).step_by(2) {
            let gap = [("   ".to_owned(), INK)];
            rows.push(Row::Words(step(k).into_iter().chain(gap).chain(step(k + 1)).collect()));
        }
        rows.push(Row::Gap);
        rows.push(words(clipped(&readings.device, LETTERS), QUIET));
        rows.push(words(clipped(&readings.deformation, LETTERS), QUIET));
        rows.push(Row::Gap);
        if readings.sensors.is_empty() {
            rows.push(words(clipped(&readings.source, LETTERS), QUIET));
        } else {
            rows.push(words(format!("{:<14}{:>9}{:>9}", "sensor", "rate", "age"), QUIET));
            rows.extend(readings.sensors.iter().map(sensor_row));
        }
        for haptic in &readings.haptics {
            rows.push(Row::Gap);
            rows.extend(haptic_rows(haptic));
        }
        rows.push(Row::Gap);
        rows.extend(hand_rows(readings));
        rows.push(Row::Gap);
        rows.push(words("F1 closes   F2 room   F3 test pattern", QUIET));
        rows
    }

    /// The newest warnings, oldest first, each cut to one row.
    fn warnings(&self, letters: usize) -> Vec<Row> {
        let all = &self.readings.warnings;
        let newest = &all[all.len().saturating_sub(WARNINGS)..];
        let row = |(time_s, text): &(f64, String)| {
            let text = clipped(text, letters.saturating_sub(11));
            Row::Words(vec![(format!("{time_s:>8.1} s "), QUIET), (text, FAIR)])
        };
        newest.iter().map(row).collect()
    }
}

fn sensor_row(sensor: &SensorReading) -> Row {
    let (state, ink) = match sensor.signal {
        Signal::Live => ("live", GOOD),
        Signal::Held { .. } => ("held", FAIR),
        Signal::Lost { .. } => ("lost", BAD),
    };
    let age = match sensor.age_s {
        s if s < 10.0 => format!("{:.0} ms", 1e3 * s),
        s => format!("{s:.0} s"),
    };
    Row::Words(vec![
        (format!("{:<14}", clipped(&sensor.name, 13)), INK),
        (format!("{:>6.1} Hz{age:>9}  ", sensor.rate_hz), INK),
        (state.into(), ink),
    ])
}

fn body_rows(body: &BodyReading) -> Vec<Row> {
    let mut rows = vec![
        words(clipped(&body.name, LETTERS), INK),
        words(clipped(&format!("model {}", body.model), LETTERS), QUIET),
        words(
            match body.effects.is_empty() {
                true => "no effects".to_owned(),
                false => clipped(&format!("effects {}", body.effects.join(", ")), LETTERS),
            },
            QUIET,
        ),
    ];
    rows.extend(gauge_rows(body));
    rows.extend(body.age.map(age_row));
    if let Some(energy) = body.energy {
        rows.push(Row::Words(vec![
            ("energy ".into(), QUIET),
            (format!("{energy:>10.4}"), INK),
            (" J".into(), QUIET),
        ]));
    }
    rows.extend(body.errors.iter().flat_map(error_rows));
    for control in &body.controls {
        rows.push(Row::Gap);
        rows.extend(control_rows(control));
    }
    rows
}

/// How old an equilibrium is that was found in the background.
fn age_row(age: StateAge) -> Row {
    match age {
        StateAge::Current => words("equilibrium of these poses".to_owned(), QUIET),
        StateAge::Old { seconds } => words(format!("equilibrium {seconds:.2} s old"), FAIR),
        StateAge::Lost => words("no equilibrium beyond this one".to_owned(), BAD),
    }
}

/// What errors to expect, as they were measured on this body; no number beyond what was measured.
fn error_rows(errors: &ErrorReading) -> Vec<Row> {
    let part = |name: &str, part: String| [(format!("{part:<7}"), INK), (name.to_owned(), QUIET)];
    let of_model = |at: &Option<ErrorsAt>| match at {
        Some(at) => {
            let force = at.wrench().map_or("none".into(), percent);
            let parts = part("force  ", force).into_iter().chain(part("shape", percent(at.shape)));
            std::iter::once(("errors ~".into(), QUIET)).chain(parts).collect()
        }
        None => vec![("errors ".into(), QUIET), ("not measured here".into(), BAD)],
    };
    let of_mesh = |mesh: &MeshErrors| {
        let parts = part("force", percent(mesh.wrench));
        std::iter::once(("of mesh ~".into(), QUIET)).chain(parts).collect()
    };
    let (model, mesh) = (errors.model.iter().map(of_model), errors.mesh.iter().map(of_mesh));
    model.chain(mesh).map(Row::Words).collect()
}

/// How far the body is bent, compared with the turn up to which its model is good.
fn gauge_rows(body: &BodyReading) -> Vec<Row> {
    let (turn, limits) = (body.turn, body.limits);
    let (ink, verdict) = match turn {
        turn if turn <= limits.good => (GOOD, "good"),
        turn if turn <= limits.fair => (FAIR, "fair"),
        // No model is made for it: the matrices of the poses are those of smaller turns.
        turn if turn > PI => (BAD, "beyond"),
        _ => (BAD, if limits.is_measured { "not measured" } else { "poor" }),
    };
    let turns = if turn > PI { format!("  {:.1} turns", turn / (2.0 * PI)) } else { String::new() };
    let whole = 1.5 * limits.fair;
    let bounds = match limits.is_measured {
        true => format!("measured to {:.0}°", limits.fair.to_degrees()),
        false => {
            format!("good to {:.0}°, fair to {:.0}°", limits.good.to_degrees(), limits.fair.to_degrees())
        }
    };
    vec![
        Row::Words(vec![
            ("turn ".into(), QUIET),
            (format!("{:>6.1}°  ", turn.to_degrees()), INK),
            (verdict.into(), ink),
            (turns, QUIET),
        ]),
        Row::Gauge { share: turn / whole, good: limits.good / whole, fair: limits.fair / whole, ink },
        words(bounds, QUIET),
    ]
}

/// The twelve coefficients, a row per axis: T in mm, then M - I.
fn control_rows(control: &ControlReading) -> Vec<Row> {
    let held = if control.held { ("   held", GOOD) } else { ("", QUIET) };
    let mut rows = vec![
        Row::Words(vec![(clipped(&control.name, LETTERS - 8), INK), (held.0.to_owned(), held.1)]),
        words(format!("{:>11}   {:>7} {:>7} {:>7}", "T (mm)", "M - I", "", ""), QUIET),
    ];
    for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
        let m = |column: usize| {
            let unit = if axis == column { 1.0 } else { 0.0 };
            fixed(control.pose.matrix[(axis, column)] - unit, 7, 3)
        };
        rows.push(Row::Words(vec![
            (format!("{letter} "), QUIET),
            (fixed(1e3 * control.pose.translation[axis], 9, 2), INK),
            (format!("   {} {} {}", m(0), m(1), m(2)), INK),
        ]));
    }
    if let Some(wrench) = &control.wrench {
        for (name, unit, vector) in [("force ", "N", wrench.force), ("torque", "N·m", wrench.moment)] {
            let parts: Vec<String> = vector.iter().map(|part| fixed(*part, 7, 2)).collect();
            rows.push(Row::Words(vec![
                (name.to_owned(), QUIET),
                (fixed(vector.norm(), 8, 2), INK),
                (format!(" {unit:<4}"), QUIET),
                (parts.concat(), QUIET),
            ]));
        }
    }
    rows
}

/// The words of what errors to expect.
#[cfg(test)]
pub(super) fn error_words(body: &BodyReading) -> Vec<String> {
    let text = |row: Row| match row {
        Row::Words(words) => words.into_iter().map(|(text, _)| text).collect(),
        _ => String::new(),
    };
    body.errors.iter().flat_map(error_rows).map(text).collect()
}

/// The words of a body's gauge.
#[cfg(test)]
pub(super) fn gauge_words(body: &BodyReading) -> Vec<String> {
    let rows = gauge_rows(body);
    let Some(Row::Words(words)) = rows.into_iter().next() else { return Vec::new() };
    words.into_iter().map(|(text, _)| text).collect()
}
