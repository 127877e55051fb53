//! The smooth problem in the norms of L2 and of energy: error against h, with the fitted slopes, and the theory's as
//! triangles.

use super::common::{PlotEntry, distinct, listed};
use crate::measure::units::{Unit, digits, relative};
use crate::measure::{Report, SmoothError};
use crate::report::canvas::Picture;
use crate::report::plot::{Plot, Point, Scale, Triangle};

pub const SMOOTH_L2: PlotEntry = PlotEntry {
    name: "smooth-l2",
    heading: "Smooth problem",
    reading: "A smooth displacement whose exact solution is known, solved on the body's own mesh: the error must fall \
              as the theory says, line parallel to triangle. Where it does not, the elements or the mesh are at \
              fault, not the body's corners.",
    caption: |report| L2.caption(report),
    picture: |report| L2.picture(report),
    table: None,
};
pub const SMOOTH_ENERGY: PlotEntry = PlotEntry {
    name: "smooth-energy",
    heading: "",
    reading: "The same in the energy norm, which falls one order slower.",
    caption: |report| ENERGY.caption(report),
    picture: |report| ENERGY.picture(report),
    table: None,
};

const L2: Norm = Norm {
    title: "Smooth problem: L2 error against h",
    label: "relative error in L2",
    error: |row| row.l2,
    rate: |row| row.l2_rate,
    promised: |row| row.promised[0],
};
const ENERGY: Norm = Norm {
    title: "Smooth problem: energy error against h",
    label: "relative error in the energy norm",
    error: |row| row.energy,
    rate: |row| row.energy_rate,
    promised: |row| row.promised[1],
};

/// Fitted slopes that fall short of the theory's by more than this are named.
const SHORT: f64 = 0.2;

struct Norm {
    title: &'static str,
    label: &'static str,
    error: fn(&SmoothError) -> f64,
    /// The fitted slope.
    rate: fn(&SmoothError) -> Option<f64>,
    /// The slope that the theory promises.
    promised: fn(&SmoothError) -> f64,
}

impl Norm {
    fn picture(&self, report: &Report) -> Result<Picture, String> {
        let rows = &report.smooth;
        let elements = distinct(rows.iter().map(|row| &row.element));
        let name = |element: &&String| {
            let fitted = rows.iter().filter(|row| row.element == **element).find_map(self.rate);
            fitted.map_or_else(|| (*element).clone(), |rate| format!("{element}: slope {rate:.2}"))
        };
        let mut points = Vec::new();
        for (series, element) in elements.iter().enumerate() {
            points.extend(rows.iter().filter(|row| row.element == **element).map(|row| {
                let (x, y) = (row.h, (self.error)(row));
                let tip = format!("{element}, h = {}: {}", Unit::Metres.text(x), relative(y));
                Point { x, y, series, line: Some(series), strong: true, tip, ..Point::default() }
            }));
        }
        points.sort_by(|a, b| a.x.total_cmp(&b.x));
        let plot = Plot {
            title: self.title,
            note: "Grey triangles: the slopes that the theory promises.".into(),
            x: Scale {
                label: "h, cube root of the mean volume of a tetrahedron".into(),
                unit: Unit::Metres,
                logarithmic: true,
            },
            y: Scale::ratio(self.label),
            series: elements.iter().map(name).collect(),
            points,
            triangles: self.triangles(rows),
            ..Plot::default()
        };
        if !rows.is_empty() && rows.iter().all(|row| (self.rate)(row).is_none()) {
            return Err("a single refinement has no rate of convergence".into());
        }
        plot.picture()
    }

    /// One for every promised rate, below the lowest line that it is promised to.
    fn triangles(&self, rows: &[SmoothError]) -> Vec<Triangle> {
        let drawn = |row: &&SmoothError| row.h > 0.0 && (self.error)(row) > 0.0;
        let triangle = |rate: f64| {
            let here = || rows.iter().filter(drawn).filter(|row| (self.promised)(row) == rate);
            let (least, most) =
                here().fold((f64::INFINITY, 0.0_f64), |(a, b), row| (a.min(row.h), b.max(row.h)));
            // In the middle of the refinements, and as wide as 0.4 of them.
            let middle = (least * most).sqrt();
            let reach = (most / least).powf(0.2).max(1.15);
            let x = [middle / reach, middle * reach];
            let below =
                here().map(|row| (self.error)(row) * (x[1] / row.h).powf(rate)).fold(f64::INFINITY, f64::min);
            let triangle = Triangle { x, y: 0.5 * below, rate };
            let usable = x[0].is_normal() && x[1].is_finite() && triangle.y.is_normal();
            (usable && triangle.left().is_normal()).then_some(triangle)
        };
        distinct(rows.iter().filter(drawn).map(self.promised)).into_iter().filter_map(triangle).collect()
    }

    fn caption(&self, report: &Report) -> String {
        let sentence = |element: &String| {
            let row = report.smooth.iter().find(|row| row.element == *element)?;
            let (promised, slope) = ((self.promised)(row), (self.rate)(row)?);
            let verdict = if slope < promised - SHORT { ", which falls short" } else { "" };
            Some(format!("{element} {slope:.2} (theory {}){verdict}", digits(promised, 3)))
        };
        let elements = distinct(report.smooth.iter().map(|row| &row.element));
        let slopes: Vec<String> = elements.into_iter().filter_map(sentence).collect();
        if slopes.is_empty() {
            return "One refinement has no slope.".into();
        }
        format!("Fitted slopes: {}.", listed(&slopes))
    }
}
