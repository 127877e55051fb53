//! Which part of the error limits, as a picture: a line a setting, a marker a part, on one axis of errors.
//!
//! The parts are not stacked: on a logarithmic axis lengths do not add, and the parts are norms of vectors, whose sum
//! is no longer than theirs.

use super::answer::{ONLINE, ladder};
use super::axis::Axis;
use super::labels::Rect;
use super::markup::{escape, shortened, width};
use super::panels::{naming, tip};
use super::plot::{Picture, WIDTH, legend, line, marker, text, ticks};
use super::units::Unit;
use super::{PARTS, Row};

const ROW: f64 = 24.0;
const LONGEST: usize = 46;
/// Parts below this share of the least total are drawn at the edge.
const NEGLIGIBLE: f64 = 1e-4;

/// The settings of the online ladder, cheapest on top.
pub fn picture(rows: &[Row]) -> Picture {
    let shown: Vec<&Row> = ladder(rows, &ONLINE).into_iter().map(|i| &rows[i]).collect();
    let (names, note) = naming(&shown.iter().map(|row| &row.setting).collect::<Vec<_>>());
    let names: Vec<String> = names.iter().map(|name| shortened(name, LONGEST)).collect();
    let widest = names.iter().map(|name| width(name, 12.0)).fold(60.0, f64::max);
    let title = "Which part of the error limits".to_owned();
    let mut body = text([16.0, 26.0], "start", "gs-title", &title);
    body +=
        &text([16.0, 45.0], "start", "gs-muted", &format!("{note} From cheap to accurate. Bar: the total."));
    let (key, used) = legend(&PARTS.map(|part| format!("{part} error")), 16.0, WIDTH - 22.0, 55.0);
    body += &key;
    let left = 24.0 + widest;
    let area =
        Rect { x: left, y: 63.0 + used, width: WIDTH - 26.0 - left, height: ROW * shown.len() as f64 + 8.0 };
    let bottom = area.y + area.height;
    let values: Vec<f64> = shown
        .iter()
        .flat_map(|row| {
            row.error.parts().map(|part| part.median).into_iter().chain([row.error.uncancelled.median])
        })
        .collect();
    let least = shown
        .iter()
        .map(|row| row.error.uncancelled.median)
        .filter(|&e| e > 0.0)
        .fold(f64::INFINITY, f64::min);
    let floor = if least.is_finite() { decade_below(NEGLIGIBLE * least) } else { 0.0 };
    let axis = Axis::above(floor, &values, Unit::Ratio, left, left + area.width);
    body += &ticks(&axis, false, [bottom, area.y]);
    for (i, (row, name)) in shown.iter().zip(&names).enumerate() {
        body += &one(row, name, area.y + 4.0 + ROW * (i as f64 + 0.5), &axis, area);
    }
    body += &text(
        [left + 0.5 * area.width, bottom + 38.0],
        "middle",
        "gs-text",
        "relative L2 error (median of the poses)",
    );
    Picture { name: "split", title, width: WIDTH, height: bottom + 50.0, body }
}

fn decade_below(value: f64) -> f64 {
    format!("1e{}", value.log10().floor()).parse().unwrap_or(0.0)
}

fn one(row: &Row, name: &str, y: f64, axis: &Axis, area: Rect) -> String {
    let mut drawn = text([area.x - 10.0, y + 4.0], "end", "gs-text", name);
    drawn += &line("gs-grid", [[area.x, y], [area.x + area.width, y]]);
    let total = axis.at(row.error.uncancelled.median);
    drawn += &format!("<g><title>{}</title>\n", escape(&tip(row)));
    drawn += &line("gs-total", [[total, y - 9.0], [total, y + 9.0]]);
    for (part, spread) in row.error.parts().iter().enumerate() {
        let at = axis.at(spread.median);
        // Parts of exactly zero share one place: side by side there.
        let aside = if axis.zero == Some(at) { 6.0 * (part as f64 - 1.5) } else { 0.0 };
        drawn += &format!("<g class=\"gs-f{part}\">{}</g>\n", marker(part, [at + aside, y], 4.6));
    }
    drawn + "</g>\n"
}
