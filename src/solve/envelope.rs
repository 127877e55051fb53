//! A small symmetric matrix whose rows begin late, and its Cholesky factor, made in place without allocating.
//!
//! In: the lower triangle, each row from its first entry that may differ from zero. Out: L with L Lᵀ = A in the same places, and
//! solutions of A x = b (George and Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981, chapter 4; Golub and
//! Van Loan, Matrix Computations, section 4.3.5).

use crate::base::lanes::{self, Kernel, fused64};

/// A pivot that is smaller than this part of its diagonal entry is rounding error.
const ROUNDING: f64 = 1e-13;

/// The lower triangle of a symmetric matrix within its envelope.
#[derive(Clone, Debug)]
pub struct Envelope {
    /// The first column of each row, and the place among the entries at which its column 0 would stand, which may be below 0.
    start: Vec<usize>,
    zero: Vec<usize>,
    entries: Vec<f64>,
    /// 1 / L_ii of the factor.
    inverse: Vec<f64>,
}

impl Envelope {
    /// Zeros, in rows that begin at these columns.
    pub fn new(start: Vec<usize>) -> Envelope {
        let mut stored = 0;
        let place = |(i, &start): (usize, &usize)| {
            let zero = usize::wrapping_sub(stored, start);
            stored += i + 1 - start;
            zero
        };
        let zero = start.iter().enumerate().map(place).collect();
        Envelope { zero, entries: vec![0.0; stored], inverse: vec![0.0; start.len()], start }
    }

    /// Zeros within `width` entries before the diagonal.
    pub fn band(rows: usize, width: usize) -> Envelope {
        Envelope::new((0..rows).map(|i| i.saturating_sub(width)).collect())
    }

    /// Zeros in whole rows of a square, of which the part above the diagonal is not used.
    pub fn square(rows: usize) -> Envelope {
        let zero = (0..rows).map(|i| i * rows).collect();
        Envelope { start: vec![0; rows], zero, entries: vec![0.0; rows * rows], inverse: vec![0.0; rows] }
    }

    pub fn clear(&mut self) {
        self.entries.fill(0.0);
    }

    pub fn copy_from(&mut self, other: &Envelope) {
        self.entries.copy_from_slice(&other.entries);
        self.inverse.copy_from_slice(&other.inverse);
    }

    /// Adds to the entry of row i and column j ≤ i.
    #[inline]
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        self.entries[self.zero[i].wrapping_add(j)] += value;
    }

    fn row(&self, i: usize) -> &[f64] {
        &self.entries[self.zero[i].wrapping_add(self.start[i])..=self.zero[i].wrapping_add(i)]
    }

    /// The columns `from..` of row i, up to the diagonal or as many as `values`, set to these.
    pub fn set(&mut self, i: usize, from: usize, values: &[f64]) {
        let at = self.zero[i].wrapping_add(from);
        self.entries[at..at + values.len()].copy_from_slice(values);
    }

    /// The sum of the diagonal.
    pub fn trace(&self) -> f64 {
        self.zero.iter().enumerate().map(|(i, zero)| self.entries[zero.wrapping_add(i)]).sum()
    }

    /// Replaces each entry d of the diagonal by f(d).
    pub fn change_diagonal(&mut self, f: impl Fn(f64) -> f64) {
        for (i, zero) in self.zero.iter().enumerate() {
            let entry = &mut self.entries[zero.wrapping_add(i)];
            *entry = f(*entry);
        }
    }

    /// The numbers of a factor, by which it can be kept.
    pub fn entries(&self) -> &[f64] {
        &self.entries
    }

    /// Takes back a factor of which `read` writes the numbers that [`Envelope::entries`] had.
    pub fn take_back(&mut self, read: impl FnOnce(&mut [f64])) {
        read(&mut self.entries);
        for (i, (inverse, zero)) in self.inverse.iter_mut().zip(&self.zero).enumerate() {
            *inverse = 1.0 / self.entries[zero.wrapping_add(i)];
        }
    }

    /// A x, of the matrix itself.
    #[cfg(test)]
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for i in 0..x.len() {
            for (j, entry) in (self.start[i]..).zip(self.row(i)) {
                product[i] += entry * x[j];
                product[j] += if i == j { 0.0 } else { entry * x[i] };
            }
        }
        product
    }

    /// Replaces the matrix by its factor; false where it is not positive definite.
    pub fn factor(&mut self) -> bool {
        let mut is_definite = false;
        lanes::run(Factor { matrix: self, is_definite: &mut is_definite });
        is_definite
    }

    /// Solves with the factor, in place.
    pub fn solve(&self, x: &mut [f64]) {
        lanes::run(Solve { factor: self, x });
    }
}

struct Factor<'a> {
    matrix: &'a mut Envelope,
    is_definite: &'a mut bool,
}

impl Kernel for Factor<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Envelope { start, zero, entries, inverse } = self.matrix;
        for (i, (&from, zero_of_row)) in start.iter().zip(&*zero).enumerate() {
            let (above, rest) = entries.split_at_mut(zero_of_row.wrapping_add(from));
            let row = &mut rest[..=i - from];
            for j in from..i {
                // From the first column that both rows have.
                let first = from.max(start[j]);
                let other = &above[zero[j].wrapping_add(first)..zero[j].wrapping_add(j)];
                let sum = fused_dot::<FUSED>(&row[first - from..j - from], other);
                row[j - from] = (row[j - from] - sum) * inverse[j];
            }
            let (row, diagonal) = row.split_at_mut(i - from);
            let pivot = diagonal[0] - fused_dot::<FUSED>(row, row);
            if pivot.is_nan() || pivot <= ROUNDING * diagonal[0].abs() {
                return;
            }
            diagonal[0] = pivot.sqrt();
            inverse[i] = 1.0 / diagonal[0];
        }
        *self.is_definite = true;
    }
}

struct Solve<'a> {
    factor: &'a Envelope,
    x: &'a mut [f64],
}

impl Kernel for Solve<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Solve { factor, x } = self;
        let row = |i: usize| &factor.row(i)[..i - factor.start[i]];
        for i in 0..factor.start.len() {
            let sum = fused_dot::<FUSED>(row(i), &x[factor.start[i]..i]);
            x[i] = (x[i] - sum) * factor.inverse[i];
        }
        for i in (0..factor.start.len()).rev() {
            x[i] *= factor.inverse[i];
            let value = x[i];
            for (x, l) in x[factor.start[i]..i].iter_mut().zip(row(i)) {
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
        let (mut band, mut dense) = (Envelope::band(rows, width), DMatrix::zeros(rows, rows));
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
        turned.change_diagonal(|entry| entry - 20.0);
        assert!(!turned.factor());
    }
}
