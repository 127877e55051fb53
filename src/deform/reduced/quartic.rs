//! A quartic V(z) = Σ w_abcd z_a z_b z_c z_d over a ≤ b ≤ c ≤ d, evaluated with its slopes and second derivatives.
//!
//! In: w as [`QuarticShape`] orders it, and z. Out, from the triangle of the a ≤ b ≤ c for each c ≤ d,
//!
//! ```text
//! D_cd = Σ w_abcd z_a z_b      X_ab = Σ w_abcd z_c z_d      ∂V/∂z_d = Σ D_cd z_c + …      V = ¼ z·∂V/∂z
//! ```
//!
//! so that each coefficient is read once, in the order in which they stand.

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

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum::<f64>() + rest
}

fn add(sum: &mut [f64], factor: f64, values: &[f64]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += factor * value;
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
        for d in 0..active {
            for c in 0..=d {
                let start = self.shape.at([0, 0, c, d]);
                let own = &self.coefficients[start..start + triangle(c + 1)];
                let sum = dot(own, &self.products[..own.len()]);
                slopes[d] += sum * z[c];
                slopes[c] += sum * z[d];
                add(&mut self.sums[..own.len()], z[c] * z[d], own);
            }
        }
        let mut at = 0;
        for b in 0..active {
            for a in 0..=b {
                slopes[a] += self.sums[at] * z[b];
                slopes[b] += self.sums[at] * z[a];
                at += 1;
            }
        }
        0.25 * dot(&z[..active], slopes)
    }

    /// The slopes against the z behind the first `active`, which are 0. Where [`Quartic::slopes`] was asked last is near enough.
    pub fn slopes_beyond(&self, z: &[f64], active: usize, slopes: &mut [f64]) {
        for (d, slope) in (active..).zip(slopes) {
            let of = |c: usize| {
                let own = self.of(c, d);
                dot(own, &self.products[..own.len()]) * z[c]
            };
            *slope = (0..active).map(of).sum();
        }
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
                add(&mut self.sums[..own.len()], z[c] * z[d], own);
                // r_i = ∂/∂z_i of Σ w_abcd z_a z_b.
                let row = &mut row[..=c];
                row.fill(0.0);
                let mut at = 0;
                for b in 0..=c {
                    let run = &own[at..=at + b];
                    row[b] += dot(run, &z[..=b]);
                    add(&mut row[..=b], z[b], run);
                    at += b + 1;
                }
                second[d * n + c] += 0.5 * dot(row, &z[..=c]);
                add(&mut second[d * n..=d * n + c], z[c], row);
                add(&mut second[c * n..=c * n + c], z[d], row);
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
