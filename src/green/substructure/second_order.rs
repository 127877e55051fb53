//! Fields of first and second order in the coordinates of a part (columns for each coordinate, and for each pair of them);
//! the points of elements at which a part's strains are taken, with the numbers that the energy's terms need there; and
//! motions of frames to second order in their coordinates.

use crate::fem::{Lame, NodeFields};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// The pairs i ≤ j below `m`.
pub fn pairs(m: usize) -> Vec<(usize, usize)> {
    (0..m).flat_map(|i| (i..m).map(move |j| (i, j))).collect()
}

/// y with 1 added at each of these places.
pub fn unit(m: usize, ones: &[usize]) -> Vec<f64> {
    let mut y = vec![0.0; m];
    ones.iter().for_each(|&k| y[k] += 1.0);
    y
}

/// The vector of one node in one field.
pub fn get(fields: &NodeFields, node: u32, column: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| fields.row(3 * node as usize + axis)[column])
}

/// Writes it.
pub fn set(fields: &mut NodeFields, node: u32, column: usize, u: &Vector3<f64>) {
    for axis in 0..3 {
        fields.row_mut(3 * node as usize + axis)[column] = u[axis];
    }
}

/// u₁ and u₂ of a node at y.
pub fn sum_at(first: &NodeFields, second: &NodeFields, node: u32, y: &[f64]) -> Orders {
    let row =
        |fields: &NodeFields, axis: usize| -> Vec<f64> { fields.row(3 * node as usize + axis).to_vec() };
    let linear = |axis: usize, _| row(first, axis).iter().zip(y).map(|(u, y)| u * y).sum();
    let square = |axis: usize, _| {
        let mut at = second.row(3 * node as usize + axis).iter();
        let mut sum = 0.0;
        for i in 0..y.len() {
            for j in i..y.len() {
                let product = y[i] * y[j] * if i == j { 0.5 } else { 1.0 };
                sum += at.next().map_or(0.0, |w| w * product);
            }
        }
        sum
    };
    [Vector3::from_fn(linear), Vector3::from_fn(square)]
}

/// Every row of the fields times a matrix.
pub fn times(fields: &NodeFields, matrix: &DMatrix<f64>) -> NodeFields {
    let rows = nalgebra::DMatrixView::from_slice(&fields.data, fields.columns, 3 * fields.nodes);
    let product = matrix.transpose() * rows;
    NodeFields { nodes: fields.nodes, columns: matrix.ncols(), data: product.as_slice().to_vec() }
}

/// ∂²q/∂y_i∂y_j of values q that are quadratic in y, a column for each pair: by polarisation.
pub fn polarised(m: usize, q: impl Fn(&DVector<f64>) -> Vec<f64>) -> DMatrix<f64> {
    let at = |ones: &[usize]| DVector::from_vec(q(&DVector::from_vec(unit(m, ones))));
    let alone: Vec<DVector<f64>> = (0..m).map(|k| at(&[k])).collect();
    let rows = alone.first().map_or(0, DVector::len);
    let columns: Vec<DVector<f64>> = pairs(m)
        .into_iter()
        .map(|(i, j)| if i == j { &alone[i] * 2.0 } else { at(&[i, j]) - &alone[i] - &alone[j] })
        .collect();
    if columns.is_empty() { DMatrix::zeros(rows, 0) } else { DMatrix::from_columns(&columns) }
}

/// A point of an element at which strains are taken: a tetrahedron's centre, or a point of its quadrature.
pub struct StrainPoint {
    pub nodes: Vec<u32>,
    /// ∇N of these nodes, 1/m.
    pub gradients: Vec<Vector3<f64>>,
    /// m³.
    pub volume: f64,
    pub lame: Lame,
    /// Whether it belongs to the part itself, not to the surroundings.
    pub is_own: bool,
}

/// λ tr ε I + 2 μ ε of ε = sym H.
pub fn stress(lame: Lame, h: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * (lame.lambda * h.trace()) + (h + h.transpose()) * lame.mu
}

