//! The energy of the neo-Hookean law beyond the quartic of St. Venant–Kirchhoff's, summed over a few points of the body.
//!
//! In: the table of the points, and z. Out, with the energy density d = ψ_NH - ψ_SVK at each point's gradient,
//!
//! ```text
//! H = Σ_k z_k H_k      V' = Σ w d(H)      ∂V'/∂z_k = Σ w ∂d/∂F : H_k      ∂²V'/∂z_i∂z_k = Σ w H_i : ∂²d/∂F² : H_k
//! ```
//!
//! (S. An, T. Kim, D. James, ACM Transactions on Graphics 27(5), 2008, 165, who sum the whole energy so.) Up to ν = 1/3 d is of third
//! order in the strain, so that small strains are as exact as the quartic; beyond, what λ is above 2 μ is summed here too
//! ([`lame_of_stvk`](crate::fem::lame_of_stvk)). Where a stretch is long d is below 0, with the fourth power of it, and
//! a weight stands for many points: lest V' fall without limit, d goes on as φ(d) below what it was in any state that the weights serve,
//! -D:
//!
//! ```text
//! φ(d) = d for d ≥ -D      φ(d) = -2 D + D exp(1 + d/D) below
//! ```
//!
//! A body that warmth makes s times as large has s³ d(F/s). Allocates nothing once it is made.

use super::quartic::SIDE;
use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::{Lame, Tangent, energy_beyond_stvk, stress_beyond_stvk, tangent_beyond_stvk};
use crate::green::CUBATURE_HEAD as HEAD;
use nalgebra::{Const, DMatrix, Matrix3};

/// Entries of a gradient.
const ENTRIES: usize = 9;
/// Parts in which the second derivatives are summed.
const PARTS: usize = 6;

/// A point of the body with its share of the volume.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// m³.
    weight: f64,
    lame: Lame,
    /// D, J/m³.
    depth: f64,
}

impl Point {
    /// φ(d) with its first and second derivative.
    #[inline(always)]
    fn limited(&self, energy: f64) -> [f64; 3] {
        if energy >= -self.depth {
            return [energy, 1.0, 0.0];
        }
        let slope = (1.0 + energy / self.depth).exp();
        [self.depth * (slope - 2.0), slope, slope / self.depth]
    }

    /// ∂²φ(d)/∂F².
    #[inline(always)]
    fn tangent(&self, h: &Matrix3<f64>) -> Tangent {
        let [_, slope, curvature] = self.limited(energy_beyond_stvk(h, self.lame));
        let tangent = tangent_beyond_stvk(h, self.lame) * slope;
        if curvature == 0.0 {
            return tangent;
        }
        let stress = stress_beyond_stvk(h, self.lame).reshape_generic(Const::<9>, Const::<1>);
        tangent + stress * stress.transpose() * curvature
    }
}

pub struct Cubature {
    points: Vec<Point>,
    /// Entries of the H_k of a point over k, nine rows of `width` numbers for each point.
    gradients: Vec<f64>,
    width: usize,
    /// w ∂d/∂F of each point where the slopes were asked last.
    stresses: Vec<Matrix3<f64>>,
    /// z, padded.
    z: Vec<f64>,
    second: Second,
}

/// Second derivatives while they are made: their lower triangle, row by row of `width` numbers.
struct Second {
    sums: Vec<f64>,
    z: Vec<f64>,
    products: Vec<f64>,
    /// Points that are in the sums; `None` before the first.
    done: Option<usize>,
}

impl Cubature {
    /// The points of a table for `variables` z; `None` where it does not suit them. Without a table there are no points.
    pub fn new(variables: usize, table: Option<&DMatrix<f64>>) -> Option<Cubature> {
        let width = variables.next_multiple_of(SIDE);
        let (mut points, mut gradients) = (Vec::new(), Vec::new());
        for column in table.iter().flat_map(|table| table.column_iter()) {
            if column.len() != HEAD + ENTRIES * (variables - 1) {
                return None;
            }
            let lame = Lame { lambda: column[1], mu: column[2] };
            points.push(Point { weight: column[0], lame, depth: column[3].max(f64::MIN_POSITIVE) });
            for row in column.as_slice()[HEAD..].chunks_exact((variables - 1).max(1)) {
                // z_0 is the body at rest.
                gradients.push(0.0);
                gradients.extend_from_slice(row);
                gradients.extend(std::iter::repeat_n(0.0, width - variables));
            }
        }
        let size = if points.is_empty() { 0 } else { width };
        Some(Cubature {
            stresses: vec![Matrix3::zeros(); points.len()],
            points,
            gradients,
            width,
            z: vec![0.0; size],
            second: Second {
                sums: vec![0.0; size * size],
                z: vec![0.0; size],
                products: vec![0.0; ENTRIES * size],
                done: None,
            },
        })
    }

