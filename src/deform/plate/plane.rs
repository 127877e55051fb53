//! The view of a thin body: along its thinnest direction, over its smallest bounding rectangle, in cells.

use super::spline::Grid;
use nalgebra::{Matrix3, SymmetricEigen, Vector2, Vector3};

/// Cells that the body fills, about, and bounds of those along and across.
const CELLS: f64 = 60.0;
const FEWEST: usize = 3;
const MOST: usize = 24;
/// The narrowest cell, and where those beside a held region end, in usual ones.
const NARROW: f64 = 0.15;
const BESIDE: [f64; 2] = [0.2, 0.55];
const LEVELS: usize = 1 + BESIDE.len();
const MOST_CELLS: usize = 256;
/// Number of times, at most, that the cells are widened by a fifth while there are more than `MOST_CELLS`.
const WIDER: i32 = 12;

/// A rectangle around the body as it is seen along its thinnest direction: a corner, and the directions along it, across
/// it and through it as columns.
pub struct Plane {
    pub corner: Vector3<f64>,
    pub axes: Matrix3<f64>,
    pub size: Vector2<f64>,
    /// Area of the body in this view, m².
    pub area: f64,
}

impl Plane {
    pub fn around(nodes: &[Vector3<f64>], triangles: &[[Vector3<f64>; 3]]) -> Option<Plane> {
        let areas =
            || triangles.iter().map(|[a, b, c]| (0.5 * (b - a).cross(&(c - a)).norm(), (a + b + c) / 3.0));
        let area: f64 = areas().map(|(area, _)| area).sum();
        let centre = areas().map(|(area, middle)| middle * area).sum::<Vector3<f64>>() / area;
        if area.is_nan() || area <= 0.0 {
            return None;
        }
        // Exact for triangles: a quarter from the corners, three quarters from the middles.
        let mut spread = Matrix3::zeros();
        for ((area, middle), corners) in areas().zip(triangles) {
            let square = |x: &Vector3<f64>| (x - centre) * (x - centre).transpose();
            spread +=
                (corners.iter().map(square).sum::<Matrix3<f64>>() + square(&middle) * 9.0) * (area / 12.0);
        }
        let eigen = SymmetricEigen::new(spread);
        let through = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned().try_normalize(0.0)?;
        let aside = through.cross(&Vector3::ith(through.iamin(), 1.0)).try_normalize(0.0)?;
        let flat = [aside, through.cross(&aside)];
        let points: Vec<Vector2<f64>> = nodes
            .iter()
            .map(|x| Vector2::new((x - centre).dot(&flat[0]), (x - centre).dot(&flat[1])))
            .collect();
        let (direction, low, size) = smallest_rectangle(points)?;
        let along = flat[0] * direction.x + flat[1] * direction.y;
        let across = through.cross(&along);
        let corner = centre + along * low.x + across * low.y;
        let seen = |[a, b, c]: &[Vector3<f64>; 3]| 0.25 * (b - a).cross(&(c - a)).dot(&through).abs();
        let area = triangles.iter().map(seen).sum();
        Some(Plane { corner, axes: Matrix3::from_columns(&[along, across, through]), size, area })
    }
}

impl Plane {
    /// Cells as square as the numbers allow, which end where held regions do, and are narrow beside them. Where that would be
    /// too many, they are less so.
    pub fn grid(&self, held: &[Vec<Vector3<f64>>]) -> Grid {
        let of = |(level, wider): (usize, f64)| Grid {
            knots: [0, 1].map(|axis| self.knots(axis, held, level, wider)),
        };
        let fits = |grid: &Grid| grid.cells().iter().product::<usize>() <= MOST_CELLS;
        let fine = (1..=LEVELS).rev().map(|level| (level, 1.0));
        // A ring fills little of its rectangle.
        let wide = (0..WIDER).map(|k| (0, 1.2_f64.powi(k)));
        fine.chain(wide).map(of).find(fits).unwrap_or_else(|| of((0, 1.2_f64.powi(WIDER))))
    }

    /// Level 0 knows no held regions, 1 where they end, the others also narrow cells beside them.
    fn knots(&self, axis: usize, held: &[Vec<Vector3<f64>>], level: usize, wider: f64) -> Vec<f64> {
        let (size, direction) = (self.size[axis], self.axes.column(axis));
        let cell = wider * (self.area / CELLS).sqrt();
        let mut ends = vec![0.0, size];
        for nodes in held {
            let places = nodes.iter().map(|x| direction.dot(&(x - self.corner)));
            let (low, high) =
                places.fold((size, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
            for beside in [0.0, BESIDE[0], BESIDE[1]].into_iter().take(level) {
                for x in [low - beside * cell, high + beside * cell] {
                    let is_apart = ends.iter().all(|end| (end - x).abs() > NARROW * cell);
                    if x > 0.0 && x < size && is_apart {
                        ends.push(x);
                    }
                }
            }
        }
        ends.sort_by(f64::total_cmp);
        let longest = cell.max(size / MOST as f64).min(size / FEWEST as f64);
        let mut knots = vec![0.0];
        for pair in ends.windows(2) {
            let cells = ((pair[1] - pair[0]) / longest).round().max(1.0);
            knots.extend((1..=cells as usize).map(|k| pair[0] + (pair[1] - pair[0]) * k as f64 / cells));
        }
        knots
    }
}

/// The rectangle of least area around the points, one of whose sides lies along their hull: its longer direction, its corner and
/// its size.
fn smallest_rectangle(mut points: Vec<Vector2<f64>>) -> Option<(Vector2<f64>, Vector2<f64>, Vector2<f64>)> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = &Vector2<f64>>| {
        let mut hull: Vec<Vector2<f64>> = Vec::new();
        for point in points {
            while let [.., a, b] = hull[..] {
                if (b - a).perp(&(point - b)) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(*point);
        }
        hull
    };
    let mut hull = half(&mut points.iter());
    hull.extend(half(&mut points.iter().rev()));
    let extent = |direction: &Vector2<f64>| {
        let aside = Vector2::new(-direction.y, direction.x);
        let (mut low, mut high) = (Vector2::repeat(f64::MAX), Vector2::repeat(f64::MIN));
        for point in &hull {
            let seen = Vector2::new(point.dot(direction), point.dot(&aside));
            (low, high) = (low.inf(&seen), high.sup(&seen));
        }
        (low, high - low)
    };
    let sides = hull.windows(2).filter_map(|pair| (pair[1] - pair[0]).try_normalize(1e-12));
    let area = |direction: &Vector2<f64>| extent(direction).1.product();
    // The first of equal ones, which rounding alone tells apart.
    let best = sides.fold(None, |best: Option<(Vector2<f64>, f64)>, side| match best {
        Some((_, least)) if area(&side) >= least * (1.0 - 1e-6) => best,
        _ => Some((side, area(&side))),
    });
    let (mut direction, _) = best?;
    if extent(&direction).1.x < extent(&direction).1.y {
        direction = Vector2::new(-direction.y, direction.x);
    }
    let (low, size) = extent(&direction);
    (size.min() > 0.0).then_some((direction, low, size))
}