/// H = Σ (u_a - u_0) ⊗ G_a of every field at a point.
pub fn gradients(point: &StrainPoint, fields: &NodeFields) -> Vec<Matrix3<f64>> {
    let mut h = vec![Matrix3::zeros(); fields.columns];
    let Some((&base, others)) = point.nodes.split_first() else { return h };
    for (&node, gradient) in others.iter().zip(&point.gradients[1..]) {
        for axis in 0..3 {
            let (u, u0) = (fields.row(3 * node as usize + axis), fields.row(3 * base as usize + axis));
            for (h, (u, u0)) in h.iter_mut().zip(u.iter().zip(u0)) {
                for j in 0..3 {
                    h[(axis, j)] += (u - u0) * gradient[j];
                }
            }
        }
    }
    h
}

/// Rows of one point: stresses and strains of second order, a column for each pair, then H_iσ_j + H_jσ_i and ∇w.
pub struct QuarticRows {
    left: DMatrix<f64>,
    right: DMatrix<f64>,
}

impl QuarticRows {
    pub fn new(pairs: usize) -> QuarticRows {
        QuarticRows { left: DMatrix::zeros(18, pairs), right: DMatrix::zeros(18, pairs) }
    }

    pub fn set(
        &mut self,
        pair: usize,
        stress: &Matrix3<f64>,
        strain: &Matrix3<f64>,
        turned: &Matrix3<f64>,
        w: &Matrix3<f64>,
    ) {
        let strain = (strain + strain.transpose()) * 0.5;
        let put = |to: &mut DMatrix<f64>, first: &Matrix3<f64>, last: &Matrix3<f64>| {
            let values = first.iter().chain(last.iter());
            to.column_mut(pair).iter_mut().zip(values).for_each(|(to, value)| *to = *value);
        };
        put(&mut self.left, stress, turned);
        put(&mut self.right, &strain, w);
    }

    pub fn add_to(&self, sum: &mut DMatrix<f64>) {
        sum.gemm_tr(1.0, &self.left, &self.right, 1.0);
    }
}

/// A value's part of first order, and that of second.
pub type Orders = [Vector3<f64>; 2];

/// Motion of a frame, rotation R = exp ŵ and shift t, as w = w₁ + w₂ and t = t₁ + t₂ by their order. The screw between two
/// frames and the frame midway follow to the same order from
///
/// ```text
/// log(Rₐᵀ R_b) = w_b - wₐ - ½ wₐ × w_b + …    V(ω)⁻¹ = I - ½ ω̂ + ω̂²/12 + …
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameSeries {
    pub turn: Orders,
    pub shift: Orders,
}

impl FrameSeries {
    /// A frame at `place` about the pole of a screw (ω, d): it turns by ω, and comes to V(ω) (place + d).
    pub fn of_screw(turn: Vector3<f64>, slide: Vector3<f64>, place: Vector3<f64>) -> FrameSeries {
        let bend = turn.cross(&place);
        FrameSeries {
            turn: [turn, Vector3::zeros()],
            shift: [slide + bend * 0.5, turn.cross(&slide) * 0.5 + turn.cross(&bend) / 6.0],
        }
    }

    /// The displacement of a point at `offset` y from the frame's place, which is also stretched: exp ŵ (I + s) y - y + t.
    pub fn displacement(&self, offset: &Vector3<f64>, stretch: &Matrix3<f64>) -> Orders {
        let ([w1, w2], stretched) = (self.turn, stretch * offset);
        let first = w1.cross(offset);
        [
            self.shift[0] + first + stretched,
            self.shift[1] + w2.cross(offset) + w1.cross(&first) * 0.5 + w1.cross(&stretched),
        ]
    }

