//! Time of one evaluation against the error of the shape, and against that of force and torque; the colour says which part of
//! the error is the largest.

use super::common::{largest_parts, names_and_note, tip};
use super::entry::PlotEntry;
use crate::report::cost_metric::ONLINE as METRIC;
use crate::report::data::{Measurement, Report, Spread};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::parameters::PARAMETERS;
use crate::report::recommendation::ladder_by;
use crate::report::units::{relative, seconds, times};
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
    of: fn(&Measurement) -> Option<Spread>,
    /// The median; infinite where it was not measured.
    median: fn(&Measurement) -> f64,
    /// Whether the parts of the error are those of this quantity.
    has_parts: bool,
}

const SHAPE: Quantity = Quantity {
    title: "Shape: what an evaluation costs, and how wrong it is",
    label: "error of the shape, relative L2 (median of the poses)",
    of: |row| Some(row.error.uncancelled),
    median: |row| row.error.uncancelled.median,
    has_parts: true,
};
const HELD: Quantity = Quantity {
    title: "Force and torque: what an evaluation costs, and how wrong it is",
    label: "error of force and torque (median of the poses)",
    of: |row| row.error.uncancelled_held,
    median: |row| row.error.uncancelled_held.map_or(f64::INFINITY, |spread| spread.median),
    has_parts: false,
};

impl Quantity {
    fn rows<'a>(&self, report: &'a Report) -> Vec<&'a Measurement> {
        report.rows.iter().filter(|row| (self.of)(row).is_some()).collect()
    }

    fn place(&self, row: &Measurement) -> [f64; 2] {
        [(METRIC.of)(&row.cost), (self.median)(row)]
    }

    /// The settings worth their time, as indices into [`Quantity::rows`].
    fn rungs(&self, rows: &[&Measurement]) -> Vec<usize> {
        let own: Vec<Measurement> = rows.iter().map(|row| (*row).clone()).collect();
        ladder_by(&own, &METRIC, self.median)
    }

    fn picture(&self, report: &Report) -> Result<Picture, String> {
        let rows = self.rows(report);
        let rungs = self.rungs(&rows);
        let (names, note) = names_and_note(&rungs.iter().map(|&i| &rows[i].setting).collect::<Vec<_>>());
        let point = |row: &&Measurement| {
            let ([x, y], series) = (self.place(row), row.error.dominating().unwrap_or(0));
            Point { x, y, series: if self.has_parts { series } else { 0 }, tip: tip(row), ..Point::default() }
        };
        let mut points: Vec<Point> = rows.iter().map(point).collect();
        let front = pareto::front_of(rows.iter().copied(), |row| self.place(row));
        for &i in front.iter().chain(&rungs) {
            points[i].strong = true;
        }
        for (&i, name) in rungs.iter().zip(names) {
            points[i].label = Some(name);
            points[i].worst = (self.of)(rows[i]).map(|spread| spread.worst);
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
            triangles: Vec::new(),
        };
        plot.told()
    }

    fn caption(&self, report: &Report) -> String {
        let rows = self.rows(report);
        let rungs = self.rungs(&rows);
        let (Some(&first), Some(&last)) = (rungs.first(), rungs.last()) else { return String::new() };
        let (cheap, best) = (rows[first], rows[last]);
        let front = pareto::front_of(rows.iter().copied(), |row| self.place(row));
        let outside = pareto::outside(&rows, &front, |row| self.place(row));
        let end = |row: &Measurement| {
            let (time, error) = (seconds(row.cost.frame_p50_s), relative((self.median)(row)));
            format!("{} ({time}, {error})", row.setting)
        };
        if first == last {
            return format!("{} is the cheapest and, to a tenth, the most accurate.{outside}", end(cheap));
        }
        let time = best.cost.frame_p50_s / cheap.cost.frame_p50_s;
        let error = (self.median)(cheap) / (self.median)(best);
        let ratio = if time.is_finite() && error.is_finite() {
            format!(": {} times the time, {} times less error", times(time), times(error))
        } else {
            String::new()
        };
        let parts = if self.has_parts {
            let known: Vec<&Measurement> = rows.iter().copied().filter(|row| row.can_be_chosen()).collect();
            format!(" {}", largest_parts(&known, "settings"))
        } else {
            String::new()
        };
        format!("From {} to {}{ratio}.{parts}{outside}", end(cheap), end(best))
    }
}