    /// V' with its slopes added to those against the first of z, as many as there are `slopes`; the others of z must be 0.
    pub fn add(&mut self, z: &[f64], size: f64, slopes: &mut [f64]) -> f64 {
        if self.points.is_empty() {
            return 0.0;
        }
        let active = slopes.len();
        copy(z, active, &mut self.z);
        let mut energy = 0.0;
        lanes::run(Sum { cubature: self, size, energy: &mut energy, slopes });
        energy
    }

    /// Adds the slopes against the z behind the first `active`. Where [`Cubature::add`] was asked last is near enough.
    pub fn add_beyond(&self, active: usize, slopes: &mut [f64]) {
        for (rows, stress) in self.gradients.chunks_exact(ENTRIES * self.width).zip(&self.stresses) {
            for (row, stress) in rows.chunks_exact(self.width).zip(stress.iter()) {
                slopes.iter_mut().zip(&row[active..]).for_each(|(slope, h)| *slope += stress * h);
            }
        }
    }

    /// Adds the second derivatives against the first `active` of z, row by row. What was prepared in part begins anew.
    pub fn add_second(&mut self, z: &[f64], active: usize, size: f64, second: &mut [f64]) {
        let was_prepared = self.is_prepared();
        self.forget();
        while !self.prepare_part(z, active, size, usize::MAX) {}
        self.add_prepared(active, second);
        if !was_prepared {
            self.forget();
        }
    }

    /// Does the next part of the second derivatives against all of z, where no warmth acts; true when all are made.
    pub fn prepare(&mut self, z: &[f64]) -> bool {
        self.prepare_part(z, z.len(), 1.0, self.points.len().div_ceil(PARTS))
    }

    /// Adds what was prepared.
    pub fn add_prepared(&self, active: usize, second: &mut [f64]) {
        let sums = &self.second.sums;
        for (i, row) in sums.chunks_exact(self.width).enumerate().take(active) {
            for (j, sum) in row.iter().enumerate().take(i + 1) {
                second[i * active + j] += sum;
                if j < i {
                    second[j * active + i] += sum;
                }
            }
        }
    }

    /// Whether the body is inside out at a point; those at which it is strained most are among them.
    pub fn is_inverted(&self, z: &[f64]) -> bool {
        self.gradients.chunks_exact(ENTRIES * self.width).any(|rows| {
            let entry = |row: &[f64]| row.iter().zip(z).map(|(h, z)| h * z).sum::<f64>();
            let h = Matrix3::from_iterator(rows.chunks_exact(self.width).map(entry));
            (h + Matrix3::identity()).determinant() <= 0.0
        })
    }

    pub fn is_prepared(&self) -> bool {
        self.points.is_empty() || self.second.done == Some(self.points.len())
    }

    /// Drops the second derivatives.
    pub fn forget(&mut self) {
        self.second.done = None;
    }

    fn prepare_part(&mut self, z: &[f64], active: usize, size: f64, count: usize) -> bool {
        if self.is_prepared() {
            return true;
        }
        if self.second.done.is_none() {
            copy(z, active, &mut self.second.z);
            self.second.sums.fill(0.0);
        }
        let first = self.second.done.unwrap_or(0);
        let last = first.saturating_add(count).min(self.points.len());
        lanes::run(SumSecond { cubature: self, active, size, points: first..last });
        self.second.done = Some(last);
        self.is_prepared()
    }
}

/// The first `active` of z, and nothing behind them.
fn copy(z: &[f64], active: usize, to: &mut [f64]) {
    to[..active].copy_from_slice(&z[..active]);
    to[active..].fill(0.0);
}

/// F/s - I of a point.
#[inline(always)]
fn gradient<const FUSED: bool>(rows: &[f64], z: &[f64], size: f64) -> Matrix3<f64> {
    let mut h = Matrix3::zeros();
    for (entry, row) in h.iter_mut().zip(rows.chunks_exact(z.len())) {
        let mut sums = [0.0; SIDE];
        for (row, z) in row.chunks_exact(SIDE).zip(z.chunks_exact(SIDE)) {
            for i in 0..SIDE {
                sums[i] = fused64::<FUSED>(row[i], z[i], sums[i]);
            }
        }
        *entry = sums.iter().sum();
    }
    if size == 1.0 { h } else { (h + Matrix3::identity()) / size - Matrix3::identity() }
}

/// row += by · other.
#[inline(always)]
fn add_row<const FUSED: bool>(by: f64, other: &[f64], row: &mut [f64]) {
    for (row, other) in row.iter_mut().zip(other) {
        *row = fused64::<FUSED>(by, *other, *row);
    }
}

struct Sum<'a> {
    cubature: &'a mut Cubature,
    size: f64,
    energy: &'a mut f64,
    slopes: &'a mut [f64],
}