    /// The screw from `self` to `other`, which lies at `rest` D from it at rest: ω of RᵀR', and d of V(ω) (D + d), in
    /// the axes of `self`.
    pub fn screw_to(&self, other: &FrameSeries, rest: &Vector3<f64>) -> (Orders, Orders) {
        let ([a1, a2], [b1, b2]) = (self.turn, other.turn);
        let turn = [b1 - a1, b2 - a2 - a1.cross(&b1) * 0.5];
        let [e1, e2] = [other.shift[0] - self.shift[0], other.shift[1] - self.shift[1]];
        let seen = e1 - a1.cross(rest);
        let bend = turn[0].cross(rest);
        let slide = [
            seen - bend * 0.5,
            e2 - a2.cross(rest) - a1.cross(&e1) + a1.cross(&a1.cross(rest)) * 0.5
                - turn[1].cross(rest) * 0.5
                - turn[0].cross(&seen) * 0.5
                + turn[0].cross(&bend) / 12.0,
        ];
        (turn, slide)
    }

    /// The frame midway on the screw to `other`; its shift is from the middle between the two at rest.
    pub fn midway(&self, other: &FrameSeries, rest: &Vector3<f64>) -> FrameSeries {
        let ([w1, w2], [d1, d2]) = self.screw_to(other, rest);
        let ([a1, a2], [b1, b2]) = (self.turn, other.turn);
        // Rₐ V(ω/2) = I + M₁ + M₂.
        let first = (a1 + w1 * 0.25).cross_matrix();
        let second = (a2 + w2 * 0.25).cross_matrix()
            + a1.cross_matrix() * a1.cross_matrix() * 0.5
            + w1.cross_matrix() * w1.cross_matrix() / 24.0
            + a1.cross_matrix() * w1.cross_matrix() * 0.25;
        FrameSeries {
            turn: [(a1 + b1) * 0.5, (a2 + b2) * 0.5],
            shift: [
                self.shift[0] + (d1 + first * rest) * 0.5,
                self.shift[1] + (d2 + first * d1 + second * rest) * 0.5,
            ],
        }
    }

    /// A point's displacement as the frame sees it: Rᵀ(x - t) - X of a point at X from where the frame rested.
    pub fn seen(&self, from_place: &Vector3<f64>, [u1, u2]: Orders) -> Orders {
        let ([w1, w2], relative) = (self.turn, u1 - self.shift[0]);
        let turned = w1.cross(from_place);
        [
            relative - turned,
            u2 - self.shift[1] - w2.cross(from_place) - w1.cross(&relative) + w1.cross(&turned) * 0.5,
        ]
    }
}

/// Fit of a frame to moved points: their offsets y from their centroid at rest, and (tr J I - J)⁻¹ of J = Σ y yᵀ.
#[derive(Clone, Debug)]
pub struct FrameFit {
    offsets: Vec<Vector3<f64>>,
    inverse: Matrix3<f64>,
}

impl FrameFit {
    /// `None` where the points lie on a line, about which a turn would not be seen.
    pub fn new(offsets: Vec<Vector3<f64>>) -> Option<FrameFit> {
        let inertia: Matrix3<f64> =
            offsets.iter().map(|y| Matrix3::identity() * y.norm_squared() - y * y.transpose()).sum();
        let eigenvalues = inertia.symmetric_eigenvalues();
        if eigenvalues.min() <= 1e-9 * eigenvalues.max() {
            return None;
        }
        inertia.try_inverse().map(|inverse| FrameFit { offsets, inverse })
    }

    /// The frame of the points displaced by `u`: the mean shift, and R the polar factor of Σ (y + u) yᵀ.
    pub fn fit(&self, u: &[Orders]) -> FrameSeries {
        let mean = |order: usize| {
            u.iter().map(|u| u[order]).sum::<Vector3<f64>>() / self.offsets.len().max(1) as f64
        };
        let moment = |order: usize| -> Matrix3<f64> {
            u.iter().zip(&self.offsets).map(|(u, y)| u[order] * y.transpose()).sum()
        };
        let (a1, a2) = (moment(0), moment(1));
        let j: Matrix3<f64> = self.offsets.iter().map(|y| y * y.transpose()).sum();
        let w1 = self.inverse * axial(&a1);
        let cross = w1.cross_matrix();
        let w2 = self.inverse * axial(&(a2 - cross * a1 + cross * cross * j * 0.5));
        FrameSeries { turn: [w1, w2], shift: [mean(0), mean(1)] }
    }
}

