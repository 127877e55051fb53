//! A symmetric matrix whose entries stand near its diagonal, and its Cholesky factor.
//!
//! In: the lower triangle, row after row, `width` entries before the diagonal. Out: L with L Lᵀ = A in the same places, and
//! solutions of A x = b (Golub and Van Loan, Matrix Computations, section 4.3.5).

use crate::base::lanes::{self, Kernel, fused64};

/// The lower triangle of a symmetric matrix within a band.
#[derive(Clone, Debug)]
pub struct Band {
    width: usize,
    rows: usize,
    entries: Vec<f64>,
}

impl Band {
    pub fn new(rows: usize, width: usize) -> Band {
        Band { width, rows, entries: vec![0.0; rows * (width + 1)] }
    }

    pub fn clear(&mut self) {
        self.entries.fill(0.0);
    }

    pub fn copy_from(&mut self, other: &Band) {
        self.entries.copy_from_slice(&other.entries);
    }

    /// Adds to the entry of row i and column j ≤ i.
    #[inline]
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        self.entries[i * (self.width + 1) + j + self.width - i] += value;
    }

    /// The sum of the diagonal.
    pub fn trace(&self) -> f64 {
        self.entries.iter().skip(self.width).step_by(self.width + 1).sum()
    }

    pub fn add_to_diagonal(&mut self, value: f64) {
        self.entries.iter_mut().skip(self.width).step_by(self.width + 1).for_each(|entry| *entry += value);
    }

    /// A x, of the matrix itself.
    #[cfg(test)]
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; self.rows];
        for i in 0..self.rows {
            for j in i.saturating_sub(self.width)..=i {
                let entry = self.entries[i * (self.width + 1) + j + self.width - i];
                product[i] += entry * x[j];
                product[j] += if i == j { 0.0 } else { entry * x[i] };
            }
        }
        product
    }

    /// Replaces the matrix by its factor; false where it is not positive definite.
    pub fn factor(&mut self) -> bool {
        let mut is_definite = false;
        lanes::run(Factor { band: self, is_definite: &mut is_definite });
        is_definite
    }

    /// Solves with the factor, in place.
    pub fn solve(&self, x: &mut [f64]) {
        lanes::run(Solve { band: self, x });
    }
}

struct Factor<'a> {
    band: &'a mut Band,
    is_definite: &'a mut bool,
}

impl Kernel for Factor<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Band { width, rows, entries } = self.band;
        let (width, stride) = (*width, *width + 1);
        for i in 0..*rows {
            let (above, rest) = entries.split_at_mut(i * stride);
            let row = &mut rest[..stride];
            for j in i.saturating_sub(width)..i {
                // From the first column that both rows have.
                let at = j + width - i;
                let first = i.saturating_sub(width).max(j.saturating_sub(width));
                let own = &row[first + width - i..at];
                let other = &above[j * stride..][..stride];
                let sum = fused_dot::<FUSED>(own, &other[first + width - j..width]);
                row[at] = (row[at] - sum) * other[width];
            }
            let pivot = row[width] - fused_dot::<FUSED>(&row[..width], &row[..width]);
            if pivot.is_nan() || pivot <= 0.0 {
                return;
            }
            // The diagonal is kept as its inverse.
            row[width] = 1.0 / pivot.sqrt();
        }
        *self.is_definite = true;
    }
}

struct Solve<'a> {
    band: &'a Band,
    x: &'a mut [f64],
}

impl Kernel for Solve<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (Band { width, rows, entries }, x) = (self.band, self.x);
        let (width, stride) = (*width, *width + 1);
        for i in 0..*rows {
            let row = &entries[i * stride..][..stride];
            let first = i.saturating_sub(width);
            x[i] = (x[i] - fused_dot::<FUSED>(&row[first + width - i..width], &x[first..i])) * row[width];
        }
        for i in (0..*rows).rev() {
            let row = &entries[i * stride..][..stride];
            let first = i.saturating_sub(width);
            x[i] *= row[width];
            let value = x[i];
            for (x, l) in x[first..i].iter_mut().zip(&row[first + width - i..width]) {
                *x = fused64::<FUSED>(-l, value, *x);
            }
        }
    }
}

/// Eight sums at once, which a compiler turns into wide additions.
#[inline]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    fused_dot::<false>(a, b)
}

#[inline(always)]
fn fused_dot<const FUSED: bool>(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (wide_a, wide_b) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = wide_a.remainder().iter().zip(wide_b.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in wide_a.zip(wide_b) {
        for k in 0..8 {
            sums[k] = fused64::<FUSED>(a[k], b[k], sums[k]);
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn solutions_are_those_of_the_dense_matrix() {
        let (rows, width) = (40, 11);
        let entry =
            |i: usize, j: usize| (1.3 * i as f64 + 0.7 * j as f64).sin() + if i == j { 12.0 } else { 0.0 };
        let (mut band, mut dense) = (Band::new(rows, width), DMatrix::zeros(rows, rows));
        for i in 0..rows {
            for j in i.saturating_sub(width)..=i {
                band.add(i, j, entry(i, j));
                dense[(i, j)] = entry(i, j);
                dense[(j, i)] = entry(i, j);
            }
        }
        assert!((band.trace() - dense.trace()).abs() < 1e-12);
        let b = DVector::from_fn(rows, |i, _| (0.3 * i as f64).cos());
        let product = DVector::from_vec(band.times(b.as_slice()));
        assert!((product - &dense * &b).amax() < 1e-12);
        let mut x = b.as_slice().to_vec();
        let mut turned = band.clone();
        assert!(band.factor());
        band.solve(&mut x);
        assert!((dense * DVector::from_vec(x) - b).amax() < 1e-12);
        turned.add_to_diagonal(-20.0);
        assert!(!turned.factor());
    }
}
