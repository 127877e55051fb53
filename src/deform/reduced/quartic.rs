//! A quartic V(z) = Σ w_abcd z_a z_b z_c z_d over a ≤ b ≤ c ≤ d, evaluated with its slopes and second derivatives.
//!
//! In: w as [`QuarticShape`] orders it, and z. Out, from the triangle of the a ≤ b ≤ c for each c ≤ d,
//!
//! ```text
//! D_cd = Σ w_abcd z_a z_b      X_ab = Σ w_abcd z_c z_d      ∂V/∂z_d = Σ D_cd z_c + …      V = ¼ z·∂V/∂z
//! ```
//!
//! so that each coefficient is read once, in the order in which they stand.

use crate::base::lanes::{self, Kernel, fused64};
use crate::fem::QuarticShape;

/// The coefficients, and the memory for an evaluation.
pub struct Quartic {
    shape: QuarticShape,
    coefficients: Vec<f64>,
    /// z_a z_b of all pairs.
    products: Vec<f64>,
    /// X.
    sums: Vec<f64>,
}

/// Numbers that are summed side by side.
const SIDE: usize = 16;

#[inline(always)]
fn dot<const FUSED: bool>(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; SIDE];
    let (wide_a, wide_b) = (a.chunks_exact(SIDE), b.chunks_exact(SIDE));
    let rest: f64 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in wide_a.zip(wide_b) {
        for i in 0..SIDE {
            sums[i] = fused64::<FUSED>(a[i], b[i], sums[i]);
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[inline(always)]
fn add<const FUSED: bool>(sum: &mut [f64], factor: f64, values: &[f64]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum = fused64::<FUSED>(factor, *value, *sum);
    }
}

fn triangle(n: usize) -> usize {
    n * (n + 1) / 2
}

impl Quartic {
    /// `None` where `coefficients` are not as many as a quartic of `variables` has.
    pub fn new(variables: usize, coefficients: Vec<f64>) -> Option<Quartic> {
        let shape = QuarticShape { variables };
        let pairs = shape.pairs();
        (coefficients.len() == shape.len()).then(|| Quartic {
            shape,
            coefficients,
            products: vec![0.0; pairs],
            sums: vec![0.0; pairs],
        })
    }

    /// The triangle of (c, d): the coefficients of all a ≤ b ≤ c.
    fn of(&self, c: usize, d: usize) -> &[f64] {
        let start = self.shape.at([0, 0, c, d]);
        &self.coefficients[start..start + triangle(c + 1)]
    }

    /// V, and its slopes against the first `active` of z; the others of z must be 0.
    pub fn slopes(&mut self, z: &[f64], active: usize, slopes: &mut [f64]) -> f64 {
        let mut at = 0;
        for (b, zb) in z[..active].iter().enumerate() {
            for za in &z[..=b] {
                self.products[at] = za * zb;
                at += 1;
            }
        }
        self.sums[..triangle(active)].fill(0.0);
        slopes.fill(0.0);
        lanes::run(Triangles { quartic: self, z: &z[..active], slopes });
        let mut at = 0;
        for b in 0..active {
            for a in 0..=b {
                slopes[a] += self.sums[at] * z[b];
                slopes[b] += self.sums[at] * z[a];
                at += 1;
            }
        }
        0.25 * dot::<false>(&z[..active], slopes)
    }

    /// The slopes against the z behind the first `active`, which are 0. Where [`Quartic::slopes`] was asked last is near enough.
    pub fn slopes_beyond(&self, z: &[f64], active: usize, slopes: &mut [f64]) {
        lanes::run(Beyond { quartic: self, z: &z[..active], slopes });
    }

    /// Second derivatives against the first `active` of z, row by row into `second`; the others of z must be 0.
    pub fn second(&mut self, z: &[f64], active: usize, row: &mut [f64], second: &mut [f64]) {
        let n = active;
        self.sums[..triangle(n)].fill(0.0);
        second[..n * n].fill(0.0);
        for d in 0..n {
            for c in 0..=d {
                let start = self.shape.at([0, 0, c, d]);
                let own = &self.coefficients[start..start + triangle(c + 1)];
                add::<false>(&mut self.sums[..own.len()], z[c] * z[d], own);
                // r_i = ∂/∂z_i of Σ w_abcd z_a z_b.
                let row = &mut row[..=c];
                row.fill(0.0);
                let mut at = 0;
                for b in 0..=c {
                    let run = &own[at..=at + b];
                    row[b] += dot::<false>(run, &z[..=b]);
                    add::<false>(&mut row[..=b], z[b], run);
                    at += b + 1;
                }
                second[d * n + c] += 0.5 * dot::<false>(row, &z[..=c]);
                add::<false>(&mut second[d * n..=d * n + c], z[c], row);
                add::<false>(&mut second[c * n..=c * n + c], z[d], row);
            }
        }
        let mut at = 0;
        for b in 0..n {
            for a in 0..=b {
                second[b * n + a] += self.sums[at];
                at += 1;
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let both = second[i * n + j] + second[j * n + i];
                (second[i * n + j], second[j * n + i]) = (both, both);
            }
        }
    }
}

/// X, and the part of the slopes that D gives.
struct Triangles<'a> {
    quartic: &'a mut Quartic,
    z: &'a [f64],
    slopes: &'a mut [f64],
}