/// (A₃₂ - A₂₃, A₁₃ - A₃₁, A₂₁ - A₁₂): (tr J I - J) w of A = ŵ J with a symmetric J.
fn axial(a: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(a[(2, 1)] - a[(1, 2)], a[(0, 2)] - a[(2, 0)], a[(1, 0)] - a[(0, 1)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::slide::slide_matrix;
    use nalgebra::Rotation3;

    fn v(x: f64, y: f64, z: f64) -> Vector3<f64> {
        Vector3::new(x, y, z)
    }

    fn at(scale: f64, of: &Orders) -> Vector3<f64> {
        of[0] * scale + of[1] * (scale * scale)
    }

    /// All series against the exact motions: what is left is of third order.
    #[test]
    fn series_are_exact_to_second_order() {
        let a = FrameSeries {
            turn: [v(0.3, -0.2, 0.5), v(0.1, 0.4, -0.2)],
            shift: [v(0.2, 0.1, -0.3), v(-0.1, 0.3, 0.2)],
        };
        let b = FrameSeries {
            turn: [v(-0.6, 0.1, 0.2), v(0.3, -0.1, 0.2)],
            shift: [v(0.1, -0.4, 0.2), v(0.2, 0.1, 0.1)],
        };
        let rest = v(1.0, 0.5, -0.7);
        let (turn, slide) = a.screw_to(&b, &rest);
        let mid = a.midway(&b, &rest);
        let (x, u): (_, Orders) = (v(0.3, 0.7, 0.2), [v(0.1, 0.2, -0.4), v(0.3, 0.1, 0.2)]);
        let points: Vec<_> =
            [v(1.0, 0.0, 0.1), v(-1.0, 0.3, 0.0), v(0.0, 1.0, 0.0), v(0.0, -1.3, -0.1)].to_vec();
        let fit = FrameFit::new(points.clone()).unwrap();
        let moved: Vec<Orders> = points.iter().map(|y| [y.yzx() * 0.5 + v(0.2, 0.1, 0.0), y.zyx()]).collect();
        let frame = fit.fit(&moved);
        let error = |e: f64| {
            let r = |o: &Orders| Rotation3::from_scaled_axis(at(e, o));
            let (ra, rb) = (r(&a.turn), r(&b.turn));
            let exact = (ra.inverse() * rb).scaled_axis();
            let chord = ra.inverse() * (rest + at(e, &b.shift) - at(e, &a.shift));
            let v_exact = slide_matrix(&exact).try_inverse().unwrap() * chord;
            let half = exact * 0.5;
            let mid_turn = (ra * Rotation3::from_scaled_axis(half)).scaled_axis();
            let mid_place = at(e, &a.shift) + ra * (slide_matrix(&half) * v_exact * 0.5) - rest * 0.5;
            let r_mid = r(&mid.turn);
            let seen = r_mid.inverse() * (x + at(e, &u) - at(e, &mid.shift)) - x;
            let sum: Matrix3<f64> =
                points.iter().zip(&moved).map(|(y, u)| (y + at(e, u)) * y.transpose()).sum();
            let polar = crate::fem::nearest_turn(&sum).scaled_axis();
            [
                (at(e, &turn) - exact).norm(),
                (at(e, &slide) + rest - v_exact).norm(),
                (at(e, &mid.turn) - mid_turn).norm(),
                (at(e, &mid.shift) - mid_place).norm(),
                (at(e, &mid.seen(&x, u)) - seen).norm(),
                (at(e, &frame.turn) - polar).norm(),
            ]
        };
        let (coarse, fine) = (error(2e-2), error(1e-2));
        for (coarse, fine) in coarse.iter().zip(fine) {
            assert!(*coarse < 1e-4 && coarse / fine > 7.0, "{coarse:e} {fine:e}");
        }
    }
}
