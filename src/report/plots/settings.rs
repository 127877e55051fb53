//! The settings: time of one evaluation against the error of the shape, and against that of force and torque; and the parts of
//! the error of those worth their time.
//!
//! The parts are not stacked: on a logarithmic axis lengths do not add, and the parts are norms of vectors, whose sum
//! is no longer than theirs.

use super::common::{PlotEntry, largest_parts, names_and_note, tip};
use crate::measure::units::{Unit, relative, seconds, times};
use crate::measure::{Measurement, PARAMETERS, Report, Spread};
use crate::report::answer::{ladder, ladder_by};
use crate::report::axis::Axis;
use crate::report::canvas::{Canvas, FONT, Picture, WIDTH, colour, escape, marker, shortened, width};
use crate::report::pareto::ONLINE as METRIC;
use crate::report::plot::{Plot, Point, Scale};
use crate::report::{pareto, tables};

pub const ONLINE: PlotEntry = PlotEntry {
    name: "online",
    heading: "What an evaluation costs",
    reading: "Each mark is one setting of all parameters; left is faster, down is more accurate. The bold steps join \
              the settings that no other beats; a thin line upward ends at the worst pose. Colour and shape say which \
              part of the error is the largest: change that parameter first.",
    caption: |report| SHAPE.caption(report),
    picture: |report| SHAPE.picture(report),
    table: None,
};
pub const FORCE: PlotEntry = PlotEntry {
    name: "online-force",
    heading: "",
    reading: "The same settings by the larger error of force and torque, as a part of the largest that equilibrium needs: a \
              setting whose shape is right may feel quite wrong.",
    caption: |report| HELD.caption(report),
    picture: |report| HELD.picture(report),
    table: Some((
        "The settings worth their online time, which the first of these plots labels: each costs more than the one above, and \
         its shape has at most nine tenths of its error.",
        |report| tables::efficient(&report.rows),
    )),
};

/// An error that settings are drawn by.
struct Quantity {
    title: &'static str,
    label: &'static str,
    of: fn(&Measurement) -> Spread,
    /// Whether the parts of the error are those of this quantity.
    has_parts: bool,
}

const SHAPE: Quantity = Quantity {
    title: "Shape: what an evaluation costs, and how wrong it is",
    label: "error of the shape, relative L2 (median of the poses)",
    of: |row| row.error.uncancelled,
    has_parts: true,
};
const HELD: Quantity = Quantity {
    title: "Force and torque: what an evaluation costs, and how wrong it is",
    label: "error of force and torque (median of the poses)",
    of: |row| row.error.uncancelled_held,
    has_parts: false,
};

impl Quantity {
    fn median(&self, row: &Measurement) -> f64 {
        (self.of)(row).median
    }

    fn place(&self, row: &Measurement) -> [f64; 2] {
        [(METRIC.of)(&row.cost), self.median(row)]
    }

    /// The settings worth their time, as indices into the rows.
    fn rungs(&self, rows: &[Measurement]) -> Vec<usize> {
        ladder_by(rows, &METRIC, |row| self.median(row))
    }

    fn picture(&self, report: &Report) -> Result<Picture, String> {
        let rows = &report.rows;
        let rungs = self.rungs(rows);
        let (names, note) = names_and_note(&rungs.iter().map(|&i| &rows[i].setting).collect::<Vec<_>>());
        let point = |row: &Measurement| {
            let ([x, y], series) = (self.place(row), row.error.dominating().unwrap_or(0));
            Point { x, y, series: if self.has_parts { series } else { 0 }, tip: tip(row), ..Point::default() }
        };
        let mut points: Vec<Point> = rows.iter().map(point).collect();
        let front = pareto::front_of(rows.iter(), |row| self.place(row));
        for &i in front.iter().chain(&rungs) {
            points[i].strong = true;
        }
        for (&i, name) in rungs.iter().zip(names) {
            points[i].label = Some(name);
            points[i].worst = Some((self.of)(&rows[i]).worst);
        }
        let parts = PARAMETERS.iter().map(|parameter| format!("mostly {}", parameter.part));
        let plot = Plot {
            title: self.title,
            note,
            x: Scale::cost(&METRIC),
            y: Scale::ratio(self.label),
            series: if self.has_parts { parts.collect() } else { vec!["a setting".into()] },
            points,
            front,
            ..Plot::default()
        };
        plot.picture()
    }

