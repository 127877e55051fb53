//! The middle surface of a thin body.
//!
//! In: the body's surface at rest. Out: a spline surface half-way between its two faces, places of integration with the thickness
//! there, and the positions of nodes against it. The body is looked at along its thinnest direction: rays on a fine grid over its
//! smallest bounding rectangle meet each face once. A body that is not thin, or lies over itself, is refused.

use super::spline::Grid;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, SymmetricEigen, Vector2, Vector3};

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

/// Rays along each side of a cell; an even number.
pub const RAYS: usize = 16;
/// Normals of opposite faces have a larger product, whatever their signs.
const OPPOSITE: f64 = 0.8;

/// Heights at which a ray enters and leaves the body.
#[derive(Clone, Copy)]
pub struct Faces {
    pub low: f64,
    pub high: f64,
    /// Whether the faces stand one behind the other, so that neither is a side wall.
    pub are_opposite: bool,
}

/// Findings of the rays along the thinnest direction: the heights of both faces, where they meet the body.
pub struct Rays {
    places: [Vec<f64>; 2],
    pub faces: Vec<Option<Faces>>,
    /// Rays that meet more than two faces.
    pub folded: usize,
}

/// Rays of a quarter of a cell.
pub struct Quarter {
    pub inside: usize,
    pub outside: usize,
    /// Their mean places.
    pub place_inside: [f64; 2],
    pub place_outside: [f64; 2],
    /// The mean height between faces that are opposite, and how many rays of that height the others amount to: at a slanted
    /// border a ray meets a part of the thickness.
    pub height: f64,
    pub filled: f64,
}

impl Rays {
    pub fn cast(plane: &Plane, grid: &Grid, triangles: &[[Vector3<f64>; 3]]) -> Rays {
        let places = [0, 1].map(|axis| {
            let rays = |pair: &[f64]| {
                let (from, step) = (pair[0], (pair[1] - pair[0]) / RAYS as f64);
                (0..RAYS).map(move |k| from + (k as f64 + 0.5 + ASIDE[axis]) * step)
            };
            grid.knots[axis].windows(2).flat_map(rays).collect::<Vec<f64>>()
        });
        let mut met: Vec<Vec<(f64, Vector3<f64>)>> = vec![Vec::new(); places[0].len() * places[1].len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|x| plane.axes.transpose() * (x - plane.corner));
            let whole = (b - a).xy().perp(&(c - a).xy());
            if whole == 0.0 {
                continue;
            }
            let normal = (b - a).cross(&(c - a)).normalize();
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            let range = |axis: usize| {
                let before = |x: f64| places[axis].partition_point(|place| *place < x);
                before(low[axis])..before(high[axis])
            };
            for i in range(0) {
                for j in range(1) {
                    let ray = Vector2::new(places[0][i], places[1][j]);
                    let part = |from: &Vector3<f64>, to: &Vector3<f64>| {
                        (to.xy() - from.xy()).perp(&(ray - from.xy())) / whole
                    };
                    let shares = [part(&b, &c), part(&c, &a), part(&a, &b)];
                    if shares.iter().all(|share| *share >= 0.0) {
                        let height = a.z * shares[0] + b.z * shares[1] + c.z * shares[2];
                        met[i * places[1].len() + j].push((height, normal));
                    }
                }
            }
        }
        let folded = met.iter().filter(|heights| heights.len() > 2).count();
        let faces = met.into_iter().map(|heights| match heights[..] {
            [(a, one), (b, other)] => {
                Some(Faces { low: a.min(b), high: a.max(b), are_opposite: one.dot(&other).abs() > OPPOSITE })
            }
            _ => None,
        });
        Rays { faces: faces.collect(), places, folded }
    }

    pub fn place(&self, ray: usize) -> [f64; 2] {
        let across = self.places[1].len();
        [self.places[0][ray / across], self.places[1][ray % across]]
    }

    pub fn quarter(&self, corner: [usize; 2], quarter: usize) -> Quarter {
        let half = RAYS / 2;
        let (first_i, first_j) =
            (corner[0] * RAYS + quarter / 2 * half, corner[1] * RAYS + quarter % 2 * half);
        let (mut inside, mut outside) = (Vec::new(), Vec::new());
        for k in 0..half * half {
            let ray = (first_i + k / half) * self.places[1].len() + first_j + k % half;
            match self.faces[ray] {
                Some(faces) => inside.push((self.place(ray), faces)),
                None => outside.push(self.place(ray)),
            }
        }
        let heights = |faces: &Faces| faces.high - faces.low;
        let (opposite, sum) = inside
            .iter()
            .filter(|(_, faces)| faces.are_opposite)
            .fold((0.0, 0.0), |(count, sum), (_, faces)| (count + 1.0, sum + heights(faces)));
        let height = if opposite > 0.0 { sum / opposite } else { 0.0 };
        let whole: f64 = inside.iter().map(|(_, faces)| heights(faces)).sum();
        let places: Vec<[f64; 2]> = inside.iter().map(|(place, _)| *place).collect();
        Quarter {
            inside: inside.len(),
            outside: outside.len(),
            place_inside: mean(&places),
            place_outside: mean(&outside),
            height,
            filled: if height > 0.0 { whole / height } else { inside.len() as f64 },
        }
    }
}

