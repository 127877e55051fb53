//! One parameter alone: mesh and element, solver, storage; a thin line joins what differs in it alone.

use super::common::{PlotEntry, distinct, fastest_on_each_mesh, listed};
use crate::measure::data::{self, Measurement, PARAMETERS, Parameter, Report, Setting};
use crate::measure::units::{relative, seconds, times};
use crate::report::canvas::Picture;
use crate::report::pareto::{self, CostMetric, OFFLINE};
use crate::report::plot::{Plot, Point, Scale};
use std::cmp::Ordering;

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
    [(OFFLINE.of)(&row.cost), row.error.discretisation.map_or(f64::INFINITY, |part| part.median)]
}

/// The reference has no error that is known, and so no place in the plot.
fn drawn(report: &Report) -> Vec<&Measurement> {
    let mut chosen = fastest_on_each_mesh(&report.rows);
    chosen.retain(|row| row.is_mesh_known() && !row.is_reference());
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
            worst: row.error.discretisation.map(|part| part.worst),
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
        note: "h/2: the scene's mesh refined once. A mesh that is the reference itself is not drawn.".into(),
        x: Scale::cost(&OFFLINE),
        y: Scale::ratio("discretisation error, relative L2 (median of the poses)"),
        series: elements.iter().map(|element| (*element).clone()).collect(),
        points: chosen.iter().enumerate().map(point).collect(),
        front,
        ..Plot::default()
    };
    plot.picture()
}

