//! Quadratic B-splines on a grid of cells, open at its ends (de Boor, A Practical Guide to Splines, chapter IX).
//!
//! In: where the cells begin and end along two axes, and a place (x, y). Out: the nine control points that stand there, with
//! the values of their splines and the first and second derivatives by x and y. A function of these splines has continuous
//! slopes, its second derivatives jump at the knots, and its first and last row of control points lie on its border.

use nalgebra::Vector3;

/// A grid of n × m cells with (n + 2) × (m + 2) control points, those along the second axis side by side.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Ends of the cells in growing order: n + 1 and m + 1 numbers, two at least.
    pub knots: [Vec<f64>; 2],
}

/// The nine splines of a cell at a place, with their derivatives, control point after control point.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    pub nodes: [usize; 9],
    pub value: [f64; 9],
    /// Derivatives by x and by y.
    pub slope: [[f64; 2]; 9],
    /// Second derivatives by xx, yy and xy.
    pub second: [[f64; 3]; 9],
}

impl Grid {
    /// Cells of length 1.
    #[cfg(test)]
    pub fn even(cells: [usize; 2]) -> Grid {
        Grid { knots: cells.map(|cells| (0..=cells).map(|k| k as f64).collect()) }
    }

    pub fn cells(&self) -> [usize; 2] {
        [0, 1].map(|axis| self.knots[axis].len().saturating_sub(1))
    }

    pub fn nodes(&self) -> usize {
        let [along, across] = self.cells();
        (along + 2) * (across + 2)
    }

    /// The largest difference of the numbers of two control points that share a cell.
    pub fn reach(&self) -> usize {
        2 * (self.cells()[1] + 2) + 2
    }

    /// The cell at x along an axis; the first or the last one outside the grid.
    pub fn cell_at(&self, axis: usize, x: f64) -> usize {
        let inner = self.knots[axis].get(1..self.cells()[axis]).unwrap_or_default();
        inner.partition_point(|knot| *knot <= x)
    }

    /// The place where the control point `node` moves a linear function: the mean of its inner knots.
    pub fn place_of(&self, node: usize) -> [f64; 2] {
        let across = self.cells()[1] + 2;
        [0, 1].map(|axis| {
            let at = if axis == 0 { node / across } else { node % across };
            let knot = |k: usize| self.knots[axis][k.saturating_sub(2).min(self.cells()[axis])];
            0.5 * (knot(at + 1) + knot(at + 2))
        })
    }

    /// The splines at a place; outside the grid, those of the nearest cell go on as polynomials.
    pub fn at(&self, place: [f64; 2]) -> Shape {
        let [(first_x, x), (first_y, y)] = [0, 1].map(|axis| self.along(axis, place[axis]));
        let across = self.cells()[1] + 2;
        let each = |k: usize| (x[k / 3], y[k % 3]);
        Shape {
            nodes: std::array::from_fn(|k| (first_x + k / 3) * across + first_y + k % 3),
            value: std::array::from_fn(|k| each(k).0[0] * each(k).1[0]),
            slope: std::array::from_fn(|k| [each(k).0[1] * each(k).1[0], each(k).0[0] * each(k).1[1]]),
            second: std::array::from_fn(|k| {
                let (x, y) = each(k);
                [x[2] * y[0], x[0] * y[2], x[1] * y[1]]
            }),
        }
    }

    /// The first of the three splines at x, and value, slope and second derivative of each.
    fn along(&self, axis: usize, x: f64) -> (usize, [[f64; 3]; 3]) {
        let (knots, cells, cell) = (&self.knots[axis], self.cells()[axis], self.cell_at(axis, x));
        // Knots of the cell: one before it, its own two, one behind it.
        let (low, high) = (knots[cell], knots[cell + 1]);
        let (before, after) = (knots[cell.saturating_sub(1)], knots[(cell + 2).min(cells)]);
        let (wide, narrow) = (1.0 / ((high - before) * (high - low)), 1.0 / ((after - low) * (high - low)));
        let (to, from) = (high - x, x - low);
        let last = [from * from * narrow, 2.0 * from * narrow, 2.0 * narrow];
        let first = [to * to * wide, -2.0 * to * wide, 2.0 * wide];
        let middle = [1.0 - first[0] - last[0], -first[1] - last[1], -first[2] - last[2]];
        (cell, [first, middle, last])
    }
}

impl Shape {
    pub fn point(&self, of: &[Vector3<f64>]) -> Vector3<f64> {
        (0..9).map(|k| of[self.nodes[k]] * self.value[k]).sum()
    }

    /// The tangents along x and y.
    pub fn tangents(&self, of: &[Vector3<f64>]) -> [Vector3<f64>; 2] {
        [0, 1].map(|axis| (0..9).map(|k| of[self.nodes[k]] * self.slope[k][axis]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Splines reproduce a quadratic function with its derivatives, and x from the control points' own places.
    #[test]
    fn derivatives_are_those_of_the_values_and_linear_functions_come_back() {
        let grid = Grid { knots: [vec![0.0, 1.0, 1.7, 3.2, 4.0], vec![0.0, 0.4, 2.0, 3.0]] };
        let wave = |node: usize| Vector3::new((1.7 * node as f64).sin(), (0.6 * node as f64).cos(), 0.0);
        let of: Vec<_> = (0..grid.nodes()).map(wave).collect();
        let places: Vec<_> = (0..grid.nodes())
            .map(|node| Vector3::new(grid.place_of(node)[0], grid.place_of(node)[1], 0.0))
            .collect();
        let step = 1e-4;
        for place in [[0.0, 0.0], [0.3, 2.7], [1.5, 0.2], [3.9, 1.1], [4.0, 3.0]] {
            let shape = grid.at(place);
            let found = shape.point(&places);
            assert!((found - Vector3::new(place[0], place[1], 0.0)).amax() < 1e-14, "{found}");
            // Of the polynomials of this cell.
            let inside = place
                .map(|x: f64| if x.fract() == 0.0 { if x == 0.0 { x + 0.01 } else { x - 0.01 } } else { x });
            let shape = grid.at(inside);
            let at = |by: [f64; 2]| grid.at([inside[0] + by[0], inside[1] + by[1]]).point(&of);
            let second =
                |k: usize| (0..9).map(|i| of[shape.nodes[i]] * shape.second[i][k]).sum::<Vector3<f64>>();
            let along = |x: f64, y: f64| (at([x, y]) - at([-x, -y])) / (2.0 * step);
            let bent = |x: f64, y: f64| (at([x, y]) + at([-x, -y]) - at([0.0, 0.0]) * 2.0) / (step * step);
            let [by_x, by_y] = shape.tangents(&of);
            assert!((by_x - along(step, 0.0)).amax() < 1e-7 && (by_y - along(0.0, step)).amax() < 1e-7);
            let mixed = (bent(step, step) - bent(step, -step)) / 4.0;
            for (k, expected) in [bent(step, 0.0), bent(0.0, step), mixed].into_iter().enumerate() {
                assert!((second(k) - expected).amax() < 1e-5, "{place:?} {k}: {} {expected}", second(k));
            }
        }
    }
}
