//! Time of one evaluation against the total error; the colour says which part of the error is the largest.

use super::common::{largest_parts, names_and_note, tip};
use super::entry::PlotEntry;
use crate::report::cost_metric::ONLINE as METRIC;
use crate::report::data::{Measurement, Report};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::parameters::PARAMETERS;
use crate::report::recommendation::ladder;
use crate::report::units::{relative, seconds, times};
use crate::report::{pareto, tables};

pub const ONLINE: PlotEntry = PlotEntry {
    name: "online",
    heading: "Time of an evaluation against the total error",
    reading: "Each mark is one setting of all parameters; left is faster, down is more accurate. The bold steps join \
              the settings that nothing beats; a thin line upward ends at the worst pose. Colour and shape say which \
              part of the error is the largest: change that parameter first.",
    caption,
    picture,
    table: Some((
        "The settings worth their online time, which the plot labels: each costs more than the one above, and has at \
         most nine tenths of its error.",
        |report| tables::efficient(&report.rows),
    )),
};

fn picture(report: &Report) -> Option<Picture> {
    let rows = &report.rows;
    let rungs = ladder(rows, &METRIC);
    let (names, note) = names_and_note(&rungs.iter().map(|&i| &rows[i].setting).collect::<Vec<_>>());
    let place = |row: &Measurement| [(METRIC.of)(&row.cost), row.error.uncancelled.median];
    let point = |row: &Measurement| {
        let ([x, y], series) = (place(row), row.error.dominating().unwrap_or(0));
        Point { x, y, series, tip: tip(row), ..Point::default() }
    };
    let mut points: Vec<Point> = rows.iter().map(point).collect();
    let front = pareto::front_of(rows.iter(), place);
    for &i in front.iter().chain(&rungs) {
        points[i].strong = true;
    }
    for (&i, name) in rungs.iter().zip(names) {
        points[i].label = Some(name);
        points[i].worst = Some(rows[i].error.uncancelled.worst);
    }
    let plot = Plot {
        title: "What an evaluation costs, and how wrong it is",
        note,
        x: Scale::cost(&METRIC),
        y: Scale::ratio("total error, relative L2 (median of the poses)"),
        series: PARAMETERS.iter().map(|parameter| format!("mostly {}", parameter.part)).collect(),
        points,
        front,
        triangles: Vec::new(),
    };
    (!rows.is_empty()).then(|| plot.picture())
}

fn caption(report: &Report) -> String {
    let rows = &report.rows;
    let rungs = ladder(rows, &METRIC);
    let (Some(&first), Some(&last)) = (rungs.first(), rungs.last()) else { return String::new() };
    let (cheap, best) = (&rows[first], &rows[last]);
    let end = |row: &Measurement| {
        let (time, error) = (seconds(row.cost.frame_p50_s), relative(row.error.uncancelled.median));
        format!("{} ({time}, {error})", row.setting)
    };
    if first == last {
        return format!("{} is the cheapest and, to a tenth, the most accurate.", end(cheap));
    }
    let time = best.cost.frame_p50_s / cheap.cost.frame_p50_s;
    let error = cheap.error.uncancelled.median / best.error.uncancelled.median;
    let ratio = if time.is_finite() && error.is_finite() {
        format!(": {} times the time, {} times less error", times(time), times(error))
    } else {
        String::new()
    };
    let known: Vec<&Measurement> = rows.iter().filter(|row| row.can_be_chosen()).collect();
    format!("From {} to {}{ratio}. {}", end(cheap), end(best), largest_parts(&known, "settings"))
}
