//! The smooth problem drawn: error against h, with the fitted slopes and the theory's as triangles.

use super::SmoothRow;
use super::panels::distinct;
use super::plot::{Plot, Point, Scale, Triangle};
use super::units::{Unit, relative};

/// One plot for the L2 error, one for the energy norm.
pub fn plots(rows: &[SmoothRow]) -> [Plot; 2] {
    [
        plot(rows, 0, "smooth-l2", "Smooth problem: L2 error against h", |row| row.l2, |row| row.l2_rate),
        plot(
            rows,
            1,
            "smooth-energy",
            "Smooth problem: energy error against h",
            |row| row.energy,
            |row| row.energy_rate,
        ),
    ]
}

fn plot(
    rows: &[SmoothRow],
    norm: usize,
    name: &'static str,
    title: &str,
    error: fn(&SmoothRow) -> f64,
    rate: fn(&SmoothRow) -> Option<f64>,
) -> Plot {
    let elements = distinct(rows.iter().map(|row| &row.element));
    let slope = |element: &String| {
        let fitted = rows.iter().filter(|row| row.element == *element).find_map(rate);
        fitted.map_or_else(|| element.clone(), |r| format!("{element}: slope {r:.2}"))
    };
    let mut points = Vec::new();
    let mut lines = Vec::new();
    for (series, element) in elements.iter().enumerate() {
        let mut of: Vec<&SmoothRow> = rows.iter().filter(|row| row.element == **element).collect();
        of.sort_by(|a, b| a.h.total_cmp(&b.h));
        let first = points.len();
        lines.push((first..first + of.len()).collect());
        for row in of {
            points.push(Point {
                x: row.h,
                y: error(row),
                worst: None,
                series,
                strong: true,
                label: None,
                tip: format!("{element}, h = {}: {}", Unit::Metres.text(row.h), relative(error(row))),
            });
        }
    }
    Plot {
        name,
        title: title.into(),
        note: "Grey triangles: the slopes that the theory promises.".into(),
        x: Scale {
            label: "h, cube root of the mean volume of a tetrahedron".into(),
            unit: Unit::Metres,
            logarithmic: true,
        },
        y: Scale {
            label: ["relative error in L2", "relative error in the energy norm"][norm].into(),
            unit: Unit::Ratio,
            logarithmic: true,
        },
        series: elements.iter().map(|element| slope(element)).collect(),
        triangles: triangles(rows, norm, error),
        points,
        lines,
        front: Vec::new(),
    }
}

/// One for every promised rate, below the lowest line that it is promised to.
fn triangles(rows: &[SmoothRow], norm: usize, error: fn(&SmoothRow) -> f64) -> Vec<Triangle> {
    let drawn = |row: &&SmoothRow| row.h > 0.0 && error(row) > 0.0;
    let rates = distinct(rows.iter().filter(drawn).map(|row| row.promised[norm]));
    let place = |rate: f64| {
        let here = || rows.iter().filter(drawn).filter(move |row| row.promised[norm] == rate);
        let (least, most) = here().fold((f64::INFINITY, 0.0_f64), |(a, b), row| (a.min(row.h), b.max(row.h)));
        // In the middle of the refinements, and as wide as 0.4 of them.
        let middle = (least * most).sqrt();
        let reach = (most / least).powf(0.2).max(1.15);
        let x = [middle / reach, middle * reach];
        let below = here().map(|row| error(row) * (x[1] / row.h).powf(rate)).fold(f64::INFINITY, f64::min);
        let y = 0.5 * below;
        let usable = x[0].is_normal() && x[1].is_finite() && y.is_normal();
        let left = y * (x[0] / x[1]).powf(rate);
        (usable && left.is_normal()).then_some(Triangle { x, y, rate })
    };
    rates.into_iter().filter_map(place).collect()
}
