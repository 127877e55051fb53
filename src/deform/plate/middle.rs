//! The middle surface of a thin body.
//!
//! In: the body's surface at rest. Out: a spline surface half-way between its two faces, places of integration with the thickness
//! there, and the positions of nodes against it. The body is looked at along its thinnest direction: rays on a fine grid over its
//! smallest bounding rectangle meet each face once. A body that is not thin, or lies over itself, is refused.

use super::plane::Plane;
use super::rays::{Faces, RAYS, Rays};
use super::spline::Grid;
use nalgebra::{DMatrix, DVector, Matrix2, Vector2, Vector3};

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
    pub fn of(
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
