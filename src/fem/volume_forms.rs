//! The neo-Hookean energy of a body whose displacements are sums of a few fields, as exact cubics.
//!
//! In: a body's integration points, n fields h_k over all nodes, and M weights ψ_m at each point. Out: the coefficients of
//!
//! ```text
//! F = Σ z_a F_a     F_0 = I     F_k = ∇h_k     z_0 = 1     J = det F = ⅓ Σ_abc z_a z_b z_c cof(F_a, F_b) : F_c
//! g_0(z) = Σ vol μ (½ (|F|² - 3) - (J - 1))        g_m(z) = Σ vol ψ_m (J - 1)
//! ```
//!
//! with cof(A, B) = ½ (cof(A + B) - cof A - cof B). Nothing is approximated. With ψ that are orthonormal, Σ vol ψ_m ψ_n/κ = δ_mn,
//! κ = λ + μ, the pressures κ (J - 1) have the energy ½ Σ g_m² as far as the ψ span them.

use super::rest_points::RestPoints;
use super::stiffness::NodeFields;
use crate::base::lanes::{self, Kernel, fused64};
use nalgebra::{DMatrix, Matrix3};
use rayon::prelude::*;

/// Points whose determinants are multiplied by the weights at a time.
const BLOCK: usize = 32;
/// Panels of coefficients that are computed in parallel. Each sums over the points in their order, so that the bits do not
/// depend on the number of threads.
const PANELS: usize = 16;

/// A homogeneous cubic of `variables` numbers z: one coefficient for each a ≤ b ≤ c, ordered by c, then b and a.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CubicShape {
    /// Number of the z: one more than there are fields.
    pub variables: usize,
}

impl CubicShape {
    /// Coefficients.
    pub fn len(self) -> usize {
        let n = self.variables;
        n * (n + 1) * (n + 2) / 6
    }

    pub fn is_empty(self) -> bool {
        self.variables == 0
    }

    /// Index of the coefficient of z_a z_b z_c, a ≤ b ≤ c.
    pub fn at(self, [a, b, c]: [usize; 3]) -> usize {
        a + b * (b + 1) / 2 + c * (c + 1) * (c + 2) / 6
    }
}

/// Number of orders in which a ≤ b ≤ c can be written.
fn orders([a, b, c]: [usize; 3]) -> f64 {
    match (a == b, b == c) {
        (true, true) => 1.0,
        (false, false) => 6.0,
        _ => 3.0,
    }
}

/// cof(A, B).
fn cofactors(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |i: usize| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        (a.column(j).cross(&b.column(k)) + b.column(j).cross(&a.column(k))) * 0.5
    };
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

impl RestPoints {
    /// The coefficients of g_0, g_1, … g_M of Σ z_k h_k, a row for each, in the order of [`CubicShape`]. `weights` has a row for each point
    /// and a column for each ψ; `advance` is called for every point.
    pub fn volume_forms(
        &self,
        fields: &NodeFields,
        weights: &DMatrix<f64>,
        advance: &(dyn Fn(u64) + Sync),
    ) -> DMatrix<f64> {
        let shape = CubicShape { variables: fields.columns + 1 };
        let panels = panels(shape);
        let share = self.count() as f64 / panels.len().max(1) as f64;
        let sums: Vec<DMatrix<f64>> = panels
            .par_iter()
            .map(|panel| {
                let sum = self.determinants(fields, weights, panel);
                advance(share.round() as u64);
                sum
            })
            .collect();
        let mut forms = DMatrix::zeros(1 + weights.ncols(), shape.len());
        let mut next = 0;
        for (sum, panel) in sums.iter().zip(&panels) {
            for (row, monomial) in monomials(panel).enumerate() {
                forms.set_column(next, &(sum.row(row).transpose() * (orders(monomial) / 3.0)));
                next += 1;
            }
        }
        let products = self.products(fields);
        for b in 0..shape.variables {
            for a in 0..=b {
                let both = if a == b { 0.5 } else { 1.0 };
                forms[(0, shape.at([0, a, b]))] += both * products[(a, b)];
            }
            // A body at rest has neither energy nor stress.
            forms[(0, shape.at([0, 0, b]))] = 0.0;
        }
        if !shape.is_empty() {
            forms.column_mut(0).fill(0.0);
        }
        forms
    }

    /// Σ vol ψ cof(F_a, F_b) : F_c for the monomials of a panel, a column for each form, with ψ_0 = -μ.
    fn determinants(
        &self,
        fields: &NodeFields,
        weights: &DMatrix<f64>,
        panel: &std::ops::Range<usize>,
    ) -> DMatrix<f64> {
        let n = fields.columns + 1;
        let rows: usize = panel.clone().map(|c| (c + 1) * (c + 2) / 2).sum();
        let (mut sum, mut own) = (DMatrix::zeros(rows, 1 + weights.ncols()), DMatrix::zeros(rows, BLOCK));
        let (mut h, mut entries) = (Vec::new(), vec![0.0; 9 * n]);
        for first in (0..self.count()).step_by(BLOCK) {
            let count = BLOCK.min(self.count() - first);
            for (i, mut column) in own.column_iter_mut().enumerate().take(count) {
                let point = self.at(first + i);
                point.gradients_of(fields, &mut h);
                h.insert(0, Matrix3::identity());
                h.iter().enumerate().for_each(|(a, h)| (0..9).for_each(|e| entries[e * n + a] = h[e]));
                column.fill(0.0);
                let panel = panel.clone();
                lanes::run(Determinants { h: &h, entries: &entries, panel, out: column.as_mut_slice() });
            }
            let of_block = DMatrix::from_fn(count, 1 + weights.ncols(), |i, form| {
                let point = self.at(first + i);
                point.volume * if form == 0 { -point.lame.mu } else { weights[(first + i, form - 1)] }
            });
            sum.gemm(1.0, &own.columns(0, count), &of_block, 1.0);
        }
        sum
    }