fn mean(places: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / places.len().max(1) as f64)
}

/// Rays stand a little aside of where edges of a regular mesh are, in parts of their distance.
const ASIDE: [f64; 2] = [0.003_141_59, 0.002_718_28];

/// A body is thin up to this part of its width.
const THIN: f64 = 0.2;
/// Rays through a fold, of all that meet the body, and the height that the splines leave, in thicknesses.
const FOLDED: f64 = 0.01;
const CRUMPLED: f64 = 0.25;
/// Share of material with which cells without any are filled, so that all control points are held.
const FILLING: f64 = 1e-4;

/// A place of integration in a part of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    pub place: [f64; 2],
    /// Area as seen along the thinnest direction, m², times the share of the material's stiffness that is there.
    pub seen: f64,
    pub thickness: f64,
}

/// A spline surface in the middle of a body.
pub struct Middle {
    pub grid: Grid,
    pub rest: Vec<Vector3<f64>>,
    pub parts: Vec<Part>,
    /// Mean, m.
    pub thickness: f64,
    plane: Plane,
}

impl Middle {
    /// `held`: the nodes of each control element; cells end where held regions do.
    pub fn new(
        nodes: &[Vector3<f64>],
        triangles: &[[u32; 3]],
        held: &[Vec<Vector3<f64>>],
    ) -> Result<Middle, String> {
        let corners = |triangle: &[u32; 3]| -> Option<[Vector3<f64>; 3]> {
            let [a, b, c] = triangle.map(|node| nodes.get(node as usize).copied());
            Some([a?, b?, c?])
        };
        let triangles: Vec<[Vector3<f64>; 3]> = triangles.iter().filter_map(corners).collect();
        let plane = Plane::around(nodes, &triangles).ok_or("its surface has no area")?;
        let grid = plane.grid(held);
        let rays = Rays::cast(&plane, &grid, &triangles);
        let met = rays.faces.iter().flatten().count();
        if met == 0 || rays.folded as f64 > FOLDED * (met + rays.folded) as f64 {
            return Err(format!(
                "seen along its thinnest direction, {:.1} % of it lies over itself (at most {:.0} %)",
                100.0 * rays.folded as f64 / (met + rays.folded).max(1) as f64,
                100.0 * FOLDED
            ));
        }
        let cells = grid.cells();
        let mut middle = Middle { grid, rest: Vec::new(), parts: Vec::new(), thickness: 0.0, plane };
        let left = middle.fit_heights(&rays);
        middle.find_parts(&rays);
        let width = middle.plane.size.y;
        let (thickness, [along, across]) = (middle.thickness, cells);
        if thickness.is_nan() {
            return Err("no line across its thinnest direction meets it between the control elements".into());
        }
        if thickness > THIN * width {
            return Err(format!(
                "it is {thickness:.3e} m thick and {width:.3e} m wide, 1 : {:.1}; a plate is 1 : {:.0} at least",
                width / thickness,
                1.0 / THIN
            ));
        }
        if left > CRUMPLED * thickness {
            return Err(format!(
                "its middle surface is off by {left:.3e} m from a smooth one of {along} × {across} cells, \
                 {:.2} of its thickness (at most {CRUMPLED})",
                left / thickness
            ));
        }
        Ok(middle)
    }

