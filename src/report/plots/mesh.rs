//! Offline time against the discretisation error: a line an element.

use super::common::{distinct, fastest_on_each_mesh, listed};
use super::entry::PlotEntry;
use crate::report::cost_metric::OFFLINE;
use crate::report::data::{Measurement, Report};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::pareto;
use crate::report::units::{relative, seconds};

pub const MESH: PlotEntry = PlotEntry {
    name: "mesh",
    heading: "Mesh and element",
    reading: "Offline time against the error of the finite elements alone. A thin line joins the refinements of one \
              element; the lower line is the better buy.",
    caption,
    picture,
    table: None,
};

fn place(row: &Measurement) -> [f64; 2] {
    [(OFFLINE.of)(&row.cost), row.error.discretisation.median]
}

/// The reference has no error that is known, and so no place in the plot.
fn drawn(report: &Report) -> Vec<&Measurement> {
    let mut chosen = fastest_on_each_mesh(&report.rows);
    chosen.retain(|row| !row.is_reference());
    chosen
}

fn picture(report: &Report) -> Result<Picture, String> {
    let elements = distinct(report.rows.iter().map(|row| &row.setting.element));
    let chosen = drawn(report);
    let front = pareto::front_of(chosen.iter().copied(), place);
    let point = |(i, row): (usize, &&Measurement)| {
        let [x, y] = place(row);
        let series = elements.iter().position(|element| **element == row.setting.element).unwrap_or(0);
        let (mesh, solver) = (row.setting.mesh(), &row.setting.solver);
        let (time, error) = (seconds(x), relative(y));
        Point {
            x,
            y,
            worst: Some(row.error.discretisation.worst),
            series,
            line: Some(series),
            strong: front.contains(&i),
            tip: format!(
                "{mesh}, {solver}: {time} offline, {} nodes; discretisation error {error}",
                row.mesh_nodes
            ),
            label: Some(mesh),
        }
    };
    let plot = Plot {
        title: "What the mesh and the element cost, and what they bring",
        note: "h/2: the scene's mesh refined once. The finest mesh is the reference, and not drawn.".into(),
        x: Scale::cost(&OFFLINE),
        y: Scale::ratio("discretisation error, relative L2 (median of the poses)"),
        series: elements.iter().map(|element| (*element).clone()).collect(),
        points: chosen.iter().enumerate().map(point).collect(),
        front,
        triangles: Vec::new(),
    };
    plot.told()
}

fn caption(report: &Report) -> String {
    let chosen = fastest_on_each_mesh(&report.rows);
    let sentence = |element: &String| {
        let of: Vec<&&Measurement> = chosen.iter().filter(|row| row.setting.element == *element).collect();
        let end = |row: &Measurement| {
            let time = seconds(row.cost.offline_s);
            match row.is_reference() {
                true => format!("the reference ({time})"),
                false => format!("{} in {time}", relative(row.error.discretisation.median)),
            }
        };
        match of[..] {
            [first, .., last] => format!("{element} goes from {} to {}", end(first), end(last)),
            [one] if one.is_reference() => format!("{element} is {}", end(one)),
            [one] => format!("{element} has {}", end(one)),
            [] => String::new(),
        }
    };
    let elements = distinct(chosen.iter().map(|row| &row.setting.element));
    let drawn = drawn(report);
    let front = pareto::front_of(drawn.iter().copied(), place);
    let outside = pareto::outside(&drawn, &front, place);
    format!("{}.{outside}", listed(&elements.into_iter().map(sentence).collect::<Vec<_>>()))
}
