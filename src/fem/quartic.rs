//! The strain energy of a St. Venant–Kirchhoff body whose displacements are sums of a few fields: an exact quartic.
//!
//! In: a body's integration points and n fields h_a over all nodes. Out: the coefficients w of
//!
//! ```text
//! u = Σ z_a h_a    H = Σ z_a H_a    E = Σ_ab z_a z_b E_ab    E_a0 = ¼ (H_a + H_aᵀ)    E_ab = ¼ (H_aᵀH_b + H_bᵀH_a)
//! V(z) = Σ vol (λ/2 (tr E)² + μ E:E) = Σ w_abcd z_a z_b z_c z_d over a ≤ b ≤ c ≤ d      z_0 = 1
//! ```
//!
//! (Barbič and James, ACM Transactions on Graphics 24, 2005, 982-990.) Nothing is approximated.

use super::lame::Lame;
use super::rest_points::{RestPoint, RestPoints};
use super::stiffness::NodeFields;
use nalgebra::{DMatrix, DMatrixView};
use rayon::prelude::*;

/// A homogeneous quartic of `variables` numbers z: one coefficient for each a ≤ b ≤ c ≤ d, ordered by d, then c, b and a.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QuarticShape {
    /// Number of the z: one more than there are fields.
    pub variables: usize,
}

impl QuarticShape {
    /// Coefficients.
    pub fn len(self) -> usize {
        let n = self.variables;
        n * (n + 1) * (n + 2) * (n + 3) / 24
    }

    pub fn is_empty(self) -> bool {
        self.variables == 0
    }

    /// Pairs a ≤ b.
    pub fn pairs(self) -> usize {
        self.variables * (self.variables + 1) / 2
    }

    /// Index of the coefficient of z_a z_b z_c z_d; the indices may come in any order.
    pub fn at(self, mut indices: [usize; 4]) -> usize {
        indices.sort_unstable();
        let [a, b, c, d] = indices;
        a + b * (b + 1) / 2 + c * (c + 1) * (c + 2) / 6 + d * (d + 1) * (d + 2) * (d + 3) / 24
    }

    /// Index of the pair (a, b), in either order.
    pub fn pair(self, a: usize, b: usize) -> usize {
        let (low, high) = (a.min(b), a.max(b));
        low + high * (high + 1) / 2
    }
}

/// Points whose strains are multiplied at a time.
const BLOCK: usize = 64;
/// Panels of columns that are computed in parallel. Each sums over the points in their order, so that the bits do not
/// depend on the number of threads.
const PANELS: usize = 16;

/// Number of orders in which the sorted indices can be written.
fn orders(sorted: [usize; 4]) -> f64 {
    let (mut count, mut same) = (24.0, 1.0);
    for pair in sorted.windows(2) {
        same = if pair[0] == pair[1] { same + 1.0 } else { 1.0 };
        count /= same;
    }
    count
}

impl RestPoints {
    /// The coefficients w of the energy of Σ z_a h_a, J, as [`QuarticShape`] orders them, its first z being 1; `advance` is
    /// called for every point.
    pub fn quartic(&self, fields: &NodeFields, advance: &dyn Fn(u64)) -> Vec<f64> {
        let shape = QuarticShape { variables: fields.columns + 1 };
        let products = self.pair_products(fields, shape, advance);
        let mut out = vec![0.0; shape.len()];
        for d in 0..shape.variables {
            for c in 0..=d {
                for b in 0..=c {
                    for a in 0..=b {
                        let of = |a, b, c, d| products[(shape.pair(a, b), shape.pair(c, d))];
                        // Mean over the three ways to make two pairs of the four; ½ of the energy's quadratic form.
                        let mean = (of(a, b, c, d) + of(a, c, b, d) + of(a, d, b, c)) / 6.0;
                        out[shape.at([a, b, c, d])] = orders([a, b, c, d]) * mean;
                    }
                }
            }
        }
        out
    }

    /// Σ vol E_ab : C : E_cd over pairs.
    fn pair_products(&self, fields: &NodeFields, shape: QuarticShape, advance: &dyn Fn(u64)) -> DMatrix<f64> {
        let pairs = shape.pairs();
        let width = pairs.div_ceil(PANELS).max(1);
        let mut panels: Vec<DMatrix<f64>> = (0..pairs.div_ceil(width))
            .map(|panel| {
                let start = panel * width;
                DMatrix::zeros(pairs - start, width.min(pairs - start))
            })
            .collect();
        let mut rows = vec![0.0; 6 * BLOCK * pairs];
        for first in (0..self.count()).step_by(BLOCK) {
            let count = BLOCK.min(self.count() - first);
            rows[..6 * count * pairs]
                .par_chunks_mut(6 * pairs)
                .enumerate()
                .for_each(|(i, rows)| pair_strains(&self.at(first + i), fields, shape, rows));
            let strains = DMatrixView::from_slice(&rows[..6 * count * pairs], pairs, 6 * count);
            let turned = strains.transpose();
            panels.par_iter_mut().enumerate().for_each(|(panel, sum)| {
                let start = panel * width;
                let (low, columns) = (strains.rows(start, pairs - start), turned.columns(start, sum.ncols()));
                sum.gemm(1.0, &low, &columns, 1.0);
            });
            advance(count as u64);
        }
        let mut whole = DMatrix::zeros(pairs, pairs);
        for (panel, sum) in panels.iter().enumerate() {
            let start = panel * width;
            for column in 0..sum.ncols() {
                for row in column..sum.nrows() {
                    whole[(start + row, start + column)] = sum[(row, column)];
                    whole[(start + column, start + row)] = sum[(row, column)];
                }
            }
        }
        whole
    }
}