impl Kernel for Triangles<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Quartic { shape, coefficients, products, sums } = self.quartic;
        for d in 0..self.z.len() {
            for c in 0..=d {
                let start = shape.at([0, 0, c, d]);
                let own = &coefficients[start..start + triangle(c + 1)];
                let sum = dot::<FUSED>(own, &products[..own.len()]);
                self.slopes[d] += sum * self.z[c];
                self.slopes[c] += sum * self.z[d];
                add::<FUSED>(&mut sums[..own.len()], self.z[c] * self.z[d], own);
            }
        }
    }
}

/// The slopes against what stands behind `z`.
struct Beyond<'a> {
    quartic: &'a Quartic,
    z: &'a [f64],
    slopes: &'a mut [f64],
}

impl Kernel for Beyond<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (d, slope) in (self.z.len()..).zip(self.slopes) {
            *slope = 0.0;
            for (c, z) in self.z.iter().enumerate() {
                let own = self.quartic.of(c, d);
                *slope += dot::<FUSED>(own, &self.quartic.products[..own.len()]) * z;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums over all coefficients, and central differences.
    #[test]
    fn slopes_and_second_derivatives_are_those_of_the_sum() {
        let n = 6;
        let shape = QuarticShape { variables: n };
        let coefficients: Vec<f64> = (0..shape.len()).map(|i| (1.3 * i as f64).sin()).collect();
        let value = |z: &[f64]| -> f64 {
            let mut sum = 0.0;
            for d in 0..n {
                for c in 0..=d {
                    for b in 0..=c {
                        for a in 0..=b {
                            sum += coefficients[shape.at([a, b, c, d])] * z[a] * z[b] * z[c] * z[d];
                        }
                    }
                }
            }
            sum
        };
        let mut quartic = Quartic::new(n, coefficients.clone()).unwrap();
        for active in [6, 4] {
            let z: Vec<f64> = (0..n).map(|i| if i < active { (0.7 * i as f64).cos() } else { 0.0 }).collect();
            let (mut slopes, mut row, mut second) = (vec![0.0; n], vec![0.0; n], vec![0.0; active * active]);
            let found = quartic.slopes(&z, active, &mut slopes[..active]);
            quartic.slopes_beyond(&z, active, &mut slopes[active..]);
            assert!((found - value(&z)).abs() < 1e-13, "{found} {}", value(&z));
            let moved = |i: usize, by: f64| {
                let mut z = z.clone();
                z[i] += by;
                z
            };
            for i in 0..n {
                let slope = (value(&moved(i, 1e-5)) - value(&moved(i, -1e-5))) / 2e-5;
                assert!((slopes[i] - slope).abs() < 1e-8, "{i}: {} {slope}", slopes[i]);
            }
            quartic.second(&z, active, &mut row, &mut second);
            for i in 0..active {
                let (mut plus, mut minus) = (vec![0.0; active], vec![0.0; active]);
                quartic.slopes(&moved(i, 1e-5), active, &mut plus);
                quartic.slopes(&moved(i, -1e-5), active, &mut minus);
                for j in 0..active {
                    let expected = (plus[j] - minus[j]) / 2e-5;
                    assert!((second[i * active + j] - expected).abs() < 1e-8, "{i} {j}: {expected}");
                }
            }
        }
    }
}