fn caption(report: &Report) -> String {
    let mut chosen = fastest_on_each_mesh(&report.rows);
    chosen.retain(|row| row.is_mesh_known());
    let sentence = |element: &String| {
        let of: Vec<&&Measurement> = chosen.iter().filter(|row| row.setting.element == *element).collect();
        let end = |row: &Measurement| {
            let time = seconds(row.cost.offline_s);
            match row.is_reference() {
                true => format!("the reference ({time})"),
                false => format!("{} in {time}", relative(place(row)[1])),
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

/// Offline time against the solver error.
pub const SOLVER: PlotEntry = PlotEntry {
    name: "solver",
    heading: "Solver and tolerance",
    reading: "Offline time against the error that the solver adds on the same mesh. It is small enough where it lies a \
              decade below the discretisation error of that mesh.",
    caption: |report| SOLVER_ALONE.caption(report),
    picture: |report| SOLVER_ALONE.picture(report),
    table: None,
};
/// Size of the file against the storage error.
pub const STORAGE: PlotEntry = PlotEntry {
    name: "storage",
    heading: "Storage",
    reading: "Size of the file against the error of rounding its columns. Hollow marks buy nothing on their mesh.",
    caption: |report| STORAGE_ALONE.caption(report),
    picture: |report| STORAGE_ALONE.picture(report),
    table: None,
};

const SOLVER_ALONE: OneParameter = OneParameter {
    parameter: data::SOLVER,
    metric: pareto::OFFLINE,
    title: "What the solver and its tolerance cost",
    multiples: "Offline times as multiples of the fastest with the same mesh, storage and model",
};
const STORAGE_ALONE: OneParameter = OneParameter {
    parameter: data::STORAGE,
    metric: pareto::FILE,
    title: "What the storage of the columns costs",
    multiples: "File sizes as multiples of the smallest with the same mesh, solver and model",
};

struct OneParameter {
    parameter: Parameter,
    metric: CostMetric,
    title: &'static str,
    /// The opening of the caption: the unit of which the costs are multiples.
    multiples: &'static str,
}

impl OneParameter {
    fn values(&self, rows: &[Measurement]) -> Vec<String> {
        let mut values = distinct(rows.iter().map(|row| (self.parameter.value)(&row.setting)));
        values.sort_by(|a, b| by_number(a, b));
        values
    }

    fn cost(&self, row: &Measurement) -> f64 {
        (self.metric.of)(&row.cost)
    }

    /// The points of one mesh, by falling error: for each value the cheapest row.
    fn line(&self, rows: &[Measurement], values: &[String], line: usize, mesh: &str) -> Vec<Point> {
        let here = |value: &String| {
            let of = rows.iter().filter(|row| row.setting.mesh() == mesh);
            let of = of.filter(|row| (self.parameter.value)(&row.setting) == *value);
            let known = of.filter_map(|row| Some((row, (self.parameter.error)(&row.error)?.median)));
            known.min_by(|(a, _), (b, _)| self.cost(a).total_cmp(&self.cost(b)))
        };
        let point = |(series, value): (usize, &String)| {
            let (row, y) = here(value)?;
            let x = self.cost(row);
            let tip = format!("{mesh}, {value}: {}, error {}", self.metric.unit.text(x), relative(y));
            Some(Point { x, y, series, line: Some(line), tip, ..Point::default() })
        };
        let mut points: Vec<Point> = values.iter().enumerate().filter_map(point).collect();
        points.sort_by(|a, b| b.y.total_cmp(&a.y).then(a.x.total_cmp(&b.x)));
        for i in pareto::front(&points.iter().map(|point| [point.x, point.y]).collect::<Vec<_>>()) {
            points[i].strong = true;
        }
        if let Some(last) = points.last_mut() {
            last.label = Some(mesh.to_owned());
        }
        points
    }

    fn picture(&self, report: &Report) -> Result<Picture, String> {
        let values = self.values(&report.rows);
        let meshes = distinct(report.rows.iter().map(|row| row.setting.mesh()));
        let lines = meshes.iter().enumerate().map(|(i, mesh)| self.line(&report.rows, &values, i, mesh));
        let Parameter { name, part, .. } = &self.parameter;
        let plot = Plot {
            title: self.title,
            note: format!(
                "A thin line joins the {name}s on one mesh; filled: nothing else on that mesh beats it."
            ),
            x: Scale::cost(&self.metric),
            y: Scale::ratio(&format!("{part} error, relative L2 (median of the poses)")),
            points: lines.flatten().collect(),
            series: values,
            ..Plot::default()
        };
        plot.picture()
    }

    /// Whether two settings differ in this parameter at most.
    fn are_alike(&self, a: &Setting, b: &Setting) -> bool {
        let differ = |parameter: &Parameter| (parameter.value)(a) != (parameter.value)(b);
        PARAMETERS.iter().all(|parameter| parameter.name == self.parameter.name || !differ(parameter))
    }

    /// The largest error of each value, and its cost as a multiple of the least of settings that differ in nothing else.
    fn caption(&self, report: &Report) -> String {
        let known = |row: &&Measurement| (self.parameter.error)(&row.error).is_some();
        let rows: Vec<&Measurement> = report.rows.iter().filter(known).collect();
        let alike = |row: &Measurement| {
            let setting = row.setting.clone();
            rows.iter().copied().filter(move |other| self.are_alike(&setting, &other.setting))
        };
        // A setting that nothing else is like is compared with nothing.
        let compared: Vec<&Measurement> = rows.iter().copied().filter(|row| alike(row).count() > 1).collect();
        let least =
            |row: &Measurement| alike(row).map(|other| self.cost(other)).fold(f64::INFINITY, f64::min);
        let sentence = |value: &String| {
            let of = || compared.iter().filter(|row| (self.parameter.value)(&row.setting) == *value);
            let errors = of().filter_map(|row| (self.parameter.error)(&row.error));
            let error = errors.map(|part| part.median).fold(0.0, f64::max);
            let ratios = of().map(|row| self.cost(row) / least(row)).filter(|ratio| ratio.is_finite());
            let (low, high) =
                ratios.fold((f64::INFINITY, 0.0_f64), |(a, b), ratio| (a.min(ratio), b.max(ratio)));
            let range = match (times(low), times(high)) {
                _ if low > high => String::new(),
                (low, high) if low == high => format!("{low} times, "),
                (low, high) => format!("{low} to {high} times, "),
            };
            format!("{value} {range}error at most {}", relative(error))
        };
        let is_compared =
            |value: &&String| compared.iter().any(|row| (self.parameter.value)(&row.setting) == **value);
        let sentences: Vec<String> =
            self.values(&report.rows).iter().filter(is_compared).map(sentence).collect();
        if sentences.is_empty() {
            return String::new();
        }
        let error = |row: &Measurement| (self.parameter.error)(&row.error).map_or(0.0, |part| part.median);
        // Twice the error for more: no property of the parameter.
        let is_odd = |a: &&&Measurement| {
            compared.iter().any(|b| {
                self.are_alike(&a.setting, &b.setting)
                    && !a.setting.solver.method.is_direct
                    && !b.setting.solver.method.is_direct
                    && error(a) > 2.0 * error(b)
                    && self.cost(a) > 1.05 * self.cost(b)
            })
        };
        let odd = match compared.iter().find(is_odd) {
            Some(row) => format!(
                " That {} costs more than what is more accurate is scatter of the times.",
                (self.parameter.value)(&row.setting)
            ),
            None => String::new(),
        };
        format!("{}: {}.{odd}", self.multiples, sentences.join("; "))
    }
}

/// "pcg 1e-10" after "pcg 1e-4": words by their text, the number at their end downwards.
fn by_number(a: &str, b: &str) -> Ordering {
    fn split(text: &str) -> (&str, f64) {
        let number = text.rsplit_once(' ').and_then(|(head, tail)| Some((head, tail.parse().ok()?)));
        number.unwrap_or((text, 0.0))
    }
    let ((a, x), (b, y)) = (split(a), split(b));
    a.cmp(b).then(y.total_cmp(&x))
}