    /// Σ vol μ F_a : F_b.
    fn products(&self, fields: &NodeFields) -> DMatrix<f64> {
        let n = fields.columns + 1;
        let (mut sum, mut h) = (DMatrix::zeros(n, n), Vec::new());
        for first in (0..self.count()).step_by(BLOCK) {
            let count = BLOCK.min(self.count() - first);
            let mut rows = DMatrix::zeros(9 * count, n);
            for i in 0..count {
                let point = self.at(first + i);
                point.gradients_of(fields, &mut h);
                h.insert(0, Matrix3::identity());
                let root = (point.volume * point.lame.mu).sqrt();
                for (a, h) in h.iter().enumerate() {
                    (0..9).for_each(|e| rows[(9 * i + e, a)] = root * h[e]);
                }
            }
            sum.gemm_tr(1.0, &rows, &rows, 1.0);
        }
        sum
    }
}

/// Ranges of c that have about as many monomials.
fn panels(shape: CubicShape) -> Vec<std::ops::Range<usize>> {
    let mut panels: Vec<std::ops::Range<usize>> = Vec::new();
    let before = |c: usize| CubicShape { variables: c }.len();
    for c in 0..shape.variables {
        let panel = before(c) * PANELS / shape.len();
        match panels.last_mut() {
            Some(last) if before(last.start) * PANELS / shape.len() == panel => last.end = c + 1,
            _ => panels.push(c..c + 1),
        }
    }
    panels
}

/// The monomials of a panel in their order.
fn monomials(panel: &std::ops::Range<usize>) -> impl Iterator<Item = [usize; 3]> {
    panel.clone().flat_map(|c| (0..=c).flat_map(move |b| (0..=b).map(move |a| [a, b, c])))
}

/// cof(F_b, F_c) : F_a of all monomials at one point.
struct Determinants<'a> {
    h: &'a [Matrix3<f64>],
    /// F_a of all a, entry by entry.
    entries: &'a [f64],
    panel: std::ops::Range<usize>,
    out: &'a mut [f64],
}

impl Kernel for Determinants<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let mut rest = self.out;
        for c in self.panel {
            for b in 0..=c {
                let (row, after) = rest.split_at_mut(b + 1);
                rest = after;
                let cofactors = cofactors(&self.h[b], &self.h[c]);
                for (own, cofactor) in self.entries.chunks_exact(self.h.len()).zip(cofactors.iter()) {
                    for (row, own) in row.iter_mut().zip(own) {
                        *row = fused64::<FUSED>(*cofactor, *own, *row);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{Lame, NEO_HOOKEAN, TET10};
    use crate::mesh::{Block, block, quadratic};

    /// The forms are the energy of the law where every point has a weight of its own, for any fields and any z.
    #[test]
    fn the_forms_are_the_energy_of_the_law() {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [1, 1, 2] }).unwrap();
        let lame: Vec<Lame> =
            (0..mesh.tets.len()).map(|i| Lame::from_young_poisson(1.0 + (i % 3) as f64, 0.4)).collect();
        let mesh = quadratic::quadratic(mesh, &quadratic::straight);
        let points = RestPoints::new(&TET10, &mesh, &lame).unwrap();
        let mut fields = NodeFields::zeros(mesh.nodes.len(), 4);
        fields.data.iter_mut().enumerate().for_each(|(i, u)| *u = 0.3 * (1.7 * i as f64).sin());
        let weights = DMatrix::from_fn(points.count(), points.count(), |point, form| {
            let own = points.at(point);
            let bulk = own.lame.lambda + own.lame.mu;
            if point == form { (bulk / own.volume).sqrt() } else { 0.0 }
        });
        let forms = points.volume_forms(&fields, &weights, &|_| ());
        let shape = CubicShape { variables: 5 };
        assert_eq!(forms.shape(), (1 + points.count(), shape.len()));
        for z in [[1.0, 0.3, -0.2, 0.5, 0.1], [1.0, -2.0, 0.4, 0.0, 1.5]] {
            let of_z = nalgebra::DVector::from_iterator(
                shape.len(),
                monomials(&(0..5)).map(|[a, b, c]| z[a] * z[b] * z[c]),
            );
            let values = &forms * of_z;
            let found = values[0] + 0.5 * values.rows(1, points.count()).norm_squared();
            let mut h = Vec::new();
            let expected: f64 = (0..points.count())
                .map(|point| {
                    let point = points.at(point);
                    point.gradients_of(&fields, &mut h);
                    let h: Matrix3<f64> = h.iter().zip(&z[1..]).map(|(h, z)| h * *z).sum();
                    point.volume * (NEO_HOOKEAN.energy)(&h, point.lame)
                })
                .sum();
            assert!((found - expected).abs() < 1e-12 * expected, "{found} {expected}");
        }
    }
}
