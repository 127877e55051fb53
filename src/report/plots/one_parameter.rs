//! Effects of the solver and the storage on each mesh: a thin line a mesh, a colour and shape for each value of the parameter.

use super::common::distinct;
use super::entry::PlotEntry;
use crate::report::cost_metric::{self, CostMetric};
use crate::report::data::{Measurement, Report, Setting};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::parameters::{self, PARAMETERS, Parameter};
use crate::report::pareto;
use crate::report::units::{relative, times};
use std::cmp::Ordering;

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
    parameter: parameters::SOLVER,
    metric: cost_metric::OFFLINE,
    title: "What the solver and its tolerance cost",
    multiples: "Offline times as multiples of the fastest with the same mesh, storage and model",
};
const STORAGE_ALONE: OneParameter = OneParameter {
    parameter: parameters::STORAGE,
    metric: cost_metric::FILE,
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
            front: Vec::new(),
            triangles: Vec::new(),
        };
        plot.told()
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