    fn caption(&self, report: &Report) -> String {
        let rows = &report.rows;
        let rungs = self.rungs(rows);
        let (Some(&first), Some(&last)) = (rungs.first(), rungs.last()) else { return String::new() };
        let (cheap, best) = (&rows[first], &rows[last]);
        let front = pareto::front_of(rows.iter(), |row| self.place(row));
        let outside = pareto::outside(&rows.iter().collect::<Vec<_>>(), &front, |row| self.place(row));
        let end = |row: &Measurement| {
            let (time, error) = (seconds(row.cost.frame_p50_s), relative(self.median(row)));
            format!("{} ({time}, {error})", row.setting)
        };
        if first == last {
            return format!("{} is the cheapest and, to a tenth, the most accurate.{outside}", end(cheap));
        }
        let time = best.cost.frame_p50_s / cheap.cost.frame_p50_s;
        let error = self.median(cheap) / self.median(best);
        let ratio = if time.is_finite() && error.is_finite() {
            format!(": {} times the time, {} times less error", times(time), times(error))
        } else {
            String::new()
        };
        let parts = if self.has_parts {
            let known: Vec<&Measurement> = rows.iter().filter(|row| row.can_be_chosen()).collect();
            format!(" {}", largest_parts(&known, "settings"))
        } else {
            String::new()
        };
        format!("From {} to {}{ratio}.{parts}{outside}", end(cheap), end(best))
    }
}

pub const SPLIT: PlotEntry = PlotEntry {
    name: "split",
    heading: "Which parameter limits",
    reading: "The settings worth their time, from cheap to accurate. The mark furthest to the right is the part that \
              limits. Parameters whose marks lie far to its left can be set cheaper without loss.",
    caption: |report| largest_parts(&efficient(report), "settings drawn here"),
    picture,
    table: None,
};

const ROW: f64 = 24.0;
const LONGEST: usize = 46;
/// Parts below this share of the least total are drawn at the edge.
const NEGLIGIBLE: f64 = 1e-4;

/// The settings of the online ladder.
fn efficient(report: &Report) -> Vec<&Measurement> {
    ladder(&report.rows, &METRIC).into_iter().map(|i| &report.rows[i]).collect()
}

fn picture(report: &Report) -> Result<Picture, String> {
    let rows = efficient(report);
    if rows.is_empty() {
        return Err("no setting can be chosen".into());
    }
    let (names, note) = names_and_note(&rows.iter().map(|row| &row.setting).collect::<Vec<_>>());
    let names: Vec<String> = names.iter().map(|name| shortened(name, LONGEST)).collect();
    let note = format!("{note} From cheap to accurate. Bar: the total.");
    let series = PARAMETERS.map(|parameter| format!("{} error", parameter.part));
    let (mut canvas, top) = Canvas::new("Which part of the error limits", note.trim_start(), &series);
    let left = 24.0 + names.iter().map(|name| width(name, FONT)).fold(60.0, f64::max);
    let (right, bottom) = (WIDTH - 26.0, top + ROW * rows.len() as f64 + 8.0);
    let totals = || rows.iter().map(|row| row.error.uncancelled.median);
    let parts = rows.iter().flat_map(|row| row.error.parts()).flatten().map(|part| part.median);
    let least = totals().filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
    let floor = if least.is_finite() { decade_below(NEGLIGIBLE * least) } else { 0.0 };
    let axis = Axis::above(floor, &parts.chain(totals()).collect::<Vec<_>>(), Unit::Ratio, left, right);
    canvas.ticks(&axis, false, [bottom, top]);
    for (i, (row, name)) in rows.iter().zip(&names).enumerate() {
        let y = top + 4.0 + ROW * (i as f64 + 0.5);
        canvas.text([left - 10.0, y + 4.0], "end", "gs-text", name);
        canvas.path("gs-grid", &[[left, y], [right, y]]);
        canvas.body += &format!("<g><title>{}</title>\n", escape(&tip(row)));
        let total = axis.at(row.error.uncancelled.median);
        canvas.path("gs-total", &[[total, y - 9.0], [total, y + 9.0]]);
        for (part, spread) in row.error.parts().iter().enumerate() {
            let Some(spread) = spread else { continue };
            let at = axis.at(spread.median);
            // Parts of exactly zero share one place: side by side there.
            let aside = if axis.zero == Some(at) { 6.0 * (part as f64 - 1.5) } else { 0.0 };
            let shape = marker(part, [at + aside, y], 4.6);
            canvas.body += &format!("<g class=\"gs-f{}\">{shape}</g>\n", colour(part));
        }
        canvas.body += "</g>\n";
    }
    let label = "relative L2 error (median of the poses)";
    canvas.text([0.5 * (left + right), bottom + 38.0], "middle", "gs-text", label);
    Ok(canvas.picture(bottom + 50.0))
}

fn decade_below(value: f64) -> f64 {
    format!("1e{}", value.log10().floor()).parse().unwrap_or(0.0)
}