impl Kernel for Sum<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Cubature { points, gradients, width, stresses, z, .. } = self.cubature;
        let all = points.iter().zip(gradients.chunks_exact(ENTRIES * *width)).zip(stresses);
        for ((point, rows), stress) in all {
            let h = gradient::<FUSED>(rows, z, self.size);
            let [energy, slope, _] = point.limited(energy_beyond_stvk(&h, point.lame));
            *self.energy += point.weight * self.size.powi(3) * energy;
            *stress = stress_beyond_stvk(&h, point.lame) * (slope * point.weight * self.size.powi(2));
            for (row, stress) in rows.chunks_exact(*width).zip(stress.iter()) {
                add_row::<FUSED>(*stress, row, self.slopes);
            }
        }
    }
}

struct SumSecond<'a> {
    cubature: &'a mut Cubature,
    active: usize,
    size: f64,
    points: std::ops::Range<usize>,
}

impl Kernel for SumSecond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Cubature { points, gradients, width, second, .. } = self.cubature;
        let Second { sums, z, products, .. } = second;
        for at in self.points {
            let (point, rows) = (points[at], &gradients[at * ENTRIES * *width..][..ENTRIES * *width]);
            let h = gradient::<FUSED>(rows, z, self.size);
            let tangent = point.tangent(&h) * (point.weight * self.size);
            products.fill(0.0);
            for (row, product) in products.chunks_exact_mut(*width).enumerate() {
                for (column, other) in rows.chunks_exact(*width).enumerate() {
                    add_row::<FUSED>(tangent[(row, column)], other, product);
                }
            }
            for (i, sum) in sums.chunks_exact_mut(*width).enumerate().take(self.active) {
                let until = (i + 1).next_multiple_of(SIDE);
                for (row, product) in rows.chunks_exact(*width).zip(products.chunks_exact(*width)) {
                    add_row::<FUSED>(row[i], &product[..until], &mut sum[..until]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(variables: usize, points: usize) -> DMatrix<f64> {
        DMatrix::from_fn(HEAD + ENTRIES * (variables - 1), points, |row, point| match row {
            0 => 0.5 + point as f64,
            1 => 2.0,
            2 => 1.0,
            // Every other one is met by φ.
            3 => [1e-3, 1e3][point % 2],
            _ => 0.3 * (1.7 * row as f64 + 0.9 * point as f64).sin(),
        })
    }

    /// Slopes and second derivatives against central differences, those of inactive z too, at rest size and in warmth.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_energy() {
        let n = 11;
        let mut cubature = Cubature::new(n, Some(&table(n, 7))).unwrap();
        for (active, size) in [(n, 1.0), (8, 1.0), (n, 1.03)] {
            let z: Vec<f64> =
                (0..n).map(|i| if i < active { 0.2 * (0.7 * i as f64).cos() } else { 0.0 }).collect();
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            let mut slopes = vec![0.0; n];
            cubature.add(&z, size, &mut slopes[..active]);
            cubature.add_beyond(active, &mut slopes[active..]);
            let mut second = vec![0.0; active * active];
            cubature.add_second(&z, active, size, &mut second);
            for i in 1..n {
                let (mut plus, mut minus) = (vec![0.0; n], vec![0.0; n]);
                let (above, below) = (
                    cubature.add(&moved(i, 1e-5), size, &mut plus),
                    cubature.add(&moved(i, -1e-5), size, &mut minus),
                );
                let slope = (above - below) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-8, "{active} {size} {i}: {} {slope}", slopes[i]);
                for j in (0..active).filter(|_| i < active) {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    let found = second[i * active + j];
                    assert!((found - expected).abs() < 1e-7, "{active} {size} {i} {j}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn a_point_that_is_pressed_flat_is_inside_out() {
        let flat = DMatrix::from_column_slice(
            13,
            1,
            &[1.0, 2.0, 1.0, 9.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        );
        let cubature = Cubature::new(2, Some(&flat)).unwrap();
        assert!(cubature.is_inverted(&[1.0, -1.01]) && !cubature.is_inverted(&[1.0, -0.99]));
    }

    /// The derivatives that are made in parts are those that are made at once.
    #[test]
    fn parts_make_the_whole() {
        let n = 5;
        let mut cubature = Cubature::new(n, Some(&table(n, 20))).unwrap();
        let z = [1.0, 0.1, -0.2, 0.3, 0.05];
        let (mut whole, mut parts) = (vec![0.0; n * n], vec![0.0; n * n]);
        cubature.add_second(&z, n, 1.0, &mut whole);
        cubature.forget();
        let calls = (1..).find(|_| cubature.prepare(&z)).unwrap();
        cubature.add_prepared(n, &mut parts);
        assert_eq!((calls, whole), (5, parts));
    }
}