/// Six rows of the strains E_ab of all pairs, weighted so that the sum of the products of two pairs' numbers is vol E:C:E:
/// of C = 2μ I + λ 1⊗1 on the normal strains the root, √2μ I + β 1⊗1; on the shear strains √4μ.
fn pair_strains(point: &RestPoint<'_>, fields: &NodeFields, shape: QuarticShape, rows: &mut [f64]) {
    let mut h = Vec::new();
    point.gradients_of(fields, &mut h);
    let (Lame { lambda, mu }, volume) = (point.lame, point.volume);
    let root = (2.0 * mu * volume).sqrt();
    let beta = (((3.0 * lambda + 2.0 * mu) * volume).sqrt() - root) / 3.0;
    let shear = root * std::f64::consts::SQRT_2;
    let pairs = shape.pairs();
    let mut put = |pair: usize, strain: [f64; 6]| {
        let trace = beta * (strain[0] + strain[1] + strain[2]);
        for axis in 0..3 {
            rows[axis * pairs + pair] = root * strain[axis] + trace;
            rows[(3 + axis) * pairs + pair] = shear * strain[3 + axis];
        }
    };
    put(0, [0.0; 6]);
    for b in 1..shape.variables {
        let hb = &h[b - 1];
        let twice = |i: usize, j: usize| 0.25 * (hb[(i, j)] + hb[(j, i)]);
        put(shape.pair(0, b), [twice(0, 0), twice(1, 1), twice(2, 2), twice(1, 2), twice(0, 2), twice(0, 1)]);
        for a in 1..=b {
            let ha = &h[a - 1];
            let product = |i: usize, j: usize| -> f64 {
                0.25 * (0..3).map(|k| ha[(k, i)] * hb[(k, j)] + ha[(k, j)] * hb[(k, i)]).sum::<f64>()
            };
            put(
                shape.pair(a, b),
                [product(0, 0), product(1, 1), product(2, 2), product(1, 2), product(0, 2), product(0, 1)],
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fem::{STVK, TET4, TET4_ANP, TET10};
    use crate::mesh::{Block, block, quadratic};
    use nalgebra::{Matrix3, Vector3};

    /// The quartic is the sum of the law's energies over the points, for any fields and any z.
    #[test]
    fn the_quartic_is_the_energy_of_the_law() {
        let mesh = block(&Block { size: [1.0, 0.7, 1.3], cells: [2, 2, 2] }).unwrap();
        let lame: Vec<Lame> =
            (0..mesh.tets.len()).map(|i| Lame::from_young_poisson(1.0 + (i % 3) as f64, 0.3)).collect();
        let straight = quadratic::quadratic(mesh.clone(), &quadratic::straight);
        for (element, mesh) in [(&TET4, &mesh), (&TET10, &straight)] {
            let points = RestPoints::new(element, mesh, &lame).unwrap();
            let mut fields = NodeFields::zeros(mesh.nodes.len(), 4);
            fields.data.iter_mut().enumerate().for_each(|(i, u)| *u = (1.7 * i as f64).sin());
            let coefficients = points.quartic(&fields, &|_| ());
            let shape = QuarticShape { variables: 5 };
            assert_eq!(coefficients.len(), shape.len());
            for z in [[1.0, 0.3, -0.2, 0.5, 0.1], [1.0, -2.0, 0.4, 0.0, 1.5]] {
                let mut found = 0.0;
                for d in 0..5 {
                    for c in 0..=d {
                        for b in 0..=c {
                            for a in 0..=b {
                                found += coefficients[shape.at([a, b, c, d])] * z[a] * z[b] * z[c] * z[d];
                            }
                        }
                    }
                }
                let mut h = Vec::new();
                let mut energy = |point: RestPoint<'_>| {
                    point.gradients_of(&fields, &mut h);
                    let h: Matrix3<f64> = h.iter().zip(&z[1..]).map(|(h, z)| h * *z).sum();
                    point.volume * (STVK.energy)(&h, point.lame)
                };
                let expected: f64 = (0..points.count()).map(|q| energy(points.at(q))).sum();
                assert!((found - expected).abs() < 1e-12 * expected, "{}: {found} {expected}", element.name);
            }
        }
        let bulged = |a: &Vector3<f64>, b: &Vector3<f64>| (a + b) * 0.5 + (a - b).cross(&Vector3::x()) * 0.05;
        let curved = quadratic::quadratic(mesh.clone(), &bulged);
        assert!(RestPoints::new(&TET10, &curved, &lame).is_err());
        assert!(RestPoints::new(&TET4_ANP, &mesh, &lame).is_err());
    }
}
