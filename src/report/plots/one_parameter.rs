//! What one parameter does on each mesh: a thin line a mesh, a colour and shape for each value of the parameter.

use super::common::distinct;
use crate::report::cost_metric::CostMetric;
use crate::report::data::{Measurement, Report};
use crate::report::drawing::canvas::Picture;
use crate::report::drawing::plot::{Plot, Point, Scale};
use crate::report::parameters::Parameter;
use crate::report::pareto;
use crate::report::units::{relative, times};
use std::cmp::Ordering;

pub struct OneParameter {
    pub parameter: Parameter,
    pub metric: CostMetric,
    pub title: &'static str,
    /// How the caption opens: what the costs are multiples of.
    pub multiples: &'static str,
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
            of.min_by(|a, b| self.cost(a).total_cmp(&self.cost(b)))
        };
        let point = |(series, value): (usize, &String)| {
            let row = here(value)?;
            let (x, y) = (self.cost(row), (self.parameter.error)(&row.error).median);
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

    pub fn picture(&self, report: &Report) -> Option<Picture> {
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
        (!report.rows.is_empty()).then(|| plot.picture())
    }

    /// For each value its largest error, and its cost as a multiple of the least on the same mesh.
    pub fn caption(&self, report: &Report) -> String {
        let rows = &report.rows;
        let least = |row: &Measurement| {
            let here = rows.iter().filter(|other| other.setting.mesh() == row.setting.mesh());
            here.map(|other| self.cost(other)).fold(f64::INFINITY, f64::min)
        };
        let sentence = |value: &String| {
            let of = || rows.iter().filter(|row| (self.parameter.value)(&row.setting) == *value);
            let error = of().map(|row| (self.parameter.error)(&row.error).median).fold(0.0, f64::max);
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
        let sentences: Vec<String> = self.values(rows).iter().map(sentence).collect();
        format!("{}: {}.", self.multiples, sentences.join("; "))
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
