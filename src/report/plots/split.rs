//! The parts of the error: a line a setting, a marker a part, on one axis of errors, so that the largest part is seen.
//!
//! The parts are not stacked: on a logarithmic axis lengths do not add, and the parts are norms of vectors, whose sum
//! is no longer than theirs.

use super::common::{largest_parts, names_and_note, tip};
use super::entry::PlotEntry;
use crate::report::cost_metric::ONLINE;
use crate::report::data::{Measurement, Report};
use crate::report::drawing::axis::Axis;
use crate::report::drawing::canvas::{Canvas, FONT, Picture, WIDTH, colour, marker};
use crate::report::drawing::markup::{escape, shortened, width};
use crate::report::parameters::PARAMETERS;
use crate::report::recommendation::ladder;
use crate::report::units::Unit;

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
    ladder(&report.rows, &ONLINE).into_iter().map(|i| &report.rows[i]).collect()
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