    /// The control points' heights, by least squares; returns the root mean square of what is left.
    fn fit_heights(&mut self, rays: &Rays) -> f64 {
        let (grid, count) = (&self.grid, self.grid.nodes());
        let (mut a, mut b) = (DMatrix::zeros(count, count), DVector::zeros(count));
        let heights = || {
            let height = |(ray, faces): (usize, &Option<Faces>)| {
                let faces = faces.filter(|faces| faces.are_opposite)?;
                Some((rays.place(ray), 0.5 * (faces.low + faces.high)))
            };
            rays.faces.iter().enumerate().filter_map(height)
        };
        for (place, height) in heights() {
            let shape = grid.at(place);
            for i in 0..9 {
                b[shape.nodes[i]] += shape.value[i] * height;
                for j in 0..9 {
                    a[(shape.nodes[i], shape.nodes[j])] += shape.value[i] * shape.value[j];
                }
            }
        }
        // Second differences are kept small, which tells the heights of control points that no ray reaches.
        let across = grid.cells()[1] + 2;
        let mut smooth = |nodes: [usize; 3]| {
            for (i, x) in nodes.into_iter().zip([1.0, -2.0, 1.0]) {
                for (j, y) in nodes.into_iter().zip([1.0, -2.0, 1.0]) {
                    a[(i, j)] += 1e-4 * x * y;
                }
            }
        };
        for node in 0..count {
            if node % across + 2 < across {
                smooth([node, node + 1, node + 2]);
            }
            if node + 2 * across < count {
                smooth([node, node + across, node + 2 * across]);
            }
        }
        let heights_of_nodes = a.cholesky().map_or_else(|| DVector::zeros(count), |factor| factor.solve(&b));
        let place = |node: usize| {
            let [x, y] = grid.place_of(node);
            self.plane.corner + self.plane.axes * Vector3::new(x, y, heights_of_nodes[node])
        };
        self.rest = (0..count).map(place).collect();
        let (mut sum, mut met) = (0.0, 0.0);
        for (place, height) in heights() {
            let shape = grid.at(place);
            let found: f64 = (0..9).map(|k| heights_of_nodes[shape.nodes[k]] * shape.value[k]).sum();
            sum += (found - height).powi(2);
            met += 1.0;
        }
        f64::sqrt(sum / f64::max(met, 1.0))
    }

    /// Four places in each cell: Gauss's, where it is full of material, and else the middle of each quarter's.
    fn find_parts(&mut self, rays: &Rays) {
        let gauss = 0.5 / 3f64.sqrt();
        let (mut volume, mut area) = (0.0, 0.0);
        let mut empty = Vec::new();
        let [along, across] = self.grid.cells();
        for corner in (0..along * across).map(|cell| [cell / across, cell % across]) {
            let quarters = [0, 1, 2, 3].map(|quarter| rays.quarter(corner, quarter));
            let is_full = quarters.iter().all(|quarter| quarter.outside == 0);
            let from_to =
                |axis: usize| (self.grid.knots[axis][corner[axis]], self.grid.knots[axis][corner[axis] + 1]);
            let cell: f64 = [0, 1].map(|axis| from_to(axis).1 - from_to(axis).0).iter().product();
            for (k, quarter) in quarters.iter().enumerate() {
                let of_ray = cell / (RAYS * RAYS) as f64;
                if quarter.inside > 0 {
                    let whole = [0, 1].map(|axis| {
                        let (from, to) = from_to(axis);
                        let side = if [k / 2, k % 2][axis] == 0 { -gauss } else { gauss };
                        from + (0.5 + side) * (to - from)
                    });
                    let place = if is_full { whole } else { quarter.place_inside };
                    let [x, y] = self.grid.at(place).tangents(&self.rest);
                    let slant = x.cross(&y);
                    let upright = slant.dot(&self.plane.axes.column(2)) / slant.norm();
                    let (seen, thickness) = (quarter.filled * of_ray, quarter.height * upright.abs());
                    if thickness > 0.0 {
                        volume += seen * slant.norm() * thickness;
                        area += seen * slant.norm();
                    }
                    self.parts.push(Part { place, seen, thickness });
                }
                if quarter.outside > 0 {
                    let seen = quarter.outside as f64 * of_ray * FILLING;
                    empty.push(Part { place: quarter.place_outside, seen, thickness: 0.0 });
                }
            }
        }
        self.thickness = volume / area;
        self.parts.extend(empty);
        for part in self.parts.iter_mut().filter(|part| part.thickness == 0.0) {
            part.thickness = self.thickness;
        }
    }

    /// The place of the middle surface that is nearest to x.
    pub fn place_of(&self, x: &Vector3<f64>) -> [f64; 2] {
        let flat = self.plane.axes.transpose() * (x - self.plane.corner);
        let inside = |place: [f64; 2]| [0, 1].map(|k| place[k].clamp(0.0, self.plane.size[k]));
        let mut place = inside([flat.x, flat.y]);
        for _ in 0..4 {
            let shape = self.grid.at(place);
            let [by_x, by_y] = shape.tangents(&self.rest);
            let off = x - shape.point(&self.rest);
            let metric =
                Matrix2::new(by_x.norm_squared(), by_x.dot(&by_y), by_x.dot(&by_y), by_y.norm_squared());
            let Some(step) = metric.lu().solve(&Vector2::new(by_x.dot(&off), by_y.dot(&off))) else { break };
            place = inside([place[0] + step.x, place[1] + step.y]);
        }
        place
    }

    /// The unit normal of the middle surface at a place.
    pub fn normal(&self, place: [f64; 2]) -> Vector3<f64> {
        let [x, y] = self.grid.at(place).tangents(&self.rest);
        x.cross(&y).normalize()
    }

    /// The thinnest direction of the whole.
    pub fn through(&self) -> Vector3<f64> {
        self.plane.axes.column(2).into_owned()
    }
}
